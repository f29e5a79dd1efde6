"""Chooses a run's folder, by robot and law; a completed run is never overwritten silently."""

from __future__ import annotations

import itertools
import json
import os
from pathlib import Path

from ..errors import BadRun
from ..experiment.scenario import Scenario
from ..identifiers import ConventionalAID

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


def folder_for(title: str, scenario: Scenario, out: Path | None, force: bool) -> Path:
    """The folder of a run: `out`, or runs/TITLE-LAW, numbered if that holds a completed run.

    Args:
        title: of the run.
        scenario: the scenario that is run.
        out: given on the command line; None to choose a folder.
        force: overwrite a completed run.

    Raises:
        BadRun: `out` holds a completed run, and `force` is not set.
    """
    if out is not None:
        if not force and holds_completed_run(out):
            raise BadRun(
                out,
                "it holds a completed run",
                "Give --force to overwrite it, or another folder with --out",
            )
        return out
    conventional = isinstance(scenario.identifier, ConventionalAID)
    law = getattr(scenario.identifier, "law", "conventional" if conventional else "own")
    first = RUNS / f"{title}-{law}"
    if force:
        return first
    numbered = (RUNS / f"{title}-{law}-{number}" for number in itertools.count(2))
    return next(f for f in itertools.chain([first], numbered) if not holds_completed_run(f))


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
