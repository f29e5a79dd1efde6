"""Conversion between MuJoCo's coordinates and a system's; it is done nowhere else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import types

from ...numerics.kernels import i8, kernel, table, vector, void
from ...numerics.spatial import cross, quaternion_of, rotate, rotation, unrotate
from ...parameters import Array, Indices


class Reading(NamedTuple):
    """Index maps between MuJoCo's state and a system's coordinates, for compiled code.

    Attributes:
        group: 6 if a free joint comes first, 3 if the joints are x, y and ψ of a body in the
            plane, 0 if all are ordinary joints.
        free: (2,) indices of the free joint in qpos and qvel; −1 if there is none.
        joints: (k, 4) for each 1-DOF joint its indices in qpos, qvel and q, and 1 if q holds its
            cosine and sine.
    """

    group: int
    free: Indices
    joints: Indices


def reading_of(
    qpos: Indices, dof: Indices, circular: Sequence[bool] = (), free: Sequence[int] = ()
) -> Reading:
    """The `Reading` of 1-DOF joints, possibly after a free joint.

    Args:
        qpos: (k,) indices of the joints in qpos.
        dof: (k,) indices of the joints in qvel.
        circular: for each joint, whether q holds its cosine and sine; empty if none does.
        free: indices of the free joint in qpos and qvel; empty if there is none.
    """
    circles = np.array(circular or np.zeros(len(qpos)), dtype=int)
    places = (7 if free else 0) + np.cumsum(1 + circles) - (1 + circles)
    joints = np.column_stack([qpos, dof, places, circles])
    places = np.array(free or (-1, -1), dtype=np.int64)
    return Reading(6 if free else 0, places, np.ascontiguousarray(joints, dtype=np.int64))


READING = types.NamedTuple((i8, i8[::1], table), Reading)
_SMALL = 1e-2  # angle below which three terms of the series are exact in double precision [rad]


@kernel(void(READING, vector, vector, vector, vector))
def read_coordinates(reading, qpos, qvel, numbers, velocity):
    """Writes position numbers (n,) and velocities (n,) from MuJoCo's qpos and qvel."""
    first = 0
    if reading.group == 6:
        at, dof = reading.free[0], reading.free[1]
        x, y, z, w = qpos[at + 4], qpos[at + 5], qpos[at + 6], qpos[at + 3]
        sine = np.sqrt(x * x + y * y + z * z)
        ratio = sine / w
        square = ratio * ratio
        turn = 2.0 / w * (1.0 - square / 3.0 + square**2 / 5.0 - square**3 / 7.0)
        if sine > _SMALL:
            turn = 2.0 * np.arctan2(sine if w >= 0.0 else -sine, abs(w)) / sine
        a, b, c = qvel[dof], qvel[dof + 1], qvel[dof + 2]
        i, j, k = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
        velocity[0] = a + w * i + j * z - k * y  # the inverse rotation
        velocity[1] = b + w * j + k * x - i * z
        velocity[2] = c + w * k + i * y - j * x
        numbers[3], numbers[4], numbers[5] = turn * x, turn * y, turn * z
        for r in range(3):
            numbers[r], velocity[3 + r] = qpos[at + r], qvel[dof + 3 + r]
        first = 6
    for k in range(reading.joints.shape[0]):
        numbers[first + k] = qpos[reading.joints[k, 0]]
        velocity[first + k] = qvel[reading.joints[k, 1]]
    if reading.group == 3:
        c, s = np.cos(numbers[2]), np.sin(numbers[2])
        x, y = velocity[0], velocity[1]
        velocity[0], velocity[1] = c * x + s * y, c * y - s * x


