"""The report of a comparison: which method is best, figures of all, and their plots."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..evaluation import figure
from ..reporting import pages
from ..reporting.report import FILE
from ..resources import write_text
from . import compare_plots
from .cells import BOUND, FIGURES, PRIOR, Cell, Row, rows, sensors

_DECIDES = "theta_perp_ratio"


def write(
    folder: Path,
    cells: Sequence[Cell],
    drawn: Mapping[str, Sequence[compare_plots.Line]],
    manifest: dict[str, Any],
) -> Path:
    """Writes a comparison's report.html and returns its path.

    Args:
        folder: of the comparison.
        cells: its results; may be empty.
        drawn: its plots, see `compare_plots.lines`.
        manifest: see `compare.Plan.manifest`.
    """
    found = rows(cells)
    figures = compare_plots.figures(drawn)
    failures = [
        pages.alarm(f"{row.failures[0]}", "poor", f"{row.method} failed, {_log(row)}:", "✘")
        for row in found
        if row.failures
    ]
    methods = list(dict.fromkeys(row.method for row in found))
    seeds = len({cell.seed for cell in cells})
    page = pages.render(
        "compare.html",
        eyebrow=f"methods on the same logs of {manifest['script']}",
        heading=folder.name,
        lead=f"{len(methods)} methods, {seeds} {'seed' if seeds == 1 else 'seeds'}.",
        verdict=_verdict(found),
        alarms=failures,
        carrying=figures[:2],
        figures=figures[2:],
        heads=["log", "method", *(label for label, _ in FIGURES), "chosen by itself"],
        lines=[_line(row) for row in found],
        again=pages.again(
            [_command(manifest)],
            manifest["versions"],
            "All cells are in compare.json and compare.csv.",
        ),
    )
    path = folder / FILE
    write_text(path, page)
    return path


def _command(manifest: dict[str, Any]) -> str:
    """The command line that repeats a comparison."""
    noisy = [noise for noise in manifest["noises"] if noise]
    kinds = ["ideal"] * (0 in manifest["noises"]) + ["noisy"] * bool(noisy)
    lists = {
        "--methods": manifest["methods"],
        "--seeds": manifest["seeds"],
        "--sensors": kinds,
        "--durations": [f"{d:g}" for d in manifest["durations"]],
        "--noise-scales": [f"{noise:g}" for noise in noisy],
    }
    flags = [word for flag, values in lists.items() if values
             for word in (flag, ",".join(map(str, values)))]  # fmt: skip
    bound = ["--bound"] if manifest["bound"] else []
    words = ["nsaid", "compare", manifest["script"], *manifest["arguments"], *flags, *bound]
    return shlex.join(words)


def _verdict(found: Sequence[Row]) -> dict[str, str]:
    """Which method is closest to the true set on the longest and noisiest log."""
    own = [row for row in found if row.method not in {PRIOR, BOUND}]
    able = [row for row in own if math.isfinite(row.median[_DECIDES])]
    if not able:
        return pages.verdict("poor", "No method has a result.")
    hardest = max(able, key=lambda row: (row.noise, row.duration))
    same = [r for r in able if (r.noise, r.duration) == (hardest.noise, hardest.duration)]
    best = min(same, key=lambda row: row.median[_DECIDES])
    text = (
        f"{best.method} comes closest to the true set: {figure(best.median[_DECIDES], '%')} in the "
        f"median, {figure(best.worst[_DECIDES], '%')} at worst ({_log(best)})."
    )
    return pages.verdict("good" if len(able) == len(own) else "fair", text)


def _log(row: Row) -> str:
    """Which logs, with spaces that do not break between a number and its unit."""
    return f"{sensors(row.noise)}, {row.duration:g} s".replace(
        " × noise", "\u00a0×\u00a0noise"
    ).replace(" s", "\u00a0s")


def _line(row: Row) -> list[str]:
    cells = []
    for _, key in FIGURES:
        median, worst = row.median[key], row.worst[key]
        told = f"{median:.2g}" if math.isfinite(median) else "–"
        if key != "wall_s" and math.isfinite(worst):
            told += f" ({worst:.2g})"
        if key in row.over_bound:
            told += f" {row.over_bound[key]:.3g}×"
        cells.append(told)
    return [_log(row), row.method, *cells, "; ".join(row.notes)]
