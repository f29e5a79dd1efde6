"""Colours of plots and pages, for light and dark screens."""

from __future__ import annotations

INK, GRID, BAD = "#1c2733", "#dde3e8", "#c92a2a"
COLOURS = (
    "#0b6e99", "#d9480f", "#5f3dc4", "#2b8a3e", "#c2255c", "#8a6d00", "#1098ad",
    "#862e9c", "#5c7080", "#7a4a21",
)  # fmt: skip
"""Colours of curves on a light page."""

DARK = (
    "#4fb3dc", "#ff8f5e", "#a791ff", "#69c77c", "#ff7aa8", "#d9b949", "#5fd3e3",
    "#d191e6", "#9fb3c3", "#cf9a6b",
)  # fmt: skip
"""Colours of curves on a dark page, in the order of `COLOURS`."""

LAWS = {
    "memory": 0, "nullspace": 0, "conventional": 1, "paper": 2, "composite": 3, "wls": 3,
    "efficient": 4, "tls": 5, "computed_torque": 5, "ekf": 6, "cone": 7, "ols": 8, "rls": 9,
}  # fmt: skip
"""Index in `COLOURS`, and in a recording's palette, of a law's or method's colour on any plot."""

VARIABLES = {INK: "--ink", GRID: "--grid", BAD: "--bad"} | {
    colour: f"--c{k}" for k, colour in enumerate(COLOURS)
}
"""CSS variable of each colour, which a page redefines on dark screens."""
