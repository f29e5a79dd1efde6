"""The results of a comparison: statistics over the seeds, the best method, a page and plots."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...base import CHOICES, Finding
from ...report import (
    BAD,
    COLOURS,
    CURVE,
    INK,
    LAWS,
    Figure,
    Page,
    Result,
    Section,
    Statistic,
    Table,
    Text,
    count,
    logarithmic,
    page_figure,
    png_of,
)
from ...report import Cell as Written
from .runs import RunGroup, Runs, digits
from .study import Row, repeated
from .study_page import study_page

PRIOR = "prior"
"""Name of the prior, which is evaluated like a method."""

BOUND = "bound"
"""Name of the Cramér–Rao bound, whose median figures stand beside those of the methods."""

_REFERENCES = (PRIOR, BOUND)

DEFAULT = CHOICES["method"][:-1]  # all but sysid, which takes minutes

FIGURES = (
    ("distance to the true set", "theta_perp_ratio"),
    ("error of gain ratios", "actuator_ratio_error"),
    ("force residual, held out", "force_residual_ratio"),
    ("wall time", "wall_s"),
)
"""The figures that are compared: label, key."""


def row_of(
    method: str,
    seed: int,
    noise: float,
    duration: float,
    theta_perp_ratio: float | None = None,
    actuator_ratio_error: float | None = None,
    force_residual_ratio: float | None = None,
    wall_s: float | None = None,
    note: str = "",
    failure: str = "",
) -> Row:
    """The row of one method on one log, as in compare.csv.

    Args:
        method: name of the method.
        seed: seed of the log.
        noise: multiple of the scenario's sensor noise.
        duration: length of the log [s].
        theta_perp_ratio: as in summary.json, as all figures; None if the method failed.
        actuator_ratio_error: a figure.
        force_residual_ratio: a figure; None also if the plant diverges when held out.
        wall_s: wall time of the method, including its regressors [s].
        note: settings that the method chose automatically.
        failure: why it failed; empty if it did not.
    """
    return {
        "method": method,
        "seed": seed,
        "noise": noise,
        "duration": duration,
        "theta_perp_ratio": theta_perp_ratio,
        "actuator_ratio_error": actuator_ratio_error,
        "force_residual_ratio": force_residual_ratio,
        "wall_s": wall_s,
        "note": note,
        "failure": failure,
    }


VARIED = ("noise", "duration", "method")
"""Names of the varied values of a comparison."""


def runs_of(folder: Path, manifest: dict[str, Any], rows: list[Row]) -> Runs:
    """The runs of a comparison, grouped as they are shown: by noise, duration and method."""
    order = (PRIOR, BOUND, *CHOICES["method"])
    vary = {name: sorted({row[name] for row in rows}) for name in VARIED[:2]}
    vary["method"] = [name for name in order if any(row["method"] == name for row in rows)]
    return Runs(folder, manifest | {"vary": vary}, rows)


def groups_of(runs: Runs) -> list[RunGroup]:
    """The runs of every method on all logs of one noise and length; a failed seed is infinite."""
    return [group for group in runs.by(*VARIED) if group.rows]


def sensors(noise: float) -> str:
    """A multiple of the scenario's sensor noise, in words."""
    return "exact sensors" if noise == 0 else f"{noise:g} × noise"


def log_of(group: RunGroup) -> str:
    """The logs of a group, in words."""
    return f"{sensors(group.values['noise'])}, {group.values['duration']:g} s"


def several(group: RunGroup) -> bool:
    """Whether there are several seeds."""
    return len(group.rows) > 1


def method_of(group: RunGroup) -> str:
    """The name of the method of a group."""
    return group.values["method"]


def is_rival(group: RunGroup) -> bool:
    """Whether a group is of a method, not of the prior or the bound."""
    return method_of(group) not in _REFERENCES


_DECIDES = "theta_perp_ratio"
_HEADS = ("distance", "gain ratios", "force residual", "time [s]")
_MEANING = "Distance to the true set, error of gain ratios, force residual on a held-out motion."
_WORST = "Medians over the seeds, worst in brackets; – stands for a failed seed."
_MULTIPLES = "Multiples (×) are of the Cramér–Rao bound of the same logs."
_BARS = "Markers are medians over the seeds, bars reach from the best to the worst seed."


