"""Recordings of runs: finished or still going on, and the viewer that shows them.

`forces`, `inertia` and `torques` draw what a robot's parameters do; the panels of a result are
drawn by `report.recording`.
"""
