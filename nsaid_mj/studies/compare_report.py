"""The results of a comparison: statistics over the seeds, the best method, a page and plots."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np

from ..baselines import BATCH
from ..evaluation.panels import BAD, COLOURS, INK, LAWS
from ..evaluation.result import Result, Statistic
from ..laws import NullspaceAID
from ..pages import plots
from ..pages.page import Cell as Written
from ..pages.page import Figure, Figures, Page, Section, Table, Text, count
from ..robot.findings import Finding
from .study import repeated
from .sweep_results import digits

PRIOR = "prior"
"""Name of the prior, which is evaluated like a method."""

BOUND = "bound"
"""Name of the Cramér–Rao bound, whose median figures stand beside those of the methods."""

_REFERENCES = (PRIOR, BOUND)

OURS: tuple[str, ...] = get_args(get_type_hints(NullspaceAID)["law"])

METHODS = ("conventional", *OURS, *BATCH, "sysid")
DEFAULT = METHODS[:-1]  # all but sysid, which takes minutes

FIGURES = (
    ("distance to the true set", "theta_perp_ratio"),
    ("error of gain ratios", "actuator_ratio_error"),
    ("force residual, held out", "force_residual_ratio"),
    ("wall time", "wall_s"),
)
"""The figures that are compared: label, key."""


@dataclass(frozen=True)
class Cell:
    """The result of one method on one log; figures are those of summary.json, None if it failed."""

    method: str
    seed: int
    noise: float  # multiple of the scenario's sensor noise
    duration: float  # length of the log [s]
    theta_perp_ratio: float | None = None
    actuator_ratio_error: float | None = None
    force_residual_ratio: float | None = None  # None also if the plant diverges when held out
    wall_s: float | None = None  # wall time of the method, including its regressors [s]
    note: str = ""  # settings that the method chose automatically
    failure: str = ""  # why it failed; empty if it did not


def sensors(noise: float) -> str:
    """A multiple of the scenario's sensor noise, in words."""
    return "exact sensors" if noise == 0 else f"{noise:g} × noise"


@dataclass(frozen=True)
class Row:
    """A method's statistics over all seeds, by key of `FIGURES`; failed seeds count as infinite."""

    method: str
    noise: float  # multiple of the scenario's sensor noise
    duration: float  # length of the log [s]
    median: dict[str, float]
    worst: dict[str, float]
    best: dict[str, float]
    failures: tuple[str, ...]  # one reason for each failed seed
    notes: tuple[str, ...]  # settings that the method chose automatically, without duplicates
    over_bound: dict[str, float]  # median over that of the Cramér–Rao bound; empty without it
    several: bool  # whether there are several seeds

    @property
    def log(self) -> str:
        """Its logs in words."""
        return f"{sensors(self.noise)}, {self.duration:g} s"


def rows(cells: Sequence[Cell]) -> list[Row]:
    """Statistics over the seeds, ordered by noise, duration and `METHODS`."""
    groups: dict[tuple[float, float, str], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.noise, cell.duration, cell.method), []).append(cell)
    found: list[Row] = []
    bounds: dict[tuple[float, float], dict[str, float]] = {}
    order = (PRIOR, BOUND, *METHODS)
    for noise, duration, method in sorted(groups, key=lambda k: (*k[:2], order.index(k[2]))):
        group = groups[noise, duration, method]
        values = {
            key: np.array([np.inf if (x := getattr(c, key)) is None else x for c in group])
            for _, key in FIGURES
        }
        median = {key: float(np.median(v)) for key, v in values.items()}
        if method == BOUND:
            bounds[noise, duration] = {
                key: value for key, value in median.items() if 0 < value < np.inf
            }
        least = bounds.get((noise, duration), {}) if method not in _REFERENCES else {}
        found.append(
            Row(
                method,
                noise,
                duration,
                median=median,
                worst={key: float(np.max(v)) for key, v in values.items()},
                best={key: float(np.min(v)) for key, v in values.items()},
                failures=tuple(cell.failure for cell in group if cell.failure),
                notes=tuple(dict.fromkeys(cell.note for cell in group if cell.note)),
                over_bound={key: median[key] / value for key, value in least.items()},
                several=len(group) > 1,
            )
        )
    return found


_DECIDES = "theta_perp_ratio"
_HEADS = ("distance", "gain ratios", "force residual", "time [s]")
_MEANING = "Distance to the true set, error of gain ratios, force residual on a held-out motion."
_WORST = "Medians over the seeds, worst in brackets; – stands for a failed seed."
_MULTIPLES = "Multiples (×) are of the Cramér–Rao bound of the same logs."
_BARS = "Markers are medians over the seeds, bars reach from the best to the worst seed."


