"""Converts runs of our own arms with continuous joints from cosine and sine to angles."""

from __future__ import annotations

import numpy as np

from ..data import RobotModel
from .tables import Channel, Table


def with_angles(table: Table, robot: RobotModel) -> Table:
    """A table whose `q_0` … are one angle for each joint, if they were Pinocchio's coordinates.

    Other tables are returned as they are. Angles are continued across whole turns.
    """
    if robot.system is not None:
        return table
    joints = [robot.model.joints[robot.model.getJointId(name)] for name in robot.joints]
    count = sum(joint.nq for joint in joints)
    names = [f"q_{k}" for k in range(count)]
    if count == len(joints) or not {*names} <= {*table.channels} or f"q_{count}" in table.channels:
        return table
    channels = {name: channel for name, channel in table.channels.items() if name not in names}
    angles, first = {}, 0
    for k, joint in enumerate(joints):
        t, values = table.channels[names[first]]
        if joint.nq == 2:
            values = np.unwrap(np.arctan2(table.channels[names[first + 1]].values, values))
        angles[f"q_{k}"] = Channel(t, values)
        first += joint.nq
    return Table(table.source, angles | channels, table.origin, table.findings)
