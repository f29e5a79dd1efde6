"""A sweep on one page: how its figures are distributed over the varied fields, and what failed."""

from __future__ import annotations

import base64
import html
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from ..reporting.report import FILE, STYLE
from ..resources import write_text
from .sweep_results import HEADS, Group, Sweep, cells

matplotlib.use("Agg")

import matplotlib.pyplot as plt

PICTURE = "distributions.png"
_LOST, _EARLY = "#c92a2a", ("#e8590c", "#e0a800", "#a0522d", "#868e96", "#5f3dc4")
_BLUE = "#0b6e99"
_NONE = "no result"


def write(sweep: Sweep) -> list[Path]:
    """Writes a sweep's report.html and distributions.png, and returns their paths."""
    picture = _draw(sweep)
    path = sweep.folder / PICTURE
    unfinished = path.with_name(f".{PICTURE}.part")
    unfinished.write_bytes(picture)
    unfinished.replace(path)
    page = sweep.folder / FILE
    write_text(page, _page(sweep, picture))
    return [page, path]


def _page(sweep: Sweep, picture: bytes) -> str:
    manifest, name = sweep.manifest, html.escape(sweep.folder.name)
    results = len(sweep.rows) - len(sweep.lost)
    missing = manifest["runs"] - len(sweep.rows)
    unfinished = f'<p class="bad">{missing} runs are still to be made.</p>' if missing else ""
    seeds = manifest.get("seeds", manifest["runs"])  # `nsaid montecarlo`: one for every run
    data = base64.b64encode(picture).decode()
    versions = ", ".join(f"{key} {value}" for key, value in manifest["versions"].items())
    return f"""<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>{name}</title><style>{STYLE}</style>
<h1>{name}</h1>
<p class="lead">{html.escape(manifest["script"])}: {results} of {manifest["runs"]} runs have a
result; {seeds} seeds from the master seed {manifest["master_seed"]}</p>{unfinished}
<h2>Distributions</h2><img alt="distributions over the varied fields"
src="data:image/png;base64,{data}">
<p>Every dot is a run that has a result. Boxes hold the middle half, whiskers the middle 90 %, the
line is the median. Where several fields vary, a column is over all values of the others. A run has
converged once its distance to the true set stays at most 0.01; times are those of the runs that
have, and how many these are stands below.</p>
<h2>Combinations</h2><div class="scroll">{_combinations(sweep)}</div>
<p>Medians, 5 % and 95 % in brackets, over the runs that have a result; – is never.</p>
<h2>Failures</h2>{_failures(sweep)}
<p class="lead">{html.escape(versions)}</p></html>
"""


def _combinations(sweep: Sweep) -> str:
    fields = list(sweep.manifest["vary"])
    lines = [[*map(str, group.values.values()), *cells(group)] for group in sweep.groups]
    return _table([*fields, *HEADS], lines)


def _failures(sweep: Sweep) -> str:
    if not sweep.lost:
        return "<p>No run is without a result.</p>"
    lines = [[str(row["run"]), str(row["seed"]), row["failure"], sweep.command(row)]
             for row in sweep.lost]  # fmt: skip
    return _table(["run", "seed", "why", "to repeat it"], lines)


def _table(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{html.escape(word)}</th>" for word in heads)
    body = "".join(
        f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in line)}</tr>" for line in lines
    )
    return f"<table><tr>{head}</tr>{body}</table>"


# -- the picture -------------------------------------------------------------------------------


def _draw(sweep: Sweep) -> bytes:
    """One line of panels for every varied field; PNG."""
    fields = list(sweep.manifest["vary"])
    kinds = [[field] for field in fields] or [[]]
    widest = max((len(values) for values in sweep.manifest["vary"].values()), default=1)
    size = (min(max(12.5, 2.4 * widest), 40.0), 0.4 + 3.6 * len(kinds))
    figure, axes = plt.subplots(len(kinds), 3, figsize=size, squeeze=False, layout="constrained")
    endings = _endings(sweep)
    for line, chosen in zip(axes, kinds, strict=True):
        groups = sweep.by(*chosen)
        labels = [str(next(iter(group.values.values()), "all runs")) for group in groups]
        _distribution(line[0], groups, labels, "theta_perp_ratio")
        line[0].set_yscale("log")
        converged = [int(np.isfinite(g.column("time_to_converge")).sum()) for g in groups]
        under = [f"{label}\n{count}/{len(g.results)}"
                 for label, count, g in zip(labels, converged, groups, strict=True)]  # fmt: skip
        _distribution(line[1], groups, under, "time_to_converge")
        line[1].set_ylim(bottom=0)
        _shares(line[2], groups, labels, endings)
        for axis in line:
            axis.set_xlabel(chosen[0] if chosen else "")
            axis.grid(axis="y", alpha=0.3)
    titles = ("distance to the true set at the end", "time to converge [s]",
              "share of runs that failed")  # fmt: skip
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    plt.close(figure)
    return stream.getvalue()


def _distribution(axis: Any, groups: list[Group], labels: list[str], key: str) -> None:
    rng = np.random.default_rng(0)  # of the dots' places, which mean nothing
    for place, group in enumerate(groups):
        values = group.column(key)
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        axis.boxplot(
            [values], positions=[place], widths=0.55, whis=(5, 95), showfliers=False,
            medianprops={"color": _BLUE, "lw": 2},
        )  # fmt: skip
        aside = place + rng.uniform(-0.2, 0.2, len(values))
        axis.plot(aside, values, ".", color=_BLUE, ms=4, alpha=max(0.05, len(values) ** -0.4))
    _categories(axis, labels)


def _shares(axis: Any, groups: list[Group], labels: list[str], endings: list[str]) -> None:
    """Stacked bars: runs without a result, and runs that ended before their time, by reason."""
    bottom = np.zeros(len(groups))
    colours = [_LOST, *(_EARLY[k % len(_EARLY)] for k in range(len(endings)))]
    for ending, colour in zip([_NONE, *endings], colours, strict=True):
        counts = [_count(group)[ending] / max(len(group.rows), 1) for group in groups]
        label = ending if any(counts) else None
        axis.bar(range(len(groups)), counts, 0.55, bottom, color=colour, label=label)
        bottom += counts
    axis.set_ylim(0, max(1.4 * bottom.max(initial=0.0), 0.05))
    axis.yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1.0))
    if bottom.any():
        axis.legend(frameon=False, fontsize="small", loc="upper left")
    _categories(axis, labels)


def _count(group: Group) -> Counter[str]:
    return Counter({_NONE: len(group.rows) - len(group.results)}) + Counter(
        row["status"] for row in group.early
    )


def _endings(sweep: Sweep) -> list[str]:
    """How runs have ended before their time, each once."""
    return sorted({row["status"] for group in sweep.by() for row in group.early})


def _categories(axis: Any, labels: list[str]) -> None:
    axis.set_xticks(range(len(labels)), labels)
    axis.set_xlim(-0.6, len(labels) - 0.4)
