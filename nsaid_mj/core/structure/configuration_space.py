"""The configuration space of a `Structure`: positions, tangent steps, and motions along a log."""

from __future__ import annotations

import threading

import numpy as np

from ..log import Log, Middle
from ..numerics.spatial import pose_jacobian, quaternion_of
from ..parameters import Array
from .arrays import CIRCLE, FREE, PLANAR
from .motion import between
from .parts import Column
from .poses import difference, integrate, write_moves
from .structure import Structure

SPATIAL_UNITS = ("m/s",) * 3 + ("rad/s",) * 3
UNITS = {
    "fixed": (),
    "free": SPATIAL_UNITS,
    "planar": ("m/s", "m/s", "rad/s"),
    "hinge": ("rad/s",),
    "slide": ("m/s",),
    "circle": ("rad/s",),
}
"""Units of the velocities of each kind of joint."""

_CACHED = 2**16  # numbers of the states of a motion that stay in a processor's cache


class _ThreadWorkspace(threading.local):
    """The workspaces of each thread."""

    def __init__(self, structure: Structure):
        self.structure, (self.work, own) = structure, structure.memory()
        self.state = own.state
        self.F = own.F

    def __reduce__(self) -> tuple[type[_ThreadWorkspace], tuple[Structure]]:
        return _ThreadWorkspace, (self.structure,)  # another process has threads of its own


class StructuredKinematics:
    """The kinematics of a structure.

    Position coordinates of a free flyer are [p, rotation vector] (6,), of any other joint its
    position or angle.

    Attributes:
        velocity_units: one SI unit for each velocity.
        group: number of leading velocities that form a body twist: 6 in space, 3 in the plane, 0
            if all velocities are rates of coordinates. See `numerics.spatial`.
        motion_steps: time steps whose motion is in memory at once.
    """

    def __init__(self, structure: Structure):
        self.structure = structure
        self.group = structure.group
        self.n = structure.n
        self.m = structure.m
        self.n_u = structure.n_u
        self.velocity_units: tuple[str, ...] = sum((UNITS[b.joint] for b in structure.bodies), ())
        self._memory, self._still = _ThreadWorkspace(structure), np.zeros(structure.n)
        self.motion_steps = max(64, min(500, _CACHED // len(self._memory.state)))

    def columns(self, kind: str) -> list[Column]:
        """The columns of a kind, in order."""
        return [column for column in self.structure.columns if column.kind == kind]

    def midpoints(self, log: Log, hermite: bool) -> Middle:
        """The states half-way between a log's samples.

        `hermite` interpolates positions and velocities by cubics; else velocities are the mean of
        both, for positions too noisy to differentiate.
        """
        t = plain(log.t)
        q = plain(log.q)
        v = plain(log.v)
        qm = np.empty((len(t) - 1, self.m))
        vm = np.empty((len(t) - 1, self.n))
        between(self.structure.arrays, hermite, t, q, v, self._memory.work, qm, vm)
        return Middle(qm, vm)

    def integrate(self, q: Array, dq: Array) -> Array:
        """(m,) the position reached from q by the tangent step dq (n,)."""
        out = np.empty(self.m)
        x = self._memory.work.scratch
        integrate(self.structure.arrays.bodies, plain(q), plain(dq), out, x)
        return out

    def difference(self, q0: Array, q1: Array) -> Array:
        """(n,) the tangent step that leads from q0 to q1; rotations are the shorter ones."""
        step = np.empty(self.n)
        x = self._memory.work.scratch
        difference(self.structure.arrays.bodies, plain(q0), plain(q1), step, x)
        return step

    def joint_errors(self, q: Array, desired: Array) -> Array:
        """(k,) desired positions (k,) of the joints minus those in q (m,), on the shorter arc."""
        aim = self.position(np.concatenate([np.zeros(self.group), desired]))
        return self.difference(q, aim)[self.group :]

    def moves(self, q: Array) -> Array:
        """(N−1, n) tangent steps between consecutive positions of (N, m)."""
        steps = np.empty((len(q) - 1, self.n))
        x = self._memory.work.scratch
        write_moves(self.structure.arrays.bodies, plain(q), steps, x)
        return steps

    def J(self, q: Array) -> Array:
        """(m, n) matrix of the kinematics q̇ = J v (3)."""
        J = np.zeros((self.m, self.n))
        starts = self.structure.starts
        for kind, at, end in zip(self.structure.kinds, starts, starts[1:], strict=False):
            block = J[at[0] : end[0], at[1] : end[1]]
            own = q[at[0] : end[0]]
            if kind == FREE:
                block[:] = pose_jacobian(plain(own))
            elif kind == CIRCLE:
                block[:, 0] = -own[1], own[0]
            else:
                np.fill_diagonal(block, 1.0)
            if kind == PLANAR:
                c = np.cos(own[2])
                s = np.sin(own[2])
                block[:2, :2] = [[c, -s], [s, c]]
        return J

    def position(self, coordinates: Array) -> Array:
        """(..., m) q of position coordinates (..., n), one per velocity, as sensors give them."""
        coordinates = np.asarray(coordinates, dtype=np.float64)
        if self.m == self.n:
            return coordinates.copy()
        rows = coordinates.reshape(-1, self.n)
        q = np.empty((len(rows), self.m))
        starts = self.structure.starts
        for kind, at, end in zip(self.structure.kinds, starts, starts[1:], strict=False):
            block = q[:, at[0] : end[0]]
            given = rows[:, at[1] : end[1]]
            if kind == FREE:
                block[:, :3] = given[:, :3]
                block[:, 3:] = [quaternion_of(plain(turn)) for turn in given[:, 3:]]
            elif kind == CIRCLE:
                block[:] = np.hstack([np.cos(given), np.sin(given)])
            else:
                block[:] = given
        return q.reshape(*coordinates.shape[:-1], self.m)


def plain(x: Array) -> Array:
    """The numbers as kernels read them: float64, C-contiguous, writable; a copy only if needed."""
    x = np.ascontiguousarray(x, dtype=np.float64)
    return x if x.flags.writeable else x.copy()
