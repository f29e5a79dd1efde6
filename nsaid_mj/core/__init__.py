"""The paper: one robot as data, its persistent nullspace, and the laws that identify it.

No MuJoCo, no files.
"""
