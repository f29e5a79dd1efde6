"""Recordings for the Rerun viewer: what draws a result's panels and a robot, and the viewer.

Only recordings import rerun, which the extra `view` installs. `scene` draws the robot, `forces` the
actuator forces, `lines` the panels; `layout` arranges them in the viewer, and `viewer` finds and
starts it. What a house records of its own results is in that house.
"""
