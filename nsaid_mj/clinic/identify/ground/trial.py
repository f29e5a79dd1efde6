"""How well an exported MJCF of a robot that walks explains its log, in MuJoCo, step by step.

MuJoCo's inverse dynamics of the file gives the forces of every measured state. In stance those of
the feet are taken out (`core`'s `Elimination`) and the rest is compared with the motors' commands;
of a leg that swings its joints are compared themselves. Legs are simulated from step to step only
while they swing, with the base's motion given: a foot that touches down a moment earlier makes
another motion of the robot, however good the model is.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco import rollout
from scipy.ndimage import maximum_filter1d
from scipy.spatial.transform import Rotation

from ....core import Array, Elimination, Indices
from ....lab import JointMap
from ....robots import RobotModel, quiet
from ...logs.imu import GRAVITY
from ...logs.recordings import Recordings
from ..problem import Mask
from ..rows import unrolled
from ..smoothing import Filter, Smooth, delayed, smooth_commands
from .conventions import limbs_of
from .feet import feet_of, imu_pose
from .rows import BASE, Ground, smooth_ground

_LOADED = 0.15  # of a foot's share of the weight, from which it counts as loaded
_TOUCHING = 0.06  # around a load, in which a foot still does [s]
_WINDOW = 0.2  # length of the simulations of a swinging leg [s]
_MOST = 25  # of them of a leg and segment: their rms is then known to a few percent
_HEAVY = 1e6  # times the robot's mass, armature with which given motions stay as they are


class StepErrors(NamedTuple):
    """Errors over the standard deviation of what the commands do (NRMSE)."""

    stance: float  # of the forces and torques on the base, while feet bear load
    swing: float  # of the joints of legs that swing; NaN where none does
    # rms error of their simulated positions [rad or m], NaN where none swings for so long
    replay: float


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
    departures = [np.zeros(0)]
    for segment in recordings.segments:
        motion = smooth_ground(ground, segment, chosen)
        if not len(chosen.centres(len(motion.t))):
            continue
        law = recordings.feedback
        u = delayed(segment, chosen, smooth_commands(segment, chosen, law), delay)
        targets = gain * u
        spring = np.zeros(len(gain))
        if law is not None:  # its damping is part of the file's
            u = u - law[0] * motion.q[:, BASE + 1 :]
            spring = gain * law[0]
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
            windows = _windows(~bears[:, foot], round(_WINDOW * chosen.rate / chosen.every))
            if len(windows):
                leg = _Leg(robot, mj, own, spring)
                departures.append(leg.departures(motion, targets, windows).ravel())
    every = np.concatenate(departures)
    error = float(np.sqrt(np.mean(every**2))) if len(every) else float("nan")
    return StepErrors(_nrmse(standing), _of_legs(swinging), error)


def _windows(free: Mask, samples: int) -> Indices:
    """(K, samples + 1) numbers of consecutive samples in all of which a mask (M,) is true."""
    starts = []
    first = 0
    while first + samples < len(free):
        taken = np.flatnonzero(~free[first : first + samples + 1])
        if len(taken):
            first += int(taken[-1]) + 1
        else:
            starts.append(first)
            first += samples
    some = np.array(starts[:: max(1, len(starts) // _MOST)], dtype=int)
    return some[:, None] + np.arange(samples + 1)


class _Leg:
    """A compiled model of which one leg moves by itself; base and other joints move as told.

    What is told is made so heavy that the leg does not disturb it, and pushed as it accelerates.
    """

    def __init__(self, robot: RobotModel, mj: Any, own: list[int], spring: Array):
        """`own` are the leg's joints, (k,) `spring` is what a PD law takes per angle [N·m/rad]."""
        self._mj = copy.copy(mj)
        (free,) = [j for j in range(mj.njnt) if mj.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
        self._joints = JointMap(mj, [free, *robot.joints])
        self._own = np.array(own)
        self._mass = _HEAVY * float(np.sum(mj.body_mass))
        told = np.setdiff1d(np.arange(mj.nv), self._joints.motors[self._own])
        self._mj.dof_armature[told] = self._mass
        self._mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        for j in own:
            joint = mj.joint(robot.joints[j])
            number = joint.id
            at = int(joint.qposadr[0])
            file = float(mj.jnt_stiffness[number])
            total = max(file + float(spring[j]), 1e-300)
            self._mj.jnt_stiffness[number] = total
            self._mj.qpos_spring[at] = file * mj.qpos_spring[at] / total

    def departures(self, motion: Smooth, targets: Array, windows: Indices) -> Array:
        """(K, samples, j) simulated minus measured positions of the leg [rad or m].

        `targets` (M, k) are the motors' forces without what a PD law takes [N·m or N].
        """
        joints = self._joints
        mj = self._mj
        turn = Rotation.from_quat(motion.q[:, 3:7])
        a = motion.a.copy()
        a[:, :3] = turn.apply(a[:, :3])
        push = np.zeros((len(a), mj.nv))
        push[:, joints.dof] = self._mass * a
        push[:, joints.motors[self._own]] = targets[:, self._own]
        step = float(motion.t[1] - motion.t[0])
        substeps = int(np.ceil(step / mj.opt.timestep - 1e-9))
        mj.opt.timestep = step / substeps
        data = mujoco.MjData(mj)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.zeros((len(windows), mujoco.mj_stateSize(mj, kind)))
        numbers = np.hstack([motion.q[:, :3], turn.as_rotvec(), motion.q[:, BASE + 1 :]])
        for row, k in zip(state, windows[:, 0], strict=True):
            joints.write(data, numbers[k], motion.v[k])
            mujoco.mj_getState(mj, data, row, kind)
        between = 0.5 * (push[windows[:, 1:]] + push[windows[:, :-1]])
        applied = np.repeat(between, substeps, axis=1)
        with quiet():  # a simulation that diverges has a large error
            spec = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
            states: Any = rollout.rollout(mj, data, state, applied, control_spec=spec)[0]
        found = joints.angles(states[:, substeps - 1 :: substeps])[:, :, self._own]
        return np.asarray(found - motion.q[windows[:, 1:]][:, :, BASE + 1 + self._own])


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
    """Of (N, n) forces of commands and of the file, the rms of the columns' relative errors."""
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