@kernel(void(READING, vector, vector), inner=True)
def write_position(reading, numbers, q):
    """Writes q (m,) from position numbers (n,), as `JointTree` and `StructuredSystem` define it."""
    first = 0
    if reading.group == 6:
        x, y, z = numbers[3], numbers[4], numbers[5]
        angle = np.sqrt(x * x + y * y + z * z)
        square = angle * angle
        half = 0.5 - square / 48.0 + square**2 / 3840.0
        if angle > _SMALL:
            half = np.sin(0.5 * angle) / angle
        q[0], q[1], q[2] = numbers[0], numbers[1], numbers[2]
        q[3], q[4], q[5], q[6] = half * x, half * y, half * z, np.cos(0.5 * angle)
        first = 6
    for k in range(reading.joints.shape[0]):
        number, place = numbers[first + k], reading.joints[k, 2]
        q[place] = number
        if reading.joints[k, 3]:
            q[place], q[place + 1] = np.cos(number), np.sin(number)


class JointMap:
    """Maps joint positions in Pinocchio's order to and from MuJoCo's qpos and qvel, by joint name.

    For 1-DOF joints: a position number is an angle [rad] or a displacement [m] in both engines.
    MuJoCo orders bodies depth first; Pinocchio need not.

    Args:
        model: MuJoCo's model.
        names: of the joints, in Pinocchio's order.

    Attributes:
        qpos: (n,) index of every joint in qpos.
        dof: (n,) index of every joint in qvel.
        motors: (n,) indices in qvel of the 1-DOF joints, here `dof`.
    """

    def __init__(self, model: Any, names: Sequence[str]):
        joints = [model.joint(name) for name in names]
        self.qpos = np.array([joint.qposadr[0] for joint in joints], dtype=int)
        self.dof = np.array([joint.dofadr[0] for joint in joints], dtype=int)
        self.motors = self.dof

    def reading(self, circular: Sequence[bool] = ()) -> Reading:
        """The index map for compiled code; `circular` marks joints with cosine and sine in q."""
        return reading_of(self.qpos, self.dof, circular)

    def read(self, data: Any) -> tuple[Array, Array]:
        """(n,) joint positions [rad or m] and (n,) joint velocities [rad/s or m/s]."""
        return data.qpos[self.qpos], data.qvel[self.dof]

    def write(self, data: Any, coordinates: Array, velocity: Array) -> None:
        """Sets qpos and qvel from joint positions (n,) and velocities (n,)."""
        data.qpos[self.qpos] = coordinates
        data.qvel[self.dof] = velocity

    def mass_matrix(self, model: Any, data: Any) -> Array:
        """(n, n) MuJoCo's M at its current state, in Pinocchio's order."""
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        return full[np.ix_(self.dof, self.dof)]

    def bias(self, model: Any, data: Any) -> Array:
        """(n,) MuJoCo's Coriolis, centrifugal and gravity forces, in Pinocchio's order."""
        return data.qfrc_bias[self.dof]

    def acceleration(self, data: Any) -> Array:
        """(n,) MuJoCo's current joint accelerations, in Pinocchio's order."""
        return data.qacc[self.dof]


def pose_of(qpos: Array) -> Array:
    """(7,) pose [p, x, y, z, w] from a free joint's qpos [p, w, x, y, z]."""
    return np.array([*qpos[:3], *qpos[4:7], qpos[3]])


class PoseMap:
    """Maps position numbers [p, rotation vector] and body twist of a free joint to and from MuJoCo.

    MuJoCo's quaternion is w, x, y, z, and its linear velocity is in world axes.

    Args:
        model: MuJoCo's model.
        joint: name of the free joint.
    """

    def __init__(self, model: Any, joint: str):
        at, dof = model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]
        self.qpos, self.dof = slice(at, at + 7), slice(dof, dof + 6)
        nowhere = np.zeros(0, dtype=int)
        self.reading = reading_of(nowhere, nowhere, free=(at, dof))

    def read(self, data: Any) -> tuple[Array, Array]:
        """(6,) position numbers and (6,) body twist."""
        numbers, twist = np.empty((2, 6))
        read_coordinates(self.reading, data.qpos, data.qvel, numbers, twist)
        return numbers, twist

    def write(self, data: Any, numbers: Array, twist: Array) -> None:
        """Sets qpos and qvel from position numbers (6,) and a body twist (6,)."""
        x, y, z, w = attitude = quaternion_of(np.asarray(numbers[3:], dtype=np.float64))
        data.qpos[self.qpos] = [*numbers[:3], w, x, y, z]
        data.qvel[self.dof] = [*rotate(attitude, np.asarray(twist[:3], float)), *twist[3:]]

    def acceleration(self, data: Any) -> Array:
        """(6,) time derivative of the body twist, from MuJoCo's current qacc."""
        attitude = pose_of(data.qpos[self.qpos])[3:]
        qvel, qacc = data.qvel[self.dof], data.qacc[self.dof]
        linear = unrotate(attitude, qacc[:3]) - np.cross(qvel[3:], unrotate(attitude, qvel[:3]))
        return np.concatenate([linear, qacc[3:]])


