"""Curves over time as SVG, for a page that must be there at once: no library is loaded for it."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from ..parameters import Array

COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd",
           "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf")  # fmt: skip
_WIDTH, _HEIGHT = 600, 350  # of a chart, in pixels of a page 1200 wide …
_LEFT, _RIGHT, _TOP, _BOTTOM = 76, 12, 28, 34  # … and of what is about its curves
_MARGIN = 0.04  # share of an axis that its curves leave free at each end
_TICKS = 7  # of an axis, at most
Places = TypeVar("Places", float, Array)


@dataclass
class Chart:
    """Curves in one pair of axes.

    Attributes:
        label: what the values are, with their unit.
        title: above the chart.
        logarithmic: axis of the values; what is not > 0 is left out then.
        curves: times (N,) [s], values (N,), colour and name of each; one without a name has no
            place in the legend.
    """

    label: str
    title: str = ""
    logarithmic: bool = False
    curves: list[tuple[Array, Array, str, str]] = field(default_factory=list)

    def add(self, t: Array, values: Array, colour: str = "", name: str = "") -> None:
        """Adds a curve, in a colour of its own where none is given."""
        colour = colour or COLOURS[len(self.curves) % len(COLOURS)]
        self.curves.append((t, np.asarray(values, dtype=np.float64), colour, name))


def svg(charts: Sequence[Chart], columns: int = 2) -> str:
    """An SVG element of charts, row by row, over one and the same time; NaN interrupts a curve."""
    times = np.concatenate([t for chart in charts for t, *_ in chart.curves])
    across = _limits(times)
    rows = -(-len(charts) // columns)
    drawn = []
    for k, chart in enumerate(charts):
        row, column = divmod(k, columns)
        shift = f"translate({column * _WIDTH} {row * _HEIGHT})"
        drawn.append(f'<g transform="{shift}">{_chart(chart, across, row == rows - 1)}</g>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" font-size="12" fill="#1c2733" '
        f'viewBox="0 0 {columns * _WIDTH} {rows * _HEIGHT}">{"".join(drawn)}</svg>'
    )


def _chart(chart: Chart, across: tuple[float, float], lowest: bool) -> str:
    scale = _logarithm if chart.logarithmic else np.asarray
    up = _limits(np.concatenate([scale(values) for _, values, *_ in chart.curves]))
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    parts = []
    for at, told in _ticks(*across, False):
        x = _place(at, across, _LEFT, right)
        parts += [_line(x, _TOP, x, bottom), _text(x, bottom + 16, told if lowest else "")]
    for at, told in _ticks(*up, chart.logarithmic):
        y = _place(at, up, bottom, _TOP)
        parts += [_line(_LEFT, y, right, y), _text(_LEFT - 6, y + 4, told, "end")]
    parts.append(f'<path d="M{_LEFT} {_TOP}H{right}V{bottom}H{_LEFT}Z" fill="none" stroke="#555"/>')
    for t, values, colour, _ in chart.curves:
        x, y = _place(t, across, _LEFT, right), _place(scale(values), up, bottom, _TOP)
        d = "".join(_paths(x, y))
        parts.append(f'<path d="{d}" fill="none" stroke="{colour}" stroke-width="1.2"/>')
    middle = (_LEFT + right) / 2
    parts += [_text(middle, _TOP - 9, chart.title), _text(middle, _HEIGHT - 3, "t [s]" * lowest)]
    turn = f"translate(14 {(_TOP + bottom) / 2}) rotate(-90)"
    parts.append(f'<g transform="{turn}">{_text(0, 0, chart.label)}</g>')
    named = [(colour, name) for _, _, colour, name in chart.curves if name]
    for k, (colour, name) in enumerate(named):
        y = _TOP + 18 + 17 * k
        parts.append(f'<g fill="{colour}">{_text(right - 8, y, name, "end")}</g>')
    return "".join(parts)


def _place(values: Places, limits: tuple[float, float], low: float, high: float) -> Places:
    """Where values between the limits are, between two places on the page."""
    return low + (high - low) / (limits[1] - limits[0]) * (values - limits[0])


def _paths(x: Array, y: Array) -> Iterator[str]:
    """Moves and lines through the finite among points (N,)."""
    pen = "M"
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if not np.isfinite(b):
            pen = "M"
            continue
        yield f"{pen}{a:.1f} {b:.1f}"
        pen = "L"


def _limits(values: Array) -> tuple[float, float]:
    """Ends of an axis that holds the finite values with a margin; 0 and 1 where there are none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    margin = _MARGIN * (high - low) or 0.01 * abs(high) or 0.5
    return low - margin, high + margin


def _ticks(low: float, high: float, logarithmic: bool) -> list[tuple[float, str]]:
    """Places of round numbers between two ends, and the numbers; the ends are log₁₀ of some."""
    if not logarithmic:
        return [(at, f"{at:.5g}") for at in _round(low, high)]
    decades = range(int(np.ceil(low)), int(np.floor(high)) + 1)
    if len(decades) > 2:
        every = -(-len(decades) // _TICKS)
        return [(float(n), f"{10.0**n:.3g}") for n in decades if n % every == 0]
    numbers = [10.0**n * i for n in range(int(np.floor(low)), decades.stop + 1) for i in (1, 2, 5)]
    numbers = [number for number in numbers if low <= np.log10(number) <= high]
    if len(numbers) < 3:
        numbers = _round(10**low, 10**high)
    return [(float(np.log10(number)), f"{number:.5g}") for number in numbers]


def _round(low: float, high: float) -> list[float]:
    """Multiples of 1, 2 or 5 · 10ⁿ between two ends, at most about seven of them."""
    least = (high - low) / _TICKS
    power = 10.0 ** np.floor(np.log10(least))
    step = next(power * i for i in (1, 2, 5, 10) if power * i >= least)
    return [step * k for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _logarithm(values: Array) -> Array:
    """log₁₀, NaN where there is none."""
    return np.log10(np.where(values > 0, values, np.nan))


def _line(x0: float, y0: float, x1: float, y1: float) -> str:
    return f'<path d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}" stroke="#dde3e8"/>'


def _text(x: float, y: float, words: str, anchor: str = "middle") -> str:
    words = html.escape(words)
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>' if words else ""
