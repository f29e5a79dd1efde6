"""All conversion between MuJoCo's coordinates and a system's."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba import f8, i8, types, void

from ....core import Array, Indices, kernel, quaternion_of, rotate, rotation


class Reading(NamedTuple):
    """Index maps between MuJoCo's state and a system's coordinates, for compiled code."""

    # 6 if a free joint comes first, 3 if the joints are x, y and ψ of a body in the plane, 0 if all
    # are ordinary joints
    group: int
    free: Indices  # (2,) indices of the free joint in qpos and qvel; −1 if there is none
    # (k, 4) each 1-DOF joint's indices in qpos, qvel and q, and 1 if q holds its cosine and sine
    joints: Indices


READING = types.NamedTuple((i8, i8[::1], i8[:, ::1]), Reading)
_SMALL = 1e-2  # angle below which three terms of the series are exact in double precision [rad]


@kernel(void(READING, f8[::1], f8[::1], f8[::1], f8[::1]))
def read_coordinates(reading, qpos, qvel, numbers, velocity):
    """Writes position numbers (n,) and velocities (n,) from MuJoCo's qpos and qvel."""
    first = 0
    if reading.group == 6:
        at = reading.free[0]
        dof = reading.free[1]
        x = qpos[at + 4]
        y = qpos[at + 5]
        z = qpos[at + 6]
        w = qpos[at + 3]
        sine = np.sqrt(x * x + y * y + z * z)
        ratio = sine / w
        square = ratio * ratio
        turn = 2.0 / w * (1.0 - square / 3.0 + square**2 / 5.0 - square**3 / 7.0)
        if sine > _SMALL:
            turn = 2.0 * np.arctan2(sine if w >= 0.0 else -sine, abs(w)) / sine
        a = qvel[dof]
        b = qvel[dof + 1]
        c = qvel[dof + 2]
        i = 2.0 * (b * z - c * y)
        j = 2.0 * (c * x - a * z)
        k = 2.0 * (a * y - b * x)
        velocity[0] = a + w * i + j * z - k * y  # the inverse rotation
        velocity[1] = b + w * j + k * x - i * z
        velocity[2] = c + w * k + i * y - j * x
        numbers[3] = turn * x
        numbers[4] = turn * y
        numbers[5] = turn * z
        for r in range(3):
            numbers[r] = qpos[at + r]
            velocity[3 + r] = qvel[dof + 3 + r]
        first = 6
    for k in range(reading.joints.shape[0]):
        numbers[first + k] = qpos[reading.joints[k, 0]]
        velocity[first + k] = qvel[reading.joints[k, 1]]
    if reading.group == 3:
        c = np.cos(numbers[2])
        s = np.sin(numbers[2])
        x = velocity[0]
        y = velocity[1]
        velocity[0] = c * x + s * y
        velocity[1] = c * y - s * x


@kernel(void(READING, f8[::1], f8[::1]), inner=True)
def write_position(reading, numbers, q):
    """Writes q (m,) from position numbers (n,), as `StructuredKinematics` defines it."""
    first = 0
    if reading.group == 6:
        x = numbers[3]
        y = numbers[4]
        z = numbers[5]
        angle = np.sqrt(x * x + y * y + z * z)
        square = angle * angle
        half = 0.5 - square / 48.0 + square**2 / 3840.0
        if angle > _SMALL:
            half = np.sin(0.5 * angle) / angle
        q[0] = numbers[0]
        q[1] = numbers[1]
        q[2] = numbers[2]
        q[3], q[4], q[5], q[6] = half * x, half * y, half * z, np.cos(0.5 * angle)
        first = 6
    for k in range(reading.joints.shape[0]):
        number = numbers[first + k]
        place = reading.joints[k, 2]
        q[place] = number
        if reading.joints[k, 3]:
            q[place], q[place + 1] = np.cos(number), np.sin(number)