class FloatingMap:
    """Maps position numbers and velocities of a floating base with joints to and from MuJoCo.

    With T = blkdiag(Rᵀ, 1), the system's v is T q̇ and its v̇ is T q̈ + [−ω × Rᵀ v_world, 0].

    Args:
        model: MuJoCo's model.
        base: name of the free joint.
        names: of the 1-DOF joints, in Pinocchio's order.

    Attributes:
        dof: (n,) indices in qvel, base first.
        motors: (n − 6,) index in qvel of every 1-DOF joint.
    """

    def __init__(self, model: Any, base: str, names: Sequence[str]):
        self.base, self.joints = PoseMap(model, base), JointMap(model, names)
        self.motors = self.joints.motors
        self.dof = np.concatenate([np.r_[self.base.dof], self.motors])
        self._reading = self.reading()

    def reading(self, circular: Sequence[bool] = ()) -> Reading:
        """The index map for compiled code; `circular` marks joints with cosine and sine in q."""
        free = self.base.qpos.start, self.base.dof.start
        return reading_of(self.joints.qpos, self.joints.dof, circular, free)

    def read(self, data: Any) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) velocities."""
        numbers, velocity = np.empty((2, len(self.dof)))
        read_coordinates(self._reading, data.qpos, data.qvel, numbers, velocity)
        return numbers, velocity

    def write(self, data: Any, numbers: Array, velocity: Array) -> None:
        """Sets qpos and qvel from position numbers (n,) and velocities (n,)."""
        self.base.write(data, numbers[:6], velocity[:6])
        self.joints.write(data, numbers[6:], velocity[6:])

    def mass_matrix(self, model: Any, data: Any) -> Array:
        """(n, n) T M Tᵀ, MuJoCo's M at its current state, for the system's v."""
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        half = self._into_body(data, full[np.ix_(self.dof, self.dof)])
        return self._into_body(data, half.T)

    def bias(self, model: Any, data: Any) -> Array:
        """(n,) MuJoCo's Coriolis, centrifugal and gravity forces, for the system's v."""
        _, velocity = self.base.read(data)
        turning = np.zeros(len(self.dof))
        turning[:3] = np.cross(velocity[3:], velocity[:3])
        own = self._into_body(data, data.qfrc_bias[self.dof])
        return own + self.mass_matrix(model, data) @ turning

    def acceleration(self, data: Any) -> Array:
        """(n,) time derivative of the system's v, from MuJoCo's current qacc."""
        return np.concatenate([self.base.acceleration(data), self.joints.acceleration(data)])

    def _into_body(self, data: Any, rows: Array) -> Array:
        """T times rows (n, ...)."""
        attitude = pose_of(data.qpos[self.base.qpos])[3:]
        turned = rows.copy()
        turned[:3] = rotation(attitude).T @ rows[:3]
        return turned


def joint_map(model: Any, names: Sequence[str]) -> JointMap | FloatingMap:
    """The coordinate map of a tree with joints of these names; the first may be a free joint."""
    if model.joint(names[0]).type[0] == mujoco.mjtJoint.mjJNT_FREE:
        return FloatingMap(model, names[0], names[1:])
    return JointMap(model, names)


class PlanarMap:
    """Maps x, y, ψ and body twist u, v, r of a planar body on two slides and a hinge.

    Args:
        model: MuJoCo's model.
        joints: names of the joints along x, along y and about z.
    """

    def __init__(self, model: Any, joints: tuple[str, str, str] = ("x", "y", "yaw")):
        self.qpos = np.array([model.joint(name).qposadr[0] for name in joints])
        self.dof = np.array([model.joint(name).dofadr[0] for name in joints])
        self.reading = reading_of(self.qpos, self.dof)._replace(group=3)

    def read(self, data: Any) -> tuple[Array, Array]:
        """(3,) x, y [m], ψ [rad] and (3,) body twist u, v [m/s], r [rad/s]."""
        numbers, twist = np.empty((2, 3))
        read_coordinates(self.reading, data.qpos, data.qvel, numbers, twist)
        return numbers, twist

    def write(self, data: Any, numbers: Array, twist: Array) -> None:
        """Sets qpos and qvel from x, y, ψ (3,) and a body twist (3,)."""
        c, s = np.cos(numbers[2]), np.sin(numbers[2])
        u, v, r = twist
        data.qpos[self.qpos], data.qvel[self.dof] = numbers, [c * u - s * v, s * u + c * v, r]

    def acceleration(self, data: Any) -> Array:
        """(3,) time derivative of the body twist, from MuJoCo's current qacc."""
        yaw = data.qpos[self.qpos[2]]
        u, v, r = self._into_body(yaw, data.qvel[self.dof])
        return self._into_body(yaw, data.qacc[self.dof]) - r * np.array([-v, u, 0.0])

    @staticmethod
    def _into_body(yaw: float, rates: Array) -> Array:
        """(3,) rates along x and y in the world and about z, turned into body axes."""
        c, s = np.cos(yaw), np.sin(yaw)
        x, y, r = rates
        return np.array([c * x + s * y, c * y - s * x, r])


