"""Known faults of actuators and sensors: differences between acting and recorded signals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ....log import Log
from ....parameters import Array
from ....structure.sensing import displaced
from ....structure.system import SecondOrderSystem, gains_by_command
from ...faults import FaultEvent
from .hypotheses import Hypothesis


class Signals(NamedTuple):
    """Differences between the acting and the recorded signals of actuators and sensors."""

    sign: Array  # (n_u,) −1 for a reversed actuator, else 1
    held: Array  # (n_u,) the constant command of a stuck one, else NaN
    bias: Array  # (2n,) constant errors of the sensors of position and velocity

    @staticmethod
    def sound(system: SecondOrderSystem) -> Signals:
        """The signals of a robot with healthy actuators and sensors."""
        n, n_u = system.n, system.n_u
        return Signals(np.ones(n_u), np.full(n_u, np.nan), np.zeros(2 * n))

    @staticmethod
    def after(system: SecondOrderSystem, events: Sequence[FaultEvent]) -> Signals:
        """The signals that some faults imply."""
        sign, held, bias = Signals.sound(system)
        commands = {
            tuple(system.space.names[i] for i in k): command
            for command, k in enumerate(gains_by_command(system))
        }
        for event in events:
            command = commands.get(tuple(event.names), -1)
            if event.kind == "bias":
                sensor, _, number = event.names[0].partition(" ")
                bias[(sensor == "velocity") * system.n + int(number) - 1] = event.size
            elif event.kind == "reversed" and command >= 0:
                sign[command] = -sign[command]
            elif event.kind in {"broken", "stuck"} and command >= 0:
                held[command] = event.size if event.kind == "stuck" else 0.0
        return Signals(sign, held, bias)

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
            q = np.array([displaced(system, one, -place) for one in q])
        if rate.any():
            v = v - rate
        return Log.unchecked(t, q, v, u)

    def under(self, hypothesis: Hypothesis) -> Signals:
        """These signals, with those of a failed actuator under a hypothesis."""
        sign, held, k = self.sign.copy(), self.held.copy(), hypothesis.command
        if hypothesis.kind == "sound":
            sign[k], held[k] = 1.0, np.nan
        elif hypothesis.kind == "reversed":
            sign[k], held[k] = -sign[k], np.nan
        elif k >= 0:
            held[k] = hypothesis.held
        return self._replace(sign=sign, held=held)

    def biased(self, channel: int, by: float) -> Signals:
        """These signals, with a larger error of one sensor."""
        bias = self.bias.copy()
        bias[channel] += by
        return self._replace(bias=bias)
