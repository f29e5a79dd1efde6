"""Systems whose kinematics, and whose equations too, are those of a `Structure`."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..log import Log, Middle
from ..numerics.spatial import pose_jacobian, quaternion_of
from ..parameters import Array, ParameterSpace
from ..system import SecondOrderSystem, Stage
from .arrays import CIRCLE, FREE, PLANAR, StructureArrays
from .evaluation import Evaluation
from .motion_types import StructureMotion
from .parts import Column
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

    @cached_property
    def _own(self) -> Evaluation:
        return Evaluation(self.structure)

    def columns(self, kind: str) -> list[Column]:
        """The columns of a kind, in order."""
        return [column for column in self.structure.columns if column.kind == kind]

    def midpoints(self, log: Log, hermite: bool) -> Middle:
        """The states half-way between a log's samples."""
        return Middle(*self._own.midpoints(hermite, plain(log.t), plain(log.q), plain(log.v)))

    def _own_motion(self, log: Log, hermite: bool) -> tuple[StructureMotion, Array]:
        """The structure's own motion along a log of N samples, and (N−1, m) positions half-way."""
        t, q, v, u = (plain(x) for x in (log.t, log.q, log.v, log.u))
        qm, vm = self._own.midpoints(hermite, t, q, v)
        along = self._own.along(q, v, qm, vm, u)
        return StructureMotion(self.structure.arrays, t, v, vm, *along), qm

    def integrate(self, q: Array, dq: Array) -> Array:
        """(m,) the position reached from q by the tangent step dq (n,)."""
        return self._own.integrate(plain(q), plain(dq))

    def difference(self, q0: Array, q1: Array) -> Array:
        """(n,) the tangent step that leads from q0 to q1; rotations are the shorter ones."""
        return self._own.difference(plain(q0), plain(q1))

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

    def _W_M(self, q: Array, a: Array) -> Array:
        return self._own.W_M(plain(q), plain(a))

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        return self._own.W_C(plain(q), plain(v), plain(w))

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        return self._own.F(plain(q), plain(v), plain(u))

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return self._own.regressor(plain(q), plain(v), plain(w), plain(a), plain(u))

    def _mass_tensor(self, q: Array) -> Array:
        return self._own.mass_tensor(plain(q))

    def _transport(self, q: Array, v: Array) -> Array:
        return self._own.transport(plain(q), plain(v))

    def evaluate_at(self, t: float, q: Array, v: Array, u: Array, w: Array, theta: Array) -> Stage:
        """(29), (10, 31) and M̂'s pivot at one sample."""
        return Stage(*self._own.evaluate(plain(q), plain(v), plain(u), plain(w), plain(theta)))

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples."""
        return self._own.forces(plain(q), plain(v), plain(u))

    def motion(self, log: Log, hermite: bool) -> StructureMotion:
        """The robot's motion along a log."""
        return self._own_motion(log, hermite)[0]

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance."""
        own, vm = plain(log.v), plain(v)
        states = self._own.along(plain(log.q), own, plain(q), vm, plain(log.u))
        return self._own.balance(leak, own, vm, states)


def plain(x: Array) -> Array:
    """The numbers as kernels read them: float64, C-contiguous, writable; a copy only if needed."""
    x = np.ascontiguousarray(x, dtype=np.float64)
    return x if x.flags.writeable else x.copy()
