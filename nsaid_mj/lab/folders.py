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


class ResultsFolder:
    """Where a command writes its results.

    Args:
        out: as given by the user; None for a folder in runs/, numbered if need be.
        force: whether results that are there are overwritten.
    """

    def __init__(self, out: Path | None, force: bool = False) -> None:
        self._out = out
        self._force = force

    def of_run(self, title: str, scenario: Scenario) -> AbstractContextManager[Path]:
        """Context with the folder of a run, locked.

        It is `out`, or runs/TITLE-LAW, numbered if that holds a completed run or is in use.

        Raises:
            FolderInUse: another run is writing into `out`, or it holds a run and `force` is not
                set.
        """
        return self._free(f"{title}-{_law_of(scenario.identifier)}", holds_run, "a run", RUN)

    def of_results(
        self, name: str, files: Sequence[str], results: str
    ) -> AbstractContextManager[Path]:
        """Context with the folder of results, locked: `out`, or runs/NAME, numbered as above.

        The command writes these `files`; a folder with the first of them holds such `results`, in
        words.

        Raises:
            BadRun: a file of the user's has one of the names, or `out` cannot be written to.
            FolderInUse: another process is writing into `out`, or it holds results and `force` is
                not set.
        """
        self.check_writable()  # before the results are computed, which may take a minute
        return self._free(name, lambda folder: (folder / files[0]).is_file(), results, files)

    def check_writable(self) -> None:
        """Raises `BadRun` unless results can be written there, before they are computed."""
        folder = self._out or RUNS
        remedy = "Give another folder with --out"
        existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        if not existing.is_dir():
            raise BadRun(existing, "it is a file, not a folder", remedy)
        if not os.access(existing, os.W_OK):
            raise BadRun(existing, "no permission to write there", remedy)

    @contextmanager
    def _free(
        self,
        name: str,
        holds_results: Callable[[Path], bool],
        results: str,
        files: Sequence[str],
    ) -> Iterator[Path]:
        """Yields `out`, or the first of runs/NAME, runs/NAME-2, … without results, locked."""
        out = self._out
        numbered = (RUNS / f"{name}-{number}" for number in itertools.count(2))
        for folder in itertools.chain([RUNS / name], numbered) if out is None else [path_of(out)]:
            with ExitStack() as stack:
                try:
                    OutputFolder(folder).check(files, None if self._force else _FORCE)
                    stack.enter_context(OutputFolder(folder).locked())
                except (FolderInUse, BadRun) as error:
                    if out is not None or (type(error) is NotWritten and not folder.is_dir()):
                        raise
                    continue
                if self._force or not holds_results(folder):
                    yield folder
                    return
                if out is not None:
                    remedy = "Give --force to overwrite it, or another folder with --out"
                    raise FolderInUse(out, f"it holds {results}", remedy)


def _law_of(identifier: IdentifierConfig) -> str:
    """The law as given on the command line, or its own name."""
    from ..core import ConventionalAID, NullspaceAID

    if isinstance(identifier, NullspaceAID):
        return identifier.law
    return "conventional" if isinstance(identifier, ConventionalAID) else identifier.name


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
