"""Measurements and commands: one sample, a log of samples, and the levels of sensor noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base import InvalidInput
from .parameters import Array


class Measurement(NamedTuple):
    """One sample in the system's own coordinates: the only input of an identifier.

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


class _Columns(NamedTuple):
    """The arrays of a log; compiled loops see a `Log` as this."""

    t: Array
    q: Array
    v: Array
    u: Array


class Log(_Columns):
    """Measurements and commands of N samples, in order of time, checked when the log is made.

    Any array-like of real numbers is accepted, with any strides and number type, and stored as
    C-contiguous float64 arrays; arrays already of that kind are not copied. A single coordinate
    may be given as (N,) instead of (N, 1). Whether m, n and n_u match a system is checked by the
    identifier that processes the log.

    Args:
        t: (N,) times [s], strictly increasing; N ≥ 1.
        q: (N, m) positions, in the system's own coordinates.
        v: (N, n) velocities.
        u: (N, n_u) commands; u[k] is held from t[k] to t[k+1].

    Raises:
        InvalidInput: a part is not an array of real numbers, has the wrong shape or length,
            contains NaN or infinity, or the times do not increase.
    """

    __slots__ = ()

    def __new__(cls, t: ArrayLike, q: ArrayLike, v: ArrayLike, u: ArrayLike) -> Log:
        """Checks and converts the parts."""
        times = _numbers("t", t)
        if times.ndim != 1 or not len(times):
            raise InvalidInput("t", "(N,) times, N ≥ 1", f"shape {times.shape}", _REMEDY)
        parts = [
            _column(name, part, len(times)) for name, part in zip("qvu", (q, v, u), strict=True)
        ]
        for name, part in zip("tqvu", (times, *parts), strict=True):
            _finite(name, part)
        late = np.flatnonzero(~(np.diff(times) > 0))
        if len(late):
            before, after = times[late[0] : late[0] + 2].tolist()
            raise InvalidInput(
                "t",
                f"a time after {before!r} s in row {late[0] + 1}",
                repr(after),
                "Sort the samples by time and drop repeated ones.",
            )
        return cls.unchecked(times, *parts)

    @classmethod
    def unchecked(cls, t: Array, q: Array, v: Array, u: Array) -> Log:
        """A log of the given arrays t (N,) [s], q (N, m), v (N, n) and u (N, n_u), without checks.

        For producers of measurements that fill the arrays later, or whose last sample may be
        non-finite. Shapes, lengths and order are the caller's responsibility: compiled loops do
        not check them again.
        """
        return tuple.__new__(cls, (t, q, v, u))

    @classmethod
    def unchecked_of(cls, measurements: Sequence[Measurement]) -> Log:
        """The log of one or more measurements in order of time, without checks; see `unchecked`."""
        parts = zip(*measurements, strict=True)
        return cls.unchecked(*(np.array(part, dtype=np.float64) for part in parts))

    @staticmethod
    def of(measurements: Sequence[Measurement]) -> Log:
        """The log of one or more measurements in order of time, checked.

        Raises:
            InvalidInput: there is no measurement, one has a wrong shape or is not finite, or the
                times do not increase.
        """
        if not len(measurements):
            raise InvalidInput("measurements", "one or more", "none", "A log begins with a sample.")
        return Log(*zip(*measurements, strict=True))  # pyright: ignore[reportArgumentType]

    def _replace(self, **parts: ArrayLike) -> Log:
        """A copy of the log with some parts replaced, checked again."""
        return Log(**(self._asdict() | parts))

    def at(self, k: int) -> Measurement:
        """The k-th measurement."""
        return Measurement(float(self.t[k]), self.q[k], self.v[k], self.u[k])

    @property
    def rows(self) -> list[Measurement]:
        """The N measurements."""
        return [self.at(k) for k in range(len(self.t))]

    def part(self, start: int, end: int) -> Log:
        """The measurements start … end − 1."""
        return Log.unchecked(*(part[start:end] for part in self))

    def last(self, count: int) -> Log:
        """The last `count` measurements, or all if there are fewer."""
        return self.part(max(0, len(self.t) - count), len(self.t))

    @staticmethod
    def joined(*logs: Log) -> Log:
        """The measurements of one or more logs, one after the other, without checks."""
        return Log.unchecked(*map(np.concatenate, zip(*logs, strict=True)))

    @staticmethod
    def extended(parts: tuple[Log, ...], log: Log) -> tuple[Log, ...]:
        """Consecutive logs and another one; short ones are joined: there are log₂ N at most."""
        parts = (*parts, log)
        while len(parts) > 1 and len(parts[-2].t) <= len(parts[-1].t):
            parts = (*parts[:-2], Log.joined(*parts[-2:]))
        return parts

    def first(self, count: int) -> Log:
        """The first `count` measurements."""
        return self.part(0, count)

    def until(self, duration: float) -> Log:
        """The measurements of the first `duration` seconds."""
        end = np.searchsorted(self.t, self.t[0] + duration * (1 + 1e-9), side="right")
        return self.first(int(end))

    @property
    def step(self) -> float:
        """The sampling interval [s], for methods that need a constant one.

        Raises:
            InvalidInput: there are fewer than 3 samples, or the intervals differ by more than a
                thousandth of their median.
        """
        steps = np.diff(self.t)
        if len(steps) < 2 or not np.ptp(steps) <= 1e-3 * abs(float(np.median(steps))):
            raise InvalidInput(
                "t",
                "at least 3 samples at a constant rate",
                f"{len(self.t)} times",
                "Resample the log.",
            )
        return float((self.t[-1] - self.t[0]) / len(steps))


