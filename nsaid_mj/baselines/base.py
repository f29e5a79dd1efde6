"""What a method is: a function from a log, a structure, a prior and stated noise to an estimate."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..errors import InvalidInput
from ..parameters import Array
from ..system import EXACT, Measurement, SecondOrderSystem, SensorLevels


class Log(NamedTuple):
    """What was measured and commanded.

    Attributes:
        t: (N,) times [s], increasing.
        q: (N, m) positions.
        v: (N, n) velocities.
        u: (N, n_u) commands; u[k] is held from t[k] to t[k+1].
    """

    t: Array
    q: Array
    v: Array
    u: Array

    @staticmethod
    def of(measurements: list[Measurement]) -> Log:
        """The log of measurements in order."""
        return Log(*(np.array(part, dtype=np.float64) for part in zip(*measurements, strict=True)))

    def until(self, duration: float) -> Log:
        """The log's first `duration` seconds."""
        end = int(np.searchsorted(self.t, self.t[0] + duration * (1 + 1e-9), side="right"))
        return Log(*(part[:end] for part in self))

    @property
    def step(self) -> float:
        """Time between two samples [s], for methods that need it constant.

        Raises:
            InvalidInput: it is not, within a thousandth.
        """
        steps = np.diff(self.t)
        if len(steps) < 2 or not np.ptp(steps) <= 1e-3 * abs(float(np.median(steps))):
            raise InvalidInput("t", "at least 3 samples at a constant rate", f"{len(self.t)} times",
                               "Resample the log.")  # fmt: skip
        return float((self.t[-1] - self.t[0]) / len(steps))


class Problem(NamedTuple):
    """All that a method may know.

    Attributes:
        system: the structure.
        log: what was measured.
        prior: (p,) θ̂(0).
        noise: what is stated of the sensors.
    """

    system: SecondOrderSystem
    log: Log
    prior: Array
    noise: SensorLevels = EXACT


class Estimate(NamedTuple):
    """What a method has found.

    Attributes:
        theta: (p,) the estimate.
        note: what the method chose by itself, in words.
    """

    theta: Array
    note: str = ""


Method = Callable[[Problem], Estimate]
"""A method raises an `NsaidError` where it finds no estimate."""
