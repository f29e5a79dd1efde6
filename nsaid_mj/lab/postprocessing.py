"""Post-processing of a run: writes summary, scenario, recording and report into its folder."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..base import (
    LARGEST,
    BadRun,
    InvalidInput,
    OutputFile,
    OutputFolder,
    installed,
    json_of,
    single_threaded,
)
from ..core import Array, Status
from .evaluation import page as report
from .evaluation.curves import with_curves
from .evaluation.run_evaluation import evaluate
from .evaluation.run_result import RunResult
from .evaluation.summary import SUMMARY_FILE as SUMMARY
from .evaluation.summary import result_from
from .evaluation.truth import Truth
from .evaluation.verify import ROWS, Verification
from .following import RunTimes
from .loop import Ending, Run, reopen
from .progress import Progress
from .record import Record

_BLOCK = 10_000  # rows of a record, which may be large, in memory at once

SCENARIO = "scenario.json"


@single_threaded
def finish(
    run: Run,
    say: Callable[[str], None] = lambda _: None,
    command: str = "",
    earlier: RunResult | None = None,
) -> RunResult:
    """Evaluates a run and writes summary.json, scenario.json, run.rrd and report.html.

    A run without any row, or with figures beyond 1e15, has no recording and no report; without
    Rerun there is no recording.

    Args:
        run: a finished run, completed or not.
        say: called with the name of each stage, for a progress display.
        command: command line of the run, for the report; empty if unknown.
        earlier: an earlier result of a run that was read from its record, for the confidence, which
            the record does not hold.

    Returns:
        The result, with its curves if it could be drawn.

    Raises:
        FolderInUse: another run is writing into the folder.
        NotWritten: a file cannot be written; the record is kept.
        BadRun: the folder no longer has this run's record, or a completed run has no row.
    """
    with OutputFolder(run.folder).locked():
        if Record.metadata_of(run.folder) != run.record.metadata:
            raise BadRun(run.folder, "it holds another run's record", "Run the scenario again")
        if run.ending.status is Status.completed and not len(run.record):
            raise BadRun(run.folder, "its record is empty", "Run the scenario again")
        OutputFolder(run.folder).check((SUMMARY, SCENARIO, "report.html", "run.rrd"), None)
        return _finish(run, say, command, earlier)


def _finish(
    run: Run, say: Callable[[str], None], command: str, earlier: RunResult | None
) -> RunResult:
    asked = "interrupted; Ctrl-C again ends at once: "
    early = asked if run.ending.status is Status.interrupted else ""
    say(f"{early}evaluating the estimate")
    truth = Truth.of(run)
    stated_before = None if earlier is None else earlier.confidence
    result = evaluate(run, truth, stated_before)
    OutputFile(run.folder / SUMMARY).write_json(result.summary())
    OutputFile(run.folder / SCENARIO).write_text(run.scenario.to_json() + "\n")
    if not _drawable(run.record):
        return result
    say(f"{early}writing recording and report")
    checks = Verification.of_run(run, truth, result) if len(run.record) >= ROWS else None
    result = with_curves(result, run, truth)
    if installed("rerun"):
        from .recording.run import write_run_recording

        write_run_recording(run, result, truth, checks)
    report.page(run, result, checks, command).write_html(run.folder)
    return result


class ThetaBar(NamedTuple):
    """θ̄ = Qᵀ θ̂/scale of a run over time, with Q = [P̄ P̄_⊥] (36, 40).

    P is the structural nullspace of the true θ at the end of the run, r its dimension.
    """

    t: Array  # (N,) times of the record [s]
    P: Array  # (N, r) θ̄_P, along P: it may end anywhere
    perp: Array  # (N, p − r) θ̄_P⊥, across P: by Theorem 2 it converges to 0


def theta_bar(folder: Path) -> ThetaBar:
    """The estimate θ̂ of a finished run of a simulated plant in the paper's coordinates.

    ‖θ̄_P⊥‖/‖θ̂/scale‖ at the end is `theta_perp_ratio` of the summary.

    Raises:
        BadRun: the folder holds no run, or that of a real robot, whose true θ is unknown.
    """
    run = reopen(folder, Record.read(folder))
    truth = Truth.of(run)
    if truth is None:
        remedy = "Give the folder of a simulated run: the true θ of a real robot is unknown"
        raise BadRun(folder, "it holds the log of a real robot", remedy)
    scaled = run.record["theta_hat"] / run.system.space.scale
    return ThetaBar(run.record["t"], *truth.nullspace.coordinates(scaled))


def _drawable(record: Record) -> bool:
    """Whether a record has rows, with figures that can be drawn."""
    if not len(record):
        return False
    blocks = [slice(k, k + _BLOCK) for k in range(0, len(record), _BLOCK)]
    columns = ("q", "v", "u", "v_hat", "theta_hat")
    parts = (record.rows(name, block) for name in columns for block in blocks)
    return all(part.min() >= -LARGEST and part.max() <= LARGEST for part in parts)


def rebuild(folder: Path) -> RunResult:
    """Post-processes a run, such as one that was killed, from its record alone.

    What a record does not hold, as the ending, costs and confidence, is taken from summary.json, if
    that is the summary of this record.

    Raises:
        BadRun: the folder has no readable record, or one with fewer than two rows.
        InvalidInput: a value in this record's summary.json is missing or of a wrong type.
    """
    record = Record.opened(folder)
    if len(record) < 2:
        raise BadRun(folder, f"its record has {len(record)} rows", "Run the scenario again")
    run = reopen(folder, record)
    earlier = _earlier(run)
    if earlier is not None:
        _recall(run, earlier)
    with Progress(folder.name) as progress:
        try:
            return finish(run, progress.say, earlier=earlier)
        except np.linalg.LinAlgError as error:
            raise BadRun(folder, "its record is damaged", "Run the scenario again") from error


def _earlier(run: Run) -> RunResult | None:
    """The result in summary.json if that belongs to this record, else None: a killed run has none.

    Raises:
        InvalidInput: it belongs to this record, and a value is missing or of a wrong type.
    """
    file = run.folder / SUMMARY
    scenario = run.scenario
    try:
        found = json_of(OutputFile(file).read())
    except (OSError, ValueError):
        return None
    ours = isinstance(found, dict) and found.get("scenario_hash") == scenario.hash
    if not ours or not run.record.complete:
        return None
    result = result_from(found, run.system.space, str(file))
    since = result.ending.status_time - float(run.record["t"][-1])
    near = -1e-9 < since < (scenario.record_every + 0.5) * scenario.dt
    return result if near else None


def _recall(run: Run, earlier: RunResult) -> None:
    """Restores ending and cost of a run that was read from its record from an earlier result.

    Raises:
        InvalidInput: an ending is not one of `Status`.
    """
    ending = earlier.ending
    cost = earlier.cost
    statuses = {name: _status(run, rival.status) for name, rival in earlier.rivals.items()}
    run.ending = Ending(_status(run, ending.status), ending.status_time, ending.status_signal)
    run.statuses.update(statuses)
    steps = round(float(run.record["t"][-1]) / run.scenario.dt)
    plant = 1e-6 * cost.plant_us_per_step * steps
    identifier = 1e-6 * cost.identifier_us_per_step * steps
    run.cost = RunTimes(cost.wall_s, plant, identifier, steps, cost.compile_s)


def _status(run: Run, words: str) -> Status:
    """The status that has these words."""
    for status in Status:
        if status.words == words:
            return status
    expected = f"one of {', '.join(status.words for status in Status)}"
    file = run.folder / SUMMARY
    raise InvalidInput(f"{file}, status", expected, words, "Delete the file and rebuild again.")
