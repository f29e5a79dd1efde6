"""Systems defined only by W_M, W_C, F and their kinematics at one sample."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np

from ..log import Log, Middle
from ..numerics.interpolation import half_way
from ..numerics.linalg import evaluate
from ..parameters import Array
from .motion_types import TensorMotion, force_regressors
from .system import SecondOrderSystem

DIFFERENCE = 1e-5
"""Step of central differences along v [s·(1 + |v|)]."""

TENSOR_NUMBERS = 1_000_000
"""How many numbers of the tensors of M and C are in memory at once: they fit the cache."""


class SampledSystem(SecondOrderSystem):
    """A system whose regressors all follow from `_W_M`, `_W_C` and `_F` at one sample."""

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return self._W_M(q, a) + self._W_C(q, v, w) - self._F(t, q, v, u)

    def _moving(self, q: Array, v: Array, w: Array, a: Array) -> Array:
        rows = [self._W_M(q, a) + self._W_C(q, v, w) for q, v, w, a in zip(q, v, w, a, strict=True)]
        return np.array(rows).reshape(-1, self.n, self.p)

    def _whole(self, t: Array, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return self._moving(q, v, w, a) - self.forces(t, q, v, u)

    def _mass_tensors(self, q: Array) -> Array:
        found = [self._W_M(row, e) for row in q for e in np.eye(self.n)]
        return np.array(found).reshape(-1, self.n, self.n, self.p)

    def _transport(self, q: Array, v: Array) -> Array:
        step = DIFFERENCE / (1.0 + float(np.abs(v).max(initial=0.0)))  # Ṁ v to about 1e-10
        ahead, behind = self.integrate(q, step * v), self.integrate(q, -step * v)
        return (self._W_M(ahead, v) - self._W_M(behind, v)) / (2 * step) - self._W_C(q, v, v)

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples."""
        rows = [self._F(*row) for row in zip(t.tolist(), q, v, u, strict=True)]
        return np.array(rows).reshape(-1, self.n, self.p)

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance, sample by sample."""
        return balance_by_sample(self, leak, log, q, v)

    def moves(self, q: Array) -> Array:
        """(N−1, n) tangent steps between consecutive positions of (N, m)."""
        return np.array([self.difference(*pair) for pair in pairwise(q)]).reshape(-1, self.n)


class GeneralSystem(SampledSystem):
    """A system that derives everything else from `_W_M`, `_W_C`, `_F` and its kinematics.

    A subclass supplies these three regressors, `integrate`, `difference`, `J`, `random_state`, and
    the attributes of `SecondOrderSystem`. Position coordinates are the position itself.
    """

    @cached_property
    def motion_steps(self) -> int:
        """Time steps whose motion is in memory at once: a step has four tensors (n, n, p)."""
        return max(1, TENSOR_NUMBERS // (4 * self.n**2 * self.p))

    def stages(
        self, t: Array, q: Array, v: Array, u: Array, w: Array, theta: Array
    ) -> tuple[Array, Array, Array]:
        """The accelerations (29), the regressors (10, 31) and M̂'s smallest pivots."""
        F = self.forces(t, q, v, u)
        a, W, pivots = np.empty(v.shape), np.empty(F.shape), np.empty(len(t))
        for k in range(len(t)):
            M, W_C = self._mass_tensor(q[k]), self._W_C(q[k], v[k], w[k])
            a[k], W[k], pivots[k] = evaluate(M, W_C, F[k], np.ascontiguousarray(theta[k]))
        return a, W, pivots

    def midpoints(self, log: Log, hermite: bool) -> Middle:
        """The states half-way between a log's samples."""
        return midpoints_by_sample(self, log, hermite)

    def motion(self, log: Log, hermite: bool) -> TensorMotion:
        """The tensors of M, C and F along a log."""
        middle = self.midpoints(log, hermite)
        n, p, steps = self.n, self.p, len(log.t) - 1
        M, C = np.empty((2 * steps + 1, n, n, p)), np.empty((2 * steps + 1, n, n, p))
        for first, q, v in ((0, log.q, log.v), (1, *middle)):
            for k in range(len(q)):
                M[first + 2 * k] = self._mass_tensor(q[k])
                C[first + 2 * k] = [self._W_C(q[k], v[k], e) for e in np.eye(n)]
        return TensorMotion(log.t, log.v, middle.v, M, C, force_regressors(self, log, middle))

    def position(self, coordinates: Array) -> Array:
        """(..., m) a copy of the position coordinates (..., n), which are the position."""
        return np.array(coordinates, dtype=np.float64)


# -- any system, from its regressors for one sample ------------------------------------------------


def midpoints_by_sample(system: SecondOrderSystem, log: Log, hermite: bool) -> Middle:
    """The states half-way between a log's samples; see `numerics.interpolation.half_way`."""
    qm, vm = np.empty((len(log.t) - 1, system.m)), np.empty((len(log.t) - 1, system.n))
    for k, dt in enumerate(np.diff(log.t)):
        dq = system.difference(log.q[k], log.q[k + 1])
        half, vm[k] = half_way(dq, log.v[k], log.v[k + 1], dt, hermite, system.group)
        qm[k] = system.integrate(log.q[k], half)
    return Middle(qm, vm)


def balance_by_sample(
    system: SecondOrderSystem, leak: float, log: Log, q: Array, v: Array
) -> tuple[Array, Array, Array, Array]:
    """The four arrays of `SecondOrderSystem.momentum_balance`, sample by sample."""
    t, held = log.t, log.u[:-1]
    momenta = np.stack([system._W_M(*row) for row in zip(log.q, log.v, strict=True)])
    drive = leak * momenta
    drive += np.stack([system._transport(*row) for row in zip(log.q, log.v, strict=True)])
    half = system.forces(0.5 * (t[:-1] + t[1:]), q, v, held)
    half += np.stack(
        [leak * system._W_M(*row) + system._transport(*row) for row in zip(q, v, strict=True)]
    )
    start = drive[:-1] + system.forces(t[:-1], log.q[:-1], log.v[:-1], held)
    end = drive[1:] + system.forces(t[1:], log.q[1:], log.v[1:], held)
    return momenta, start, half, end
