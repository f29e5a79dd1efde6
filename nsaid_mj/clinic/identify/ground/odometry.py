"""The specific force of a base without an accelerometer, from the legs: feet that bear load stand.

A foot that stands tells the velocity of the base, −(ω × r + J q̇) along its axes, and the feet's
loads are the weights of a mean. Its derivative plus gravity is the specific force. Feet slip, roll
and sink in, so that it holds for slow motion only (a few hertz), at which it is within .1 to .5
m/s²: a hundredth of gravity or two, where taking it for gravity's alone would be off by .5 to 1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ....core import zero_phase
from ...logs.imu import GRAVITY
from ...logs.recordings import Recordings
from ..smoothing import slope
from .rows import BASE, GroundRows
from .stance import Stance


def with_odometry(rows: GroundRows, seen: Stance) -> Recordings:
    """The recordings of rows with the specific force that standing feet tell, at the IMU."""
    segments = list(rows.recordings.segments)
    each = zip(rows.segments, rows.motions, seen.normal, strict=True)
    for segment, motion, normal in each:
        assert segment.imu is not None
        J = rows.system.contact_jacobians(rows.ground.feet, motion.q)[0]
        moving = np.hstack([np.zeros_like(motion.v[:, :3]), motion.v[:, 3:]])
        slides = np.einsum("nij,nj->ni", J, moving)
        first = np.cumsum([0, *(foot.rows for foot in rows.ground.feet)])[:-1]
        relative = slides[:, first[:, None] + np.arange(3)]
        load = np.maximum(normal, 1e-3 * seen.least)
        share = load / load.sum(axis=1)[:, None]
        spin = motion.v[:, 3:BASE]
        v = np.cross(spin, rows.ground.imu.translation)
        v = v - np.einsum("nk,nkj->nj", share, relative)
        rate = rows.chosen.rate / rows.chosen.every
        v = zero_phase(v, min(rows.chosen.cutoff, 0.4 * rate), rate)
        up = Rotation.from_quat(motion.q[:, 3:7]).as_matrix()[:, 2]
        force = (slope(motion.t, v) + np.cross(spin, v) + GRAVITY * up) @ rows.ground.imu.rotation
        imu = segment.imu.copy()
        for axis in range(3):
            imu[:, 7 + axis] = np.interp(segment.log.t, motion.t, force[:, axis])
        at = next(k for k, other in enumerate(segments) if other is segment)
        segments[at] = segment._replace(imu=imu)
    return replace(rows.recordings, segments=tuple(segments))
