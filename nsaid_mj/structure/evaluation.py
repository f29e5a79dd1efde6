"""A structure's regressors and dynamics at one sample, for Python: numpy in, new arrays out."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np

from .arrays import FALL, FRAME, Array
from .forces import ALL, write_forces
from .kinematics import place
from .motion import accelerate_at, along, balance, between
from .poses import difference, integrate
from .regressor import write_regressors
from .slopes import linearise
from .stage import stage
from .structure import Structure


class Stage(NamedTuple):
    """What a law needs at one instant.

    Attributes:
        a: (n,) acceleration v̇(t, x, w, θ̂) of (29).
        gradient: (p,) Wᵀ Δv.
        pivot: smallest pivot of M̂, > 0 where it is positive definite; else the rest is void.
    """

    a: Array
    gradient: Array
    pivot: float


class _Memory(threading.local):
    """The workspaces of each thread."""

    def __init__(self, structure: Structure):
        self.work, self.state = structure.workspace(), np.zeros(structure.state_size)
        self.slopes = structure.slopes()


class Evaluation:
    """Evaluates a structure.

    Args:
        structure: the robot.
    """

    def __init__(self, structure: Structure):
        self.structure, self.arrays = structure, structure.arrays
        self._memory, self._still = _Memory(structure), np.zeros((1, structure.n))
        self._none = np.zeros(len(self.arrays.nonzeros))

    def __reduce__(self) -> tuple[type[Evaluation], tuple[Structure]]:
        return Evaluation, (self.structure,)  # another process has threads of its own

    def _regressors(self, q: Array, v: Array, u: Array, w: Array, a: Array, weight: float) -> Array:
        """(N, n, p) W of N samples; see `regressor.write_regressors`."""
        W, own = np.empty((len(q), self.structure.n, self.structure.p)), self._memory
        F = self._none.copy()
        write_regressors(self.arrays, q, v, u, w, a, weight, own.state, F, own.work, W)
        return W

    def _plain(self, q: Array, v: Array, w: Array, a: Array) -> Array:
        """(N, n, p) W without F and weight for N of v, w and a (N, n) at q (m,)."""
        commands = np.empty((len(v), self.structure.n_u))
        return self._regressors(np.tile(q, (len(v), 1)), v, commands, w, a, 0.0)

    def regressor(self, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        """(n, p) combined regressor W = W_M + W_C − F of (10)."""
        return self._regressors(q[None], v[None], u[None], w[None], a[None], 1.0)[0]

    def W_M(self, q: Array, a: Array) -> Array:
        """(n, p) with W_M θ = M(q, θ) a (8)."""
        return self._plain(q, self._still, self._still, a[None])[0]

    def mass_tensor(self, q: Array) -> Array:
        """(n, n, p), entry [j] is W_M(q, e_j)."""
        still = np.zeros((self.structure.n, self.structure.n))
        return self._plain(q, still, still, np.eye(self.structure.n))

    def W_C(self, q: Array, v: Array, w: Array) -> Array:
        """(n, p) with W_C θ = C(q, v, θ) w (9)."""
        return self._plain(q, v[None], w[None], self._still)[0]

    def F(self, q: Array, v: Array, u: Array) -> Array:
        """(n, p) force regressor of (4), with the weight of rigid bodies."""
        return self.forces(q[None], v[None], u[None])[0]

    def forces(self, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples q (N, m), v (N, n), u (N, n_u): −W without motion."""
        still = np.zeros(v.shape)
        return -self._regressors(q, v, u, still, still, 1.0)

    def transport(self, q: Array, v: Array) -> Array:
        """(n, p) regressor of Cᵀ v."""
        size = self.structure.n, self.structure.p
        place(self.arrays, q, v, self._memory.state)
        fall = (len(self.structure.bodies) + size[0]) * FRAME + FALL
        self._memory.state[fall : fall + 3] = 0.0  # without weight
        terms, none, F = np.zeros((2, *size)), np.empty((0, *size)), np.empty((3, 0, 0))
        empty, out = np.empty((0, 0)), np.empty(size)
        balance(
            self.arrays, 0.0, v[None], empty, self._memory.state[None], empty, F,
            self._memory.work, out, terms[0], terms[1:], none, none, none,
        )  # fmt: skip
        return out

    def evaluate(
        self, q: Array, v: Array, u: Array, w: Array, theta: Array
    ) -> tuple[Array, Array, float]:
        """â of (29), W of (10) and M̂'s smallest pivot.

        If M̂ is not positive definite, â is NaN and W that of â = 0.
        """
        a, pivot = self.acceleration(q, v, u, w, theta)
        return a, self.regressor(q, v, w, a if pivot > 0 else self._still[0], u), pivot

    def acceleration(
        self, q: Array, v: Array, u: Array, w: Array, theta: Array
    ) -> tuple[Array, float]:
        """â of (29) and M̂'s smallest pivot; â is NaN if M̂ is not positive definite."""
        a, own, F = np.empty(self.structure.n), self._memory, self._none.copy()
        pivot = accelerate_at(self.arrays, q, v, u, w, theta, own.state, F, own.work, a)
        if not pivot > 0:
            a[:] = np.nan
        return a, pivot

    def midpoints(self, hermite: bool, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """(N−1, m) and (N−1, n) states half-way between N samples; see `motion.between`."""
        qm, vm = np.empty((len(t) - 1, self.structure.m)), np.empty((len(t) - 1, self.structure.n))
        between(self.arrays, hermite, t, q, v, self._memory.work, qm, vm)
        return qm, vm

    def along(
        self, q: Array, v: Array, qm: Array, vm: Array, u: Array
    ) -> tuple[Array, Array, Array]:
        """States at N samples and half-way, and F; see `motion.along`."""
        size = len(self._memory.state)
        states, middles = np.empty((len(q), size)), np.empty((len(qm), size))
        F = np.empty((3, len(qm), len(self._none)))
        along(self.arrays, q, v, qm, vm, u, self._memory.work, states, middles, F)
        return states, middles, F

    def balance(
        self, leak: float, v: Array, vm: Array, along: tuple[Array, Array, Array]
    ) -> tuple[Array, Array, Array, Array]:
        """The momentum balance's terms, from velocities and the result of `along`."""
        size = self.structure.n, self.structure.p
        momenta, spare = np.empty((len(v), *size)), np.empty((2, *size))
        terms = np.empty((3, len(vm), *size))
        balance(self.arrays, leak, v, vm, *along, self._memory.work, *spare, momenta, *terms)
        return momenta, terms[0], terms[1], terms[2]

    def mass_matrix(self, q: Array, theta: Array) -> Array:
        """(n, n) M(q, θ)."""
        return self.mass_tensor(q) @ theta

    def coriolis_matrix(self, q: Array, v: Array, theta: Array) -> Array:
        """(n, n) C(q, v, θ)."""
        unit, size = np.eye(self.structure.n), (self.structure.n, 1)
        tensor = self._plain(q, np.tile(v, size), unit, np.zeros(unit.shape))
        return (tensor @ theta).T

    def stage(self, q: Array, v: Array, w: Array, u: Array, theta: Array) -> Stage:
        """â of (29), Wᵀ Δv and M̂'s smallest pivot."""
        a, gradient = np.zeros(self.structure.n), np.zeros(self.structure.p)
        F, state, work = self._none.copy(), self._memory.state, self._memory.work
        place(self.arrays, q, v, state)
        write_forces(self.arrays, state, q, v, u, ALL, work.scratch, F)
        pivot = stage(self.arrays, state, v, F, w, theta, work, a, gradient)
        return Stage(a, gradient, pivot)

    def linearise(
        self, q: Array, v: Array, u: Array, theta: Array, scale: Array
    ) -> tuple[Array, Array, Array]:
        """v̇ (n,), its derivatives by q and v (n, 2n), and those by θ/scale (n, p)."""
        a, B = np.zeros(self.structure.n), np.zeros((self.structure.n, self.structure.p))
        linearise(self.arrays, q, v, u, theta, scale, self._memory.work, self._memory.slopes, a, B)
        return a, self._memory.slopes.by_state.copy(), B

    def integrate(self, q: Array, step: Array) -> Array:
        """(m,) the position reached from q by a tangent step (n,)."""
        out = np.empty(self.structure.m)
        integrate(self.arrays.bodies, q, step, out, self._memory.work.scratch)
        return out

    def difference(self, q0: Array, q1: Array) -> Array:
        """(n,) the tangent step that leads from q0 to q1."""
        step = np.empty(self.structure.n)
        difference(self.arrays.bodies, q0, q1, step, self._memory.work.scratch)
        return step
