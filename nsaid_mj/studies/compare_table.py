"""The table of a comparison on the terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .cells import BOUND, FIGURES, Cell, rows, sensors

_HEADS = ("‖θ̄_P⊥‖/‖θ̂‖", "relative gains", "force residual", "time [s]")


def print_table(cells: Sequence[Cell], console: Console) -> None:
    """Prints a table of medians over the seeds, with the worst in brackets, and the failures."""
    several = len({cell.seed for cell in cells}) > 1
    wide = console.width >= 110
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("", no_wrap=True)
    for head in _HEADS:
        table.add_column(escape(head), justify="right", no_wrap=True)
    if wide:
        table.add_column("")
    section: tuple[float, float] | None = None
    failures = []
    for row in rows(cells):
        if section != (row.noise, row.duration):
            section = row.noise, row.duration
            table.add_row(f"[bold]{sensors(row.noise)}, {row.duration:g} s[/bold]")
        shown = [
            _digits(row.median[key])
            + (f" ({_digits(row.worst[key])})" if several and key != "wall_s" else "")
            + (f" {row.over_bound[key]:.3g}×" if key in row.over_bound else "")
            for _, key in FIGURES
        ]
        table.add_row(f"  {row.method}", *shown, *(["; ".join(row.notes)] if wide else []))
        if row.failures:
            failures.append(
                f"  {row.method}, {sensors(row.noise)}, {row.duration:g} s, failed on "
                f"{len(row.failures)} {'seed' if len(row.failures) == 1 else 'seeds'}: "
                f"{row.failures[0]}"
            )
    console.print(table)
    if several:
        console.print("Medians over the seeds, worst in brackets; – stands for a failed seed.")
    if any(row.method == BOUND for row in rows(cells)):
        console.print("Multiples (×) are of the Cramér–Rao bound of the same logs.")
    for line in failures:
        console.print(line, soft_wrap=True, markup=False)


def _digits(value: float) -> str:
    """Formats a figure with two digits; – if it is not finite."""
    if not np.isfinite(value):
        return "–"
    digits = f"{value:.1e}" if value < 0.01 else f"{value:.2g}"
    return digits.replace("e-0", "e-")
