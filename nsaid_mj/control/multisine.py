"""Open-loop multisine commands."""

from __future__ import annotations

import numpy as np

from ..bounds import Positive, Tones, config
from ..parameters import Array
from ..system import SecondOrderSystem
from .driver import Driver, DriverConfig
from .signals import Multisine


@config
class MultisineCommand(DriverConfig):
    """Every actuator follows its own multisine, from rest.

    Attributes:
        low: lowest frequency [Hz].
        high: highest frequency [Hz].
        tones: number of sines in each command.
        amplitude: bound on each command.
    """

    low: Positive = 0.05
    high: Positive = 0.5
    tones: Tones = 8
    amplitude: Positive = 0.8

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver."""
        signal = Multisine(system.n_u, self.low, self.high, self.tones, self.amplitude, rng)
        return _MultisineDriver(system.n, signal)


class _MultisineDriver(Driver):
    """Plays a multisine in open loop, from rest."""

    def __init__(self, n: int, signal: Multisine):
        self._n, self._signal = n, signal

    def start(self) -> tuple[Array, Array]:
        return np.zeros(self._n), np.zeros(self._n)

    def command(self, t: float, q: Array, v: Array) -> Array:
        return self._signal(t)

    def compiled(self, t: Array) -> Array:
        return self._signal(t)
