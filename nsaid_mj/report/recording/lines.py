"""The lines of a recording: the curves of a result's panels, as entities of Rerun."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import rerun as rr

from ...core import Array, Indices
from ..panels import MEASURED, TARGET, AnyPanel, Comparison, Curve, Panel
from .text import drawable

PALETTE = (  # RGB, readable on a dark and on a light background; hues in the order of the pages'
    (58, 134, 226),
    (230, 126, 34),
    (148, 103, 232),
    (46, 160, 87),
    (222, 93, 164),
    (190, 148, 20),
    (20, 164, 170),
    (178, 92, 205),
    (112, 132, 160),
    (150, 117, 82),
    (229, 72, 77),
    (130, 130, 130),
)
RED = 10
GREY_BLUE = 8
GREY = 11
"""Places in the palette."""

_LEFT_OUT = "left out of the fit"
_COLORS = {0: "blue", 1: "orange", RED: "red", GREY: "grey"}
"""Words of the colours of comparisons."""

LOGARITHM = "log_"
"""Prefix of entities of logarithms, of panels with a logarithmic axis, which Rerun has not."""

_INTERVAL = "interval"
_USUAL = 2.0  # widths of lines [points]; of two that are compared, the one drawn first is wide
_WIDE = 4.5
_THIN = 1.5
_PALE = 0.5  # share of a pale line's colour, mixed with grey
_MIDDLE = 128
_POINTS = 30_000  # of a comparison, at most; the viewer thins them by zoom


@dataclass(frozen=True)
class Lines:
    """Curves over the same times, of one Rerun entity."""

    path: str  # path of the entity
    names: Sequence[str]  # one for each curve, with its unit
    t: Array  # (N,) times [s]; (0,) if they are streamed later
    values: Array  # (N, curves); (0, curves) if they are streamed later
    places: Sequence[int]  # of each curve's colour in `PALETTE`
    pale: bool = False  # drawn as a reference, in paler versions of the colours
    steps: bool = False  # drawn as a zero-order hold instead of linear interpolation
    width: float = _USUAL  # [points]
    compared: bool = False  # whether it is one side of a comparison, whose colours a key explains

    def log_style(self, rec: rr.RecordingStream) -> None:
        """Logs the curves' names, colours and widths."""
        colors = [PALETTE[place % len(PALETTE)] for place in self.places]
        if self.pale:
            grey = (1 - _PALE) * _MIDDLE
            colors = [tuple(round(_PALE * c + grey) for c in color) for color in colors]
        rec.log(
            self.path,
            rr.SeriesLines(
                names=[drawable(name) for name in self.names],
                colors=colors,
                widths=[self.width] * len(self.names),
                interpolation_mode="StepAfter" if self.steps else "Linear",
            ),
            static=True,
        )

    def log(self, rec: rr.RecordingStream) -> None:
        """Logs style and values."""
        self.log_style(rec)
        time = rr.TimeColumn("sim_time", duration=self.t)
        rec.send_columns(self.path, [time], rr.Scalars.columns(scalars=self.values))


def path(*parts: str) -> str:
    """An entity path made of parts; characters that would need an escape become underscores."""
    return "/".join(
        "".join(c if c.isalnum() or c == "-" else "_" for c in drawable(p)) for p in parts
    )


def lines_of(panels: Iterable[AnyPanel]) -> list[Lines]:
    """The lines of panels over time that have a key.

    A panel with a logarithmic axis also has the powers of ten of its values, with the prefix
    `LOGARITHM`.
    """
    found: list[Lines] = []
    for panel in panels:
        if isinstance(panel, Comparison) and panel.key:
            found += _compared(panel)
        if isinstance(panel, Panel) and panel.key:
            found += _over_time(panel)
    return [replace(lines, width=_width(lines, found)) for lines in found]


def _width(lines: Lines, all_lines: Sequence[Lines]) -> float:
    """The width of lines: where one plot also has a reference, those drawn first are wide."""
    parent = lines.path.rpartition("/")[0]
    beside = [
        other
        for other in all_lines
        if other.path.rpartition("/")[0] == parent and not other.path.endswith(f"/{_INTERVAL}")
    ]
    if all(other is not lines for other in beside) or len({other.pale for other in beside}) == 1:
        return lines.width
    return _WIDE if lines.path == min(other.path for other in beside) else _THIN


