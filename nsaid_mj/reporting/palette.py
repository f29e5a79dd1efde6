"""Colours of plots and pages, for light and dark screens."""

from __future__ import annotations

INK, GRID, BAD = "#1c2733", "#dde3e8", "#c92a2a"
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

DARK = (
    "#4fb3dc",
    "#ff8f5e",
    "#a791ff",
    "#69c77c",
    "#ff7aa8",
    "#d9b949",
    "#5fd3e3",
    "#d191e6",
    "#9fb3c3",
    "#cf9a6b",
)
"""Colours of curves on a dark page, in the order of `COLOURS`."""

VARIABLES = {INK: "--ink", GRID: "--grid", BAD: "--bad"} | {
    colour: f"--c{k}" for k, colour in enumerate(COLOURS)
}
"""CSS variable of each colour, which a page redefines on dark screens."""
