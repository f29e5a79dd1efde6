"""The summary of a run on the terminal."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .. import evaluation, recording
from . import report

_GAINS, _DIRECTIONS = 12, 3  # printed at most; the report has all of them
_LENGTH = 120  # characters of a printed list of parameters, at most
_COMPILED = 0.5  # compile times below this are not mentioned [s]
_COLOURS = {
    "converged": "green",
    "still converging": "yellow",
    "not converging": "red",
    "the motion contradicts this structure": "red",
    "ended early": "red",
}


def print_summary(name: str, summary: dict[str, Any], folder: Path) -> None:
    """Prints the verdict on a run, the figures behind it, and the paths of its files.

    Args:
        name: of the run.
        summary: the content of its summary.json.
        folder: of the run.
    """
    console = Console(highlight=False)
    judgement, _, figures = summary["verdict"].partition(":")
    colour = _COLOURS[judgement]
    console.print(
        f"[bold]{escape(name)}[/bold]: [bold {colour}]{judgement}[/bold {colour}]:"
        f"{escape(figures)}",
        soft_wrap=True,
    )
    if summary["status_remedy"]:
        console.print(f"  {escape(summary['status_remedy'])}", soft_wrap=True)
    compiled = summary["compile_s"]
    done = "followed" if "stream" in summary else "simulated"
    console.print(
        f"  {summary['sim_s']:.4g} s {done} in {summary['wall_s']:.1f} s "
        f"({summary['real_time_factor']:.1f} × real time)"
        + (f", plus {compiled:.0f} s of one-time compilation" if compiled > _COMPILED else ""),
        soft_wrap=True,
    )
    if summary.get("mismatch"):
        words = "; ".join(summary["mismatch"])
        console.print(f"  not in the structure: {escape(words)}", soft_wrap=True)
    if told := report.stream_line(summary.get("stream", {})):
        console.print(f"  samples: {told}", soft_wrap=True)
    if summary["sensor_noise"]:
        console.print(f"  sensors: {escape(summary['sensor_noise'])}", soft_wrap=True)
    if summary.get("fault"):
        console.print(f"  fault: {escape(summary['fault'])}", soft_wrap=True)
    for fault in summary["faults"]:
        words = f"found at {fault['found']:.4g} s: {fault['words']}"
        sure = f"{100 * fault['confidence']:.4g} % sure"
        console.print(f"  [bold red]{escape(words)}[/bold red], {sure}", soft_wrap=True)
    _print_gains(console, summary)
    _print_figures(console, summary)
    for line in evaluation.confidence_lines(summary):
        console.print(f"  {escape(line)}", soft_wrap=True)
    _print_unobservable(console, summary, folder)
    file = folder / recording.FILE
    seen = f"{file}   (nsaid view {shlex.quote(str(folder))})"
    console.print(
        f"\n  recording  {seen if file.is_file() else recording.HINT}\n"
        f"  report     {folder / report.FILE}",
        soft_wrap=True,
        markup=False,
    )


def _print_gains(console: Console, summary: dict[str, Any]) -> None:
    """Prints the actuators' gains with their intervals, if the law states any."""
    rows = evaluation.gain_rows(summary)
    if not rows:
        return
    relative, true = rows[0][1] is not None, rows[0][3] is not None
    heads = [("gain / mean", relative), ("± (95 %)", True), ("true", true)]
    table = _table("actuators", *(head for head, shown in heads if shown))
    for label, value, interval, truth in rows[:_GAINS]:
        cells = [f"{value:.4f}"] if value is not None else []
        cells.append(f"{100 * interval:.2g} %")
        cells += [f"{truth:.4f}"] if truth is not None else []
        table.add_row("  " + escape(label), *cells)
    console.print(table)
    if len(rows) > _GAINS:
        console.print(f"    … and {len(rows) - _GAINS} more in the report")


def _print_figures(console: Console, summary: dict[str, Any]) -> None:
    """Prints the figures of every identifier of the run."""
    identifiers = {evaluation.OWN: summary, **summary["rivals"]}
    table = _table("figures", *(identifiers if len(identifiers) > 1 else [""]))
    for label, key, unit in evaluation.FIGURES:
        cells = (evaluation.figure(s.get(key), unit) for s in identifiers.values())
        table.add_row("  " + label, *cells)
    console.print(table)


def _table(title: str, *heads: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2), header_style="dim")
    table.add_column("\n  " + title)
    for head in heads:
        table.add_column("\n" + head, justify="right")
    return table


def _print_unobservable(console: Console, summary: dict[str, Any], folder: Path) -> None:
    """Prints the directions that no motion reveals, and what would fix them."""
    lines = evaluation.unobservable_lines(summary)
    among = ", among them" if len(lines) > _DIRECTIONS else ""
    end = f"{among}:" if lines else ""
    console.print(f"\n  {evaluation.observable_line(summary)}{end}")
    for what, fix in lines[:_DIRECTIONS]:
        console.print(f"    {escape(_cut(what))}\n      {escape(_cut(fix))}", soft_wrap=True)
    if len(lines) > _DIRECTIONS:
        console.print(f"    … all in {folder / report.FILE}", soft_wrap=True, markup=False)


def _cut(words: str) -> str:
    """A list in words; a long one is cut after a comma."""
    if len(words) <= _LENGTH:
        return words
    end = words.rfind(", ", 0, _LENGTH)
    return f"{words[: end if end > 0 else _LENGTH]}, …"
