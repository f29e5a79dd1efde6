"""Draws the panels of a page as SVG elements."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..core import Array, Indices
from .page import Figure as PageFigure
from .panels import (
    BAD,
    COLOURS,
    DIFFERENCE,
    GRID,
    INK,
    INTERVAL,
    MEASURED,
    POINTS,
    PREDICTED,
    UNSURE,
    AnyPanel,
    Comparison,
    Forest,
    HeatMap,
    Panel,
    local_rms,
)
from .svg import LETTER, WIDE, WIDTH, Axes, Side, drawing

_FAINT = 0.05  # correlations below are not drawn
_WRITTEN = 0.5  # correlations from here on are also written as numbers
_BROAD = 30.0  # intervals are drawn up to this factor
_LONG = 26  # characters of a name, at most
_CELL = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])  # corners of a cell
_POINTS = 1400  # of a measured or predicted curve, at most


def figures_of(panels: Iterable[AnyPanel], others: int = 0) -> list[PageFigure]:
    """Panels as figures of a page; one alone, without any `others`, is twice as wide."""
    some = list(panels)
    some = [replace(panel, wide=True) for panel in some] if len(some) + others == 1 else some
    return [PageFigure(p.title, draw(p), p.legend, p.wide) for p in some]


def draw(panel: AnyPanel) -> str:
    """Draws a panel as an SVG element; title and legend are left to the page."""
    if isinstance(panel, Forest):
        return forest(panel)
    if isinstance(panel, HeatMap):
        return heat_map(panel)
    if isinstance(panel, Comparison):
        return comparison(panel)
    return over_time(panel)


def over_time(panel: Panel) -> str:
    """Draws a panel's curves; title and legend are left to the page."""
    rows = [extremes(curve.values, POINTS) for curve in panel.curves]
    shown = [curve.values[kept] for curve, kept in zip(panel.curves, rows, strict=True)]
    level = [] if panel.level is None else [np.array([panel.level])]
    bands = [
        end[kept]
        for curve, kept in zip(panel.curves, rows, strict=True)
        for end in (curve.low, curve.high)
        if end is not None
    ]
    x = Side(_times([curve.t for curve in panel.curves]), "t [s]")
    y = Side.over([*shown, *bands, *level], panel.label, panel.logarithmic)
    axes = Axes.alone(x, y, panel.wide, cursor=True)
    axes.shade(panel.unused, GRID)
    if panel.level is not None:
        axes.across(panel.level, INK)
    for t in panel.events:
        axes.across(t, COLOURS[8], vertical=True, dash=":")
    for curve, kept in zip(panel.curves, rows, strict=True):
        if curve.low is not None and curve.high is not None:
            ends = (curve.low[kept], curve.high[kept])
            axes.band(curve.t[kept], *ends, curve.colour, panel.band_name, curve.name)
        axes.line(curve.t[kept], curve.values[kept], curve.colour, curve.name, dash=curve.dash)
    return axes.drawing(panel.title)


def _times(some: Sequence[Array]) -> tuple[float, float]:
    """First and last of all times [s]; 0 and 1 if there are none, a second more if only one."""
    every = np.concatenate([t for t in some] or [np.zeros(0)])
    if not len(every):
        return 0.0, 1.0
    first = float(every.min())
    last = float(every.max())
    # a second later is another float only where times are below 1e16 s
    return first, last if last > first else first + max(1.0, 1e-9 * abs(first))


def forest(panel: Forest) -> str:
    """Draws values with intervals; on a logarithmic axis if all are positive."""
    values = panel.values
    low = panel.low
    high = panel.high
    known = np.isfinite(values)
    positive = bool(((values > 0) & ~(low <= 0))[known].all())
    if positive:
        low = np.maximum(low, values / _BROAD)
        high = np.minimum(high, values * _BROAD)
    else:
        every = [values, *(other.values for other in panel.others), np.full_like(values, 1e-300)]
        size = _BROAD * np.nanmax(np.abs(every))
        low = np.maximum(low, -size)
        high = np.minimum(high, size)
    # one line for each name, the first on top
    short = [name if len(name) <= _LONG else name[: _LONG - 1] + "…" for name in panel.names]
    y = Side((len(short) - 0.4, -0.6), names=short)
    level = [np.zeros(0 if positive else 1)]
    level += [] if panel.level is None else [np.array([panel.level])]
    others = [other.values for other in panel.others]
    x = Side.over([values, low, high, *others, *level], panel.label, positive)
    width = WIDE if panel.wide else WIDTH
    bottom = 6.0 + max(52.0, 17.0 * len(short))
    axes = Axes((12.0 + y.room, 6.0, width - 12, bottom), x, y)
    axes.grids = (True, False)
    if panel.level is not None:
        axes.across(panel.level, INK, vertical=True)
    if not positive:
        axes.across(0.0, INK, vertical=True, dash="-")
    rows = np.arange(len(values))
    for chosen, name, colour in (
        (panel.firm, panel.certain, COLOURS[0]),
        (~panel.firm, UNSURE, COLOURS[8]),
    ):
        firm = colour == COLOURS[0]
        drawn = chosen & np.isfinite(low) & np.isfinite(high)
        for row in rows[drawn]:
            ends = [low[row], high[row]]
            style = "-" if firm else "--"
            axes.line(ends, [row, row], colour, width=1.8, dash=style, curve=name)
        for end, ends in (("low", low), ("high", high)):
            axes.tell(ends[drawn], rows[drawn], f"{name}, {end}")
        axes.marks(values[chosen], rows[chosen], colour, name, "●" if firm else "o")
    for other in panel.others:
        width_ = 1.8 if other.marker == "|" else 0.9
        at = rows[: len(other.values)]
        axes.marks(other.values, at, other.colour, other.name, other.marker, width=width_)
    return axes.drawing(panel.title)


