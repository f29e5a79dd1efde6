"""From a table's channels to ordered signals in SI, and the speeds below which a joint is at rest.

Every step is reported.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from ...base import Finding
from ...core import Array, Log, continuous_signs, number
from ...robots import RobotModel
from . import signals
from .clocks import regular
from .layout import ChannelSource, Layout
from .phases import Event
from .recordings import LogSegment
from .signals import Signal
from .tables import Channel, LogTable

SHOWN = 5
"""Row numbers stated in a message; the finding's data hold up to a hundred."""


_JITTER = 0.2  # half the spread of intervals, over their median, from which it is reported


class Cleaned(NamedTuple):
    """The signals of one log, in SI."""

    source: str  # name of the file, or of the files
    made: Layout  # which channels they are
    signals: dict[str, Signal]  # by the names of their columns
    events: tuple[Event, ...] = ()  # when it says that it is disarmed or landed

    def of(self, source: ChannelSource) -> Signal:
        """The signal of a source."""
        return self.signals[source.column.column]

    @property
    def reference(self) -> Signal:
        """The first position, by whose rows messages name times."""
        return self.of(self.made.positions[0])


def clean(table: LogTable, layout: Layout) -> tuple[Cleaned, tuple[Finding, ...]]:
    """The signals of a layout's sources.

    Rows without a value or out of order are dropped, angles continued across whole turns, and
    outliers of positions and velocities interpolated. Every step adds a finding.
    """
    table, findings = _on_regular_clocks(_same_signs(table, layout), layout)
    orders: dict[int, signals.Order] = {}
    found: dict[str, Signal] = {}
    for source in layout.sources:
        name = source.column.column
        channel = table.channels[name]
        key = id(channel.t)
        if key not in orders:
            orders[key] = signals.order(channel.t)
            said = _disorder(table.source, channel, orders[key])
            findings += [finding for finding in said if finding not in findings]
        jumps = False
        if layout.imu is not None:  # velocities do at every touch-down
            jumps = source.quantity == "velocity" or source in layout.imu.sources
        found[name] = _clean_one(table.source, source, channel, orders[key], findings, jumps)
    return Cleaned(table.source, layout, found), tuple(findings)


def _on_regular_clocks(table: LogTable, layout: Layout) -> tuple[LogTable, list[Finding]]:
    """A table with regular times in place of stamps that scatter about them, and findings."""
    findings = []
    channels = dict(table.channels)
    clocks = {id(channel.t): channel.t for channel in channels.values()}
    for key, t in clocks.items():
        values = []
        for source in layout.positions:
            channel = channels[source.column.column]
            if id(channel.t) == key and np.isfinite(channel.values).all():
                turn = np.sign(source.factor) * abs(source.column.ratio) * source.factor
                x = signals.unwrap(channel.values * turn)[0] if source.angle else channel.values
                values.append(x)
        if (clock := regular(t, values)) is None:
            continue
        channels |= {
            name: Channel(clock.t, channel.values)
            for name, channel in channels.items()
            if id(channel.t) == key
        }
        text = f"the stamps scatter by {clock.scatter * 1e3:.2g} ms about a regular clock of "
        text += f"{1 / clock.period:.4g} Hz, on which the positions are smoother and {clock.lost} "
        text += "rows are missing; its times are used"
        data = {"period": clock.period, "scatter": clock.scatter, "lost": clock.lost}
        findings.append(Finding("note", "jitter", table.source, text, data=data))
    return replace(table, channels=channels), findings


def _same_signs(table: LogTable, layout: Layout) -> LogTable:
    """A table whose quaternions q and −q do not alternate, so that they can be interpolated."""
    names = layout.quaternion
    parts = [table.channels[name] for name in names]
    if not parts or len({len(part.values) for part in parts}) > 1:
        return table
    signs = continuous_signs(np.column_stack([part.values for part in parts]))
    turned = {
        name: Channel(part.t, part.values * signs) for name, part in zip(names, parts, strict=True)
    }
    return replace(table, channels=table.channels | turned)


def _clean_one(
    file: str,
    source: ChannelSource,
    channel: Channel,
    order: signals.Order,
    findings: list[Finding],
    jumps: bool = False,
) -> Signal:
    """The signal of a channel; where it `jumps` by itself, no value counts as an outlier."""
    where = f"{file}, {source.column.column}"
    values = channel.values[order.index] * source.factor
    present = np.isfinite(values)
    t = order.t  # shared by all signals of a clock: a log may be large
    x = values
    row = order.rows
    if not present.all():
        text = "rows without a number were dropped"
        findings.append(about_rows("note", "missing_values", where, row[~present], text))
        t = t[present]
        x = x[present]
        row = row[present]
    if source.angle:
        raw = np.sign(source.factor) * abs(source.column.ratio)  # a whole turn in the column's unit
        x_turns, turned = signals.unwrap(x * raw)
        if len(turned):
            x = x_turns / raw
            text = "jumps of a whole turn were removed"
            findings.append(about_rows("note", "wrapped_angle", where, row[turned], text))
    bad = np.zeros(0, int)
    if source.quantity != "command" and not jumps:
        bad = signals.outliers(t, x)
    if len(bad):
        good = np.setdiff1d(np.arange(len(x)), bad)
        away = float(np.max(np.abs(x[bad] - np.interp(t[bad], t[good], x[good]))))
        x[bad] = np.interp(t[bad], t[good], x[good])
        one = len(bad) == 1
        far = f"{'' if one else 'up to '}{number(away, significant=3)}"
        text = f"outlier{'' if one else 's'} ({far} from {'its' if one else 'their'} neighbours) "
        text += f"{'was' if one else 'were'} interpolated"
        findings.append(about_rows("note", "outliers", where, row[bad], text))
    last = len(t) - 1
    doubtful = np.column_stack([t[np.maximum(bad - 1, 0)], t[np.minimum(bad + 1, last)]])
    made = Signal(t, x, row, doubtful)
    if len(t) > 2:
        made = made._replace(doubtful=np.concatenate([doubtful, signals.dropouts(made)]))
    return made


