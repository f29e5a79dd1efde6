"""A structure's regressors and dynamics at one sample, with memory made for every call."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from nsaid_mj.core.parameters import Array, Block, ParameterSpace
from nsaid_mj.core.structure.derivatives import linearise
from nsaid_mj.core.structure.forces import ALL, write_forces
from nsaid_mj.core.structure.forward_dynamics import stage
from nsaid_mj.core.structure.kinematics import place
from nsaid_mj.core.structure.structure import Structure
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.core.structure.touching import Touch
from tests.support.dense import transport


class Stage(NamedTuple):
    """What a law needs at one instant: (n,) â of (29), (p,) Wᵀ Δv, and M̂'s smallest pivot."""

    a: Array
    gradient: Array
    pivot: float


class Nameless(SecondOrderSystem):
    """A structure as a system, its parameters called 0, 1, …"""

    def __init__(self, structure: Structure):
        p = structure.p
        names = tuple(map(str, range(p)))
        super().__init__(structure, ParameterSpace((Block("all", names, ("1",) * p, np.ones(p)),)))

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        raise NotImplementedError


class Evaluation:
    """Evaluates a structure."""

    def __init__(self, structure: Structure):
        self.structure, self.arrays, self.system = structure, structure.arrays, Nameless(structure)
        self.W_M, self.W_C = self.system._W_M, self.system._W_C
        self.mass_tensor = self.system._mass_tensor
        self.transport = partial(transport, self.system)
        self.integrate, self.difference = self.system.integrate, self.system.difference

    def regressor(self, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        """(n, p) W of (10)."""
        return self.system._W(0.0, q, v, w, a, u)

    def F(self, q: Array, v: Array, u: Array) -> Array:
        """(n, p) force regressor of (4)."""
        return self.system._F(0.0, q, v, u)

    def evaluate(self, q: Array, v: Array, u: Array, w: Array, theta: Array):
        """â, W and M̂'s smallest pivot."""
        return self.system.evaluate_at(0.0, q, v, u, w, theta)

    def mass_matrix(self, q: Array, theta: Array) -> Array:
        """(n, n) M(q, θ)."""
        return self.mass_tensor(q) @ theta

    def coriolis_matrix(self, q: Array, v: Array, theta: Array) -> Array:
        """(n, n) C(q, v, θ)."""
        return np.stack([self.W_C(q, v, e) @ theta for e in np.eye(self.structure.n)], axis=1)

    def stage(self, q: Array, v: Array, w: Array, u: Array, theta: Array) -> Stage:
        """â of (29), Wᵀ Δv and M̂'s smallest pivot."""
        s = self.structure
        (work, slopes), F = s.memory(), np.zeros(len(s.arrays.nonzeros))
        state = slopes.state
        a, gradient = np.zeros(s.n), np.zeros(s.p)
        place(s.arrays, q, v, state)
        write_forces(s.arrays, state, q, v, u, ALL, work.scratch, F)
        return Stage(a, gradient, stage(s.arrays, state, v, F, w, theta, work, a, gradient))

    def linearise(
        self, q: Array, v: Array, u: Array, theta: Array, scale: Array
    ) -> tuple[Array, Array, Array]:
        """v̇ (n,), its derivatives by q and v (n, 2n), and those by θ/scale (n, p)."""
        s = self.structure
        (work, slopes), a, B = s.memory(), np.zeros(s.n), np.zeros((s.n, s.p))
        linearise(s.arrays, q, v, u, theta, scale, work, slopes, a, B, v[:0], Touch.of(0, s.n))
        return a, slopes.by_state, B
