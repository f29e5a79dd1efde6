"""A structure's regressors and dynamics at one sample, for Python: numpy in, new arrays out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arrays import Array
from .forces import write_forces
from .kinematics import place
from .poses import difference, integrate
from .regressor import write_regressor
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


class Evaluation:
    """Evaluates a structure; not for several threads at once.

    Args:
        structure: the robot.
    """

    def __init__(self, structure: Structure):
        self.structure, self.arrays = structure, structure.arrays
        self._work, self._state = structure.workspace(), structure.state()
        self._slopes, self._still = structure.slopes(), np.zeros(structure.n)
        self._none = np.zeros(len(self.arrays.nonzeros))

    def _place(self, q: Array, v: Array) -> None:
        place(self.arrays, q, v, self._state)

    def _forces(self, q: Array, v: Array, u: Array) -> Array:
        F = self._none.copy()
        write_forces(self.arrays, self._state, q, v, u, True, self._work.scratch, F)
        return F

    def _regressor(self, w: Array, a: Array, weight: float, F: Array) -> Array:
        W = np.empty((self.structure.n, self.structure.p))
        write_regressor(self.arrays, self._state, w, a, weight, F, self._work, W)
        return W

    def regressor(self, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        """(n, p) combined regressor W = W_M + W_C − F of (10)."""
        self._place(q, v)
        return self._regressor(w, a, 1.0, self._forces(q, v, u))

    def W_M(self, q: Array, a: Array) -> Array:
        """(n, p) with W_M θ = M(q, θ) a (8)."""
        self._place(q, self._still)
        return self._regressor(self._still, a, 0.0, self._none)

    def W_C(self, q: Array, v: Array, w: Array) -> Array:
        """(n, p) with W_C θ = C(q, v, θ) w (9)."""
        self._place(q, v)
        return self._regressor(w, self._still, 0.0, self._none)

    def F(self, q: Array, v: Array, u: Array) -> Array:
        """(n, p) force regressor of (4), with the weight of rigid bodies."""
        self._place(q, v)
        columns = np.zeros((self.structure.n, self.structure.p))
        np.add.at(columns, tuple(self.arrays.nonzeros.T), self._forces(q, v, u))
        self._place(q, self._still)
        return columns - self._regressor(self._still, self._still, 1.0, self._none)

    def mass_matrix(self, q: Array, theta: Array) -> Array:
        """(n, n) M(q, θ)."""
        return np.stack([self.W_M(q, e) @ theta for e in np.eye(self.structure.n)], axis=1)

    def coriolis_matrix(self, q: Array, v: Array, theta: Array) -> Array:
        """(n, n) C(q, v, θ)."""
        return np.stack([self.W_C(q, v, e) @ theta for e in np.eye(self.structure.n)], axis=1)

    def stage(self, q: Array, v: Array, w: Array, u: Array, theta: Array) -> Stage:
        """â of (29), Wᵀ Δv and M̂'s smallest pivot."""
        self._place(q, v)
        a, gradient = np.zeros(self.structure.n), np.zeros(self.structure.p)
        F = self._forces(q, v, u)
        pivot = stage(self.arrays, self._state, v, F, w, theta, self._work, a, gradient)
        return Stage(a, gradient, pivot)

    def linearise(
        self, q: Array, v: Array, u: Array, theta: Array, scale: Array
    ) -> tuple[Array, Array, Array]:
        """v̇ (n,), its derivatives by q and v (n, 2n), and those by θ/scale (n, p)."""
        a, B = np.zeros(self.structure.n), np.zeros((self.structure.n, self.structure.p))
        linearise(self.arrays, q, v, u, theta, scale, self._work, self._slopes, a, B)
        return a, self._slopes.by_state.copy(), B

    def integrate(self, q: Array, step: Array) -> Array:
        """(m,) the position reached from q by a tangent step (n,)."""
        out = np.empty(self.structure.m)
        integrate(self.arrays.bodies, q, step, out, self._work.scratch)
        return out

    def difference(self, q0: Array, q1: Array) -> Array:
        """(n,) the tangent step that leads from q0 to q1."""
        step = np.empty(self.structure.n)
        difference(self.arrays.bodies, q0, q1, step, self._work.scratch)
        return step