def _disorder(file: str, channel: Channel, order: signals.Order) -> list[Finding]:
    """Findings about a clock: missing, repeated and late times, resets, uneven intervals."""
    if _coarse(channel, order):
        step = number(float(np.median(np.diff(order.t))), significant=3)
        text = f"{len(order.repeated)} of {len(channel.t)} rows repeat the time before with other "
        text += f"values: the clock has steps of {step} s"
        remedy = "Export times with all their digits, or no times and `rate` under `[time]`."
        return [Finding("refusal", "coarse_clock", file, text, remedy)]
    found = []
    undated = np.flatnonzero(~np.isfinite(channel.t))
    for code, rows, text in (
        ("missing_times", undated, "rows without a time were dropped"),
        ("duplicates", order.repeated, "rows that repeat the time before were dropped"),
        ("backward_times", order.late, "rows whose time lies before an earlier one were dropped"),
        ("clock_reset", order.resets, "restarts of the clock; the log is split there"),
    ):
        if len(rows):
            level = "warning" if len(rows) > 0.2 * len(channel.t) else "note"
            found.append(about_rows(level, code, file, rows + 1, text))
    if len(order.t) < 10:
        return found
    intervals = np.diff(order.t)
    period = float(np.median(intervals))
    low, high = np.quantile(intervals, [0.05, 0.95])
    if high - low >= 2 * _JITTER * period:
        text = f"intervals between rows scatter from {low * 1e3:.3g} to {high * 1e3:.3g} ms (5 % "
        text += "to 95 %); values are interpolated to a constant rate"
        data = {"period": period, "low": float(low), "high": float(high)}
        found.append(Finding("note", "jitter", file, text, data=data))
    return found


def _coarse(channel: Channel, order: signals.Order) -> bool:
    """Whether a clock stands still, as one of whole seconds does, while its rows go on.

    A logger that writes each row twice or three times repeats the values, too.
    """
    again = np.asarray(order.repeated)
    if len(order.t) < 2 or len(again) <= 0.5 * len(channel.t):
        return False
    return bool(np.mean(channel.values[again] != channel.values[again - 1]) > 0.5)


def about_rows(
    level: Literal["note", "warning", "refusal"],
    code: str,
    where: str,
    rows: Sequence[int] | np.ndarray,
    text: str,
) -> Finding:
    """A finding that begins with a number of rows and ends with the first of them.

    `rows` are their numbers in the file, from 1; `text` says what happened to them, without their
    number; `where` is file and channel.
    """
    listed = [int(row) for row in rows[:100]]
    first = ", ".join(str(row) for row in listed[:SHOWN]) + (" …" if len(rows) > SHOWN else "")
    plural = "row" if len(rows) == 1 else "rows"
    data = {"count": len(rows), "rows": listed}
    return Finding(level, code, where, f"{len(rows)} {text} ({plural} {first})", data=data)


_MARGIN = 4.0  # standard deviations of a velocity's noise that count as rest
_LOUD = 0.05  # such a margin, over a joint's speed, from which rest is hidden in the noise
_WINDOW = 0.2  # a robot moves if it does in most rows of such a window [s]


