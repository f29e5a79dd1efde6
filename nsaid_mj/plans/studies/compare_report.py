"""The results of a comparison: statistics over the seeds, the best method, and a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...base import CHOICES, Finding
from ...report import (
    BAD,
    COLOURS,
    INK,
    LAWS,
    Axes,
    Figure,
    Page,
    Result,
    Section,
    Side,
    Statistic,
    Table,
    Text,
    count,
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
_BARS = "Marks are medians over the seeds, bars reach from the best to the worst seed."


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


def page_of(runs: Runs) -> Page:
    """The page of a comparison."""
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
        drawn=figures(runs),
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
    "paper": "●",
    "cone": "■",
    "memory": "◆",
    "efficient": "⬢",
    BOUND: "_",
    "conventional": "●",
    "ols": "▲",
    "wls": "▼",
    "tls": "◀",
    "rls": "▶",
    "ekf": "✚",
    "sysid": "★",
    PRIOR: "x",
}
_REST = {"sysid": BAD, PRIOR: COLOURS[8]}  # colours of methods that are not laws


def figures(runs: Runs) -> list[Figure]:
    """The drawings with enough runs, of the noisiest logs and of distances first.

    Marks are medians over the seeds, bars reach from the best to the worst seed. Medians that are
    not finite are left out.
    """
    groups = groups_of(runs)
    if not groups:
        return []
    noises = runs.manifest["vary"]["noise"]
    durations = runs.manifest["vary"]["duration"]
    last = [g for g in groups if g.values["duration"] == durations[-1]]
    logs = f"{durations[-1]:g} s of data"
    found = []
    for label, key in _SHOWN:
        # all 0 is the error of a single actuator's gain ratio
        if not any(0 < group.median(key) < np.inf for group in groups):
            continue
        for x in reversed(noises):
            able = [g for g in last if is_rival(g) and g.values["noise"] == x]
            where = [group.median("wall_s") for group in able]
            side = Side.over([np.array(where)], "wall time [s]", log=True)
            title = f"{label.capitalize()} over wall time: {sensors(x)}, {logs}"
            found.append(_figure(title, label, key, able, where, side))
        for x in reversed(noises) if len(durations) > 1 else ():
            some = [g for g in groups if g.values["noise"] == x]
            side = Side.over([np.array(durations)], "length of the log [s]", log=True)
            side.ticks = [(d, f"{d:g}") for d in durations]
            title = f"{label.capitalize()} over length of the log: {sensors(x)}"
            where = [group.values["duration"] for group in some]
            found.append(_figure(title, label, key, some, where, side))
        if len(noises) > 1:
            names = [f"{x:g} ×" if x else "exact" for x in noises]
            name = "sensor noise, multiple of the scenario's"
            side = Side((-0.1, len(noises) - 0.9), name, names=names)
            where = [noises.index(group.values["noise"]) for group in last]
            title = f"{label.capitalize()} over sensor noise: {logs}"
            found.append(_figure(title, label, key, last, where, side))
    return found


def _figure(
    title: str,
    label: str,
    key: str,
    groups: Sequence[RunGroup],
    where: Sequence[float],
    side: Side,
) -> Figure:
    """Every method's medians of a figure at places of an axis, with bars from best to worst seed.

    Args:
        title: above the drawing.
        label: what the figure is.
        key: of the figure in the rows.
        groups: the runs.
        where: of each group its place on the horizontal axis.
        side: that axis.
    """
    middle = np.array([group.median(key) for group in groups])
    shown = (middle > 0) & (middle < np.inf)
    least = np.array([group.best(key) for group in groups])
    most = np.array([group.worst(key) for group in groups])
    most = np.where(np.isfinite(most), most, middle)
    up = Side.over([middle[shown], least[shown], most[shown]], f"{label} [–]", log=True)
    axes = Axes.alone(side, up)
    legend = []
    for method in dict.fromkeys(method_of(group) for group in groups):
        own = np.array([method_of(group) == method for group in groups]) & shown
        if not own.any():
            continue
        colour = COLOURS[LAWS[method]] if method in LAWS else _REST.get(method, INK)
        dash = "--" if method in _REFERENCES else "-"
        mark = _MARKS.get(method, "·")
        width = 2.2 if method in CHOICES["law of a run"] else 1.1
        x = np.array(where, float)[own]
        for at, low, high in zip(x, least[own], most[own], strict=True):
            axes.line([at, at], [low, high], colour, width=0.8, curve=method)
        axes.line(x, middle[own], colour, width=width, dash=dash, curve=method)
        axes.marks(x, middle[own], colour, method, mark)
        legend.append((method, colour, dash + mark if len(x) > 1 else mark))
    return axes.figure(title, legend)
