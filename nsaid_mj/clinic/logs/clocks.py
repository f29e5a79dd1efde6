"""Times of a log in seconds, from any clock and unit."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...core import Array
from .mapping import TIME, of_name

_CORE = {"t", "time", "timestamp", "timestamps", "stamp", "datetime", "date", "clock", "times"}
_AROUND = {"header", "system", "robot", "elapsed", "rel", "relative", "log", "sample", "utc", "ros"}
_EPOCH = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # times since 1970, from 2001 to 2033

_MOMENT = 5.0  # duration [s] below which no log is worth recording
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
        return (
            self
            if scale == 1
            else self._replace(t=scale * self.t, origin=round(scale * self.origin))
        )


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
    if step < 0.5:  # a step of whole numbers is not a second
        return "s"
    # rows follow at 20 Hz to 20 kHz; at 2 to 20 Hz if at 2 to 20 kHz all would be over in a moment
    for unit, longest, finer in (("ms", 50.0, 1e6), ("us", 5e4, 1e9)):
        brief = len(steps) * step < _MOMENT * finer
        if step < (10 * longest if brief else longest):
            return unit
    return "ns"


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


# -- stamps that scatter about a regular clock -----------------------------------------------------

_LAG = 200  # rows over which the period is taken
_SPREAD = 0.1  # half the spread of intervals, 5 % to 95 %, over their median from which it is tried
_SMOOTHER = 0.8  # ratio of roughness below which positions are on the regular clock
_MOST_LOST = 0.2  # share of lost rows above which there is no regular clock
_SURE = 0.2  # deviation of a count of periods, from the positions' steps, up to which it is sure
_COARSE = 2.0  # usual step, in those of the sensor, from which no step at all is no reading
_BESIDE = 4  # rows on either side from which the usual step is taken
_MISSED = 100  # lost rows, at most, that positions at rest do not show
_RARE = 12.0  # cost of such a row, in squares of deviations


class Regular(NamedTuple):
    """The regular clock about which stamps scatter."""

    t: Array  # (N,) times [s]
    period: float  # [s]
    lost: int  # rows that are missing
    scatter: float  # standard deviation of the stamps [s]


def regular(t: Array, positions: Sequence[Array]) -> Regular | None:
    """The regular clock of stamps t (N,) [s], if positions (N,) are smoother on it; else None.

    A sensor that is read at a fixed rate is often stamped late, by a process that waits, and some
    rows are lost: a position then takes two steps at once. Sampling that is irregular itself gives
    smooth positions at its own times.
    """
    if len(t) < 2 * _LAG or not positions or not np.isfinite(t).all():
        return None
    steps = np.diff(t)
    low, high = np.quantile(steps, [0.05, 0.95])
    typical = float(np.median(steps))
    if typical <= 0 or high - low < 2 * _SPREAD * typical or np.abs(steps).max() > 1.0:
        return None
    count = np.r_[0, np.cumsum(_periods(t, np.column_stack(positions)))]
    lagged = (t[_LAG:] - t[:-_LAG]) / np.maximum(count[_LAG:] - count[:-_LAG], 1)
    count = count + _unseen(t - float(np.median(lagged)) * count, float(np.median(lagged)))
    period, start = np.polyfit(count, t, 1)
    even = start + period * count
    lost = int(np.maximum(np.diff(count) - 1, 0).sum())
    if lost > _MOST_LOST * len(t) or period <= 0:
        return None
    ratios = [_roughness(even, x) / max(_roughness(t, x), 1e-300) for x in positions]
    if np.median(ratios) > _SMOOTHER:
        return None
    return Regular(even, float(period), lost, float(np.std(t - even)))


def _periods(t: Array, x: Array) -> np.ndarray:
    """(N − 1,) periods between rows, from the steps of positions x (N, k) to the usual one.

    The usual step is that of the rows around, with stamps t (N,) [s]. 0 where all positions of a
    moving robot repeat: the row was written before the sensor's next reading. 1 where they move too
    slowly to tell.
    """
    steps = np.diff(x, axis=0)
    rows = np.arange(len(steps))
    first = np.maximum(rows - _BESIDE, 0)
    last = np.minimum(rows + 1 + _BESIDE, len(steps))
    speed = (x[last] - x[first]) / np.maximum(t[last] - t[first], 1e-9)[:, None]
    usual = speed * np.median(np.diff(t))
    noise = np.median(np.abs(np.diff(steps, 2, axis=0)), axis=0) / 0.6745
    resolved = np.where(steps != 0, np.abs(steps), np.inf).min(axis=0)  # inf where nothing moves
    weight = usual / np.maximum(noise, resolved / np.sqrt(12)) ** 2
    information = np.maximum(np.sum(weight * usual, axis=1), 1e-300)
    found = np.sum(weight * steps, axis=1) / information
    sure = information**-0.5 < _SURE
    repeats = np.all(steps == 0, axis=1) & np.any(np.abs(usual) > _COARSE * resolved, axis=1)
    return np.where(sure, np.clip(np.round(found), np.where(repeats, 0, 1), 50), 1).astype(int)


def _unseen(shift: Array, period: float) -> np.ndarray:
    """(N,) further periods before each row, by the likeliest path through the stamps' shifts (N,).

    The path never falls, and every rise costs as much as a few outliers (Viterbi's algorithm).
    """
    near = shift - np.median(shift[:50])
    scatter = max(float(np.median(np.abs(np.diff(near)))) / 0.954, 1e-3 * period)
    states = np.arange(-1, _MISSED) * period
    cost = np.full(len(states), np.inf)
    cost[1] = 0.0
    risen = np.zeros((len(near), len(states)), bool)
    for row, value in enumerate(near):
        up = np.r_[np.inf, cost[:-1] + _RARE]
        risen[row] = up < cost
        cost = np.where(risen[row], up, cost) + np.minimum(((value - states) / scatter) ** 2, 25.0)
    state = int(np.argmin(cost))
    path = np.empty(len(near), int)
    for row in range(len(near) - 1, -1, -1):
        path[row] = state
        state -= int(risen[row, state])
    return path - path[0]


def _roughness(t: Array, x: Array) -> float:
    """Root median square of x (N,) off the cubic through two rows on either side."""
    a = t[:-4]
    b = t[1:-3]
    c = t[3:-1]
    d = t[4:]
    s = t[2:-2]
    with np.errstate(divide="ignore", invalid="ignore"):
        guess = (
            x[:-4] * (s - b) * (s - c) * (s - d) / ((a - b) * (a - c) * (a - d))
            + x[1:-3] * (s - a) * (s - c) * (s - d) / ((b - a) * (b - c) * (b - d))
            + x[3:-1] * (s - a) * (s - b) * (s - d) / ((c - a) * (c - b) * (c - d))
            + x[4:] * (s - a) * (s - b) * (s - c) / ((d - a) * (d - b) * (d - c))
        )
    off = np.abs(x[2:-2] - guess)
    off = off[np.isfinite(off)]
    return float(np.sqrt(np.median(off**2))) if len(off) else np.inf
