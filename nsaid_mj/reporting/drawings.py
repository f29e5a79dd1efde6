"""Draws the panels of a page as SVG elements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ..parameters import Array
from .palette import BAD, COLOURS, INK
from .panels import AnyPanel, Comparison, Forest, HeatMap
from .plots import logarithmic, over_time, style, svg

WIDTH = 4.3  # of a panel of ordinary width [inch]
_FAINT = 0.05  # correlations below are not drawn
_WRITTEN = 0.5  # correlations from here on are also written as numbers
_BROAD = 30.0  # intervals are drawn up to this factor
_INTERVALS = 150  # over which errors are averaged
_LONG = 26  # characters of a name, at most


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
    values, low, high, other = panel.values, panel.low, panel.high, panel.reference
    positive = bool(((values > 0) & ~(low <= 0)).all())
    if positive:
        low, high = np.maximum(low, values / _BROAD), np.minimum(high, values * _BROAD)
    else:
        least = np.full_like(values, 1e-300)
        size = _BROAD * np.nanmax(np.abs([values, other, least]))
        low, high = np.maximum(low, -size), np.minimum(high, size)
    with style():
        figure, axis = named_lines(panel.names)
        rows = np.arange(len(values))
        for chosen, colour, filled, dash in (
            (panel.firm, COLOURS[0], COLOURS[0], "-"),
            (~panel.firm, COLOURS[8], "none", "--"),
        ):
            for row in rows[chosen]:
                axis.plot([low[row], high[row]], [row, row], dash, color=colour, linewidth=1.8)
            axis.plot(values[chosen], rows[chosen], "o", color=colour, markerfacecolor=filled)
        shown = (other > 0) if positive else np.isfinite(other)
        axis.plot(
            other[shown], rows[shown], "D", color=INK, markersize=4.5, markerfacecolor="none",
            markeredgewidth=0.8,
        )  # fmt: skip
        if positive:
            logarithmic(axis, "x")
        else:
            axis.axvline(0, color=INK, linewidth=0.6)
        axis.set_xlabel(panel.label)
        return svg(figure, panel.title)


def named_lines(names: Sequence[str], least: float = 1.3) -> tuple[Figure, Axes]:
    """A figure with one line for each name, the first on top."""
    height = max(least, 0.24 * len(names) + 0.75)
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axis = figure.add_subplot()
    axis.set_yticks(range(len(names)), [shortened(name) for name in names])
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.grid(False, axis="y")
    return figure, axis


def shortened(name: str) -> str:
    """A name of at most `_LONG` characters."""
    return name if len(name) <= _LONG else name[: _LONG - 1] + "…"


def heat_map(panel: HeatMap) -> str:
    """Draws correlations below the diagonal; strong ones are also written as numbers."""
    r, names, n = panel.correlation, panel.names, len(panel.names)
    with style():
        cell = min(0.21, (2 * WIDTH - 2.0) / n)  # [inch]
        figure = Figure(figsize=(2 * WIDTH, cell * n + 2.0), layout="constrained")
        axis = figure.add_subplot()
        for i in range(n):
            for j in range(i):
                if abs(r[i, j]) >= _FAINT:
                    colour = BAD if r[i, j] > 0 else COLOURS[0]
                    alpha = min(1.0, abs(float(r[i, j])))
                    axis.add_patch(
                        Rectangle((j - 0.5, i - 0.5), 1, 1, facecolor=colour, alpha=alpha, lw=0)
                    )
                if abs(r[i, j]) >= _WRITTEN:
                    axis.text(
                        j, i, f"{r[i, j]:.1f}".replace("-", "−").replace("0.", "."),
                        ha="center", va="center", fontsize=6,
                    )  # fmt: skip
        axis.set_xticks(range(n - 1), names[:-1], rotation=90)
        axis.set_yticks(range(1, n), names[1:])
        axis.set_xlim(-0.5, n - 1.5)
        axis.set_ylim(n - 0.5, 0.5)
        axis.set_aspect("equal")
        axis.grid(False)
        return svg(figure, panel.title or "Correlations")


def comparison(panel: Comparison) -> str:
    """Draws both curves, and the rms of their difference on a logarithmic axis below."""
    t, error = panel.t, panel.predicted - panel.measured
    with style():
        figure = Figure(figsize=(WIDTH, 3.0))
        upper = figure.add_axes((0.16, 0.42, 0.81, 0.54))
        lower = figure.add_axes((0.16, 0.14, 0.81, 0.22), sharex=upper)
        upper.plot(t, panel.measured, color=COLOURS[8], linewidth=3.0, alpha=0.45)
        if panel.half is not None:
            ends = (panel.predicted - panel.half, panel.predicted + panel.half)
            upper.fill_between(t, *ends, color=COLOURS[0], alpha=0.25, linewidth=0)
        upper.plot(t, panel.predicted, color=COLOURS[0], linewidth=0.9)
        lower.plot(*local_rms(t, error), color=COLOURS[1], linewidth=0.9)
        upper.margins(x=0.0)
        upper.tick_params(labelbottom=False)
        upper.set_ylabel(f"{panel.label} [{panel.unit}]")
        lower.set_ylabel(f"error [{panel.unit}]")
        lower.set_xlabel("t [s]")
        logarithmic(lower, most=4)
        figure.align_ylabels([upper, lower])
        return svg(figure, panel.title)


def local_rms(t: Array, values: Array) -> tuple[Array, Array]:
    """Middles of at most `_INTERVALS` stretches of rows [s], and rms values over each."""
    parts = np.array_split(np.arange(len(t)), max(1, min(_INTERVALS, len(t) // 3)))
    middle = np.array([t[part].mean() for part in parts])
    return middle, np.array([np.sqrt(np.nanmean(values[part] ** 2)) for part in parts])
