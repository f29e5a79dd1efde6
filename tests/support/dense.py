"""Any system as a `GeneralSystem`, known by its regressors of one sample only."""

from __future__ import annotations

import numpy as np

from nsaid_mj.parameters import Array
from nsaid_mj.structure.general import GeneralSystem
from nsaid_mj.structure.system import SecondOrderSystem


class Dense(GeneralSystem):
    """A system as a `GeneralSystem`: all follows from its W_M, W_C and F for one sample."""

    def __init__(self, system: SecondOrderSystem):
        self.n, self.m, self.n_u, self.space = system.n, system.m, system.n_u, system.space
        self.group, self.velocity_units = system.group, system.velocity_units
        self.inner = system

    def _W_M(self, q: Array, a: Array) -> Array:
        return self.inner._W_M(q, a)

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        return self.inner._W_C(q, v, w)

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        return self.inner._F(t, q, v, u)

    def integrate(self, q: Array, dq: Array) -> Array:
        return self.inner.integrate(q, dq)

    def difference(self, q0: Array, q1: Array) -> Array:
        return self.inner.difference(q0, q1)

    def J(self, q: Array) -> Array:
        return self.inner.J(q)

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        return self.inner.random_state(rng)
