"""The report of a sweep: distributions of its figures over the varied fields, and failures."""

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...report import (
    BAD,
    COLOURS,
    INK,
    Axes,
    Figure,
    Page,
    Section,
    Side,
    Text,
    count,
    spread,
)
from .runs import RunGroup, Runs
from .study import repeated
from .study_page import study_page
from .sweep import SPREADS, lead_of, sweep_result, table_of

_COLUMNS = 8  # largest number of categories in a panel of ordinary width
_DOTS = 400  # largest number of dots per group of runs
_LONG = 28  # characters of a category's label, at most
_HALF = 0.27  # of the width of a box or a bar, of 1 between two
_EARLY = (COLOURS[1], COLOURS[5], COLOURS[9], COLOURS[8], COLOURS[2])
_NONE = "no result"
_NOTE = (
    "Each dot is a run with a result{thinned}. Boxes span the quartiles, whiskers the 5 % to 95 % "
    "quantiles; the line is the median. If several fields vary, a column includes all values of "
    "the others. A run has converged when its distance to the true set stays within 1 %; times "
    "are those of converged runs, which are counted above each column."
)


def write_sweep_page(runs: Runs) -> Path:
    """Writes a sweep's report.html and returns its path."""
    return sweep_page(runs).write_html(runs.folder)


def sweep_page(runs: Runs) -> Page:
    """The page of a sweep."""
    manifest = runs.manifest
    fields = list(manifest["vary"])
    seeds = manifest.get("seeds", manifest["runs"])  # `nsaid montecarlo`: one for every run
    thinned = any(len(group.results) > _DOTS for field in fields for group in runs.by(field))
    drawn = [figure for field in fields or [""] for figure in _figures(runs, field)]
    carrying = 2 if any(_converged(group) for group in runs.by()) else 1
    last = [path.rpartition(".")[2] for path in fields]
    named = [k if last.count(k) == 1 else path for path, k in zip(fields, last, strict=True)]
    return study_page(
        runs,
        sweep_result(runs),
        Section("Combinations", [table_of(runs, named), Text(SPREADS)], brief=True),
        f"{lead_of(runs)}; {count(seeds, 'seed')} from the master seed {manifest['master_seed']}.",
        drawn=drawn,
        carrying=carrying,
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


# -- the drawings ------------------------------------------------------------------------------


def _figures(runs: Runs, field: str) -> list[Figure]:
    """The drawings over one varied field or, if `field` is empty, over all runs.

    There are drawings of times and of failures only if some run converged, or failed.
    """
    groups = runs.by(field) if field else runs.by()
    labels = [str(next(iter(group.values.values()), "all runs")) for group in groups]
    short = [label if len(label) <= _LONG else label[: _LONG - 1] + "…" for label in labels]
    columns = Side((-0.6, len(short) - 0.4), field, names=short)
    endings = sorted({row["status"] for group in runs.by() for row in group.early})
    converged = any(map(_converged, groups))
    failed = bool(runs.lost or endings)
    over = f", by {field}" if field else ""
    wide = len(groups) > _COLUMNS or not (converged or failed or len(runs.manifest["vary"]) > 1)
    found = [_distances(groups, columns, wide).figure(f"Distance to the true set at the end{over}")]
    if converged:
        found.append(_times(groups, columns, wide).figure(f"Time to converge{over}"))
    if failed:
        axes, legend = _failures(groups, columns, endings, wide)
        found.append(axes.figure(f"Share of runs that failed{over}", legend))
    return found


def _distances(groups: Sequence[RunGroup], columns: Side, wide: bool) -> Axes:
    """Distributions of the distances to the true set, on a logarithmic axis."""
    values = [_finite(group, "theta_perp_ratio") for group in groups]
    axes = Axes.alone(columns, Side.over(values, "‖P⊥ᵀ θ̂‖ / ‖θ̂‖, of θ/scale [–]", log=True), wide)
    _distributions(axes, values)
    return axes


def _times(groups: Sequence[RunGroup], columns: Side, wide: bool) -> Axes:
    """Distributions of the times to converge, with the number of runs that did."""
    values = [_finite(group, "time_to_converge") for group in groups]
    longest = max(some.max() for some in values if len(some))
    axes = Axes.alone(columns, Side((0.0, 1.15 * longest or 1.0), "time [s]"), wide)
    _distributions(axes, values)
    for place, group in enumerate(groups):
        axes.text(f"{_converged(group)}/{len(group.results)}", place, 1.08 * longest)
    return axes


def _distributions(axes: Axes, columns: Sequence[np.ndarray]) -> None:
    """Draws dots, and a box with whiskers, for the values of each column."""
    rng = np.random.default_rng(0)  # of the dots' horizontal jitter
    for place, values in enumerate(columns):
        if not len(values):
            continue
        low, first, median, third, high = np.quantile(values, (0.05, 0.25, 0.5, 0.75, 0.95))
        left = place - _HALF
        right = place + _HALF
        for ends in ((low, first), (third, high)):
            axes.line([place, place], ends, INK, width=0.8)
        for end in (low, high):
            axes.line([place - _HALF / 2, place + _HALF / 2], [end, end], INK, width=0.8)
        corners = [left, right, right, left, left]
        axes.line(corners, [first, first, third, third, first], INK, width=0.8)
        axes.line([left, right], [median, median], COLOURS[0], width=2.0)
        shown = values[spread(len(values), _DOTS)]
        aside = place + rng.uniform(-0.2, 0.2, len(shown))
        pale = max(0.05, len(shown) ** -0.4)
        axes.marks(aside, shown, COLOURS[0], "run", "·", opacity=pale)


def _failures(
    groups: Sequence[RunGroup], columns: Side, endings: Sequence[str], wide: bool
) -> tuple[Axes, list[tuple[str, str, str]]]:
    """Stacked bars of runs without a result and of runs that ended early, by reason; a legend."""
    reasons = [_NONE, *endings]
    colours = [BAD, *(_EARLY[k % len(_EARLY)] for k in range(len(endings)))]
    counts = [_ended(group) for group in groups]
    sizes = np.array([max(len(group.rows), 1) for group in groups])
    shares = np.array([[100 * count[reason] for reason in reasons] for count in counts])
    shares = shares / sizes[:, None]
    most = max(1.05 * shares.sum(axis=1).max(initial=0.0), 5.0)
    axes = Axes.alone(columns, Side((0.0, most), "share of runs [%]"), wide)
    for place, column in enumerate(shares):
        tops = np.cumsum(column)
        for reason, colour, top, share in zip(reasons, colours, tops, column, strict=True):
            if share:
                x = place + _HALF * np.array([-1, 1, 1, -1])
                axes.area(x, [top - share, top - share, top, top], colour, reason)
    occurring = [k for k in range(len(reasons)) if shares[:, k].any()]
    return axes, [(reasons[k], colours[k], "■") for k in occurring]


def _finite(group: RunGroup, key: str) -> np.ndarray:
    """(k,) the finite values of a figure, in ascending order."""
    values = np.sort(group.column(key))
    return values[np.isfinite(values)]


def _converged(group: RunGroup) -> int:
    """Number of runs that converged."""
    return int(np.isfinite(group.column("time_to_converge")).sum())


def _ended(group: RunGroup) -> Counter[str]:
    """Numbers of runs by how they ended, if not with the scenario's end."""
    return Counter({_NONE: len(group.rows) - len(group.results)}) + Counter(
        row["status"] for row in group.early
    )
