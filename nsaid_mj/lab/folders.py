"""Chooses a run's folder, by robot and law; a completed run is never overwritten silently."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..base import RECORD, BadRun, FolderInUse, check_own, json_of, locked

if TYPE_CHECKING:
    from ..core import IdentifierConfig
    from .scenario import Scenario

RUNS = Path("runs")
_FORCE = ", or --force to write among them"
RUN = (RECORD, "scenario.json", "summary.json")
"""Files that mark the folder of a run, even of one that ended early."""


def title_of(name: str, default: Scenario, scenario: Scenario) -> str:
    """The title of a run: the scenario's name, or that of the robot chosen for it.

    `default` is the scenario as defined by its script.
    """
    robot = getattr(scenario.plant, "robot", "")
    chosen = name == "arm" or robot != getattr(default.plant, "robot", "")
    return (Path(robot).stem or name) if robot and chosen else name


def folder_for(
    title: str, scenario: Scenario, out: Path | None, force: bool
) -> AbstractContextManager[Path]:
    """Context with the folder of a run, locked.

    It is `out`, or runs/TITLE-LAW, numbered if that holds a completed run or is in use.

    Raises:
        BadRun: `out` holds a completed run, and `force` is not set.
        FolderInUse: another run is writing into `out`.
    """
    law = _law_of(scenario.identifier)
    return _free(f"{title}-{law}", out, force, holds_completed_run, "a completed run", RUN)


def _law_of(identifier: IdentifierConfig) -> str:
    """The law as given on the command line, or its own name."""
    from ..core import ConventionalAID, NullspaceAID

    if isinstance(identifier, NullspaceAID):
        return identifier.law
    return "conventional" if isinstance(identifier, ConventionalAID) else identifier.name


def folder_for_results(
    name: str, out: Path | None, force: bool, file: str, results: str
) -> AbstractContextManager[Path]:
    """Context with the folder of results, locked: `out`, or runs/NAME, numbered as above.

    A folder with the `file` holds such `results`, in words.

    Raises:
        BadRun: `out` holds results, and `force` is not set; or it cannot be written to.
        FolderInUse: another process is writing into `out`.
    """
    check_writable(out or RUNS)  # before the results are computed, which may take a minute
    return _free(name, out, force, lambda folder: (folder / file).is_file(), results, (file,))


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
        check_own(out, known, _FORCE)
    numbered = (RUNS / f"{name}-{number}" for number in itertools.count(2))
    for folder in itertools.chain([RUNS / name], numbered) if out is None else [out]:
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