def result_of(runs: Runs) -> Result:
    """The result of a comparison: every figure of every method, by log and method.

    The verdict is the method closest to the true set on the longest and noisiest log.
    """
    groups = groups_of(runs)
    rivals = [group for group in groups if is_rival(group)]
    able = [group for group in rivals if math.isfinite(group.median(_DECIDES))]
    text = "No method has a result."
    if able:
        hardest = max(log_key(group) for group in able)
        same = [group for group in able if log_key(group) == hardest]
        winner = min(same, key=lambda group: group.median(_DECIDES))
        text = (
            f"{method_of(winner)} comes closest to the true set: within "
            + digits(winner.median(_DECIDES))
            + (
                f" in the median, {digits(winner.worst(_DECIDES))} at worst"
                if several(winner)
                else ""
            )
            + f" ({log_of(winner)})."
        )
    names = {f"{log_of(group)}: {method_of(group)}": group for group in groups}
    figures = [
        Statistic(
            label,
            "s" if key == "wall_s" else "%",
            {name: group.median(key) for name, group in names.items()},
            {name: group.worst(key) for name, group in names.items() if several(group)},
        )
        for label, key in FIGURES
    ]
    failures = [
        Finding(
            "refusal",
            "failed",
            f"{method_of(group)}, {log_of(group)}",
            f"failed on {count(len(group.failures), 'seed')}: {group.failures[0]}",
        )
        for group in groups
        if group.failures
    ]
    return Result(
        explains="no" if not able else "yes" if len(able) == len(rivals) else "partly",
        verdict=text,
        statistics=tuple(figures),
        findings=tuple(failures),
    )


def log_key(group: RunGroup) -> tuple[float, float]:
    """Noise and length of the logs of a group."""
    return group.values["noise"], group.values["duration"]


