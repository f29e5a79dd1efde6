"""A structure's regressors and dynamics at one sample, for Python: numpy in, new arrays out."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np

from .arrays import FALL, FRAME, Array
from .forces import ALL, write_forces
from .kinematics import place
from .motion import (
    along,
    balance,
    between,
    combine,
    evaluate,
    write_force_regressors,
    write_mass_tensor,
)
from .poses import difference, integrate
from .regressor import write_regressor
from .slopes import linearise
from .stage import accelerate, stage
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
        self._memory, self._still = _Memory(structure), np.zeros(structure.n)
        self._none = np.zeros(len(self.arrays.nonzeros))

    def __reduce__(self) -> tuple[type[Evaluation], tuple[Structure]]:
        return Evaluation, (self.structure,)  # another process has threads of its own

    def _place(self, q: Array, v: Array) -> None:
        place(self.arrays, q, v, self._memory.state)

    def _forces(self, q: Array, v: Array, u: Array) -> Array:
        F = self._none.copy()
        write_forces(self.arrays, self._memory.state, q, v, u, ALL, self._memory.work.scratch, F)
        return F

    def _regressor(self, w: Array, a: Array, weight: float, F: Array) -> Array:
        W = np.empty((self.structure.n, self.structure.p))
        write_regressor(self.arrays, self._memory.state, w, a, weight, F, self._memory.work, W)
        return W

    def regressor(self, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        """(n, p) combined regressor W = W_M + W_C − F of (10)."""
        F, own = self._none.copy(), self._memory
        W = np.empty((self.structure.n, self.structure.p))
        combine(self.arrays, q, v, w, a, u, own.state, F, own.work, W)
        return W

    def W_M(self, q: Array, a: Array) -> Array:
        """(n, p) with W_M θ = M(q, θ) a (8)."""
        self._place(q, self._still)
        return self._regressor(self._still, a, 0.0, self._none)

    def mass_tensor(self, q: Array) -> Array:
        """(n, n, p), entry [j] is W_M(q, e_j)."""
        n, own = self.structure.n, self._memory
        out = np.empty((n, n, self.structure.p))
        write_mass_tensor(self.arrays, q, self._still, own.state, own.work, out)
        return out

    def W_C(self, q: Array, v: Array, w: Array) -> Array:
        """(n, p) with W_C θ = C(q, v, θ) w (9)."""
        self._place(q, v)
        return self._regressor(w, self._still, 0.0, self._none)

    def F(self, q: Array, v: Array, u: Array) -> Array:
        """(n, p) force regressor of (4), with the weight of rigid bodies."""
        return self.forces(q[None], v[None], u[None])[0]

    def forces(self, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples q (N, m), v (N, n), u (N, n_u)."""
        F, out = self._none.copy(), np.empty((*v.shape, self.structure.p))
        write_force_regressors(
            self.arrays, q, v, u, self._memory.state, F, self._still, self._memory.work, out
        )
        return out

    def transport(self, q: Array, v: Array) -> Array:
        """(n, p) regressor of Cᵀ v."""
        size = self.structure.n, self.structure.p
        self._place(q, v)
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
        """â of (29), NaN if M̂ is not positive definite, W of (10), and M̂'s smallest pivot."""
        a, W = np.empty(self.structure.n), np.empty((self.structure.n, self.structure.p))
        F, own = self._none.copy(), self._memory
        pivot = evaluate(self.arrays, q, v, u, w, theta, own.state, F, own.work, a, W)
        return a, W, pivot

    def acceleration(
        self, q: Array, v: Array, u: Array, w: Array, theta: Array
    ) -> tuple[Array, float]:
        """â of (29) and M̂'s smallest pivot; â is NaN if M̂ is not positive definite."""
        self._place(q, v)
        a, own = np.empty(self.structure.n), self._memory
        F = self._forces(q, v, u)
        pivot = accelerate(self.arrays, own.state, F, w, theta, own.work, a)
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
        return np.stack([self.W_C(q, v, e) @ theta for e in np.eye(self.structure.n)], axis=1)

    def stage(self, q: Array, v: Array, w: Array, u: Array, theta: Array) -> Stage:
        """â of (29), Wᵀ Δv and M̂'s smallest pivot."""
        self._place(q, v)
        a, gradient = np.zeros(self.structure.n), np.zeros(self.structure.p)
        F = self._forces(q, v, u)
        pivot = stage(
            self.arrays, self._memory.state, v, F, w, theta, self._memory.work, a, gradient
        )
        return Stage(a, gradient, pivot)

    def linearise(
        self, q: Array, v: Array, u: Array, theta: Array, scale: Array
    ) -> tuple[Array, Array, Array]:
        """v̇ (n,), its derivatives by q and v (n, 2n), and those by θ/scale (n, p)."""
        a, B = np.zeros(self.structure.n), np.zeros((self.structure.n, self.structure.p))
        work, slopes = self._memory.work, self._memory.slopes
        linearise(self.arrays, q, v, u, theta, scale, work, slopes, a, B, v[:0])
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
