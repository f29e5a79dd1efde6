"""Colours of plots and pages; a page may replace them, as it does where the screen is dark."""

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
"""Of curves; every one stands out from white."""

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
"""The same curves on a dark page."""

VARIABLES = {INK: "--ink", GRID: "--grid", BAD: "--bad"} | {
    colour: f"--c{k}" for k, colour in enumerate(COLOURS)
}
"""Colour to the CSS variable that holds it in a page."""
