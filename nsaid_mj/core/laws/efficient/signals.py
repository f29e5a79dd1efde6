"""Differences between the signals that act on a robot and those that are recorded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...log import Log
from ...parameters import Array
from ...structure.system import SecondOrderSystem


class Signals(NamedTuple):
    """Differences between the acting and the recorded signals of actuators and sensors."""

    sign: Array  # (n_u,) −1 for a reversed actuator, else 1
    held: Array  # (n_u,) the constant command of a stuck one, else NaN
    bias: Array  # (2n,) constant errors of the sensors of position and velocity

    @staticmethod
    def sound(system: SecondOrderSystem) -> Signals:
        """The signals of a robot with healthy actuators and sensors."""
        n = system.n
        n_u = system.n_u
        return Signals(np.ones(n_u), np.full(n_u, np.nan), np.zeros(2 * n))

    @property
    def as_recorded(self) -> bool:
        """Whether no failed actuator is known."""
        return bool((self.sign == 1).all() and np.isnan(self.held).all())

    def acting(self, system: SecondOrderSystem, log: Log) -> Log:
        """The log with the acting commands, and with sensor biases removed."""
        t, q, v, u = log
        if not self.as_recorded:
            u = np.where(np.isnan(self.held), self.sign * u, self.held)
        place, rate = np.split(self.bias, 2)
        if place.any():
            q = np.array([system.displaced(one, -place) for one in q])
        if rate.any():
            v = v - rate
        return Log.unchecked(t, q, v, u)

    def biased(self, channel: int, by: float) -> Signals:
        """These signals, with a larger error of one sensor."""
        bias = self.bias.copy()
        bias[channel] += by
        return self._replace(bias=bias)
