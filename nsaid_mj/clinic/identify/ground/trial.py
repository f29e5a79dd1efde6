"""How well an exported MJCF of a robot that walks explains its log, in MuJoCo, step by step.

MuJoCo's inverse dynamics of the file gives the forces of every measured state. In stance those of
the feet are taken out (`core`'s `Elimination`) and the rest is compared with the motors' commands;
of a leg that swings its joints are compared themselves. There is no simulation from step to step: a
foot that touches down a moment earlier makes another motion of it, however good the model is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.spatial.transform import Rotation

from ....core import Array, Elimination
from ....lab import JointMap
from ....robots import RobotModel
from ...logs.imu import GRAVITY
from ...logs.recordings import Recordings
from ..rows import unrolled
from ..smoothing import Filter, delayed, smooth_commands
from .conventions import limbs_of
from .feet import feet_of, imu_pose
from .rows import BASE, Ground, smooth_ground

_LOADED = 0.15  # of a foot's share of the weight, from which it counts as loaded
_TOUCHING = 0.06  # around a load, in which a foot still does [s]


class StepErrors(NamedTuple):
    """Errors over the standard deviation of what the commands do (NRMSE)."""

    stance: float  # of the forces and torques on the base, while feet bear load
    swing: float  # of the joints of legs that swing; NaN where none does


def trial(
    robot: RobotModel, mj: Any, gain: Array, recordings: Recordings, chosen: Filter, delay: Array
) -> StepErrors:
    """Errors of a compiled MJCF with motors of gains (k,), commanded late by (k,) seconds [s]."""
    assert recordings.imu is not None
    feet = feet_of(robot, recordings.contacts)[0]
    ground = Ground(feet, imu_pose(robot, recordings.imu)[0])
    structure = unrolled(robot.system).structure
    limbs = limbs_of(robot)
    starts = np.cumsum([0, *(foot.rows for foot in feet)])[:-1]
    weight = GRAVITY * float(np.sum(mj.body_mass)) / len(feet)
    standing = []
    swinging = []
    for segment in recordings.segments:
        motion = smooth_ground(ground, segment, chosen)
        if not len(chosen.centres(len(motion.t))):
            continue
        law = recordings.feedback
        u = delayed(segment, chosen, smooth_commands(segment, chosen, law), delay)
        if law is not None:  # its damping is part of the file's
            u = u - law[0] * motion.q[:, BASE + 1 :]
        acting = np.zeros_like(motion.v)
        acting[:, BASE:] = gain * u
        force = required(robot, mj, motion.q, motion.v, motion.a)
        every = Elimination(structure, feet, motion.q)
        implied = np.einsum("nij,nj->ni", every.to_force, force - acting)
        up = Rotation.from_quat(motion.q[:, 3:7]).as_matrix()[:, 2]
        normal = np.column_stack(
            [np.sum(implied[:, first : first + 3] * up, axis=1) for first in starts]
        )
        width = 2 * max(1, round(_TOUCHING * chosen.rate / chosen.every)) + 1
        bears = np.asarray(maximum_filter1d(np.abs(normal) > _LOADED * weight, width, axis=0), bool)
        E = Elimination(structure, feet, motion.q, bears).E
        pairs = [np.einsum("nij,nj->ni", E, x) for x in (acting, force)]
        rows = [chosen.rows(x) for x in pairs]
        centres = chosen.centres(len(motion.t))
        loaded = bears[centres]
        some = loaded.any(axis=1)
        standing.append([x[some, :BASE] for x in rows])
        for foot, contact in enumerate(feet):
            own = _limb_of(robot, contact.body, limbs)
            free = ~loaded[:, foot]
            columns = [BASE + j for j in own]
            swinging.append([(x[free][:, columns], columns) for x in rows])
    return StepErrors(_nrmse(standing), _of_legs(swinging))


def required(robot: RobotModel, mj: Any, q: Array, v: Array, a: Array) -> Array:
    """(N, 6 + k) forces of a file's inverse dynamics, without contacts, in the model's order.

    Velocities (N, 6 + k) and accelerations are along the base's axes, a base at rest has no weight.
    """
    data = mujoco.MjData(mj)
    (free,) = [j for j in range(mj.njnt) if mj.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    joints = JointMap(mj, [free, *robot.joints])
    return np.array([joints.inverse_dynamics(mj, data, *row) for row in zip(q, v, a, strict=True)])


def _limb_of(robot: RobotModel, body: int, limbs: list[list[int]]) -> list[int]:
    """The joints of the limb that ends in a body."""
    name = robot.model.names[body + 1]
    joint = robot.joints.index(name)
    return next(limb for limb in limbs if joint in limb)


def _nrmse(parts: list[list[Array]]) -> float:
    """Of (N, n) forces of commands and of the file, the geometric mean of the columns' errors."""
    acting, force = (np.concatenate(each) for each in zip(*parts, strict=True))
    error = np.sqrt(np.mean((force - acting) ** 2, axis=0)) / np.maximum(acting.std(axis=0), 1e-12)
    return float(np.sqrt(np.mean(error**2)))


def _of_legs(parts: list[list[tuple[Array, list[int]]]]) -> float:
    """Error of swinging legs' commands over their size, each leg by its joints; NaN without."""
    errors = []
    legs: dict[tuple[int, ...], list[list[Array]]] = {}
    for acting, force in parts:
        legs.setdefault(tuple(acting[1]), []).append([acting[0], force[0]])
    for each in legs.values():
        if sum(len(pair[0]) for pair in each) >= _FEW:
            errors.append(_nrmse(each))
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan")


_FEW = 20  # rows of a leg in swing, below which it says nothing
