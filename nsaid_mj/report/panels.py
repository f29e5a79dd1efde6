"""The curves of a result as plain data: panels, their legends and colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Indices

INK = "#1c2733"
GRID = "#dde3e8"
BAD = "#c92a2a"
COLOURS = (
    "#0b6e99",
    "#d9480f",
    "#5f3dc4",
    "#2b8a3e",
    "#c2255c",
    "#8a6d00",
    "#1098ad",
    "#862e9c",
    "#5c7080",
    "#7a4a21",
)
"""Colours of curves on a light page."""

LAWS = {
    "memory": 0,
    "nullspace": 0,
    "conventional": 1,
    "paper": 2,
    "composite": 3,
    "wls": 3,
    "efficient": 4,
    "tls": 5,
    "computed_torque": 5,
    "ekf": 6,
    "cone": 7,
    "ols": 8,
    "rls": 9,
}
"""Index in `COLOURS`, and in a recording's palette, of a law's or method's colour on any plot."""

POINTS = 1500
"""Largest number of drawn points of a curve."""

DASHES = {"-": "none", "--": "6 3", ":": "2 2", "-.": "8 2 2 2"}
"""SVG dash patterns by signs that look like them."""

MEASURED = "measured"
PREDICTED = "predicted"
INTERVAL = "95 % interval"
TARGET = "target"
DIFFERENCE = "error, rms over short intervals"
UNSURE = "not identified by itself"
UNUSED = "not used"
_INTERVALS = 150  # number of intervals over which errors are averaged
_CORRELATED = 20  # parameters whose correlations are drawn, at most: more labels are unreadable
_STRONG = 0.5  # correlation from which a pair is drawn
BAND = "band"
PALE = "pale"
"""Instead of a dash pattern: the legend's entry is a shaded area, or a wide pale line."""


