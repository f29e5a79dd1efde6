"""Systems whose equations are those of a `Structure`, evaluated by its kernels."""

from functools import cached_property

import numpy as np

from ..log import Log
from ..parameters import Array
from .arrays import FALL, FRAME, StructureArrays
from .configuration import plain
from .kinematics import place
from .motion import Motion, balance
from .system import SecondOrderSystem


class StructuredSystem(SecondOrderSystem):
    """A robot whose equations are data; a subclass supplies `random_state`."""

    @cached_property
    def forward(self) -> StructureArrays:
        """The structure, for compiled simulation."""
        return self.structure.arrays

    def _regressors(
        self, q: Array, v: Array, u: Array, w: Array, a: Array, weight: float = 1.0
    ) -> Array:
        return self._own_regressors(q, v, u, w, a, weight)

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

    def motion(self, log: Log, hermite: bool) -> Motion:
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
