"""What a run has found, on the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from .. import evaluation, recording
from . import report


def print_summary(name: str, summary: dict[str, Any], folder: Path) -> None:
    """Prints what a run has found, and where its files are."""
    console = Console(highlight=False)
    ended = summary["status"]
    console.print(
        f"[bold]{name}[/bold]: {ended}, {summary['sim_s']:.4g} s simulated in "
        f"{summary['wall_s']:.1f} s ({summary['real_time_factor']:.1f} × real time)"
    )
    if ended != "completed":
        at = f"at t = {summary['status_time']:.4g} s"
        signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
        console.print(f"  [red]ended early[/red] {at}{signal}. {summary['status_remedy']}")
    if summary["mismatch"]:
        words = "; ".join(summary["mismatch"])
        console.print(f"  not in the structure: {words}", soft_wrap=True)
    if summary["fault"]:
        console.print(f"  fault: {summary['fault']}", soft_wrap=True)
    identifiers = {evaluation.OWN: summary, **summary["rivals"]}
    table = Table(box=None, pad_edge=False, padding=(0, 2))
    table.add_column("")
    for identifier in identifiers:
        table.add_column(identifier, justify="right")
    for label, key, unit in evaluation.FIGURES:
        cells = (evaluation.figure(s[key], unit) for s in identifiers.values())
        table.add_row("  " + label, *cells)
    console.print(table)
    for line in evaluation.confidence_lines(summary):
        console.print(f"  {line}", soft_wrap=True)
    r, p = summary["r"], summary["p"]
    console.print(f"  {p - r} of {p} directions of θ can be known; {r} cannot, among them:")
    lines = evaluation.unobservable_lines(summary)
    for what, fix in lines[:3]:
        console.print(f"    {what}\n      {fix}", soft_wrap=True)
    if len(lines) > 3:
        console.print(f"    … all of them in {folder / report.FILE}")
    console.print(
        f"  recording  {folder / recording.FILE}   (nsaid view {folder})\n"
        f"  report     {folder / report.FILE}"
    )