_REMEDY = "A log is t (N,), q (N, m), v (N, n) and u (N, n_u), one row for each sample."


def _numbers(name: str, part: ArrayLike) -> Array:
    """The part as a C-contiguous float64 array."""
    try:
        found = np.asarray(part)
        if found.dtype.kind not in "fiubO":
            raise TypeError(f"an array of {found.dtype}")
        return np.ascontiguousarray(found, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(name, "an array of real numbers", f"{error}", _REMEDY) from error


def _column(name: str, part: ArrayLike, count: int) -> Array:
    """The part as (N, ·) rows; (N,) counts as one column."""
    rows = _numbers(name, part)
    if rows.ndim == 1:
        rows = rows[:, None]
    if rows.ndim != 2 or len(rows) != count:
        raise InvalidInput(
            name, f"{count} rows, one for each time", f"shape {np.shape(part)}", _REMEDY
        )
    return rows


def _finite(name: str, part: Array) -> None:
    if not np.isfinite(part).all():
        row, *column = np.argwhere(~np.isfinite(part))[0].tolist()
        where = f"{part[(row, *column)]} in row {row}" + (f", column {column[0]}" if column else "")
        raise InvalidInput(name, "finite numbers", where, "Drop or interpolate such samples.")


class Middle(NamedTuple):
    """The states half-way between consecutive samples of a log of N, for RK4's middle stages."""

    q: Array  # (N−1, m) positions
    v: Array  # (N−1, n) velocities

    def part(self, start: int, end: int) -> Middle:
        """The states start … end − 1."""
        return Middle(self.q[start:end], self.v[start:end])


class SensorLevels(NamedTuple):
    """Assumed standard deviations of the sensors' noise, white from sample to sample.

    Attributes:
        position: standard deviation of every position coordinate [rad or m].
        velocity: standard deviation of every velocity [rad/s or m/s].
    """

    position: float = 0.0
    velocity: float = 0.0

    @property
    def exact(self) -> bool:
        """Whether there is no noise, so that positions may be differentiated."""
        return self.position == 0 and self.velocity == 0


EXACT = SensorLevels()