def heat_map(panel: HeatMap) -> str:
    """Draws correlations below the diagonal; strong ones are also written as numbers."""
    r = panel.correlation
    names = panel.names
    n = len(names)
    room = LETTER * max(map(len, names)) + 8
    width = 2 * WIDTH
    cell = min(15.0, (width - room - 10) / n)  # [points]
    x = Side((-0.5, n - 1.5), names=names[:-1])
    y = Side((n - 0.5, 0.5), names=["", *names[1:]])
    box = (room, 4.0, room + cell * (n - 1), 4.0 + cell * (n - 1))
    axes = Axes(box, x, y)
    axes.grids = (False, False)
    axes.upright = False
    rows, columns = np.nonzero(np.tril(np.abs(r) >= _FAINT, -1))
    for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
        share = float(r[i, j])
        words = f"{share:.2f}".replace("-", "−")
        sides = (j + _CELL[:, 0], i + _CELL[:, 1])
        axes.area(*sides, BAD if share > 0 else COLOURS[0], opacity=min(1.0, abs(share)))
        axes.tell([j], [i], f"{names[i]}, {names[j]}: {words}")
        if abs(share) >= _WRITTEN:
            words = f"{share:.1f}".replace("-", "−").replace("0.", ".")
            axes.text(words, j, i, size=min(6.0, 0.55 * cell))
    return drawing(panel.title or "Correlations", width, box[3] + room + 4, [axes])


def comparison(panel: Comparison) -> str:
    """Draws both curves, and the rms of their difference on a logarithmic axis below."""
    t = panel.t
    error = panel.predicted - panel.measured
    used = np.ones(len(t), bool) if panel.used is None else panel.used
    segment = np.zeros(len(t), int) if panel.segment is None else panel.segment
    parts = np.split(np.arange(len(t)), np.flatnonzero(np.diff(segment)) + 1)
    unit = f" [{panel.unit}]" if panel.unit else ""
    errors = [
        local_rms(t[rows], error[rows])
        for rows in (part[used[part] & np.isfinite(error[part])] for part in parts)
        if len(rows)
    ]
    rms = [np.concatenate([np.append(one[k], np.nan) for one in errors] or [[]]) for k in (0, 1)]
    half = (
        [] if panel.half is None else [panel.predicted - panel.half, panel.predicted + panel.half]
    )
    x = Side(_times([t]), "t [s]")
    label = panel.label + (unit or " [as logged]")
    above = Side.over([panel.measured, panel.predicted, *half], label)
    below = Side.over(rms[1:], "error" + unit, log=True, most=3)
    width = WIDE if panel.wide else WIDTH
    left = 22.0 + max(above.room, below.room)
    upper = Axes((left, 6.0, width - 12, 123.0), x, above, cursor=True)
    lower = Axes((left, 136.0, width - 12, 184.0), x, below, cursor=True)
    upper.labelled = False
    unused = _stretches(~used, parts)
    for axes in (upper, lower):
        axes.shade([(float(t[rows[0]]), float(t[rows[-1]])) for rows in unused], GRID)
        axes.grids = (False, True)
    if half:
        low, high = half
        upper.band(t, low, high, COLOURS[0], INTERVAL)
    measured = _thinned(t, panel.measured, parts)
    upper.line(*measured, COLOURS[1], MEASURED, width=4.5, opacity=0.4)
    upper.line(*_thinned(t, panel.predicted, parts), COLOURS[0], PREDICTED)
    if errors:
        lower.line(rms[0][:-1], rms[1][:-1], COLOURS[2], DIFFERENCE, width=0.9)
    return drawing(panel.title, width, 214.0, [upper, lower])


def _stretches(chosen: np.ndarray, parts: Sequence[Indices]) -> list[Indices]:
    """Rows of every stretch of a segment in which all rows are chosen."""
    found = []
    for part in parts:
        inside = chosen[part]
        found += [
            rows
            for rows in np.split(part, np.flatnonzero(np.diff(inside)) + 1)
            if len(rows) and chosen[rows[0]]
        ]
    return found


def _thinned(t: Array, values: Array, parts: Sequence[Indices]) -> tuple[Array, Array]:
    """Points of a line with a gap between segments: all, or extremes of short intervals."""
    times = []
    drawn = []
    for part in parts:
        rows = part[extremes(values[part], max(2, _POINTS * len(part) // len(t)))]
        times += [t[rows], t[rows[-1:]]]
        drawn += [values[rows], [np.nan]]
    return np.concatenate(times)[:-1], np.concatenate(drawn)[:-1]


def extremes(values: Array, points: int) -> Indices:
    """Indices of at most about `points` values that keep every peak."""
    n = len(values)
    if n <= points:
        return np.arange(n)
    width = -(-2 * n // points)
    padded = np.append(values, np.full(-n % width, values[-1])).reshape(-1, width)
    low, high = (
        f(np.where(np.isfinite(padded), padded, fill), axis=1)
        for f, fill in ((np.argmin, np.inf), (np.argmax, -np.inf))
    )
    start = np.arange(len(padded)) * width
    chosen = np.concatenate([[0, n - 1], start + low, start + high])
    return np.unique(np.minimum(chosen, n - 1))