class JointMap:
    """Maps position numbers and velocities to and from MuJoCo's qpos and qvel, by joint name.

    MuJoCo orders bodies depth first, which Pinocchio need not; its quaternion is w, x, y, z, and a
    free joint's linear velocity is in world axes, as is that of a body in the plane. With R the
    base's axes in the world and T = blkdiag(Rᵀ, 1), the system's v is T q̇, and its v̇ is
    T q̈ − [ω × v_base, 0]; on a fixed base T = 1. A joint's position number is its angle [rad] or
    displacement [m] in both.

    Args:
        model: MuJoCo's model.
        names: names or numbers of the joints in the system's order; the first may be a free joint.
        circular: for each 1-DOF joint, whether q holds its cosine and sine; empty if none does.
        planar: whether the joints are those along x, along y and about z of a body in the plane.

    Attributes:
        reading: index maps for compiled code.
        qpos: (k,) index in qpos of every 1-DOF joint.
        motors: (k,) index in qvel of every 1-DOF joint.
        dof: (n,) indices in qvel, a free joint's first.
    """

    def __init__(
        self,
        model: Any,
        names: Sequence[str | int],
        circular: Sequence[bool] = (),
        planar: bool = False,
    ):
        joints = [model.joint(name) for name in names]
        free = joints[0].type[0] == mujoco.mjtJoint.mjJNT_FREE
        at = (joints[0].qposadr[0], joints[0].dofadr[0]) if free else (-1, -1)
        alone = joints[1:] if free else joints
        self.qpos = np.array([joint.qposadr[0] for joint in alone], dtype=int)
        self.motors = np.array([joint.dofadr[0] for joint in alone], dtype=int)
        self.dof = np.r_[at[1] + np.arange(6 if free else 0), self.motors].astype(int)
        circles = np.array(circular or np.zeros(len(alone)), dtype=int)
        places = (7 if free else 0) + np.cumsum(1 + circles) - (1 + circles)
        rows = np.column_stack([self.qpos, self.motors, places, circles]).astype(np.int64)
        group = 6 if free else 3 if planar else 0
        self.reading = Reading(group, np.array(at, dtype=np.int64), np.ascontiguousarray(rows))

    def read(self, data: Any) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) velocities."""
        numbers, velocity = np.empty((2, len(self.dof)))
        read_coordinates(self.reading, data.qpos, data.qvel, numbers, velocity)
        return numbers, velocity

    def angles(self, states: Array) -> Array:
        """(..., k) position numbers of the 1-DOF joints in full physics states (..., s)."""
        return states[..., 1 + self.qpos]  # after the time

    def write(self, data: Any, numbers: Array, velocity: Array) -> None:
        """Sets qpos and qvel from position numbers (n,) and velocities (n,)."""
        at = self.reading.free[0]
        first = 6 if at >= 0 else 0
        if first:
            x, y, z, w = quaternion_of(np.asarray(numbers[3:6], dtype=np.float64))
            data.qpos[at : at + 7] = [*numbers[:3], w, x, y, z]
        data.qpos[self.qpos] = numbers[first:]
        data.qvel[self.dof] = self._from_base(data, velocity)

    def place(self, data: Any, q: Array) -> None:
        """Sets qpos from the system's position q (m,)."""
        at = self.reading.free[0]
        if at >= 0:
            data.qpos[at : at + 7] = [*q[:3], q[6], *q[3:6]]
        for joint, _, to, circle in self.reading.joints:
            data.qpos[joint] = np.arctan2(q[to + 1], q[to]) if circle else q[to]

    def mass_matrix(self, model: Any, data: Any) -> Array:
        """(n, n) T M Tᵀ, MuJoCo's M at its current state, for the system's v."""
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        half = self._into_base(data, full[np.ix_(self.dof, self.dof)])
        return self._into_base(data, half.T)

    def bias(self, model: Any, data: Any) -> Array:
        """(n,) MuJoCo's Coriolis, centrifugal and gravity forces, for the system's v."""
        own = self._into_base(data, data.qfrc_bias[self.dof])
        return own + self.mass_matrix(model, data) @ self._turning(data)

    def inverse_dynamics(self, model: Any, data: Any, q: Array, v: Array, a: Array) -> Array:
        """(n,) forces that MuJoCo's inverse dynamics require of a motion, for the system's v.

        q (m,) is the system's position, v (n,) and a (n,) are its v and v̇.
        """
        self.place(data, q)
        data.qvel[self.dof] = self._from_base(data, v)
        data.qacc[:] = 0.0
        data.qacc[self.dof] = self._from_base(data, a + self._turning(data))
        mujoco.mj_inverse(model, data)
        return self._into_base(data, data.qfrc_inverse[self.dof])

    def acceleration(self, data: Any) -> Array:
        """(n,) time derivative of the system's v, from MuJoCo's current qacc."""
        return self._into_base(data, data.qacc[self.dof]) - self._turning(data)

    def _axes(self, data: Any) -> Array:
        """(s, s) R; s is 3, 2 in the plane, 0 on a fixed base."""
        if self.reading.group == 6:
            at = self.reading.free[0]
            return rotation(np.roll(data.qpos[at + 3 : at + 7], -1))
        if self.reading.group == 3:
            c = np.cos(data.qpos[self.qpos[2]])
            s = np.sin(data.qpos[self.qpos[2]])
            return np.array([[c, -s], [s, c]])
        return np.zeros((0, 0))

    def _into_base(self, data: Any, rows: Array) -> Array:
        """T times rows (n, ...)."""
        R = self._axes(data)
        turned = rows.copy()
        turned[: len(R)] = R.T @ rows[: len(R)]
        return turned

    def _from_base(self, data: Any, v: Array) -> Array:
        """T⁻¹ v, of v (n,)."""
        R = self._axes(data)
        turned = np.array(v, dtype=np.float64)
        turned[: len(R)] = R @ turned[: len(R)]
        return turned

    def _turning(self, data: Any) -> Array:
        """(n,) [ω × v_base, 0]."""
        v = self._into_base(data, data.qvel[self.dof])
        found = np.zeros(len(self.dof))
        if self.reading.group == 6:
            found[:3] = np.cross(v[3:6], v[:3])
        elif self.reading.group == 3:
            found[:2] = -v[2] * v[1], v[2] * v[0]
        return found


