"""Poses of a walking robot for drawings: its lowest foot stands on the ground, above the origin."""

from __future__ import annotations

import numpy as np

from ....core import Array, rotation
from ....robots import RobotModel
from ...logs.recordings import LogSegment, Recordings
from ..rows import unrolled
from .feet import feet_of, imu_pose
from .rows import turned


def poses(robot: RobotModel, recordings: Recordings, segment: LogSegment) -> tuple[Array, Array]:
    """(N, m) positions and (N, n) velocities along a segment; joints alone on a fixed base.

    Where a base walks to is not measured, and is left out.
    """
    log = segment.log
    if segment.imu is None or recordings.imu is None or not robot.floating:
        return robot.system.position(log.q), log.v
    system = unrolled(robot.system)
    turn = imu_pose(robot, recordings.imu)[0].rotation
    quaternion = turned(segment.imu[:, :4], turn)
    q = np.hstack([np.zeros((len(log.t), 3)), quaternion, log.q])
    places = system.contact_jacobians(feet_of(robot, recordings.contacts)[0], q)[1]
    up = np.array([rotation(x)[2] for x in quaternion])
    q[:, 2] = -np.min(np.einsum("nkj,nj->nk", places, up), axis=1)
    spin = segment.imu[:, 4:7] @ turn.T
    v = np.hstack([np.zeros_like(spin), spin, log.v])
    return _rolled(robot, q), v


def _rolled(robot: RobotModel, q: Array) -> Array:
    """Positions of the robot's own system, whose continuous joints are (cos, sin)."""
    if q.shape[1] == robot.system.m:
        return q
    found = [q[:, :7]]
    for k, joint in enumerate(list(robot.model.joints)[2:]):
        own = q[:, 7 + k : 8 + k]
        found.append(np.hstack([np.cos(own), np.sin(own)]) if joint.nq == 2 else own)
    return np.hstack(found)
