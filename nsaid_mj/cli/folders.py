"""Chooses a run's folder, by robot and law; a completed run is never overwritten silently."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from ..errors import BadRun, FolderInUse
from ..experiment.scenario import Scenario
from ..identifiers import ConventionalAID
from ..resources import check_own, json_of, locked

RUNS = Path("runs")
FORCE = ", or --force to write among them"
DESIGN = "design.json"
RUN = ("record.arrow", "scenario.json", "summary.json")
"""Files that mark the folder of a run, even of one that ended early."""


def title_of(name: str, default: Scenario, scenario: Scenario) -> str:
    """The title of a run: the scenario's name, or that of the robot chosen for it.

    `default` is the scenario as defined by its script.
    """
    robot = getattr(scenario.plant, "robot", "")
    chosen = name == "arm" or robot != getattr(default.plant, "robot", "")
    return (Path(robot).stem or name) if robot and chosen else name


@contextmanager
def folder_for(title: str, scenario: Scenario, out: Path | None, force: bool) -> Iterator[Path]:
    """Yields the folder of a run, locked.

    It is `out`, or runs/TITLE-LAW, numbered if that holds a completed run or is in use.

    Raises:
        BadRun: `out` holds a completed run, and `force` is not set.
        FolderInUse: another run is writing into `out`.
    """
    conventional = isinstance(scenario.identifier, ConventionalAID)
    law = getattr(scenario.identifier, "law", "conventional" if conventional else "own")
    with _free(f"{title}-{law}", out, force, holds_completed_run, "a completed run", RUN) as folder:
        yield folder


@contextmanager
def folder_for_design(name: str, out: Path | None, force: bool) -> Iterator[Path]:
    """Yields the folder of a design, locked: `out`, or runs/NAME-excite, numbered as above.

    Raises:
        BadRun: `out` holds a design, and `force` is not set; or it cannot be written to.
        FolderInUse: another process is writing into `out`.
    """
    check_writable(out or RUNS)  # before the search, which takes a minute
    with _free(f"{name}-excite", out, force, _holds_design, "a design", (DESIGN,)) as folder:
        yield folder


@contextmanager
def _free(
    name: str,
    out: Path | None,
    force: bool,
    holds_results: Callable[[Path], bool],
    results: str,
    known: Sequence[str],
) -> Iterator[Path]:
    """Yields `out`, or the first of runs/NAME, runs/NAME-2, … without results, locked."""
    if out is not None and not force:
        check_own(out, known, FORCE)
    for folder in _numbered(name) if out is None else [out]:
        with ExitStack() as stack:
            try:
                stack.enter_context(locked(folder))
            except FolderInUse:
                if force or out is not None:
                    raise
                continue
            if force or not holds_results(folder):
                yield folder
                return
            if out is not None:
                raise BadRun(
                    out,
                    f"it holds {results}",
                    "Give --force to overwrite it, or another folder with --out",
                )


def _numbered(name: str) -> Iterator[Path]:
    """The folders runs/NAME, runs/NAME-2, and so on."""
    yield RUNS / name
    yield from (RUNS / f"{name}-{number}" for number in itertools.count(2))


def _holds_design(folder: Path) -> bool:
    return (folder / DESIGN).is_file()


def holds_completed_run(folder: Path) -> bool:
    """Whether a folder has the summary of a completed run."""
    try:
        summary = json_of((folder / "summary.json").read_bytes())
    except (OSError, ValueError):  # a run killed before its evaluation, or no run at all
        return False
    return isinstance(summary, dict) and summary.get("status") == "completed"


def check_writable(folder: Path) -> None:
    """Raises `BadRun` unless results can be written to a folder, before they are computed."""
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise BadRun(existing, "it is a file, not a folder", "Give another folder with --out")
    if not os.access(existing, os.W_OK):
        raise BadRun(existing, "no permission to write there", "Give another folder with --out")
