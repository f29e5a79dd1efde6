"""Times of a log in seconds, from any clock and unit."""

import re
from typing import NamedTuple

import numpy as np

from ...core import Array
from .mapping import TIME, of_name

_CORE = {"t", "time", "timestamp", "timestamps", "stamp", "datetime", "date", "clock", "times"}
_AROUND = {"header", "system", "robot", "elapsed", "rel", "relative", "log", "sample", "utc", "ros"}
_EPOCH = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # times since 1970, from 2001 to 2033

_LATEST = 9 * 10**9  # seconds that fit into 64 bits as nanoseconds
_SECONDS = re.compile(r"(.*?)(?:secs?|seconds|s)", re.IGNORECASE)
_NANOSECONDS = re.compile(r"(.*?)(?:n(?:ano)?secs?|nanoseconds|ns)", re.IGNORECASE)


class Clock(NamedTuple):
    """Times of a column."""

    t: Array  # (N,) times since the origin [s]; NaN where a row has none
    origin: int  # the file's own time at t = 0 [ns]
    unit: str  # `s`, `ms`, `us`, `ns` or `date`
    guessed: bool  # whether the unit is inferred from the magnitude of the numbers alone

    def scaled(self, scale: float) -> "Clock":
        """The clock with its times multiplied, of one that runs too fast or too slowly."""
        return self if scale == 1 else self._replace(t=scale * self.t, origin=round(scale * self.origin))


def with_whole_stamps(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns with seconds and nanoseconds of one stamp merged into nanoseconds.

    A stamp in two columns, such as `header.stamp.sec` and `header.stamp.nanosec`, becomes
    `header.stamp_ns`; columns that share no such prefix stay as they are.
    """
    stems = {match[1]: name for name in columns if (match := _SECONDS.fullmatch(name))}
    for name, column in columns.items():
        match = _NANOSECONDS.fullmatch(name)
        if match is None or match[1] not in stems:
            continue
        seconds = columns[stems[match[1]]]
        whole = seconds.dtype.kind == column.dtype.kind == "i"
        if not whole or np.ptp(column) >= 10**9 or np.abs(seconds).max() > _LATEST:
            continue
        stem = match[1].rstrip("._/ ") or "stamp"
        stamps = {f"{stem}_ns": seconds * 10**9 + column}
        return stamps | {k: x for k, x in columns.items() if k not in (name, stems[match[1]])}
    return columns


def time_column(columns: dict[str, np.ndarray]) -> str | None:
    """The name of the time column, found by its name or because it increases steadily."""
    named = [name for name in columns if _says_time(name)]
    for name in named:
        if _increases(columns[name], 0.9):
            return name
    if named and columns[named[0]].dtype.kind in "fiM":
        return named[0]
    for name, column in columns.items():
        return name if _increases(column, 0.999) else None
    return None


def read(column: np.ndarray, name: str, unit: str | None) -> Clock | None:
    """Converts a time column (N,) to seconds; None if it holds no times.

    The column holds numbers, `datetime64` or date strings. `unit` is `s`, `ms`, `us`, `ns` or
    `date`; None detects it from the name, such as `t_ms`, the size of the numbers (times since
    1970) and the interval between rows. A float beyond 2⁶³ is no time.
    """
    if column.dtype.kind == "O":
        dates = _dates(column)
        return None if dates is None else read(dates, name, unit)
    if column.dtype.kind == "M":
        whole = column.astype("datetime64[ns]")
        absent = np.isnat(whole)
        counts = whole.astype(np.int64)
        if absent.all():
            return None
        origin = int(counts[~absent][0])
        t = np.asarray((counts - origin) * 1e-9, np.float64)
        t[absent] = np.nan
        return Clock(t, origin, "date", False)
    finite = np.isfinite(column)
    if column.dtype.kind == "f":  # no clock counts further than 2⁶³
        finite &= np.abs(column) < 2.0**63
        column = np.where(finite, column, np.nan)
    if not finite.any() or unit == "date":
        return None
    stated = unit or of_name(name, TIME)[1]
    used = stated or _unit_of(column[finite])
    first = column[finite][0]
    scale = TIME[used]
    t = np.asarray((column - first) * (scale * 1e-9), np.float64)
    return Clock(t, round(first.item() * scale), used, not stated)


def _unit_of(times: Array) -> str:
    """The unit of times: of those since 1970 by their size, of others by the interval of rows."""
    size = float(np.median(np.abs(times.astype(np.float64))))
    for unit, epoch in _EPOCH.items():
        if epoch <= size < 2 * epoch:
            return unit
    steps = np.diff(times.astype(np.float64))
    steps = steps[steps > 0]
    step = float(np.median(steps)) if len(steps) else 0.0
    # 5 Hz to 20 kHz; a step of whole numbers is not a second
    return "s" if step < 0.5 else "ms" if step < 50 else "us" if step < 5e4 else "ns"


def _says_time(name: str) -> bool:
    bare, _ = of_name(name, TIME)
    tokens = set(re.split(r"[^a-z]+", bare.lower())) - {""}
    return bool(tokens & _CORE) and tokens <= _CORE | _AROUND | set(TIME)


def _increases(column: np.ndarray, share: float) -> bool:
    """Whether at least this share of the steps between rows is positive."""
    if column.dtype.kind == "O":
        dates = _dates(column)
        return dates is not None and _increases(dates, share)
    if len(column) < 3 or column.dtype.kind not in "fiM":
        return False
    steps = np.diff(column.astype(np.int64) if column.dtype.kind == "M" else column)
    return bool(np.mean(steps > 0) >= share)


def _dates(texts: np.ndarray) -> np.ndarray | None:
    """ISO dates, or times of day, as datetime64[ns]; None if the texts are neither."""
    if not len(texts) or not re.match(r"\d{4}-\d\d-\d\d|\d\d?:\d\d", str(texts[0])):
        return None
    day = "1970-01-01T" if re.match(r"\d\d?:\d\d", str(texts[0])) else ""
    plain = [day + re.sub(r"(?:Z|[+-]\d\d:?\d\d)$", "", str(x)) if x else "NaT" for x in texts]
    try:
        return np.array(plain, dtype="datetime64[ns]")
    except ValueError:
        return None
