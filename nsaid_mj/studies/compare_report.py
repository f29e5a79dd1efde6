"""The report of a comparison: which method is best, figures of all, and their plots."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from ..evaluation import figure
from ..evaluation.result import Mark, judged
from ..reporting import pages
from ..reporting.pages import Figures, Page, Section, Table, Text, count
from ..reporting.terminal import print_panels
from ..robot.findings import Finding
from .cells import BOUND, FIGURES, PRIOR, Cell, Row, rows, sensors

if TYPE_CHECKING:
    from .compare_plots import Line

_DECIDES = "theta_perp_ratio"
_HEADS = ("‖θ̄_P⊥‖/‖θ̂‖", "gain ratios", "force residual", "time [s]")
_WORST = "Medians over the seeds, worst in brackets; – stands for a failed seed."
_MULTIPLES = "Multiples (×) are of the Cramér–Rao bound of the same logs."
_BARS = "Markers are medians over the seeds, bars reach from the best to the worst seed."


def write(
    folder: Path,
    cells: Sequence[Cell],
    drawn: Mapping[str, Sequence[Line]],
    manifest: dict[str, Any],
) -> Path:
    """Writes a comparison's report.html and returns its path.

    Args:
        folder: of the comparison.
        cells: its results; may be empty.
        drawn: its plots, see `compare_plots.lines`.
        manifest: see `compare.Plan.manifest`.
    """
    from . import compare_plots  # imported late: matplotlib takes half a second

    found = rows(cells)
    figures = compare_plots.figures(drawn)
    failures = [
        Finding("refusal", "failed", f"{row.method} failed, {_log(row)}", row.failures[0])
        for row in found
        if row.failures
    ]
    methods = len(dict.fromkeys(row.method for row in found))
    seeds = len({cell.seed for cell in cells})
    heads = ["log", "method", *(label for label, _ in FIGURES), "chosen by itself"]
    table = Table(heads, [_line(row) for row in found], (0, 1, 6))
    sections = [Section("All methods", [table, Text(f"{_WORST} {_MULTIPLES}", note=True)])]
    if figures[2:]:
        more = [Figures(figures[2:], "plots", 6), Text(_BARS, note=True)]
        sections.append(Section("More plots", more))
    page = Page(
        heading=folder.name,
        verdict=verdict_of(cells),
        eyebrow=f"methods on the same logs of {manifest['script']}",
        lead=f"{count(methods, 'method')}, {count(seeds, 'seed')}.",
        findings=failures,
        carrying=figures[:2],
        sections=sections,
        commands=[_command(manifest)],
        versions=manifest["versions"],
        notes=["All cells are in compare.json and compare.csv."],
    )
    return pages.write(page, folder)


def print_table(cells: Sequence[Cell], console: Console) -> None:
    """Prints medians over the seeds, with the worst in brackets, and the failures."""
    several = len({cell.seed for cell in cells}) > 1
    found = rows(cells)
    lines: list[list[pages.Cell]] = []
    for row in found:
        log = f"{sensors(row.noise)}, {row.duration:g} s"
        if [log] not in lines:
            lines.append([log])
        lines.append([row.method, *_figures(row, several), "; ".join(row.notes)])
    table = Table(["", *_HEADS, ""], lines, (0, 5), spare=(5,), most=len(lines))
    print_panels([table], console)
    notes = [_WORST] * several + [_MULTIPLES] * any(row.method == BOUND for row in found)
    failures = [
        f"{row.method}, {_log(row)}, failed on {count(len(row.failures), 'seed')}: "
        f"{row.failures[0]}"
        for row in found
        if row.failures
    ]
    print_panels([Text(line) for line in [*notes, *failures]], console)


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


def verdict_of(cells: Sequence[Cell]) -> Mark:
    """Which method is closest to the true set on the longest and noisiest log."""
    own = [row for row in rows(cells) if row.method not in {PRIOR, BOUND}]
    able = [row for row in own if math.isfinite(row.median[_DECIDES])]
    if not able:
        return judged("no", "No method has a result.")
    hardest = max(able, key=lambda row: (row.noise, row.duration))
    same = [r for r in able if (r.noise, r.duration) == (hardest.noise, hardest.duration)]
    best = min(same, key=lambda row: row.median[_DECIDES])
    text = (
        f"{best.method} comes closest to the true set: {figure(best.median[_DECIDES], '%')} in the "
        f"median, {figure(best.worst[_DECIDES], '%')} at worst ({_log(best)})."
    )
    return judged("yes" if len(able) == len(own) else "partly", text)


def _log(row: Row) -> str:
    """Which logs, with spaces that do not break between a number and its unit."""
    return f"{sensors(row.noise)}, {row.duration:g} s".replace(
        " × noise", "\u00a0×\u00a0noise"
    ).replace(" s", "\u00a0s")


def _line(row: Row) -> list[pages.Cell]:
    return [_log(row), row.method, *_figures(row), "; ".join(row.notes)]


def _figures(row: Row, several: bool = True) -> list[str]:
    """Median, worst in brackets if there are several seeds, and the multiple of the bound."""
    cells = []
    for _, key in FIGURES:
        worst = several and key != "wall_s"
        told = _digits(row.median[key]) + (f" ({_digits(row.worst[key])})" if worst else "")
        cells.append(told + (f" {row.over_bound[key]:.3g}×" if key in row.over_bound else ""))
    return cells


def _digits(value: float) -> str:
    """Formats a figure with two digits; – if it is not finite."""
    if not math.isfinite(value):
        return "–"
    return (f"{value:.1e}" if value < 0.01 else f"{value:.2g}").replace("e-0", "e-")
