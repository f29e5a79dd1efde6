"""What is to be drawn of a run: curves over time, as data, without any plotting library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..parameters import Array, Indices
from .palette import COLOURS, VARIABLES

POINTS = 1500
"""How many points of a curve are drawn, at most."""

DASHES = {"-": "none", "--": "6 3", ":": "2 2", "-.": "8 2 2 2"}
"""Line styles of matplotlib, and SVG's for the same."""


@dataclass(frozen=True)
class Curve:
    """One line of a panel.

    Attributes:
        t: (N,) times [s].
        values: (N,); NaN interrupts the line.
        name: for the legend.
        colour: of the line.
        dash: matplotlib's line style.
    """

    t: Array
    values: Array
    name: str
    colour: str
    dash: str = "-"


@dataclass
class Panel:
    """Curves over time in one pair of axes.

    Attributes:
        title: what is shown, in words.
        label: of the vertical axis, with its unit.
        logarithmic: whether the vertical axis is; values ≤ 0 are left out then.
        level: where a horizontal reference line is drawn, if anywhere.
        curves: see `add`.
    """

    title: str
    label: str
    logarithmic: bool = False
    level: float | None = None
    curves: list[Curve] = field(default_factory=list)

    def add(self, t: Array, values: Array, name: str = "") -> None:
        """Adds a curve with the next colour, and with the next dashes once all are used."""
        round_, colour = divmod(len(self.curves), len(COLOURS))
        dash = list(DASHES)[round_ % len(DASHES)]
        self.curves.append(Curve(t, values, name, COLOURS[colour], dash))

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """Name, colour and dash of curves to be named below the plot; none where it is but one."""
        named = [(c.name, c.colour, c.dash) for c in self.curves if c.name]
        return named if len(self.curves) > 1 else []


def thin(rows: int, points: int = POINTS) -> Indices:
    """Indices of at most `points` of all rows, evenly spread, with the first and the last."""
    return np.unique(np.linspace(0, rows - 1, min(rows, points)).round().astype(np.intp))


def template_figure(
    title: str, drawing: str, legend: Sequence[tuple[str, str, str]], wide: bool = False
) -> dict[str, Any]:
    """One figure of the template; its legend has (name, colour, dash) of each entry."""
    from markupsafe import Markup

    entries = [
        {"name": name, "paint": f"var({VARIABLES[colour]})", "dashes": DASHES[dash]}
        for name, colour, dash in legend
    ]
    return {"title": title, "svg": Markup(drawing), "wide": wide, "legend": entries}