class LevelMap:
    """Maps a free joint's horizontal motion, x, y, ψ and u, v, r, to and from qpos and qvel.

    ψ is the heading of the body's x-axis projected on the ground. Height, pitch and roll are
    ignored when reading.

    Args:
        model: MuJoCo's model.
        joint: name of the free joint.
    """

    def __init__(self, model: Any, joint: str):
        self.pose = PoseMap(model, joint)

    def read(self, data: Any) -> tuple[Array, Array]:
        """(3,) x, y [m], ψ [rad] and (3,) velocities along and across the heading [m/s], ψ̇."""
        pose, qvel = data.qpos[self.pose.qpos], data.qvel[self.pose.dof]
        return _seen_from_above(pose, qvel)

    def write(self, data: Any, numbers: Array, twist: Array) -> None:
        """Sets x, y, ψ (3,) and a horizontal twist (3,), at the same height, level."""
        c, s = np.cos(numbers[2] / 2), np.sin(numbers[2] / 2)
        height = data.qpos[self.pose.qpos][2]
        data.qpos[self.pose.qpos] = [*numbers[:2], height, c, 0.0, 0.0, s]
        c, s = np.cos(numbers[2]), np.sin(numbers[2])
        u, v, r = twist
        data.qvel[self.pose.dof] = [c * u - s * v, s * u + c * v, 0.0, 0.0, 0.0, r]


@kernel()
def _seen_from_above(pose, qvel):
    """Position and velocity as `LevelMap.read` returns them, from qpos (7,) and qvel (6,)."""
    attitude = (pose[4], pose[5], pose[6], pose[3])
    ahead = rotate(attitude, (1.0, 0.0, 0.0))
    turning = cross(rotate(attitude, qvel[3:]), ahead)
    length = np.hypot(ahead[0], ahead[1])
    c, s = ahead[0] / length, ahead[1] / length
    yaw_rate = (ahead[0] * turning[1] - ahead[1] * turning[0]) / length**2
    numbers = np.array([pose[0], pose[1], np.arctan2(s, c)])
    return numbers, np.array([c * qvel[0] + s * qvel[1], c * qvel[1] - s * qvel[0], yaw_rate])
