"""Small compiled mathematics: linear algebra, rotations and poses. No robotics.

Whoever defines a kernel imports `kernels`, or `cache`, which set the folder of compiled kernels.
"""
