"""Post-processing of a run: writes summary, scenario, recording and report into its folder."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from .. import evaluation, recording
from ..bounds import LARGEST
from ..errors import BadRun
from ..evaluation.verify import ROWS, verify
from ..experiment.loop import Cost, Ending, Run, reopen
from ..experiment.record import Record
from ..laws import Status
from ..numerics.threads import single_threaded
from ..pages import report
from ..pages.page import write_html
from ..pages.progress import Progress
from ..resources import json_of, locked, write_json, write_text

_BLOCK = 10_000  # rows of a record, which may be large, in memory at once

SUMMARY, SCENARIO = "summary.json", "scenario.json"


@single_threaded
def finish(
    run: Run, say: Callable[[str], None] = lambda _: None, command: str = ""
) -> dict[str, Any]:
    """Writes summary.json, scenario.json, run.rrd and report.html; returns the summary.

    A run without any row, or with figures beyond 1e15, has no recording and no report; without
    Rerun there is no recording.

    Args:
        run: a finished run, completed or not.
        say: called with the name of each stage, for a progress display.
        command: command line of the run, for the report; empty if unknown.

    Raises:
        FolderInUse: another run is writing into the folder.
        NotWritten: a file cannot be written; the record is kept.
        BadRun: the folder no longer has this run's record, or a completed run has no row.
    """
    with locked(run.folder):
        if Record.metadata_of(run.folder) != run.record.metadata:
            raise BadRun(run.folder, "it holds another run's record", "Run the scenario again")
        if run.ending.status is Status.completed and not len(run.record):
            raise BadRun(run.folder, "its record is empty", "Run the scenario again")
        return _finish(run, say, command)


def _finish(run: Run, say: Callable[[str], None], command: str) -> dict[str, Any]:
    say("evaluating the estimate")
    # half a second of matplotlib, which the page needs last
    Thread(target=import_module, args=["..pages.drawings", __package__], daemon=True).start()
    truth = evaluation.truth_of(run)
    summary = evaluation.summarize(run, truth)
    write_json(run.folder / SUMMARY, summary)
    write_text(run.folder / SCENARIO, run.scenario.to_json() + "\n")
    if not _drawable(run.record):
        return summary
    say("writing recording and report")
    verdicts = verify(run, truth, summary) if len(run.record) >= ROWS else []
    if recording.available():
        recording.write(run, summary, truth, verdicts)
    write_html(report.page(run, summary, truth, verdicts, command), run.folder)
    return summary


def _drawable(record: Record) -> bool:
    """Whether a record has rows, with figures that can be drawn."""
    if not len(record):
        return False
    blocks = [slice(k, k + _BLOCK) for k in range(0, len(record), _BLOCK)]
    columns = ("q", "v", "u", "v_hat", "theta_hat")
    parts = (record.rows(name, block) for name in columns for block in blocks)
    return all(part.min() >= -LARGEST and part.max() <= LARGEST for part in parts)


def rebuild(folder: Path) -> dict[str, Any]:
    """Post-processes a run, such as one that was killed, from its record alone.

    Raises:
        BadRun: the folder has no readable record, or one with fewer than two rows.
    """
    from ..calibration.measured import reopen_measured  # no simulated run needs it

    record = Record.opened(folder)
    if len(record) < 2:
        raise BadRun(folder, f"its record has {len(record)} rows", "Run the scenario again")
    run = reopen_measured(folder, record) or reopen(folder, record)
    _recall_ending(run)
    with Progress(folder.name) as progress:
        try:
            return finish(run, progress.say)
        except np.linalg.LinAlgError as error:
            raise BadRun(folder, "its record is damaged", "Run the scenario again") from error


def _recall_ending(run: Run) -> None:
    """Restores ending, confidence and cost from summary.json, if that belongs to this record."""
    try:
        summary = json_of((run.folder / SUMMARY).read_bytes())
    except (OSError, ValueError):  # a killed run has none
        return
    scenario, end, words = run.scenario, float(run.record["t"][-1]), {s.words: s for s in Status}
    try:
        since = summary["status_time"] - end
        near = -1e-9 < since < (scenario.record_every + 0.5) * scenario.dt
        if summary["scenario_hash"] != scenario.hash or not near or not run.record.complete:
            return
        ending = Ending(words[summary["status"]], summary["status_time"], summary["status_signal"])
        rivals = {name: words[rival["status"]] for name, rival in summary["rivals"].items()}
        steps = round(end / scenario.dt)
        compiled = float(summary.get("compile_s", 0.0))  # absent in earlier versions
        plant, own = (1e-6 * summary[f"{of}_us_per_step"] * steps for of in ("plant", "identifier"))
        cost = Cost(float(summary["wall_s"]), float(plant), float(own), steps, compiled)
        confidence = summary.get("confidence")
    except (AttributeError, KeyError, TypeError, ValueError):  # not a run's summary
        return
    run.ending, run.confidence, run.cost = ending, confidence, cost
    run.statuses.update(rivals)
