"""Draws the panels of a page as SVG elements."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

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
    PREDICTED,
    UNSURE,
    AnyPanel,
    Comparison,
    Forest,
    HeatMap,
    local_rms,
)
from .plots import (
    CURVE,
    NAMES,
    WIDE,
    WIDTH,
    band,
    line,
    logarithmic,
    over_time,
    store_values,
    style,
    svg,
)

_FAINT = 0.05  # correlations below are not drawn
_WRITTEN = 0.5  # correlations from here on are also written as numbers
_BROAD = 30.0  # intervals are drawn up to this factor
_LONG = 26  # characters of a name, at most
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
    with style():
        size = (WIDE if panel.wide else WIDTH, max(1.3, 0.24 * len(panel.names) + 0.75))
        figure = Figure(figsize=size, layout="constrained")
        axis = figure.add_subplot()  # one line for each name, the first on top
        short = [name if len(name) <= _LONG else name[: _LONG - 1] + "…" for name in panel.names]
        axis.set_yticks(range(len(short)), short)
        axis.set_ylim(len(short) - 0.4, -0.6)
        axis.grid(False, axis="y")
        axis.yaxis.set_gid(NAMES)
        rows = np.arange(len(values))
        for chosen, name, colour, filled in (
            (panel.firm, panel.certain, COLOURS[0], COLOURS[0]),
            (~panel.firm, UNSURE, COLOURS[8], "none"),
        ):
            if not chosen.any():
                continue
            drawn = chosen & np.isfinite(low) & np.isfinite(high)
            if drawn.any():
                axis.hlines(
                    rows[drawn],
                    low[drawn],
                    high[drawn],
                    colour,
                    "solid" if filled == colour else "dashed",
                    linewidth=1.8,
                    gid=CURVE + name,
                )
                for end, values_ in (("low", low), ("high", high)):
                    store_values(axis, values_[drawn], rows[drawn], f"{name}, {end}")
            line(
                axis, values[chosen], rows[chosen], name, "o", color=colour, markerfacecolor=filled
            )
        for other in panel.others:
            if len(other.values):
                shown = (other.values > 0) if positive else np.isfinite(other.values)
                line(
                    axis,
                    other.values[shown],
                    rows[shown],
                    other.name,
                    other.marker,
                    color=other.colour,
                    markersize=9 if other.marker == "|" else 4.5,
                    markerfacecolor="none",
                    markeredgewidth=1.8 if other.marker == "|" else 0.8,
                )
        if panel.level is not None:
            axis.axvline(panel.level, color=INK, linewidth=0.8, linestyle="--")
        if positive:
            logarithmic(axis, "x")
        else:
            axis.axvline(0, color=INK, linewidth=0.6)
        axis.set_xlabel(panel.label)
        return svg(figure, panel.title)


def heat_map(panel: HeatMap) -> str:
    """Draws correlations below the diagonal; strong ones are also written as numbers."""
    r = panel.correlation
    names = panel.names
    n = len(panel.names)
    with style():
        cell = min(0.21, (2 * WIDTH - 2.0) / n)  # [inch]
        figure = Figure(figsize=(2 * WIDTH, cell * n + 2.0), layout="constrained")
        axis = figure.add_subplot()
        rows, columns = np.nonzero(np.tril(np.abs(r) >= _FAINT, -1))
        shares = r[rows, columns]
        corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
        cells = corners + np.column_stack([columns, rows])[:, None]
        colours = [
            to_rgba(BAD if share > 0 else COLOURS[0], min(1.0, abs(share))) for share in shares
        ]
        axis.add_collection(PolyCollection(list(cells), facecolors=colours, linewidths=0))
        for i, j, share in zip(rows.tolist(), columns.tolist(), shares, strict=True):
            words = f"{share:.2f}".replace("-", "−")
            store_values(axis, j, i, f"{names[i]}, {names[j]}: {words}")
            if abs(share) >= _WRITTEN:
                words = f"{share:.1f}".replace("-", "−").replace("0.", ".")
                text = axis.text(j, i, words, ha="center", va="center", fontsize=6)
                text.set_in_layout(False)
        axis.set_xticks(range(n - 1), names[:-1], rotation=90)
        axis.set_yticks(range(1, n), names[1:])
        axis.set_xlim(-0.5, n - 1.5)
        axis.set_ylim(n - 0.5, 0.5)
        axis.xaxis.set_gid(NAMES)
        axis.set_aspect("equal")
        axis.grid(False)
        return svg(figure, panel.title or "Correlations")


def comparison(panel: Comparison) -> str:
    """Draws both curves, and the rms of their difference on a logarithmic axis below."""
    t = panel.t
    error = panel.predicted - panel.measured
    used = np.ones(len(t), bool) if panel.used is None else panel.used
    segment = np.zeros(len(t), int) if panel.segment is None else panel.segment
    parts = np.split(np.arange(len(t)), np.flatnonzero(np.diff(segment)) + 1)
    unit = f" [{panel.unit}]" if panel.unit else ""
    with style():
        width = WIDE if panel.wide else WIDTH
        figure = Figure(figsize=(width, 3.0))
        left = 0.16 * WIDTH / width
        upper = figure.add_axes((left, 0.42, 0.97 - left, 0.54))
        lower = figure.add_axes((left, 0.14, 0.97 - left, 0.22), sharex=upper)
        if panel.half is not None:
            low = panel.predicted - panel.half
            high = panel.predicted + panel.half
            band(upper, t, low, high, COLOURS[0], INTERVAL)
        for values, name, colour, width, alpha in (
            (panel.measured, MEASURED, COLOURS[1], 4.5, 0.4),
            (panel.predicted, PREDICTED, COLOURS[0], 1.1, 1.0),
        ):
            times, drawn = _thinned(t, values, parts)
            line(upper, times, drawn, name, color=colour, linewidth=width, alpha=alpha)
        unused = _stretches(~used, parts)
        for axis in (upper, lower):
            _shade(axis, [(float(t[rows[0]]), float(t[rows[-1]])) for rows in unused])
            axis.grid(False, axis="x")
        errors = [
            local_rms(t[rows], error[rows])
            for rows in (part[used[part] & np.isfinite(error[part])] for part in parts)
            if len(rows)
        ]
        if errors:
            times, drawn = (
                np.concatenate([np.append(one[k], np.nan) for one in errors]) for k in (0, 1)
            )
            line(lower, times[:-1], drawn[:-1], DIFFERENCE, color=COLOURS[2], linewidth=0.9)
        upper.margins(x=0.0)
        upper.tick_params(labelbottom=False)
        upper.set_ylabel(panel.label + (unit or " [as logged]"))
        lower.set_ylabel("error" + unit)
        lower.set_xlabel("t [s]")
        logarithmic(lower, most=4)
        figure.align_ylabels([upper, lower])
        return svg(figure, panel.title)


def _shade(axis: Axes, spans: Sequence[tuple[float, float]]) -> None:
    """Shades intervals of x over all of an axis' height: one artist, as there may be thousands."""
    boxes = [[(a, 0), (a, 1), (b, 1), (b, 0)] for a, b in spans]
    shading = PolyCollection(
        boxes, transform=axis.get_xaxis_transform(), color=GRID, alpha=0.9, lw=0, zorder=0
    )
    axis.add_collection(shading, autolim=False)


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
