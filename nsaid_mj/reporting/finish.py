"""From a run that has ended to its folder's files and a few lines on the terminal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from .. import evaluation, recording
from ..errors import BadRun
from ..experiment.loop import Ending, Run, reopen
from ..experiment.record import Record
from ..identifiers import Status
from ..resources import write_json, write_text
from . import report

SUMMARY, SCENARIO = "summary.json", "scenario.json"


def finish(run: Run, progress: bool = False) -> dict[str, Any]:
    """Writes summary.json, scenario.json, run.rrd and report.html; returns the summary.

    Args:
        run: a run that has ended, however it did.
        progress: say on the terminal what is being done.
    """
    with Console(stderr=True, quiet=not progress).status("judging the estimate"):
        summary = evaluation.summarize(run)
        write_json(run.folder / SUMMARY, summary)
        write_text(run.folder / SCENARIO, run.scenario.to_json() + "\n")
    if not len(run.record):
        return summary  # nothing to show
    with Console(stderr=True, quiet=not progress).status("writing recording and report"):
        recording.write(run, summary)
        report.write(run, summary)
    return summary


def rebuild(folder: Path) -> dict[str, Any]:
    """Finishes a run from its record, such as one that was killed.

    Raises:
        BadRun: the folder has no readable record, or one with less than two rows.
    """
    record = Record.read(folder)
    if len(record) < 2:
        raise BadRun(folder, f"its record has {len(record)} rows", "Run the scenario again")
    run = reopen(folder, record)
    _recall_ending(run)
    return finish(run, progress=True)


def _recall_ending(run: Run) -> None:
    """Takes from the summary there is, if it is of this very run, what a record cannot tell."""
    try:
        summary = json.loads((run.folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # a run that was killed has none
        return
    scenario, end = run.scenario, float(run.record["t"][-1])
    try:
        since = summary["status_time"] - end
        same = summary["scenario_hash"] == scenario.hash
    except (KeyError, TypeError):  # not a summary of ours
        return
    near = -1e-9 < since < (scenario.record_every + 0.5) * scenario.dt
    if not (same and near and run.record.complete):
        return
    words = {status.words: status for status in Status}
    run.ending = Ending(words[summary["status"]], summary["status_time"], summary["status_signal"])
    run.confidence = summary.get("confidence")
    for name, rival in summary["rivals"].items():
        run.statuses[name] = words[rival["status"]]
    steps = round(end / scenario.dt)
    cost = run.cost
    cost.wall, cost.steps = summary["wall_s"], steps
    cost.compile = summary.get("compile_s", 0.0)  # runs of earlier versions do not say
    cost.plant = 1e-6 * summary["plant_us_per_step"] * steps
    cost.identifier = 1e-6 * summary["identifier_us_per_step"] * steps


def tell(name: str, summary: dict[str, Any], folder: Path) -> None:
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