class LevelMap:
    """Maps a free joint's horizontal motion, x, y, ψ and u, v, r, to and from qpos and qvel.

    ψ is the heading of the body's x-axis projected on the ground. Height, pitch and roll are
    ignored when reading.
    """

    def __init__(self, model: Any, joint: str):
        at = model.joint(joint).qposadr[0]
        dof = model.joint(joint).dofadr[0]
        self._pose, self._twist = slice(at, at + 7), slice(dof, dof + 6)

    def read(self, data: Any) -> tuple[Array, Array]:
        """(3,) x, y [m], ψ [rad] and (3,) velocities along and across the heading [m/s], ψ̇."""
        pose = data.qpos[self._pose]
        qvel = data.qvel[self._twist]
        return _seen_from_above(pose, qvel)

    def write(self, data: Any, numbers: Array, twist: Array) -> None:
        """Sets x, y, ψ (3,) and a horizontal twist (3,), at the same height, level."""
        c = np.cos(numbers[2] / 2)
        s = np.sin(numbers[2] / 2)
        height = data.qpos[self._pose][2]
        data.qpos[self._pose] = [*numbers[:2], height, c, 0.0, 0.0, s]
        c = np.cos(numbers[2])
        s = np.sin(numbers[2])
        u, v, r = twist
        data.qvel[self._twist] = [c * u - s * v, s * u + c * v, 0.0, 0.0, 0.0, r]


@kernel()
def _seen_from_above(pose, qvel):
    """Position and velocity as `LevelMap.read` returns them, from qpos (7,) and qvel (6,)."""
    attitude = (pose[4], pose[5], pose[6], pose[3])
    ahead = rotate(attitude, (1.0, 0.0, 0.0))
    omega = rotate(attitude, qvel[3:])
    x = omega[1] * ahead[2] - omega[2] * ahead[1]  # of ω × ahead
    y = omega[2] * ahead[0] - omega[0] * ahead[2]
    length = np.hypot(ahead[0], ahead[1])
    c = ahead[0] / length
    s = ahead[1] / length
    yaw_rate = (ahead[0] * y - ahead[1] * x) / length**2
    numbers = np.array([pose[0], pose[1], np.arctan2(s, c)])
    return numbers, np.array([c * qvel[0] + s * qvel[1], c * qvel[1] - s * qvel[0], yaw_rate])