def _over_time(panel: Panel) -> list[Lines]:
    """The lines of a panel, one entity for each part."""
    parts: dict[tuple[str, ...], list[Curve]] = {}
    for curve in panel.curves:
        parts.setdefault(curve.part, []).append(curve)
    unit = panel.label.rpartition("[")[2].removesuffix("]") if "[" in panel.label else "–"
    found = []
    for part, curves in parts.items():
        found.append(_entity(path(*panel.key, *part), curves, unit))
        if panel.logarithmic:
            found.append(_logarithms(found[-1], curves, unit))
        if banded := [curve for curve in curves if curve.low is not None]:
            found.append(_ends(path(*panel.key, *part[:-1], _INTERVAL), banded))
    return found


def _entity(entity: str, curves: Sequence[Curve], unit: str) -> Lines:
    """Curves over the same times as one entity."""
    first = curves[0]
    values = np.column_stack([curve.values for curve in curves])
    places = [curve.place for curve in curves]
    names = [_with_unit(curve.name, unit) for curve in curves]
    return Lines(entity, names, first.t, values, places, first.pale, first.steps)


def _with_unit(name: str, unit: str) -> str:
    """A curve's name with its unit, unless it has one or is a reference to another curve."""
    plain = name.endswith("]") or name == "true direction"
    return name if plain else f"{name} [{unit}]".strip()


def _logarithms(lines: Lines, curves: Sequence[Curve], unit: str) -> Lines:
    """The powers of ten of lines; values ≤ 0 are left out."""
    values = np.where(lines.values > 0, lines.values, np.nan)
    of = "" if unit == "–" else f" of {unit}"
    names = [f"{curve.name} [log₁₀{of}]".strip() for curve in curves]
    return Lines(LOGARITHM + lines.path, names, lines.t, np.log10(values), lines.places)


def _ends(entity: str, curves: Sequence[Curve]) -> Lines:
    """Both ends of the curves' bands."""
    ends = [end for curve in curves for end in (curve.low, curve.high) if end is not None]
    values = np.column_stack(ends)
    names = ["95 % interval"] * len(ends)
    places = [GREY_BLUE] * len(ends)
    return Lines(entity, names, curves[0].t, values, places, pale=True, width=_THIN)


def _compared(panel: Comparison) -> list[Lines]:
    """Measured and computed values, those that were not used, and the difference, thinned.

    Measured values are a wide line below the computed ones. Lines are NaN after every segment but
    the last.
    """
    segment = np.zeros(len(panel.t), int) if panel.segment is None else panel.segment
    rows, gaps = _thinned(segment)
    t = np.insert(panel.t[rows], gaps, panel.t[rows][gaps - 1] + 1e-6)
    used = np.ones(len(panel.t), bool) if panel.used is None else panel.used
    # by entity, in whose order Rerun draws them: name, values, place of the colour, width
    sides: dict[str, tuple[str, Array | None, int, float]] = {
        "command": (TARGET, panel.target, GREY, _THIN),
        MEASURED: (MEASURED, panel.measured, 1, _WIDE),
        f"{MEASURED}_unused": (_LEFT_OUT, np.where(used, np.nan, panel.measured), RED, _WIDE),
        panel.computed: (panel.computed, panel.predicted, 0, _THIN),
    }
    found = []
    for side, (name, values, place, width) in sides.items():
        if values is not None and np.isfinite(values).any():
            shown = np.insert(values[rows], gaps, np.nan)[:, None]
            entity = path(*panel.key, side)
            found.append(Lines(entity, [name], t, shown, [place], width=width, compared=True))
    *before, _, last = panel.key
    difference = np.insert((panel.measured - panel.predicted)[rows], gaps, np.nan)[:, None]
    entity = path(*before, "residual", last)
    found.append(Lines(entity, [f"{MEASURED} - {panel.computed}"], t, difference, [2]))
    return found


def key(lines: Iterable[Lines]) -> str:
    """The colours of the sides of all comparisons, in words; empty without comparisons.

    It stands once on a page, whose plots need no legends then.
    """
    words = {}
    for one in lines:
        if one.compared:
            name = one.names[0]
            words[name] = f"{name}: {_COLORS[one.places[0]]}{', wide' * (one.width == _WIDE)}"
    return "; ".join(words.values())


def _thinned(segment: Indices) -> tuple[Indices, Indices]:
    """Rows to show, with the last of every segment, and where a gap follows among them."""
    stride = max(1, -(-len(segment) // _POINTS))
    last = np.append(np.flatnonzero(np.diff(segment)), len(segment) - 1)
    rows = np.unique(np.concatenate([np.arange(0, len(segment), stride), last]))
    return rows, np.flatnonzero(np.diff(segment[rows])) + 1
