"""The common part of all studies: a scenario, its script, and the flags to repeat a run."""

import csv
import io
import json
import os
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console

from .. import evaluation
from ..bounds import shown
from ..errors import InvalidInput
from ..evaluation.result import Result
from ..experiment.library import digest_of
from ..experiment.scenario import Scenario
from ..pages.page import Page, write_html
from ..pages.progress import counted
from ..pages.terminal import print_page
from ..resources import check_own, locked, write_text

MOST_RUNS = 1_000_000
"""Largest number of runs of a study; a day has as many tenths of a second."""
MOST_JOBS = 1024
"""Largest number of runs at the same time."""

_Made = TypeVar("_Made")


def check_count(name: str, number: int, remedy: str, most: int = MOST_RUNS) -> None:
    """Raises `InvalidInput` unless a number of runs, in all or at a time, is from 1 to `most`."""
    if not 1 <= number <= most:
        raise InvalidInput(name, f"a number from 1 to {most}", shown(number), remedy)


def processors() -> int:
    """The number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True)
class Study:
    """A scenario that is run many times."""

    script: str  # name of the packaged scenario, or path of its script
    scenario: Scenario
    # flags of `nsaid run` that turn the script's scenario into this one
    arguments: tuple[str, ...] = field(default=(), kw_only=True)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the script."""
        return digest_of(self.script)

    def manifest_of(self, **own: Any) -> dict[str, Any]:
        """The study's manifest: everything its results depend on, and `own`, as JSON values."""
        return {
            "script": self.script,
            "script_sha256": self.digest,
            "scenario": json.loads(self.scenario.to_json()),
            **own,
            "versions": evaluation.versions(),
            "arguments": list(self.arguments),
        }


def repeated(command: str, manifest: Mapping[str, Any], flags: Mapping[str, Sequence[Any]]) -> str:
    """The command line that repeats a study, with the flags that have values."""
    words = ["nsaid", command, manifest["script"], *manifest["arguments"]]
    for flag, values in flags.items():
        words += [f"--{flag}", ",".join(map(str, values))] if values else []
    return shlex.join(words)


def carried_out(
    folder: Path,
    own: Sequence[str],
    total: int,
    made: Callable[[Callable[[str], object]], Iterator[_Made]],
    write: Callable[[list[_Made]], object],
    draw: Callable[[list[_Made]], tuple[Page, list[Path]]],
    quiet: bool,
) -> tuple[Result, list[_Made]]:
    """Collects the parts of a study in a folder; after Ctrl-C, writes those available.

    Args:
        folder: folder of the results; created if missing.
        own: files that mark such a folder.
        total: number of parts.
        made: yields them; receives a function to report each stage.
        write: writes them; also called before the first, to fail early.
        draw: makes the page and draws at the end; returns all files but the page's.
        quiet: whether neither progress nor the page is printed.

    Raises:
        FolderInUse: another process is writing into the folder.
        NotWritten: the folder cannot be written.
    """
    check_own(folder, own)
    done: list[_Made] = []
    with locked(folder):
        write(done)
        try:
            with counted(quiet) as bar:
                task = bar.add_task("", total=total)
                for found in made(lambda words: bar.update(task, description=words)):
                    done.append(found)
                    bar.advance(task)
        finally:
            write(done)
            page, files = draw(done)
            files = [write_html(page, folder), *files]
        if not quiet:
            print_page(page, Console(highlight=False), files)
    return page.result, done


def write_csv(path: Path, heads: Sequence[str], rows: Iterable[dict[str, Any]]) -> None:
    """Writes rows as CSV, with empty fields for missing entries."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, heads, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, stream.getvalue())