def result_of(found: Sequence[Row]) -> Result:
    """The result of a comparison: every figure of every method, by log and method.

    The verdict is the method closest to the true set on the longest and noisiest log.
    """
    own = [row for row in found if row.method not in _REFERENCES]
    able = [row for row in own if math.isfinite(row.median[_DECIDES])]
    text = "No method has a result."
    if able:
        hardest = max(able, key=lambda row: (row.noise, row.duration))
        same = [r for r in able if (r.noise, r.duration) == (hardest.noise, hardest.duration)]
        best = min(same, key=lambda row: row.median[_DECIDES])
        text = (
            f"{best.method} comes closest to the true set: within {digits(best.median[_DECIDES])}"
            + (f" in the median, {digits(best.worst[_DECIDES])} at worst" if best.several else "")
            + f" ({best.log})."
        )
    figures = [
        Statistic(
            label, "s" if key == "wall_s" else "%",
            {f"{row.log}: {row.method}": row.median[key] for row in found},
            {f"{row.log}: {row.method}": row.worst[key] for row in found if row.several},
        )
        for label, key in FIGURES
    ]  # fmt: skip
    failures = [
        Finding(
            "refusal", "failed", f"{row.method}, {row.log}",
            f"failed on {count(len(row.failures), 'seed')}: {row.failures[0]}",
        )
        for row in found
        if row.failures
    ]  # fmt: skip
    return Result(
        explains="no" if not able else "yes" if len(able) == len(own) else "partly",
        verdict=text,
        statistics=tuple(figures),
        findings=tuple(failures),
    )


def page_of(
    folder: Path,
    cells: Sequence[Cell],
    drawn: Mapping[str, Mapping[str, Panels]],
    manifest: dict[str, Any],
) -> Page:
    """The page of a comparison, with its plots from `lines`."""
    found = rows(cells)
    result, shown = result_of(found), figures(drawn)
    lines: list[list[Written]] = []
    for row in found:
        if [row.log] not in lines:
            lines.append([row.log])
        lines.append([row.method, *_figures(row), "; ".join(row.notes)])
    heads = ["method", *_HEADS, "chosen automatically"]
    table = Table(heads, lines, (0, 5), spare=(5, 4, 2), most=len(lines))
    several = any(row.several for row in found)
    notes = " ".join([_MEANING, *[_WORST] * several, *[_MULTIPLES] * bool(manifest["bound"])])
    more = [Figures(shown[2:], "plots", 6), Text(_BARS, note=True)] if shown[2:] else []
    sections = [
        Section("All methods", [table, Text(notes)], brief=True),
        Section("More plots", more),
    ]
    methods = len(dict.fromkeys(row.method for row in found))
    return Page(
        heading=folder.name,
        result=result,
        eyebrow=f"methods on the same logs of {manifest['script']}",
        lead=f"{count(methods, 'method')}, {count(len({c.seed for c in cells}), 'seed')}.",
        carrying=shown[:2],
        sections=[section for section in sections if section.panels],
        commands=[_command(manifest)],
        versions=manifest["versions"],
        notes=["All cells are in compare.json and compare.csv."],
    )


def _command(manifest: dict[str, Any]) -> str:
    """The command line that repeats a comparison."""
    noisy = [noise for noise in manifest["noises"] if noise]
    flags = {
        "methods": manifest["methods"],
        "seeds": manifest["seeds"],
        "sensors": ["ideal"] * (0 in manifest["noises"]) + ["noisy"] * bool(noisy),
        "durations": [f"{d:g}" for d in manifest["durations"]],
        "noise-scales": [f"{noise:g}" for noise in noisy],
    }
    return repeated("compare", manifest, flags) + " --bound" * manifest["bound"]


def _figures(row: Row) -> list[str]:
    """Median, worst in brackets if there are several seeds, and the multiple of the bound."""
    cells = []
    for _, key in FIGURES:
        worst = row.several and key != "wall_s"
        cell = digits(row.median[key]) + (f" ({digits(row.worst[key])})" if worst else "")
        cells.append(cell + (f" {row.over_bound[key]:.3g}×" if key in row.over_bound else ""))
    return cells


_SHOWN = FIGURES[:3]
_MARKS = {
    "paper": "o", "cone": "s", "memory": "D", "efficient": "h", BOUND: "_", "conventional": "o",
    "ols": "^", "wls": "v", "tls": "<", "rls": ">", "ekf": "P", "sysid": "*", PRIOR: "x",
}  # fmt: skip
_REST = {"sysid": BAD, PRIOR: COLOURS[8]}  # colours of methods that are not laws
_TITLES = {"wall_time": "wall time", "data_length": "length of the log", "noise": "sensor noise"}

