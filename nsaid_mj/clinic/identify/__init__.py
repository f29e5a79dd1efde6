"""A user's robot: its model file, its logs, and what they reveal about its parameters.

`identify` fits plant and actuators to logs of any number of files, `live` while the robot moves.
"""
