"""Samples one by one: axes, order and gaps."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal, get_args

import numpy as np
import orjson

from ..bounds import shown
from ..errors import InvalidInput, UnknownName
from ..experiment.source import LONGEST_STEP
from ..log import Measurement
from ..parameters import Array
from ..resources import json_of
from ..system import SecondOrderSystem

Frame = Literal["ENU/FLU", "NED/FRD"]
"""Axes of world and body: east, north, up and forward, left, up, as in the models; or north, east,
down and forward, right, down."""
_TRIED = 50  # number of intervals whose median is compared with the stated rate
_OFF = 0.2  # relative difference of both from which samples are refused
_EXPECTED = 'a line such as {"t": 0.002, "q": [...], "v": [...], "u": [...]}'


@dataclass
class Counts:
    """Counts of faulty samples.

    Attributes:
        used: samples that the law received.
        gaps: stretches without a sample.
        missing: samples that would have fitted into them.
        not_finite: dropped because a number, or the time since the first sample, was not finite.
        duplicates: dropped because their time equalled that of the sample before.
        late: dropped because a later sample had come before.
        unreadable: lines that are not samples.
    """

    used: int = 0
    gaps: int = 0
    missing: int = 0
    not_finite: int = 0
    duplicates: int = 0
    late: int = 0
    unreadable: int = 0

    def keys(self) -> dict[str, int]:
        """The numbers by name."""
        return asdict(self)


class Cleaner:
    """Turns raw samples into measurements in the system's own axes, with time since the first.

    Args:
        system: whose samples they are.
        rate: samples per second [Hz].
        frame: axes of the samples.

    Attributes:
        counts: of samples so far.

    Raises:
        UnknownName: there is no such frame.
        InvalidInput: the frame is not the usual one, and the robot neither floats nor drives.
    """

    def __init__(self, system: SecondOrderSystem, rate: float, frame: str = "ENU/FLU"):
        if frame not in get_args(Frame):
            raise UnknownName("frame", frame, get_args(Frame))
        if frame != "ENU/FLU" and not system.group:
            remedy = "A robot on a fixed base has no axes of its own: leave it out."
            raise InvalidInput("frame", "ENU/FLU", frame, remedy)
        self._system, self._period, self._turned = system, 1 / rate, frame == "NED/FRD"
        self._start: float | None = None
        self._last, self._steps = 0.0, []
        self.counts = Counts()

    def accept(self, t: float, q: Array, v: Array, u: Array) -> tuple[Measurement, bool] | None:
        """A sample as a measurement, and whether a gap precedes it; None if it is dropped.

        t is in s, q (m,), v (n,), and u (n_u,) is held from t on.

        Raises:
            InvalidInput: the samples do not come at the stated rate.
        """
        counts = self.counts
        if not (np.isfinite(t) and all(np.isfinite(part).all() for part in (q, v, u))):
            counts.not_finite += 1
            return None
        if self._start is None:
            self._start = t
        t -= self._start
        if not np.isfinite(t / self._period):  # too far from the first sample
            counts.not_finite += 1
            return None
        if counts.used and t <= self._last:
            counts.duplicates += t == self._last
            counts.late += t < self._last
            return None
        step = t - self._last if counts.used else 0.0
        gap = step > LONGEST_STEP * self._period
        if gap:
            counts.gaps += 1
            counts.missing += max(1, round(step / self._period) - 1)
        if counts.used and len(self._steps) < _TRIED:
            self._check_rate(step)
        counts.used += 1
        self._last = t
        if self._turned:
            q, v = turned(self._system, q, v)
        return Measurement(t, q, v, u), gap

    def _check_rate(self, step: float) -> None:
        self._steps.append(step)
        median = float(np.median(self._steps))
        if len(self._steps) == _TRIED and abs(median / self._period - 1) > _OFF:
            raise InvalidInput(
                "rate",
                f"{1 / self._period:g} samples per second, as stated",
                f"about {1 / median:.3g}",
                "Give the rate at which samples come, and their times in seconds.",
            )


def sample_of(
    system: SecondOrderSystem, t: object, q: object, v: object, u: object
) -> tuple[float, Array, Array, Array]:
    """The parts of a sample as arrays (m,), (n,) and (n_u,), which may hold NaN.

    Raises:
        InvalidInput: a part is not of numbers, or has the wrong length.
    """
    parts = []
    widths = {"t": None, "q": system.m, "v": system.n, "u": system.n_u}
    for (name, width), given in zip(widths.items(), (t, q, v, u), strict=True):
        shape = () if width is None else (width,)
        try:
            part = np.asarray(given, dtype=np.float64, order="C")  # as orjson requires
        except (TypeError, ValueError, OverflowError):  # the last: a whole number of 400 digits
            part = None
        if part is None or part.shape != shape:
            got = f"shape {part.shape}" if part is not None else shown(given)
            expected = "a number [s]" if width is None else f"{width} numbers"
            raise InvalidInput(name, expected, got, "See docs/live.md for their order and units.")
        parts.append(part)
    return float(parts[0]), parts[1], parts[2], parts[3]


def parsed(system: SecondOrderSystem, line: bytes) -> tuple[float, Array, Array, Array] | None:
    """The sample in a line of JSON, None for `{"end": true}`; else raises `InvalidInput`."""
    try:
        found = orjson.loads(line)
    except ValueError:
        found = _lenient(line)
    if isinstance(found, dict) and found.get("end"):
        return None
    if not isinstance(found, dict) or not {"t", "q", "v", "u"} <= found.keys():
        got = line[:60].decode("utf-8", "replace").strip()
        raise InvalidInput("sample", _EXPECTED, got, "See docs/live.md.")
    return sample_of(system, *(found[key] for key in "tqvu"))


def _lenient(line: bytes) -> object:
    """The content of a line with NaN or Infinity, which JSON lacks; None if it has none."""
    try:
        return json_of(line)
    except ValueError:
        return None


def turned(system: SecondOrderSystem, q: Array, v: Array) -> tuple[Array, Array]:
    """A pose q (m,) and twist v (n,) in NED/FRD as ones in ENU/FLU; joints stay as they are.

    The base floats, q = [p, (x, y, z, w), joints], or drives, q = [x, y, heading]; v is along the
    body's axes.
    """
    q, v = q.copy(), v.copy()
    if system.group == 6:
        north, east, down, x, y, z, w = q[:7]
        q[:3] = east, north, -down
        q[3:7] = np.array([x + y, x - y, w - z, w + z]) * np.sqrt(0.5)
        v[[1, 2, 4, 5]] *= -1.0
    else:
        north, east, heading = q[:3]
        q[:3] = east, north, 0.5 * np.pi - heading
        v[[1, 2]] *= -1.0
    return q, v