@dataclass(frozen=True)
class Curve:
    """One line of a panel."""

    t: Array  # (N,) times [s]
    values: Array  # (N,) values; NaN interrupts the line
    name: str  # entry in the legend
    place: int = 0  # of its colour in `COLOURS`; past their end the line style changes
    # (N,) lower ends of a band around the line, NaN where there is none; None for no band
    low: Array | None = None
    high: Array | None = None  # (N,) upper ends of that band
    # entity of a recording below its panel's; curves with one part and one time axis share it
    part: tuple[str, ...] = ()
    pale: bool = False  # whether a recording draws it paler, as a reference
    steps: bool = False  # whether a recording draws it as a zero-order hold

    @property
    def colour(self) -> str:
        """The line's colour."""
        return COLOURS[self.place % len(COLOURS)]

    @property
    def dash(self) -> str:
        """The line's style, of `DASHES`."""
        return list(DASHES)[self.place // len(COLOURS) % len(DASHES)]


@dataclass
class Panel:
    """Curves over time in one pair of axes."""

    title: str  # above the panel
    label: str  # label of the vertical axis, with its unit
    # whether the vertical axis is logarithmic; values ≤ 0 are then left out
    logarithmic: bool = False
    level: float | None = None  # value of a horizontal reference line; None for no line
    level_name: str = ""  # entry of that line in the legend; empty for none
    band_name: str = INTERVAL  # entry of the curves' bands in the legend
    events: Sequence[float] = ()  # times of vertical lines [s]
    event_name: str = "fault"  # entry of those lines in the legend
    curves: list[Curve] = field(default_factory=list)  # added by `add`
    unused: Sequence[tuple[float, float]] = ()  # beginnings and ends of shaded intervals [s]
    wide: bool = False
    key: tuple[str, ...] = ()  # entity in recordings; empty if they leave it out
    page: bool = True  # whether pages draw it; recordings draw every panel with a key

    def add(
        self,
        t: Array,
        values: Array,
        name: str = "",
        band: tuple[Array, Array] | None = None,
        place: int | None = None,
        part: tuple[str, ...] = (),
    ) -> None:
        """Adds a curve (N,) over times t (N,) [s].

        `band` holds (N,) lower and (N,) upper ends of an interval around the values; the default
        place of its colour is the next one.
        """
        place = len(self.curves) if place is None else place
        self.curves.append(Curve(t, values, name, place, *(band or (None, None)), part=part))

    def add_rms(
        self, t: Array, values: Array, name: str, place: int, part: tuple[str, ...] = ()
    ) -> None:
        """Adds the rms, over short intervals of t (N,) [s], of all numbers in rows (N, …)."""
        self.add(*local_rms(t, values), name, place=place, part=part)

    def add_columns(
        self,
        t: Array,
        values: Array,
        names: Sequence[str],
        part: tuple[str, ...] = (),
        pale: bool = False,
    ) -> None:
        """Adds a curve for each column of values (N, k), with colours from the first on."""
        for place, name in enumerate(names):
            self.curves.append(Curve(t, values[:, place], name, place, part=part, pale=pale))

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """(name, colour, dash) of curves, bands and level; empty if there is only one curve."""
        named = list(dict.fromkeys((c.name, c.colour, c.dash) for c in self.curves if c.name))
        named = named if len(self.curves) > 1 else []
        if any(curve.low is not None for curve in self.curves):
            named.append((self.band_name, self.curves[0].colour, BAND))
        if self.level is not None and self.level_name:
            named.append((self.level_name, INK, "--"))
        named += [(self.event_name, COLOURS[8], ":")] * bool(len(self.events))
        return named + [(UNUSED, COLOURS[8], BAND)] * bool(len(self.unused))


@dataclass(frozen=True)
class Points:
    """Further values of a forest's lines."""

    name: str  # entry in the legend
    values: Array  # (k,) NaN for none
    marker: str = "D"  # of `page.MARKS`
    colour: str = INK  # colour of the markers


@dataclass(frozen=True)
class Forest:
    """Values with intervals, one line for each name."""

    title: str  # above the panel
    label: str  # label of the horizontal axis, with its unit
    names: list[str]  # (k) names of the lines, from top to bottom
    values: Array  # (k,) values
    low: Array  # (k,) lower ends of the intervals, NaN for none
    high: Array  # (k,) upper ends
    firm: NDArray[np.bool_]  # (k,) whether the value is drawn as certain, else pale and dashed
    others: list[Points] = field(default_factory=list)  # values to compare with
    certain: str = "identified"  # entry of the certain values in the legend
    level: float | None = None  # value of a vertical reference line; None for no line
    wide: bool = False

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """(name, colour, dash) of the values shown."""
        line = "-●" if np.isfinite(self.high[self.firm]).any() else "●"
        entries = [(self.certain, COLOURS[0], line)] if self.firm.any() else []
        if not self.firm.all():
            entries.append((UNSURE, COLOURS[8], "o"))
        return entries + [(o.name, o.colour, o.marker) for o in self.others if len(o.values)]


@dataclass(frozen=True)
class HeatMap:
    """Correlations as a heat map, below the diagonal."""

    title: str  # above the panel
    names: list[str]  # (k) names of rows and columns
    correlation: Array  # (k, k), symmetric
    wide: bool = True
    MEANING: ClassVar = (
        "Two parameters of strong colour are determined together by this motion: one known value "
        "narrows the other. Shown are the parameters with the strongest correlations, from 0.5 on."
    )

    @staticmethod
    def of_strongest(labels: Sequence[str], r: Array) -> list[HeatMap]:
        """Correlations (k, k) of those in the strongest pairs; no heat map if all are weak."""
        strongest = np.abs(r - np.diag(np.diag(r))).max(axis=1, initial=0.0)
        order = np.argsort(-strongest, kind="stable")[:_CORRELATED]
        rows = sorted(k for k in order.tolist() if strongest[k] >= _STRONG)
        strong = [labels[int(k)] for k in rows]
        return [HeatMap("", strong, r[np.ix_(rows, rows)])] if len(rows) > 1 else []

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """(name, colour, dash) of both signs."""
        return [("positive", BAD, "-"), ("negative", COLOURS[0], "-")]


@dataclass(frozen=True)
class Comparison:
    """A measured and a predicted quantity over time, and below it their difference."""

    title: str  # above the panel
    label: str  # label of the vertical axis, without its unit
    unit: str  # unit of all values; empty if unknown
    t: Array  # (k,) times [s]
    measured: Array  # (k,) values
    predicted: Array  # (k,) values
    half: Array | None = None  # (k,) half width of the prediction's interval; None for none
    # (k,) whether a row counts; others are shaded, and not in the error; None for all
    used: NDArray[np.bool_] | None = None
    # (k,) number of a row's segment, with which lines end; None for one segment
    segment: Indices | None = None
    wide: bool = False
    key: tuple[str, ...] = ()  # entity in recordings; empty if they leave it out
    computed: str = PREDICTED  # what a recording calls the predicted quantity
    target: Array | None = None  # (k,) commanded values, which a recording shows; None for none

    def first(self, rows: int) -> Comparison:
        """The first rows, on a time axis that begins at 0."""
        parts = {
            name: None if (values := getattr(self, name)) is None else values[:rows]
            for name in ("measured", "predicted", "half", "used", "segment", "target")
        }
        return replace(self, t=self.t[:rows] - self.t[0], **parts)

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """(name, colour, dash) of the curves."""
        entries = [
            (MEASURED, COLOURS[1], PALE),
            (PREDICTED, COLOURS[0], "-"),
            (DIFFERENCE, COLOURS[2], "-"),
        ]
        entries += [(INTERVAL, COLOURS[0], BAND)] if self.half is not None else []
        unused = self.used is not None and not self.used.all()
        return entries + ([(UNUSED, COLOURS[8], BAND)] if unused else [])


AnyPanel = Panel | Forest | HeatMap | Comparison
"""What `drawings.draw` draws."""


def spread(length: int, most: int) -> Indices:
    """Indices of at most about `most` of `length` rows, evenly spaced, including first and last."""
    stride = max(1, -(-length // most))
    return np.unique(np.append(np.arange(0, length, stride), length - 1))


def local_rms(t: Array, values: Array) -> tuple[Array, Array]:
    """Middles of at most 150 stretches of rows [s], and rms values of all numbers in each."""
    parts = np.array_split(np.arange(len(t)), max(1, min(_INTERVALS, len(t) // 3)))
    middle = np.array([t[part].mean() for part in parts])
    return middle, np.array([np.sqrt(np.nanmean(values[part] ** 2)) for part in parts])