Panels = dict[str, Callable[[Any], None]]
"""Functions that draw panels into matplotlib axes, by the label of the figure that they show."""


def lines(cells: Sequence[Cell]) -> dict[str, dict[str, Panels]]:
    """The panels with enough cells, by the stem of a picture's file and by the logs of a line.

    Markers are medians over the seeds, error bars reach from the best to the worst seed. Medians
    that are not finite are left out.
    """
    found = rows(cells)
    noises, durations = sorted({r.noise for r in found}), sorted({r.duration for r in found})
    if not found:
        return {}
    # the error of gain ratios of a single actuator is 0
    shown = [(label, key) for label, key in _SHOWN if any(r.median[key] for r in found)]

    def line(
        chosen: list[Row],
        abscissa: Callable[[Row], float],
        name: str,
        ticks: Mapping[float, str] | None = None,
    ) -> Panels:
        return {
            label: partial(_curves, chosen, key, abscissa, name, ticks or {})
            for label, key in shown
        }

    last = [r for r in found if r.duration == durations[-1]]
    logs = f"{durations[-1]:g} s of data"
    able = [r for r in last if r.method not in _REFERENCES]
    drawn = {
        "wall_time": {
            f"{sensors(x)}, {logs}": line(
                [r for r in able if r.noise == x], lambda row: row.median["wall_s"], "wall time [s]"
            )
            for x in noises
        }
    }
    if len(durations) > 1:
        ticks, name = {d: f"{d:g}" for d in durations}, "length of the log [s]"
        drawn["data_length"] = {
            sensors(x): line([r for r in found if r.noise == x], lambda r: r.duration, name, ticks)
            for x in noises
        }
    if len(noises) > 1:
        ticks = {float(k): f"{x:g} ×" if x else "exact" for k, x in enumerate(noises)}
        name = "sensor noise, multiple of the scenario's"
        drawn["noise"] = {logs: line(last, lambda row: noises.index(row.noise), name, ticks)}
    return drawn


def write_pictures(folder: Path, drawn: Mapping[str, Mapping[str, Panels]]) -> list[Path]:
    """Writes the plots as PNG, and returns their paths."""
    return [
        plots.png_of(
            list(of.values()), (12.5, 1.0 + 3.3 * len(of)), folder / f"{stem}.png", list(of)
        )
        for stem, of in sorted(drawn.items())
    ]


def figures(drawn: Mapping[str, Mapping[str, Panels]]) -> list[Figure]:
    """The plots of the page, the noisiest logs and distances first."""

    def labelled(label: str, draw: Callable[[Any], None], axis: Any) -> None:
        draw(axis)
        axis.set_ylabel(f"{label} [–]")

    return [
        plots.page_figure(
            f"{label.capitalize()} over {_TITLES[stem]}: {logs}",
            partial(labelled, label, panels[label]),
        )
        for label, _ in _SHOWN
        for stem, of in drawn.items()
        for logs, panels in reversed(list(of.items()))
        if label in panels
    ]


def _curves(
    chosen: list[Row], key: str, abscissa: Callable[[Row], float], name: str,
    ticks: Mapping[float, str], axis: Any,
) -> None:  # fmt: skip
    """Draws every method's medians over an abscissa, with error bars from best to worst seed.

    Without ticks the abscissa is logarithmic.
    """
    for method in dict.fromkeys(row.method for row in chosen):
        own = [row for row in chosen if row.method == method]
        own = [row for row in own if np.isfinite(row.median[key]) and row.median[key] > 0]
        if not own:
            continue
        colour = COLOURS[LAWS[method]] if method in LAWS else _REST.get(method, INK)
        dash = "--" if method in _REFERENCES else "-"
        median = np.array([row.median[key] for row in own])
        best = np.array([row.best[key] for row in own])
        worst = np.array([row.worst[key] for row in own])
        reach = np.vstack([median - best, np.where(np.isfinite(worst), worst, median) - median])
        ours = method in OURS
        axis.errorbar(
            list(map(abscissa, own)), median, reach, color=colour, ls=dash,
            marker=_MARKS.get(method, "."), ms=7 if ours else 5, lw=2.2 if ours else 1.1,
            elinewidth=0.8, capsize=2, label=method, gid=plots.CURVE + method,
        )  # fmt: skip
    axis.set_xlabel(name)
    if not ticks:
        plots.logarithmic(axis, "x")
    else:
        if min(ticks) > 0:  # lengths of logs
            axis.set_xscale("log")
            axis.minorticks_off()
        axis.set_xticks(list(ticks), list(ticks.values()))
    plots.logarithmic(axis)
