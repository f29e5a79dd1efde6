"""The report of a sweep: distributions of its figures over the varied fields, and failures."""

import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...report import (
    BAD,
    COLOURS,
    Page,
    Section,
    Text,
    categories,
    count,
    logarithmic,
    page_figure,
    png_of,
    thin,
)
from ...report import line as plots_line
from .folder import PICTURE
from .runs import RunGroup, Runs
from .study import repeated
from .study_page import study_page
from .sweep import SPREADS, lead_of, sweep_result, table_of

_COLUMNS = 8  # largest number of categories in a panel of ordinary width
_DOTS = 400  # largest number of dots per group of runs
_EARLY = (COLOURS[1], COLOURS[5], COLOURS[9], COLOURS[8], COLOURS[2])
_NONE = "no result"
_NOTE = (
    "Each dot is a run with a result{thinned}. Boxes span the quartiles, whiskers the 5 % to 95 % "
    "quantiles; the line is the median. If several fields vary, a column includes all values of "
    "the others. A run has converged when its distance to the true set stays within 1 %; times "
    "are those of converged runs, which are counted below each column."
)

Draw = Callable[[Any], None]
"""Draws one panel into matplotlib axes."""


def write_sweep_page(runs: Runs) -> list[Path]:
    """Writes a sweep's report.html and distributions.png, and returns their paths."""
    lines = [_line(runs, field) for field in runs.manifest["vary"] or [""]]
    widest = max((len(values) for values in runs.manifest["vary"].values()), default=1)
    size = (min(max(12.5, 2.4 * widest), 40.0), 0.4 + 3.6 * len(lines))
    picture = png_of(lines, size, runs.folder / PICTURE)
    return [sweep_page(runs, lines).write_html(runs.folder), picture]


def sweep_page(runs: Runs, lines: Sequence[Mapping[str, Draw]] = ()) -> Page:
    """The page of a sweep, with the panels of these lines if there are any."""
    manifest = runs.manifest
    fields = list(manifest["vary"])
    seeds = manifest.get("seeds", manifest["runs"])  # `nsaid montecarlo`: one for every run
    thinned = any(len(group.results) > _DOTS for field in fields for group in runs.by(field))
    drawn = []
    for field, line in zip(fields or [""], lines, strict=bool(lines)):
        wide = len(manifest["vary"].get(field, "")) > _COLUMNS or sum(map(len, lines)) == 1
        for title, draw in line.items():
            over = f"{title}, by {field}" if field else title
            drawn.append(page_figure(over, draw, wide))
    first = 2 if lines and "Time to converge" in lines[0] else 1
    last = [path.rpartition(".")[2] for path in fields]
    named = [k if last.count(k) == 1 else path for path, k in zip(fields, last, strict=True)]
    return study_page(
        runs,
        sweep_result(runs),
        Section("Combinations", [table_of(runs, named), Text(SPREADS)], brief=True),
        f"{lead_of(runs)}; {count(seeds, 'seed')} from the master seed {manifest['master_seed']}.",
        drawn=drawn,
        carrying=first,
        legend=_NOTE.format(thinned=f" (at most {_DOTS} in a column)" if thinned else ""),
        eyebrow=f"{'Monte Carlo' if 'montecarlo' in manifest else 'sweep'} of {manifest['script']}",
        commands=[_command(manifest)],
        notes=[
            "The plan is in manifest.json, all runs are in rows.jsonl and results.parquet. Run k "
            f"depends only on the master seed {manifest['master_seed']} and on k."
        ],
    )


def _command(manifest: Mapping[str, Any]) -> str:
    """The command line that repeats a sweep or a Monte Carlo study."""
    if "montecarlo" in manifest:
        own = "" if manifest["montecarlo"]["shared"] else " --own-plants"
        return repeated("montecarlo", manifest, {"runs": [manifest["runs"]]}) + own
    words = [repeated("sweep", manifest, {"seeds": [manifest["seeds"]]})]
    for path, values in manifest["vary"].items():
        varied = f"{path}={','.join(map(str, values))}"
        words += ["--vary", shlex.quote(varied)]
    return " ".join(words)


# -- the panels --------------------------------------------------------------------------------


def _line(runs: Runs, field: str) -> dict[str, Draw]:
    """The panels by title, over one varied field or, if `field` is empty, over all runs.

    There are panels of times and of failures only if some run converged, or failed.
    """
    groups = runs.by(field) if field else runs.by()
    labels = [str(next(iter(group.values.values()), "all runs")) for group in groups]
    converged = [int(np.isfinite(g.column("time_to_converge")).sum()) for g in groups]
    under = [
        f"{label}\n{count}/{len(g.results)}"
        for label, count, g in zip(labels, converged, groups, strict=True)
    ]
    distances = partial(_distribution, groups, labels, field, "theta_perp_ratio")
    panels = {"Distance to the true set at the end": distances}
    if any(converged):
        times = partial(_distribution, groups, under, field, "time_to_converge")
        panels["Time to converge"] = times
    endings = sorted({row["status"] for group in runs.by() for row in group.early})
    if runs.lost or endings:
        panels["Share of runs that failed"] = partial(_failed, groups, labels, field, endings)
    return panels


def _distribution(
    groups: list[RunGroup], labels: list[str], field: str, key: str, axis: Any
) -> None:
    """Draws a box and dots for the finite values of each group."""
    rng = np.random.default_rng(0)  # of the dots' horizontal jitter
    for place, group in enumerate(groups):
        values = np.sort(group.column(key))
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        axis.boxplot(
            [values],
            positions=[place],
            widths=0.55,
            whis=(5, 95),
            showfliers=False,
            medianprops={"color": COLOURS[0], "lw": 2},
        )
        shown = values[thin(len(values), _DOTS)]
        aside = place + rng.uniform(-0.2, 0.2, len(shown))
        pale = max(0.05, len(shown) ** -0.4)
        plots_line(axis, aside, shown, "run", ".", color=COLOURS[0], ms=4, alpha=pale)
    categories(axis, labels, field)
    if key == "time_to_converge":
        axis.set_ylim(bottom=0)
        axis.set_ylabel("time [s]")
    else:
        axis.set_ylabel("‖P⊥ᵀ θ̂‖ / ‖θ̂‖, of θ/scale [–]")
        logarithmic(axis)


def _failed(
    groups: list[RunGroup], labels: list[str], field: str, endings: list[str], axis: Any
) -> None:
    """Draws stacked bars of runs without a result and of runs that ended early, by reason."""
    bottom = np.zeros(len(groups))
    colours = [BAD, *(_EARLY[k % len(_EARLY)] for k in range(len(endings)))]
    for ending, colour in zip([_NONE, *endings], colours, strict=True):
        counts = [100 * _count(group)[ending] / max(len(group.rows), 1) for group in groups]
        label = ending if any(counts) else None
        axis.bar(range(len(groups)), counts, 0.55, bottom, color=colour, label=label)
        bottom += counts
    axis.set_ylim(0, max(1.05 * bottom.max(initial=0.0), 5.0))
    axis.set_ylabel("share of runs [%]")
    categories(axis, labels, field)


def _count(group: RunGroup) -> Counter[str]:
    return Counter({_NONE: len(group.rows) - len(group.results)}) + Counter(
        row["status"] for row in group.early
    )
