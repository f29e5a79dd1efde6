"""SVG drawings of a page: axes with ticks, curves, bands and marks, in the page's colours.

Lengths are in points, from the upper left corner; texts have a height of 8. A page's script reads
the curves' values from the drawing's metadata, finds the elements of a curve by `data-curve` and
zooms by moving the points of paths and marks. Equal data give equal bytes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from ..core import Array
from .page import FILLED, MARKS, VARIABLES, Figure
from .panels import DASHES, GRID, INK

HUGE = 1e200
"""Larger values are not drawn."""

WIDTH = 310.0  # of a panel on a page, and of one as wide as the page [points]
WIDE = 446.0
LETTER = 4.6  # mean width of a letter of height 8 [points]
_LINE = 11.0  # height of a line of text [points]
_RIGHT = 12.0  # room on the right of a pair of axes [points]
_MARGIN = 0.04  # of the values' range that is added at each end
_MOST = 6  # ticks of an axis, at most
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def paint(colour: str) -> str:
    """A colour as a style's value: the page's variable of it, where there is one."""
    return f"var({VARIABLES[colour]}, {colour})" if colour in VARIABLES else colour


def number(value: float, plain: bool = True) -> str:
    """Formats a tick label: 0.02, 300, 2·10⁻⁵; always as a power of ten if not `plain`."""
    if value == 0 or (plain and 1e-3 <= abs(value) < 1e4):
        return f"{value:.4g}"
    digits, _, power = f"{value:.3e}".partition("e")
    factor = f"{float(digits):g}"
    tens = "10" + str(int(power)).translate(_SUPERSCRIPTS)
    return tens if factor == "1" else f"{factor}·{tens}"


def multiples(low: float, high: float, most: int) -> tuple[float, list[float]]:
    """Step and values of at most about `most` multiples of 1, 2 or 5 · 10ⁿ within two ends."""
    rough = (high - low) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(power * next(k for k in (1, 2, 5, 10) if k * power >= rough * (1 - 1e-9)))
    first = int(np.ceil(low / step - 1e-9))
    last = int(np.floor(high / step + 1e-9))
    return step, [k * step for k in range(first, last + 1)]


class Side:
    """One of the two directions of axes.

    Attributes:
        ends: values at both ends, of which the first may be the larger.
        label: beside the axis; empty for none.
        log: whether it is logarithmic.
        names: of the values 0, 1, 2 … instead of numbers; empty for none.
        ticks: (value, text) of every tick.
    """

    def __init__(
        self,
        ends: tuple[float, float],
        label: str = "",
        log: bool = False,
        names: Sequence[str] = (),
        most: int = _MOST,
    ) -> None:
        self.ends = ends
        self.label = label
        self.log = log
        self.names = list(names)
        self.ticks = list(enumerate(self.names)) if names else self._numbers(most)

    @classmethod
    def over(
        cls, values: Sequence[Array], label: str = "", log: bool = False, most: int = _MOST
    ) -> Side:
        """One that shows all values, with a margin; with round ends if there are none."""
        every = np.concatenate([np.ravel(some) for some in values] or [np.zeros(0)]).astype(float)
        every = every[np.abs(every) < HUGE]
        every = np.log10(every[every > 0]) if log else every
        if not len(every):
            return cls((0.1, 10.0) if log else (0.0, 1.0), label, log, most=most)
        low = float(every.min())
        high = float(every.max())
        span = high - low
        if span <= 1e-9 * max(abs(low), abs(high)) or span < 1e-250:  # all equal
            span = 1.0 if log or not high else 2 * abs(high)
        low -= _MARGIN * span
        high += _MARGIN * span
        return cls((10**low, 10**high) if log else (low, high), label, log, most=most)

    @property
    def room(self) -> float:
        """Width of the longest of its ticks' texts [points]."""
        return LETTER * max((len(text) for _, text in self.ticks), default=0)

    def share(self, values: Any) -> Array:
        """Where values lie between the ends, 0 to 1; NaN for values that cannot be drawn."""
        given = np.asarray(values, float)
        drawn = np.where(np.abs(given) < HUGE, given, np.nan)
        if not self.log:
            low, high = self.ends
            return (drawn - low) / (high - low)
        low, high = np.log10(self.ends)
        return (np.log10(np.where(drawn > 0, drawn, np.nan)) - low) / (high - low)

    def _numbers(self, most: int) -> list[tuple[float, str]]:
        """Decades, multiples of 1, 2 and 5, or equal steps: the first of these that are enough."""
        low, high = sorted(self.ends)
        if not self.log:
            return _even(low, high, most)
        decades = np.log10(high / low)
        few = most <= 4
        first = int(np.ceil(np.log10(low)))
        last = int(np.floor(np.log10(high)))
        found = [10.0**k for k in range(first, last + 1, max(1, int(np.ceil(decades / most))))]
        if len(found) < 2 or (decades <= 2 and not few):
            steps = (10.0**k * times for k in range(first - 1, last + 1) for times in (1, 2, 5))
            found = [at for at in steps if low <= at <= high]
            if len(found) < (2 if few else 4):
                return _even(low, high, most - 1)
            found = found[:: -(-len(found) // most)] if few else found
        plain = decades <= 2 or (low >= 1e-3 and high < 1e4)
        return [(at, number(at, plain)) for at in found]


def _even(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Ticks in equal steps, each with as many digits as tell them apart."""
    step, found = multiples(low, high, most)
    largest = max(abs(low), abs(high))
    # at most three digits of a tick are written beside a power of ten
    if (largest >= 1e5 or step < 1e-4) and largest < 1000 * step:
        return [(at, number(at, plain=False).replace("-", "−")) for at in found]
    places = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return [(at, f"{at + 0.0:.{places}f}".replace("-", "−")) for at in found]


class Axes:
    """A pair of axes, and what is drawn in it, from the back to the front.

    Args:
        box: left, top, right and bottom [points].
        x: from left to right.
        y: from the bottom to the top.
        cursor: whether a page shows all curves at the pointer's time, else the nearest point.
        frame: whether axes, grid and ticks are drawn.
    """

    def __init__(
        self,
        box: tuple[float, float, float, float],
        x: Side,
        y: Side,
        cursor: bool = False,
        frame: bool = True,
    ) -> None:
        self.box = box
        self.x = x
        self.y = y
        self.cursor = cursor
        self.frame = frame
        self.grids = (True, True)  # of x and y
        self.upright = True  # whether ticks along x are written from left to right
        self.labelled = True  # whether x has texts at its ticks, and its label below
        self._parts: list[str] = []
        self._free: list[str] = []  # in front, not clipped by the box
        self._tables: list[list[float | None]] = []
        self._curves: list[dict[str, Any]] = []
        self._marks: set[str] = set()

    @classmethod
    def alone(cls, x: Side, y: Side, wide: bool = False, cursor: bool = False) -> Axes:
        """The only axes of a figure, which is `wide` or of ordinary width."""
        axes = cls((22.0 + y.room, 8.0, (WIDE if wide else WIDTH) - _RIGHT, 156.0), x, y, cursor)
        between = (axes.box[2] - axes.box[0]) / max(len(x.names), 1)
        axes.upright = not x.names or x.room <= between
        return axes

    def at(self, x: Any, y: Any) -> tuple[Array, Array]:
        """Where values are drawn [points]."""
        left, top, right, bottom = self.box
        return left + self.x.share(x) * (right - left), bottom - self.y.share(y) * (bottom - top)

    def line(self, x: Any, y: Any, colour: str, name: str = "", **how: Any) -> None:
        """A line that NaN interrupts.

        Args:
            x: (k,) values.
            y: (k,) values.
            colour: of the line.
            name: of the curve, by which the page finds its values; empty for none.
            how: its `width` [points], `dash` and `opacity`, and the `curve` with which the page
                shows or hides a line without a name.
        """
        across, up = self.at(x, y)
        data = path(across, up)
        width = how.get("width", 1.2)
        dash = DASHES[how.get("dash", "-")]
        style = f"fill: none; stroke: {paint(colour)}; stroke-width: {width}"
        style += "" if dash == "none" else f"; stroke-dasharray: {_scaled(dash, 0.6)}"
        style += f"; stroke-opacity: {how['opacity']}" if "opacity" in how else ""
        if data:
            self._parts.append(_tag("path", d=data, style=style, data_curve=how.get("curve", name)))
        self.tell(x, y, name)

    def tell(self, x: Any, y: Any, name: str) -> None:
        """Tells values to the page's script, such as the ends of a band; not without a name."""
        across = numbers(x)
        if not across or not name:
            return
        if across not in self._tables:
            self._tables.append(across)
        self._curves.append({"name": name, "x": self._tables.index(across), "y": numbers(y)})

    def area(self, x: Any, y: Any, colour: str, name: str = "", opacity: float = 1.0) -> None:
        """A filled area with corners x (k,), y (k,)."""
        style = f"fill: {paint(colour)}; fill-opacity: {opacity:.3g}"
        data = path(*self.at(x, y))
        if data:
            self._parts.append(_tag("path", d=f"{data} Z", style=style, data_curve=name))

    def band(self, x: Array, low: Array, high: Array, colour: str, name: str, of: str = "") -> None:
        """Shades between low and high (k,) where both are numbers; `of` is the curve within."""
        known = np.isfinite(low) & np.isfinite(high)
        for rows in np.split(np.arange(len(x)), np.flatnonzero(np.diff(known)) + 1):
            if len(rows) and known[rows[0]]:
                around = np.append(rows, rows[::-1])
                ends = np.append(low[rows], high[rows[::-1]])
                bottom, top = sorted(self.y.ends)
                self.area(x[around], np.clip(ends, bottom, top), colour, name, 0.2)
        for end, values in (("low", low), ("high", high)):
            self.tell(x, values, f"{f'{of}, ' if of else ''}{name}, {end}")

    def shade(self, spans: Sequence[tuple[float, float]], colour: str) -> None:
        """Shades intervals of x over all of the height: one path, as there may be thousands."""
        _, top, _, bottom = self.box
        data = []
        for a, b in spans:
            left, right = self.at([a, b], np.nan)[0]
            data.append(
                f"M {left:.2f} {top} L {right:.2f} {top} L {right:.2f} {bottom} "
                f"L {left:.2f} {bottom} Z"
            )
        if data:
            self._parts.insert(0, _tag("path", d=" ".join(data), style=f"fill: {paint(colour)}"))

    def across(self, at: float, colour: str, vertical: bool = False, dash: str = "--") -> None:
        """A straight line over the whole box, at a value of y, or of x if it is `vertical`."""
        ends: Any = [at, at]
        along = self.y.ends if vertical else self.x.ends
        x, y = (ends, along) if vertical else (along, ends)
        self.line(x, y, colour, width=0.8, dash=dash)

    def marks(self, x: Any, y: Any, colour: str, name: str, mark: str, **how: Any) -> None:
        """Marks of `page.MARKS` at x (k,), y (k,).

        Lines have a `width` [points], and marks an `opacity`.
        """
        self._marks.add(mark)
        fill = paint(colour) if mark in FILLED else "none"
        style = f"fill: {fill}; stroke: {paint(colour)}; stroke-width: {how.get('width', 0.9)}"
        style += f"; opacity: {how['opacity']:.2g}" if "opacity" in how else ""
        across, up = self.at(x, y)
        drawn = np.isfinite(across) & np.isfinite(up)
        for a, b in zip(across[drawn].tolist(), up[drawn].tolist(), strict=True):
            place = {"x": f"{a:.2f}", "y": f"{b:.2f}", "href": f"#@{_name(mark)}"}
            self._parts.append(_tag("use", **place, style=style, data_curve=name))
        self.tell(x, y, name)

    def text(self, words: str, x: float, y: float, anchor: str = "middle", size: float = 8) -> None:
        """A text at values x, y, its middle at the height of y."""
        across, up = self.at(x, y)
        self._free.append(_text(words, float(across), float(up) + 0.35 * size, anchor, size))

    @property
    def data(self) -> dict[str, Any]:
        """Place, axes and named curves, as the page's script reads them."""
        return {
            "box": [round(end, 2) for end in self.box],
            "x": _told(self.x),
            "y": _told(self.y),
            "cursor": self.cursor,
            "xs": self._tables,
            "curves": self._curves,
        }

    def drawn(self, place: int) -> str:
        """The element of these axes, of number `place` in the drawing; `@` stands before ids."""
        left, top, right, bottom = self.box
        clip = f"@{place}"
        corners = {"x": f"{left:.2f}", "y": f"{top:.2f}"}
        size = {"width": f"{right - left:.2f}", "height": f"{bottom - top:.2f}"}
        defined = f'<clipPath id="{clip}">{_tag("rect", **corners, **size)}</clipPath>'
        inside = f'<g clip-path="url(#{clip})">{"".join(self._parts)}</g>'
        frame = self._frame() if self.frame else ""
        return f'<g data-axes="{place}">{defined}{frame}{inside}{"".join(self._free)}</g>'

    @property
    def shapes(self) -> set[str]:
        """The kinds of marks that it has."""
        return self._marks

    def figure(self, title: str, legend: Sequence[tuple[str, str, str]] = ()) -> Figure:
        """These axes alone as a figure of a page."""
        return Figure(title, self.drawing(title), legend, wide=self.box[2] > WIDTH)

    def drawing(self, title: str) -> str:
        """These axes alone as an SVG element; see `drawing`."""
        _, _, right, bottom = self.box
        if not self.frame:
            return drawing(title, right, bottom, [self])
        return drawing(title, right + _RIGHT, bottom + self._below + 7.0, [self])

    @property
    def _below(self) -> float:
        """Distance of the label of x from the box, with the texts of the ticks between [points]."""
        ticks = _LINE if self.upright else self.x.room + 4.0
        return ticks + _LINE + 2.0 if self.x.label else ticks

    def _frame(self) -> str:
        left, top, right, bottom = self.box
        parts = []
        for at, words in self.x.ticks:
            x = float(self.at(at, np.nan)[0])
            line = f"M {x:.2f} {top if self.grids[0] else bottom + 3} L {x:.2f} {bottom}"
            text = ""
            if not self.upright:
                place = f"rotate(-90 {x + 3:.2f} {bottom + 6:.2f})"
                text = _text(words, x + 3, bottom + 6, "end", transform=place)
            elif self.labelled:
                text = _text(words, x, bottom + _LINE)
            parts.append(f'<g data-tick="x">{_rule(line)}{text}</g>')
        for at, words in self.y.ticks:
            y = float(self.at(np.nan, at)[1])
            line = f"M {left} {y:.2f} L {right if self.grids[1] else left - 3} {y:.2f}"
            parts.append(
                f'<g data-tick="y">{_rule(line)}{_text(words, left - 5, y + 3, "end")}</g>'
            )
        parts.append(_rule(f"M {left} {top} L {left} {bottom} L {right} {bottom}", INK))
        if self.x.label and self.labelled:
            parts.append(_text(self.x.label, (left + right) / 2, bottom + self._below))
        if self.y.label:
            x, y = 9.0, (top + bottom) / 2
            turn = f"rotate(-90 {x} {y:.2f})"
            parts.append(_text(self.y.label, x, y, transform=turn))
        return "".join(parts)


def drawing(title: str, width: float, height: float, axes: Sequence[Axes]) -> str:
    """An SVG element of axes; its ids begin with a hash of it, so that they are unique on a page.

    Args:
        title: for screen readers.
        width: of the drawing [points].
        height: of the drawing [points].
        axes: what is drawn.
    """
    shapes = sorted(set[str]().union(*(one.shapes for one in axes)))
    body = "".join(f'<path id="@{_name(mark)}" d="{MARKS[mark]}"/>' for mark in shapes)
    body = f"<defs>{body}</defs>" if body else ""
    body += "".join(one.drawn(place) for place, one in enumerate(axes))
    told = [one.data for one in axes]
    data = escape(json.dumps(told, separators=(",", ":"), ensure_ascii=False), quote=False)
    prefix = f"p{hashlib.sha256((title + body + data).encode()).hexdigest()[:10]}-"
    for before in ('id="', "url(#", 'href="#'):
        body = body.replace(f"{before}@", f"{before}{prefix}")
    head = {"viewBox": f"0 0 {width:.4g} {height:.4g}", "role": "img", "aria-label": title}
    head["style"] = f"--size: {width:.0f}px"  # at which its text is readable
    attributes = " ".join(f'{key}="{escape(value)}"' for key, value in head.items())
    return f"<svg {attributes}>{body}<metadata>{data}</metadata></svg>"


def path(x: Array, y: Array) -> str:
    """Path through points (k,), (k,) [points], interrupted where one is not a number."""
    drawn = np.isfinite(x) & np.isfinite(y)
    points = np.round(np.column_stack([x, y])[drawn], 2).tolist()
    begins = (drawn & ~np.append(False, drawn[:-1]))[drawn].tolist()
    return " ".join(
        f"{'M' if begin else 'L'} {a:g} {b:g}" for begin, (a, b) in zip(begins, points, strict=True)
    )


def numbers(values: Any) -> list[float | None]:
    """Values with six digits for JSON; None where there is no number."""
    given = np.asarray(values, float).ravel().tolist()
    return [float(f"{value:.6g}") if abs(value) < HUGE else None for value in given]


def _told(side: Side) -> dict[str, Any]:
    return {
        "ends": [float(end) for end in side.ends],
        "log": side.log,
        "label": side.label,
        "names": side.names or None,
    }


def _name(mark: str) -> str:
    return f"m{list(MARKS).index(mark)}"


def _scaled(dash: str, factor: float) -> str:
    return " ".join(f"{factor * float(part):.2g}" for part in dash.split())


def _rule(data: str, colour: str = GRID) -> str:
    return _tag("path", d=data, style=f"fill: none; stroke: {paint(colour)}; stroke-width: 0.6")


def _text(
    words: str, x: float, y: float, anchor: str = "middle", size: float = 8, transform: str = ""
) -> str:
    style = f"font: {size:.3g}px system-ui, sans-serif; text-anchor: {anchor}; fill: {paint(INK)}"
    place = {"x": f"{x:.2f}", "y": f"{y:.2f}", "style": style, "transform": transform}
    return _tag("text", **place)[:-2] + f">{escape(words)}</text>"


def _tag(name: str, **attributes: str) -> str:
    """An element; attributes without a value are left out."""
    given = "".join(
        f' {key.replace("_", "-")}="{escape(value)}"' for key, value in attributes.items() if value
    )
    return f"<{name}{given}/>"
