"""Which feet bear load, from the forces that the robot's own balance leaves to them.

λ̂ of `core`'s `Elimination` is the force that the legs' torques ascribe to each foot. A foot is in
swing where its normal component stays small for longer than touch-down takes, and where it is
higher than any foot that bears load: noise of the forces hides those of a foot that drags or is put
down gently, and joints and orientation show its height without any parameter. Everywhere else its
force is taken out of the rows, whatever it is. So an error here costs information, not truth, as
long as no foot that bears load counts as swinging.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from ....core import GRAVITY, Array, zero_phase
from ..problem import Mask
from .rows import GroundRows

SMOOTH = 25.0  # of the forces, before they are judged [Hz]
_UNLOADED = 0.08  # of a foot's share of the robot's weight, below which it may be in swing
_NOISES = 4.0  # standard deviations of the forces of unloaded feet that this must exceed
_TOUCHING = 0.03  # around a load, in which a foot still counts as loaded [s]
_HEAVY = 0.5  # of a foot's share of the weight, from which it surely stands
_STANDING = 0.95  # quantile of the heights of such feet over the lowest,
_KNOWN = 3e-3  # and to what the places of feet are known [m]: of both the larger, and
_CLEAR = 2.0  # times that height, above which a foot is free: light feet sink in less than others


class Stance(NamedTuple):
    """What the feet do along the logs."""

    touching: tuple[Mask, ...]  # (N, feet) of every segment's samples: what may bear load
    normal: tuple[Array, ...]  # (N, feet) normal forces of the same samples [N]
    share: Array  # (feet,) of the samples in which a foot bears load
    swinging: Array  # (feet,) of those in which it surely swings
    least: float  # normal force from which a foot counts as loaded [N]


def stance(rows: GroundRows, theta: Array, delay: Array, total: float) -> Stance:
    """The feet's loads under θ̂ (p,) and delays (k,); `total` is the robot's mass [kg]."""
    each = [_normal(rows, k, theta, delay) for k in range(len(rows.motions))]
    feet = len(rows.ground.feet)
    weight = total * GRAVITY / feet
    every = np.concatenate(each)
    calm = every[np.abs(every) < 2 * _UNLOADED * weight]
    noise = float(1.48 * np.median(np.abs(calm))) if len(calm) else 0.0
    least = max(_UNLOADED * weight, _NOISES * noise)
    rate = rows.chosen.rate / rows.chosen.every
    width = 2 * max(1, round(_TOUCHING * rate)) + 1
    loaded = [np.abs(x) > least for x in each]
    heights = [_heights(rows, k) for k in range(len(rows.motions))]
    heavy = every > max(_HEAVY * weight, least)
    standing = np.append(np.concatenate(heights)[heavy], _KNOWN)
    clear = _CLEAR * max(float(np.quantile(standing, _STANDING)), _KNOWN)
    near = [scipy.ndimage.maximum_filter1d(x, width, axis=0) for x in loaded]
    touching = [x | (height < clear) for x, height in zip(near, heights, strict=True)]
    full = {id(s): mask for s, mask in zip(rows.segments, touching, strict=True)}
    spread = []
    for segment in rows.recordings.segments:
        own = full.get(id(segment), np.ones((1, feet), dtype=bool))
        spread.append(np.repeat(own, rows.chosen.every, axis=0)[: len(segment.log.t)])
    share = np.concatenate(loaded).mean(axis=0)
    swinging = 1 - np.concatenate(touching).mean(axis=0)
    return Stance(tuple(spread), tuple(each), share, swinging, least)


def _heights(rows: GroundRows, number: int) -> Array:
    """(M, feet) heights of the feet over the lowest one along a motion [m]."""
    up = Rotation.from_quat(rows.motions[number].q[:, 3:7]).as_matrix()[:, 2]
    found = np.einsum("nkj,nj->nk", rows.eliminated[number].places, up)
    return np.asarray(found - found.min(axis=1, keepdims=True))


def _normal(rows: GroundRows, number: int, theta: Array, delay: Array) -> Array:
    """(M, feet) normal forces along a motion [N]."""
    motion = rows.motions[number]
    torque = rows.required(number, theta, delay)
    force = np.einsum("nij,nj->ni", rows.eliminated[number].to_force, torque)
    up = Rotation.from_quat(motion.q[:, 3:7]).as_matrix()[:, 2]
    found = []
    first = 0
    for foot in rows.ground.feet:
        found.append(np.sum(force[:, first : first + 3] * up, axis=1))
        first += foot.rows
    rate = rows.chosen.rate / rows.chosen.every
    found = np.column_stack(found)
    return zero_phase(found, min(SMOOTH, 0.4 * rate), rate) if len(found) > 8 else found
