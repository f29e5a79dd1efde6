"""Chooses a run's folder, by robot and law; a completed run is never overwritten silently."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..base import BadRun, FolderInUse, NotWritten, OutputFile, OutputFolder, json_of, path_of

if TYPE_CHECKING:
    from ..core import IdentifierConfig
    from .scenario import Scenario

RUNS = Path("runs")
_FORCE = ", or --force to write among them"
RUN = (
    *(OutputFolder.RECORD, "scenario.json", "summary.json", "report.html"),
    *("run.rrd", "verify.json", "faults.json"),
)
"""Files of a run, even of one that ended early."""


def folder_for(
    title: str, scenario: Scenario, out: Path | None, force: bool
) -> AbstractContextManager[Path]:
    """Context with the folder of a run, locked.

    It is `out`, or runs/TITLE-LAW, numbered if that holds a completed run or is in use.

    Raises:
        FolderInUse: another run is writing into `out`, or it holds a run and `force` is not set.
    """
    law = _law_of(scenario.identifier)
    return _free(f"{title}-{law}", out, force, holds_run, "a run", RUN)


def _law_of(identifier: IdentifierConfig) -> str:
    """The law as given on the command line, or its own name."""
    from ..core import ConventionalAID, NullspaceAID

    if isinstance(identifier, NullspaceAID):
        return identifier.law
    return "conventional" if isinstance(identifier, ConventionalAID) else identifier.name


def folder_for_results(
    name: str, out: Path | None, force: bool, files: Sequence[str], results: str
) -> AbstractContextManager[Path]:
    """Context with the folder of results, locked: `out`, or runs/NAME, numbered as above.

    The command writes these `files`; a folder with the first of them holds such `results`, in
    words.

    Raises:
        BadRun: a file of the user's has one of the names, or `out` cannot be written to.
        FolderInUse: another process is writing into `out`, or it holds results and `force` is not
            set.
    """
    check_writable(out or RUNS)  # before the results are computed, which may take a minute
    return _free(name, out, force, lambda folder: (folder / files[0]).is_file(), results, files)


@contextmanager
def _free(
    name: str,
    out: Path | None,
    force: bool,
    holds_results: Callable[[Path], bool],
    results: str,
    files: Sequence[str],
) -> Iterator[Path]:
    """Yields `out`, or the first of runs/NAME, runs/NAME-2, … without results, locked."""
    numbered = (RUNS / f"{name}-{number}" for number in itertools.count(2))
    for folder in itertools.chain([RUNS / name], numbered) if out is None else [path_of(out)]:
        with ExitStack() as stack:
            try:
                OutputFolder(folder).check(files, None if force else _FORCE)
                stack.enter_context(OutputFolder(folder).locked())
            except (FolderInUse, BadRun) as error:
                if out is not None or (type(error) is NotWritten and not folder.is_dir()):
                    raise
                continue
            if force or not holds_results(folder):
                yield folder
                return
            if out is not None:
                remedy = "Give --force to overwrite it, or another folder with --out"
                raise FolderInUse(out, f"it holds {results}", remedy)


def holds_run(folder: Path) -> bool:
    """Whether a folder has a completed run, or the rows of one that was ended before."""
    from .record import Record

    try:
        return holds_completed_run(folder) or len(Record.opened(folder)) > 0
    except BadRun:  # no run at all
        return False


def holds_completed_run(folder: Path) -> bool:
    """Whether a folder has the summary of a completed run."""
    try:
        summary = json_of(OutputFile(folder / "summary.json").read())
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
