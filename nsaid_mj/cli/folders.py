"""Chooses a run's folder, by robot and law; a completed run is never overwritten silently."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from ..errors import BadRun, FolderInUse
from ..experiment.scenario import Scenario
from ..identifiers import ConventionalAID
from ..resources import locked

RUNS = Path("runs")


def title_of(name: str, default: Scenario, scenario: Scenario) -> str:
    """The title of a run: the scenario's name, or that of the robot chosen for it.

    Args:
        name: of the scenario.
        default: the scenario as defined by its script.
        scenario: the scenario that is run.
    """
    robot = getattr(scenario.plant, "robot", "")
    chosen = name == "arm" or robot != getattr(default.plant, "robot", "")
    return (Path(robot).stem or name) if robot and chosen else name


@contextmanager
def folder_for(title: str, scenario: Scenario, out: Path | None, force: bool) -> Iterator[Path]:
    """Yields the folder of a run, locked.

    It is `out`, or runs/TITLE-LAW, numbered if that holds a completed run or is in use.

    Args:
        title: of the run.
        scenario: the scenario that is run.
        out: given on the command line; None to choose a folder.
        force: overwrite a completed run.

    Raises:
        BadRun: `out` holds a completed run, and `force` is not set.
        FolderInUse: another run is writing into `out`.
    """
    for folder in _candidates(title, scenario) if out is None else [out]:
        with ExitStack() as stack:
            try:
                stack.enter_context(locked(folder))
            except FolderInUse:
                if force or out is not None:
                    raise
                continue
            if force or not holds_completed_run(folder):
                yield folder
                return
            if out is not None:
                raise BadRun(
                    out,
                    "it holds a completed run",
                    "Give --force to overwrite it, or another folder with --out",
                )


def _candidates(title: str, scenario: Scenario) -> Iterator[Path]:
    """The folders runs/TITLE-LAW, runs/TITLE-LAW-2, and so on."""
    conventional = isinstance(scenario.identifier, ConventionalAID)
    law = getattr(scenario.identifier, "law", "conventional" if conventional else "own")
    yield RUNS / f"{title}-{law}"
    yield from (RUNS / f"{title}-{law}-{number}" for number in itertools.count(2))


def holds_completed_run(folder: Path) -> bool:
    """Whether a folder has the summary of a completed run."""
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):  # a run killed before its evaluation, or no run at all
        return False
    return isinstance(summary, dict) and summary.get("status") == "completed"


def check_writable(folder: Path) -> None:
    """Whether results can be written, before they are computed.

    Raises:
        BadRun: the folder is a file, lies below one, or may not be written to.
    """
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise BadRun(existing, "it is a file, not a folder", "Give another folder with --out")
    if not os.access(existing, os.W_OK):
        raise BadRun(existing, "no permission to write there", "Give another folder with --out")