class Rest:
    """Speeds below which the joints of a log count as being at rest, on a grid of `rate` [Hz].

    Measured velocities are compared with them, or the derivatives of the positions where noise
    hides rest in the former but not in the latter. stated (n,) are the map's limits.
    """

    def __init__(self, log: Cleaned, stated: Array, rate: float):
        made = log.made
        self._stated = stated
        self._rate = rate
        self._derived = False
        n = len(made.positions)
        self._coupling = np.eye(n) if made.coupling is None else made.coupling
        own = np.array(
            [
                signals.derivative_noise(signals.noise(s.x), s.rate, rate)
                for s in map(log.of, made.positions)
            ]
        )
        columns = [log.of(v).x if v else None for v in made.velocities]
        steps = [0.0 if x is None else signals.quantum(x) for x in columns]
        noises = [own[j] if x is None else signals.noise(x) for j, x in enumerate(columns)]
        fast = [np.quantile(np.abs(x), 0.95) for x in columns if x is not None]
        self._steps, measured = np.array(steps), np.array(noises)
        if len(fast) == n:  # else the others' columns have their own units and delays
            loud = _MARGIN * measured > _LOUD * np.array(fast)
            self._derived = bool((loud & (own < measured)).any() and (own <= measured).all())
        if self._derived:
            self._steps = np.zeros(n)
            measured = own
        self._noise = measured

    def limits(self, logs: Sequence[Log]) -> Array:
        """(n,) speeds of the joints [rad/s or m/s], from the log's stretches on the grid.

        Four standard deviations of the velocity's noise, and not less than its quantisation; for a
        joint that is ten times faster than its noise, at most a tenth of its speed, since fourth
        differences of few rows count a fast motion as noise. The limits of the map always apply.
        """
        spread = np.sqrt(self._coupling**2 @ np.square(self._noise))
        limits = np.maximum(_MARGIN * spread, np.abs(self._coupling) @ self._steps)
        fast = np.quantile(np.concatenate([self.speed(log) for log in logs]), 0.95, axis=0)
        limits = np.where(fast > 10 * spread, np.minimum(limits, 0.1 * fast), limits)
        return np.maximum(limits, self._stated)

    def speed(self, log: Log) -> Array:
        """(N, n) speeds for rest detection."""
        return np.abs(signals.derivative(log.q, self._rate) if self._derived else log.v)


def rows_of(signal: Signal, start: float, end: float) -> tuple[int, int]:
    """First and last row, in the file, of the stretch between two times [s]."""
    first = np.searchsorted(signal.t, start - 1e-9)
    last = np.searchsorted(signal.t, end + 1e-9, side="right") - 1
    return int(signal.row[min(first, len(signal.row) - 1)]), int(signal.row[max(last, 0)])


def moving_part(moving: np.ndarray, rate: float) -> slice:
    """The slice from the first to the last window in which the robot moves in most rows."""
    width = max(1, round(_WINDOW * rate))
    share = np.convolve(moving, np.ones(width) / width, mode="same")
    often = np.flatnonzero(share > 0.5)
    if not len(often):
        return slice(0, 0)
    inside = np.flatnonzero(moving[often[0] : often[-1] + 1]) + often[0]
    return slice(int(inside[0]), int(inside[-1]) + 1) if len(inside) else slice(0, 0)


def cut_rest(log: Cleaned, grid: Array, kept: slice) -> list[Finding]:
    """Reports the cuts at both ends of a stretch, whose part `kept` has motion.

    grid (N,) are times [s].
    """
    findings = []
    reference = log.reference
    whole = rows_of(reference, *grid[[0, -1]].tolist())
    if kept.stop == kept.start:
        text = f"the robot stands still in rows {whole[0]}–{whole[1]}, which were left out"
        return [Finding("warning", "rest", log.source, text, data={"rows": list(whole)})]
    inner = rows_of(reference, *grid[[kept.start, kept.stop - 1]].tolist())
    for a, b, when in ((whole[0], inner[0] - 1, "before"), (inner[1] + 1, whole[1], "after")):
        if b - a > 0.05 / reference.period:
            text = f"the robot stands still {when} its motion, in rows {a}–{b}, which were left out"
            findings.append(Finding("note", "rest", log.source, text, data={"rows": [a, b]}))
    return findings


def limits_stated(
    file: str, segments: Sequence[LogSegment], limits: Array, robot: RobotModel
) -> Finding:
    """Reports the speeds below which rows are not used, and the share of rows above."""
    usable = np.concatenate([segment.usable for segment in segments]).mean(axis=0)
    units = robot.units[-len(robot.joints) :]  # those before are of a floating base
    each = ", ".join(
        f"{robot.joints[j]} {number(limits[j], significant=2)} {units[j]}/s "
        f"({100 * usable[j]:.0f} %)"
        for j in robot.independent
    )
    text = f"rows at rest are not used, below these speeds (in brackets: rows used): {each}"
    data = {"limits": limits.tolist(), "share": usable.tolist()}
    return Finding("note", "rest_limits", file, text, data=data)


class ShortStretch(NamedTuple):
    """A stretch of a log that is too short to be used."""

    source: str  # name of the file
    rows: tuple[int, int]  # its first and last row
    seconds: float


def short_stated(short: Sequence[ShortStretch], used: int, least: float) -> list[Finding]:
    """The finding about stretches shorter than `least` [s], beside `used` ones; none without any.

    It is a warning if they outnumber those used.
    """
    if not short:
        return []
    seconds = sum(stretch.seconds for stretch in short)
    first = [f"{s.source} rows {s.rows[0]}–{s.rows[1]}" for s in short[:SHOWN]]
    text = f"{len(short)} of {len(short) + used} stretches of the logs, "
    text += f"{number(seconds, significant=2)} s together, are shorter than {least:g} s and were "
    text += f"left out ({'; '.join(first)}{' …' if len(short) > SHOWN else ''})"
    data = {"count": len(short), "used": used, "seconds": seconds}
    level = "warning" if len(short) > used else "note"
    return [Finding(level, "short_stretch", "", text, data=data)]
