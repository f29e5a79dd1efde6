"""Plots of a comparison: accuracy over data length, over noise, and over wall time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..reporting import plots
from .cells import BOUND, FIGURES, LAWS, PRIOR, Cell, Row, rows, sensors

_SHOWN = FIGURES[:3]
_STYLES = {
    "paper": ("#5f3dc4", "o"),
    "cone": ("#9775fa", "s"),
    "memory": ("#0b6e99", "D"),
    "efficient": ("#d6336c", "h"),
    BOUND: ("#212529", "_"),
    "conventional": ("#868e96", "o"),
    "ols": ("#e8590c", "^"),
    "wls": ("#2b8a3e", "v"),
    "tls": ("#e0a800", "<"),
    "rls": ("#c2255c", ">"),
    "ekf": ("#1c2733", "P"),
    "sysid": ("#a0522d", "*"),
    PRIOR: ("#adb5bd", "x"),
}


def write(folder: Path, drawn: Mapping[str, Any]) -> list[Path]:
    """Writes drawn plots as PNG, and returns their paths."""
    return [plots.png(figure, folder / f"{stem}.png") for stem, figure in drawn.items()]


def draw(cells: Sequence[Cell]) -> dict[str, Any]:
    """The plots for which there are enough cells, by the stems of their files.

    Markers are medians over the seeds, error bars reach from the best to the worst seed. Medians
    that are not finite are left out.
    """
    found = rows(cells)
    noises, durations = sorted({r.noise for r in found}), sorted({r.duration for r in found})
    drawn: dict[str, Any] = {}
    with plots.style():
        if len(durations) > 1:
            drawn["data_length"] = _against_length(found, noises)
        if len(noises) > 1:
            drawn["noise"] = _against_noise(found, noises, durations[-1])
        if found:
            drawn["wall_time"] = _against_time(found, noises, durations[-1])
    return drawn


def _against_length(found: list[Row], noises: list[float]) -> Any:
    figure, axes = _panels(len(noises))
    durations = sorted({row.duration for row in found})
    for line, noise in zip(axes, noises, strict=True):
        chosen = [row for row in found if row.noise == noise]
        for axis, (_, key) in zip(line, _SHOWN, strict=True):
            for method in dict.fromkeys(row.method for row in chosen):
                _curve(
                    axis, [r for r in chosen if r.method == method], key, lambda row: row.duration
                )
            axis.set_xscale("log")
            axis.set_xticks(durations, [f"{d:g}" for d in durations])
            axis.minorticks_off()
        line[0].set_ylabel(sensors(noise))
    return _finish(figure, axes, "length of the log [s]")


def _against_noise(found: list[Row], noises: list[float], duration: float) -> Any:
    figure, axes = _panels(1)
    chosen = [row for row in found if row.duration == duration]
    for axis, (_, key) in zip(axes[0], _SHOWN, strict=True):
        for method in dict.fromkeys(row.method for row in chosen):
            _curve(
                axis,
                [r for r in chosen if r.method == method],
                key,
                lambda row: noises.index(row.noise),
            )
        axis.set_xticks(range(len(noises)), ["exact" if not x else f"{x:g} ×" for x in noises])
    axes[0][0].set_ylabel(f"{duration:g} s of data")
    return _finish(figure, axes, "sensor noise, multiple of the scenario's")


def _against_time(found: list[Row], noises: list[float], duration: float) -> Any:
    figure, axes = _panels(len(noises))
    for axis in axes.ravel()[1:]:
        axis.sharex(axes[0, 0])
    for line, noise in zip(axes, noises, strict=True):
        chosen = [r for r in found if (r.noise, r.duration) == (noise, duration)]
        for axis, (_, key) in zip(line, _SHOWN, strict=True):
            for row in chosen:
                if row.method not in {PRIOR, BOUND}:
                    _curve(axis, [row], key, lambda row: row.median["wall_s"])
        line[0].set_ylabel(f"{sensors(noise)}, {duration:g} s of data")
    for axis in axes.ravel():
        plots.logarithmic(axis, "x")
    return _finish(figure, axes, "wall time [s]")


def _curve(axis: Any, chosen: list[Row], key: str, abscissa: Any) -> None:
    """Draws one method's medians, with error bars from the best to the worst seed."""
    chosen = [row for row in chosen if np.isfinite(row.median[key]) and row.median[key] > 0]
    if not chosen:
        return
    method = chosen[0].method
    colour, mark = _STYLES.get(method, ("#000000", "."))
    median = np.array([row.median[key] for row in chosen])
    best, worst = (
        np.array([getattr(row, end)[key] for row in chosen]) for end in ("best", "worst")
    )
    reach = np.vstack([median - best, np.where(np.isfinite(worst), worst, median) - median])
    ours = method in LAWS
    axis.errorbar(
        [abscissa(row) for row in chosen],
        median,
        yerr=reach,
        color=colour,
        marker=mark,
        ms=7 if ours else 5,
        lw=2.2 if ours else 1.1,
        ls="--" if method in {PRIOR, BOUND} else "-",
        elinewidth=0.8,
        capsize=2,
        label=method,
    )


def _panels(lines: int) -> tuple[Any, Any]:
    return plots.grid(lines, len(_SHOWN), (12.5, 1.0 + 3.3 * lines))


def _finish(figure: Any, axes: Any, xlabel: str) -> Any:
    for axis, (label, _) in zip(axes[0], _SHOWN, strict=True):
        axis.set_title(label)
    for axis in axes.ravel():
        plots.logarithmic(axis)
    for axis in axes[-1]:
        axis.set_xlabel(xlabel)
    handles: dict[str, Any] = {}
    for axis in axes.ravel():
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(handles.values(), handles.keys(), loc="outside right center")
    return figure
