"""What a page's figures show, as plain data, independent of the plotting library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..parameters import Array, Indices
from .palette import BAD, COLOURS, INK, VARIABLES

POINTS = 1500
"""Largest number of points drawn of one curve."""

DASHES = {"-": "none", "--": "6 3", ":": "2 2", "-.": "8 2 2 2"}
"""SVG dash patterns of matplotlib's line styles."""

BAND = "band"
"""In place of a dash pattern: the legend's entry is a shaded area."""


@dataclass(frozen=True)
class Curve:
    """One line of a panel.

    Attributes:
        t: (N,) times [s].
        values: (N,) values; NaN interrupts the line.
        name: entry in the legend.
        colour: of the line.
        dash: line style of matplotlib.
        low: (N,) lower ends of a band around the line, NaN where there is none; None for no band.
        high: (N,) upper ends of that band.
    """

    t: Array
    values: Array
    name: str
    colour: str
    dash: str = "-"
    low: Array | None = None
    high: Array | None = None


@dataclass
class Panel:
    """Curves over time in one pair of axes.

    Attributes:
        title: above the panel.
        label: of the vertical axis, with its unit.
        logarithmic: whether the vertical axis is logarithmic; values ≤ 0 are then left out.
        level: of a horizontal reference line; None for no line.
        level_name: entry of that line in the legend; empty for none.
        band_name: entry of the curves' bands in the legend.
        curves: added by `add`.
    """

    title: str
    label: str
    logarithmic: bool = False
    level: float | None = None
    level_name: str = ""
    band_name: str = "95 % interval"
    curves: list[Curve] = field(default_factory=list)
    wide: bool = False

    def add(
        self, t: Array, values: Array, name: str = "", band: tuple[Array, Array] | None = None
    ) -> None:
        """Adds a curve in the next colour; once all are used, with the next dash pattern.

        Args:
            t: (N,) times [s].
            values: (N,) values.
            name: entry in the legend.
            band: (N,) lower and (N,) upper ends of an interval around the values.
        """
        round_, colour = divmod(len(self.curves), len(COLOURS))
        dash = list(DASHES)[round_ % len(DASHES)]
        self.curves.append(Curve(t, values, name, COLOURS[colour], dash, *(band or (None, None))))

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """(name, colour, dash) of curves, bands and level; empty if there is only one curve."""
        named = [(c.name, c.colour, c.dash) for c in self.curves if c.name]
        named = named if len(self.curves) > 1 else []
        if any(curve.low is not None for curve in self.curves):
            named.append((self.band_name, self.curves[0].colour, BAND))
        if self.level is not None and self.level_name:
            named.append((self.level_name, INK, "--"))
        return named


@dataclass(frozen=True)
class Forest:
    """Values with intervals, one line for each name.

    Attributes:
        title: above the panel.
        label: of the horizontal axis, with its unit.
        names: (k) of the lines, from top to bottom.
        values: (k,) values.
        low: (k,) lower ends of the intervals, NaN for none.
        high: (k,) upper ends.
        firm: (k,) whether the value is drawn as certain, else pale and dashed.
        reference: (k,) values to compare with, NaN for none.
        legend: (name, colour, dash) of each entry.
    """

    title: str
    label: str
    names: list[str]
    values: Array
    low: Array
    high: Array
    firm: NDArray[np.bool_]
    reference: Array
    legend: list[tuple[str, str, str]] = field(default_factory=list)
    wide: bool = False


@dataclass(frozen=True)
class HeatMap:
    """Correlations as a heat map, below the diagonal.

    Attributes:
        title: above the panel.
        names: (k) of rows and columns.
        correlation: (k, k), symmetric.
    """

    title: str
    names: list[str]
    correlation: Array
    wide: bool = True

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """(name, colour, dash) of both signs."""
        return [("positive", BAD, "-"), ("negative", COLOURS[0], "-")]


@dataclass(frozen=True)
class Comparison:
    """A measured and a predicted quantity over time, and below it their difference.

    Attributes:
        title: above the panel.
        label: of the vertical axis, without its unit.
        unit: of all values.
        t: (k,) times [s].
        measured: (k,) values.
        predicted: (k,) values.
        half: (k,) half width of the prediction's interval; None for none.
    """

    title: str
    label: str
    unit: str
    t: Array
    measured: Array
    predicted: Array
    half: Array | None = None
    wide: bool = False

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """(name, colour, dash) of the curves."""
        entries = [
            ("measured", COLOURS[8], "-"),
            ("predicted", COLOURS[0], "-"),
            ("error, rms over short intervals", COLOURS[1], "-"),
        ]
        return entries + ([("95 % interval", COLOURS[0], BAND)] if self.half is not None else [])


AnyPanel = Panel | Forest | HeatMap | Comparison
"""What `plots.draw` draws."""


def thin(rows: int, points: int = POINTS) -> Indices:
    """Indices of at most `points` of all rows, evenly spaced, including the first and the last."""
    return np.unique(np.linspace(0, rows - 1, min(rows, points)).round().astype(np.intp))


def page_figures(panels: Sequence[AnyPanel], drawings: Sequence[str]) -> list[dict[str, Any]]:
    """Variables of drawn panels for the template `parts.html`."""
    return [
        template_figure(p.title, drawing, p.legend, p.wide)
        for p, drawing in zip(panels, drawings, strict=True)
    ]


def template_figure(
    title: str, drawing: str, legend: Sequence[tuple[str, str, str]], wide: bool = False
) -> dict[str, Any]:
    """Variables of one figure for the template `parts.html`.

    Args:
        title: above the figure.
        drawing: SVG element.
        legend: (name, colour, dash) of each entry; a dash of `BAND` is a shaded area.
        wide: whether the figure takes the whole width of the page.
    """
    from markupsafe import Markup

    entries = [
        {
            "name": name,
            "paint": f"var({VARIABLES[colour]})",
            "band": dash == BAND,
            "dashes": DASHES.get(dash, "none"),
        }
        for name, colour, dash in legend
    ]
    return {"title": title, "svg": Markup(drawing), "wide": wide, "legend": entries}
