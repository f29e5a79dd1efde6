"""What is measured and commanded: one sample, a log of samples, and how noisy the sensors are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .errors import InvalidInput
from .parameters import Array


class Measurement(NamedTuple):
    """All an identifier ever sees, in the system's own coordinates.

    Attributes:
        t: time [s].
        q: (m,) position.
        v: (n,) velocity.
        u: (n_u,) command, held from t until the next measurement.
    """

    t: float
    q: Array
    v: Array
    u: Array


class Log(NamedTuple):
    """What was measured and commanded, in order.

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
    def of(measurements: Sequence[Measurement]) -> Log:
        """The log of one or more measurements in order."""
        return Log(*(np.array(part, dtype=np.float64) for part in zip(*measurements, strict=True)))

    def at(self, k: int) -> Measurement:
        """The k-th measurement."""
        return Measurement(float(self.t[k]), self.q[k], self.v[k], self.u[k])

    @property
    def rows(self) -> list[Measurement]:
        """The measurements."""
        return [self.at(k) for k in range(len(self.t))]

    def part(self, start: int, end: int) -> Log:
        """Its measurements start … end − 1."""
        return Log(*(part[start:end] for part in self))

    def first(self, count: int) -> Log:
        """Its first measurements."""
        return self.part(0, count)

    def until(self, duration: float) -> Log:
        """The log's first `duration` seconds."""
        end = np.searchsorted(self.t, self.t[0] + duration * (1 + 1e-9), side="right")
        return self.first(int(end))

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


class SensorLevels(NamedTuple):
    """What sensors are said to be off by: standard deviations, independent from sample to sample.

    Attributes:
        position: of every position number [rad or m].
        velocity: of every velocity [rad/s or m/s].
    """

    position: float = 0.0
    velocity: float = 0.0

    @property
    def exact(self) -> bool:
        """Whether positions may be differentiated."""
        return self.position == 0 and self.velocity == 0


EXACT = SensorLevels()
