"""Systems whose kinematics, and whose equations too, are those of a `Structure`."""

from __future__ import annotations

import threading
from functools import cached_property

import numpy as np

from ..log import Log, Middle
from ..numerics.spatial import pose_jacobian, quaternion_of
from ..parameters import Array, ParameterSpace
from .arrays import CIRCLE, FALL, FRAME, FREE, PLANAR, StructureArrays
from .kinematics import place
from .motion import accelerate_at, along, balance, between
from .motion_types import StructureMotion
from .parts import Column
from .poses import difference, integrate, write_moves
from .regressor import write_regressors
from .structure import Structure
from .system import SecondOrderSystem

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


class _Memory(threading.local):
    """The workspaces of each thread."""

    def __init__(self, structure: Structure):
        self.structure, self.work = structure, structure.workspace()
        self.state = np.zeros(structure.state_size)
        self.F = np.zeros(len(structure.arrays.nonzeros))

    def __reduce__(self) -> tuple[type[_Memory], tuple[Structure]]:
        return _Memory, (self.structure,)  # another process has threads of its own


class StructuredKinematics(SecondOrderSystem):
    """A robot whose kinematics are those of a structure; a subclass supplies the regressors.

    Position coordinates of a free flyer are [p, rotation vector] (6,), of any other joint its
    position or angle.

    Args:
        structure: the robot.
        space: names, units and scale of θ.
        mounts: (k, 3) point of application of every actuator parameter's force, in the body's
            axes [m]; None if there is nothing to draw.
    """

    def __init__(self, structure: Structure, space: ParameterSpace, mounts: Array | None = None):
        self.structure, self.space, self.mounts = structure, space, mounts
        self.n, self.m, self.n_u = structure.n, structure.m, structure.n_u
        self.group = structure.group
        self.velocity_units = sum((UNITS[body.joint] for body in structure.bodies), ())
        self.motion_steps = max(64, min(500, _CACHED // structure.state_size))
        self._memory, self._still = _Memory(structure), np.zeros(structure.n)

    def columns(self, kind: str) -> list[Column]:
        """The columns of a kind, in order."""
        return [column for column in self.structure.columns if column.kind == kind]

    def midpoints(self, log: Log, hermite: bool) -> Middle:
        """The states half-way between a log's samples."""
        t, q, v = plain(log.t), plain(log.q), plain(log.v)
        qm, vm = np.empty((len(t) - 1, self.m)), np.empty((len(t) - 1, self.n))
        between(self.structure.arrays, hermite, t, q, v, self._memory.work, qm, vm)
        return Middle(qm, vm)

    def _along(
        self, q: Array, v: Array, qm: Array, vm: Array, u: Array
    ) -> tuple[Array, Array, Array]:
        """States at N samples and half-way, and F; see `motion.along`."""
        size, own = len(self._memory.state), self.structure.arrays
        states, middles = np.empty((len(q), size)), np.empty((len(qm), size))
        F = np.empty((3, len(qm), len(own.nonzeros)))
        along(own, q, v, qm, vm, u, self._memory.work, states, middles, F)
        return states, middles, F

    def _own_motion(self, log: Log, hermite: bool) -> tuple[StructureMotion, Array]:
        """The structure's own motion along a log of N samples, and (N−1, m) positions half-way."""
        t, q, v, u = (plain(x) for x in (log.t, log.q, log.v, log.u))
        qm, vm = self.midpoints(log, hermite)
        own = self._along(q, v, qm, vm, u)
        return StructureMotion(self.structure.arrays, t, v, vm, *own), qm

    def stages(
        self, t: Array, q: Array, v: Array, u: Array, w: Array, theta: Array
    ) -> tuple[Array, Array, Array]:
        """(29), (10, 31) and M̂'s pivots; â is the structure's."""
        a, pivots, own = np.empty((len(q), self.n)), np.empty(len(q)), self._memory
        given = map(plain, (q, v, u, w, theta))
        accelerate_at(self.structure.arrays, *given, own.state, own.F, own.work, a, pivots)
        failed = ~(pivots > 0)
        a[failed] = 0.0
        W = self._whole(t, q, v, w, a, u)
        a[failed] = np.nan
        return a, W, pivots

    def integrate(self, q: Array, dq: Array) -> Array:
        """(m,) the position reached from q by the tangent step dq (n,)."""
        out, x = np.empty(self.m), self._memory.work.scratch
        integrate(self.structure.arrays.bodies, plain(q), plain(dq), out, x)
        return out

    def difference(self, q0: Array, q1: Array) -> Array:
        """(n,) the tangent step that leads from q0 to q1; rotations are the shorter ones."""
        step, x = np.empty(self.n), self._memory.work.scratch
        difference(self.structure.arrays.bodies, plain(q0), plain(q1), step, x)
        return step

    def moves(self, q: Array) -> Array:
        """(N−1, n) tangent steps between consecutive positions of (N, m)."""
        steps, x = np.empty((len(q) - 1, self.n)), self._memory.work.scratch
        write_moves(self.structure.arrays.bodies, plain(q), steps, x)
        return steps

    def J(self, q: Array) -> Array:
        """(m, n) matrix of q̇ = J v (3)."""
        J = np.zeros((self.m, self.n))
        for kind, at, end in zip(
            self.structure.kinds, self.structure.starts, self.structure.starts[1:], strict=False
        ):
            block, own = J[at[0] : end[0], at[1] : end[1]], q[at[0] : end[0]]
            if kind == FREE:
                block[:] = pose_jacobian(plain(own))
            elif kind == CIRCLE:
                block[:, 0] = -own[1], own[0]
            else:
                np.fill_diagonal(block, 1.0)
            if kind == PLANAR:
                c, s = np.cos(own[2]), np.sin(own[2])
                block[:2, :2] = [[c, -s], [s, c]]
        return J

    def position(self, coordinates: Array) -> Array:
        """(..., m) q of position coordinates (..., n), one per velocity, as sensors give them."""
        coordinates = np.asarray(coordinates, dtype=np.float64)
        if self.m == self.n:
            return coordinates.copy()
        rows = coordinates.reshape(-1, self.n)
        q, starts = np.empty((len(rows), self.m)), self.structure.starts
        for kind, at, end in zip(self.structure.kinds, starts, starts[1:], strict=False):
            block, given = q[:, at[0] : end[0]], rows[:, at[1] : end[1]]
            if kind == FREE:
                block[:, :3] = given[:, :3]
                block[:, 3:] = [quaternion_of(plain(turn)) for turn in given[:, 3:]]
            elif kind == CIRCLE:
                block[:] = np.hstack([np.cos(given), np.sin(given)])
            else:
                block[:] = given
        return q.reshape(*coordinates.shape[:-1], self.m)


class StructuredSystem(StructuredKinematics):
    """A robot whose equations are data; a subclass supplies `random_state`."""

    @cached_property
    def forward(self) -> StructureArrays:
        """The structure, for compiled simulation."""
        return self.structure.arrays

    def _regressors(
        self, q: Array, v: Array, u: Array, w: Array, a: Array, weight: float = 1.0
    ) -> Array:
        """(N, n, p) W of N samples; see `regressor.write_regressors`."""
        W, own, given = np.empty((len(q), self.n, self.p)), self._memory, (q, v, u, w, a)
        if weight == 0.0:
            own.F[:] = 0.0
        write_regressors(
            self.forward, *map(plain, given), weight, own.state, own.F, own.work, W
        )  # fmt: skip
        return W

    def _moving(self, q: Array, v: Array, w: Array, a: Array) -> Array:
        return self._regressors(q, v, np.zeros((len(q), self.n_u)), w, a, 0.0)

    def _whole(self, t: Array, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return self._regressors(q, v, u, w, a)

    def _W_M(self, q: Array, a: Array) -> Array:
        return self._moving(q[None], self._still[None], self._still[None], a[None])[0]

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        return self._moving(q[None], v[None], w[None], self._still[None])[0]

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        return self.forces(np.array([t]), q[None], v[None], u[None])[0]

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return self._regressors(q[None], v[None], u[None], w[None], a[None])[0]

    def _mass_tensors(self, q: Array) -> Array:
        N, n, still = len(q), self.n, np.zeros((len(q) * self.n, self.n))
        W = self._moving(q.repeat(n, axis=0), still, still, np.tile(np.eye(n), (N, 1)))
        return W.reshape(N, n, n, self.p)

    def _transport(self, q: Array, v: Array) -> Array:
        v, size, own = plain(v), (self.n, self.p), self._memory
        place(self.forward, plain(q), v, own.state)
        fall = (len(self.structure.bodies) + self.n) * FRAME + FALL
        own.state[fall : fall + 3] = 0.0  # without weight
        terms, none, F = np.zeros((2, *size)), np.empty((0, *size)), np.empty((3, 0, 0))
        empty, out = np.empty((0, 0)), np.empty(size)
        balance(
            self.forward, 0.0, v[None], empty, own.state[None], empty, F,
            own.work, out, terms[0], terms[1:], none, none, none,
        )  # fmt: skip
        return out

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples: −W without motion."""
        still = np.zeros(v.shape)
        return -self._regressors(q, v, u, still, still)

    def motion(self, log: Log, hermite: bool) -> StructureMotion:
        """The robot's motion along a log."""
        return self._own_motion(log, hermite)[0]

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance."""
        own, vm, size = plain(log.v), plain(v), (self.n, self.p)
        states = self._along(plain(log.q), own, plain(q), vm, plain(log.u))
        momenta, spare = np.empty((len(own), *size)), np.empty((2, *size))
        terms, work = np.empty((3, len(vm), *size)), self._memory.work
        balance(self.forward, leak, own, vm, *states, work, *spare, momenta, *terms)
        return momenta, terms[0], terms[1], terms[2]


def plain(x: Array) -> Array:
    """The numbers as kernels read them: float64, C-contiguous, writable; a copy only if needed."""
    x = np.ascontiguousarray(x, dtype=np.float64)
    return x if x.flags.writeable else x.copy()