def page_of(runs: Runs, drawn: Mapping[str, Mapping[str, Panels]]) -> Page:
    """The page of a comparison, with its plots from `lines`."""
    groups = groups_of(runs)
    bounds = {log_key(group): group for group in groups if method_of(group) == BOUND}
    lines: list[list[Written]] = []
    for group in groups:
        if [log_of(group)] not in lines:
            lines.append([log_of(group)])
        notes = dict.fromkeys(row["note"] for row in group.rows if row["note"])
        cells = _figures(group, bounds.get(log_key(group)))
        lines.append([method_of(group), *cells, "; ".join(notes)])
    heads = ["method", *_HEADS, "chosen automatically"]
    table = Table(heads, lines, (0, 5), spare=(5, 4, 2), most=len(lines))
    notes = [_MEANING]
    if any(several(group) for group in groups):
        notes.append(_WORST)
    if runs.manifest["bound"]:
        notes.append(_MULTIPLES)
    methods = len({method_of(group) for group in groups})
    seeds = len({row["seed"] for row in runs.rows})
    return study_page(
        runs,
        result_of(runs),
        Section("All methods", [table, Text(" ".join(notes))], brief=True),
        f"{count(methods, 'method')}, {count(seeds, 'seed')}.",
        drawn=figures(drawn),
        carrying=2,
        legend=_BARS,
        eyebrow=f"methods on the same logs of {runs.manifest['script']}",
        commands=[_command(runs.manifest)],
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


def _figures(group: RunGroup, bound: RunGroup | None) -> list[str]:
    """Median, worst in brackets if there are several seeds, and the multiple of the bound."""
    cells = []
    for _, key in FIGURES:
        cell = digits(group.median(key))
        if several(group) and key != "wall_s":
            cell += f" ({digits(group.worst(key))})"
        multiple = over_bound(group, bound, key)
        cells.append(cell if multiple is None else f"{cell} {multiple:.3g}×")
    return cells


def over_bound(group: RunGroup, bound: RunGroup | None, key: str) -> float | None:
    """A method's median figure over that of the Cramér–Rao bound of the same logs, if there is."""
    least = bound.median(key) if bound is not None and is_rival(group) else 0.0
    return group.median(key) / least if 0 < least < np.inf else None


_SHOWN = FIGURES[:3]
_MARKS = {
    "paper": "o",
    "cone": "s",
    "memory": "D",
    "efficient": "h",
    BOUND: "_",
    "conventional": "o",
    "ols": "^",
    "wls": "v",
    "tls": "<",
    "rls": ">",
    "ekf": "P",
    "sysid": "*",
    PRIOR: "x",
}
_REST = {"sysid": BAD, PRIOR: COLOURS[8]}  # colours of methods that are not laws
_TITLES = {"wall_time": "wall time", "data_length": "length of the log", "noise": "sensor noise"}

Panels = dict[str, Callable[[Any], None]]
"""Functions that draw panels into matplotlib axes, by the label of the figure that they show."""


def lines(runs: Runs) -> dict[str, dict[str, Panels]]:
    """The panels with enough runs, by the stem of a picture's file and by the logs of a line.

    Markers are medians over the seeds, error bars reach from the best to the worst seed. Medians
    that are not finite are left out.
    """
    groups = groups_of(runs)
    if not groups:
        return {}
    noises = runs.manifest["vary"]["noise"]
    durations = runs.manifest["vary"]["duration"]
    # the error of gain ratios of a single actuator is 0
    shown = [(label, key) for label, key in _SHOWN if any(g.median(key) for g in groups)]

    def line(
        chosen: list[RunGroup],
        abscissa: Callable[[RunGroup], float],
        name: str,
        ticks: Mapping[float, str] | None = None,
    ) -> Panels:
        return {
            label: partial(_curves, chosen, key, abscissa, name, ticks or {})
            for label, key in shown
        }

    last = [g for g in groups if g.values["duration"] == durations[-1]]
    logs = f"{durations[-1]:g} s of data"
    able = [g for g in last if is_rival(g)]
    drawn = {
        "wall_time": {
            f"{sensors(x)}, {logs}": line(
                [g for g in able if g.values["noise"] == x],
                lambda group: group.median("wall_s"),
                "wall time [s]",
            )
            for x in noises
        }
    }
    if len(durations) > 1:
        ticks = {d: f"{d:g}" for d in durations}
        drawn["data_length"] = {
            sensors(x): line(
                [g for g in groups if g.values["noise"] == x],
                lambda group: group.values["duration"],
                "length of the log [s]",
                ticks,
            )
            for x in noises
        }
    if len(noises) > 1:
        ticks = {float(k): f"{x:g} ×" if x else "exact" for k, x in enumerate(noises)}
        name = "sensor noise, multiple of the scenario's"
        of_noise = line(last, lambda group: noises.index(group.values["noise"]), name, ticks)
        drawn["noise"] = {logs: of_noise}
    return drawn


def write_pictures(folder: Path, drawn: Mapping[str, Mapping[str, Panels]]) -> list[Path]:
    """Writes the plots as PNG, and returns their paths."""
    return [
        png_of(list(of.values()), (12.5, 1.0 + 3.3 * len(of)), folder / f"{stem}.png", list(of))
        for stem, of in sorted(drawn.items())
    ]


def figures(drawn: Mapping[str, Mapping[str, Panels]]) -> list[Figure]:
    """The plots of the page, the noisiest logs and distances first."""

    def labelled(label: str, draw: Callable[[Any], None], axis: Any) -> None:
        draw(axis)
        axis.set_ylabel(f"{label} [–]")

    return [
        page_figure(
            f"{label.capitalize()} over {_TITLES[stem]}: {logs}",
            partial(labelled, label, panels[label]),
        )
        for label, _ in _SHOWN
        for stem, of in drawn.items()
        for logs, panels in reversed(list(of.items()))
        if label in panels
    ]


def _curves(
    chosen: list[RunGroup],
    key: str,
    abscissa: Callable[[RunGroup], float],
    name: str,
    ticks: Mapping[float, str],
    axis: Any,
) -> None:
    """Draws every method's medians over an abscissa, with error bars from best to worst seed.

    Without ticks the abscissa is logarithmic.
    """
    for method in dict.fromkeys(method_of(group) for group in chosen):
        own = [group for group in chosen if method_of(group) == method]
        own = [group for group in own if 0 < group.median(key) < np.inf]
        if not own:
            continue
        colour = COLOURS[LAWS[method]] if method in LAWS else _REST.get(method, INK)
        dash = "--" if method in _REFERENCES else "-"
        middle = np.array([group.median(key) for group in own])
        least = np.array([group.best(key) for group in own])
        most = np.array([group.worst(key) for group in own])
        reach = np.vstack([middle - least, np.where(np.isfinite(most), most, middle) - middle])
        ours = method in CHOICES["law of a run"]
        axis.errorbar(
            list(map(abscissa, own)),
            middle,
            reach,
            color=colour,
            ls=dash,
            marker=_MARKS.get(method, "."),
            ms=7 if ours else 5,
            lw=2.2 if ours else 1.1,
            elinewidth=0.8,
            capsize=2,
            label=method,
            gid=CURVE + method,
        )
    axis.set_xlabel(name)
    if not ticks:
        logarithmic(axis, "x")
    else:
        if min(ticks) > 0:  # lengths of logs
            axis.set_xscale("log")
            axis.minorticks_off()
        axis.set_xticks(list(ticks), list(ticks.values()))
    logarithmic(axis)
