"""Plots of a comparison: accuracy over data length, over noise, and over wall time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..reporting import plots
from ..reporting.pages import Figure
from ..reporting.palette import BAD, COLOURS, INK, LAWS
from .cells import BOUND, FIGURES, PRIOR, Cell, Row, rows, sensors
from .cells import LAWS as OURS

_SHOWN = FIGURES[:3]
_MARKS = {
    "paper": "o", "cone": "s", "memory": "D", "efficient": "h", BOUND: "_", "conventional": "o",
    "ols": "^", "wls": "v", "tls": "<", "rls": ">", "ekf": "P", "sysid": "*", PRIOR: "x",
}  # fmt: skip
_REST = {"sysid": BAD, PRIOR: COLOURS[8]}  # colours of what is no law
_REFERENCES = (PRIOR, BOUND)
_TITLES = {"wall_time": "wall time", "data_length": "length of the log", "noise": "sensor noise"}

Draw = Callable[[Any], None]
"""Draws one panel into matplotlib axes."""


@dataclass(frozen=True)
class Line:
    """A line of panels in a picture: one figure each, on the same logs.

    Attributes:
        logs: which logs, in words.
        methods: that are drawn.
        panels: by the figure's label.
    """

    logs: str
    methods: Sequence[str]
    panels: Mapping[str, Draw]


def lines(cells: Sequence[Cell]) -> dict[str, list[Line]]:
    """What there are enough cells to draw, by the stem of a picture's file.

    Markers are medians over the seeds, error bars reach from the best to the worst seed. Medians
    that are not finite are left out.
    """
    found = rows(cells)
    noises, durations = sorted({r.noise for r in found}), sorted({r.duration for r in found})
    drawn: dict[str, list[Line]] = {}
    if not found:
        return drawn
    last = [r for r in found if r.duration == durations[-1]]
    logs = f"{durations[-1]:g} s of data"
    able = [r for r in last if r.method not in _REFERENCES]
    drawn["wall_time"] = [
        _line(f"{sensors(x)}, {logs}", [r for r in able if r.noise == x], _over_time)
        for x in noises
    ]
    if len(durations) > 1:
        over = partial(_over_length, durations)
        drawn["data_length"] = [
            _line(sensors(x), [r for r in found if r.noise == x], over) for x in noises
        ]
    if len(noises) > 1:
        drawn["noise"] = [_line(logs, last, partial(_over_noise, noises))]
    return drawn


def write(folder: Path, drawn: Mapping[str, Sequence[Line]]) -> list[Path]:
    """Writes the plots as PNG, and returns their paths."""
    with plots.style():
        return [
            plots.png(_picture(of), folder / f"{stem}.png") for stem, of in sorted(drawn.items())
        ]


def figures(drawn: Mapping[str, Sequence[Line]]) -> list[Figure]:
    """The plots of the page, the noisiest logs and distances first."""
    found = []
    for label, _ in _SHOWN:
        for stem, of in drawn.items():
            for line in reversed(of):
                title = f"{label.capitalize()} over {_TITLES[stem]}: {line.logs}"
                legend = [(m, _look(m)[0], _look(m)[2]) for m in line.methods]
                found.append(plots.page_figure(title, line.panels[label], legend=legend))
    return found


def _line(logs: str, chosen: list[Row], draw: Callable[..., None]) -> Line:
    methods = list(dict.fromkeys(row.method for row in chosen))
    return Line(logs, methods, {label: partial(draw, chosen, key) for label, key in _SHOWN})


def _picture(of: Sequence[Line]) -> Any:
    figure, axes = plots.grid(len(of), len(_SHOWN), (12.5, 1.0 + 3.3 * len(of)))
    handles: dict[str, Any] = {}
    for row, line in zip(axes, of, strict=True):
        for axis, draw in zip(row, line.panels.values(), strict=True):
            draw(axis)
            for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
                handles.setdefault(label, handle)
        row[0].set_ylabel(line.logs)
    for axis, label in zip(axes[0], of[0].panels, strict=True):
        axis.set_title(label)
    figure.legend(handles.values(), handles.keys(), loc="outside right center")
    return figure


def _over_length(durations: list[float], chosen: list[Row], key: str, axis: Any) -> None:
    _curves(axis, chosen, key, lambda row: row.duration)
    axis.set_xscale("log")
    axis.set_xticks(durations, [f"{d:g}" for d in durations])
    axis.minorticks_off()
    axis.set_xlabel("length of the log [s]")
    plots.logarithmic(axis)


def _over_noise(noises: list[float], chosen: list[Row], key: str, axis: Any) -> None:
    _curves(axis, chosen, key, lambda row: noises.index(row.noise))
    axis.set_xticks(range(len(noises)), ["exact" if not x else f"{x:g} ×" for x in noises])
    axis.set_xlabel("sensor noise, multiple of the scenario's")
    plots.logarithmic(axis)


def _over_time(chosen: list[Row], key: str, axis: Any) -> None:
    for row in chosen:
        _curve(axis, [row], key, lambda row: row.median["wall_s"])
    axis.set_xlabel("wall time [s]")
    plots.logarithmic(axis, "x")
    plots.logarithmic(axis)


def _curves(axis: Any, chosen: list[Row], key: str, abscissa: Any) -> None:
    for method in dict.fromkeys(row.method for row in chosen):
        _curve(axis, [row for row in chosen if row.method == method], key, abscissa)


def _curve(axis: Any, chosen: list[Row], key: str, abscissa: Any) -> None:
    """Draws one method's medians, with error bars from the best to the worst seed."""
    chosen = [row for row in chosen if np.isfinite(row.median[key]) and row.median[key] > 0]
    if not chosen:
        return
    method = chosen[0].method
    colour, mark, dash = _look(method)
    median = np.array([row.median[key] for row in chosen])
    best, worst = (
        np.array([getattr(row, end)[key] for row in chosen]) for end in ("best", "worst")
    )
    reach = np.vstack([median - best, np.where(np.isfinite(worst), worst, median) - median])
    ours = method in OURS
    axis.errorbar(
        [abscissa(row) for row in chosen],
        median,
        yerr=reach,
        color=colour,
        marker=mark,
        ms=7 if ours else 5,
        lw=2.2 if ours else 1.1,
        ls=dash,
        elinewidth=0.8,
        capsize=2,
        label=method,
        gid=plots.CURVE + method,
    )


def _look(method: str) -> tuple[str, str, str]:
    """Colour, marker and dash of a method."""
    colour = COLOURS[LAWS[method]] if method in LAWS else _REST.get(method, INK)
    return colour, _MARKS.get(method, "."), "--" if method in _REFERENCES else "-"
