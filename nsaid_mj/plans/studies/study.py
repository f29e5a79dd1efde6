"""What all studies are: runs of one scenario, over varied values and seeds, in one folder."""

import csv
import io
import itertools
import json
import os
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import Progress as Bar

from ...base import InvalidInput, OutputFile, OutputFolder
from ...lab import Scenario, counted, versions
from ...report import Page, Result, print_page
from .one_run import digest_of

MOST_RUNS = 1_000_000
"""Largest number of runs of a study; a day has as many tenths of a second."""
MOST_JOBS = 1024
"""Largest number of runs at the same time."""

Row = dict[str, Any]
"""A run: the varied values and its seed by name, its figures by key, and why it had a `failure`."""

_Made = TypeVar("_Made")


def check_count(name: str, number: int, remedy: str, most: int = MOST_RUNS) -> None:
    """Raises `InvalidInput` unless a number of runs, in all or at a time, is from 1 to `most`."""
    if not 1 <= number <= most:
        raise InvalidInput(name, f"a number from 1 to {most}", number, remedy)


def processors() -> int:
    """The number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class DrawnSeeds(Sequence[int]):
    """The seed of every draw from a master seed; see `seed_of`."""

    def __init__(self, master: int, count: int):
        self._master = master
        self._count = count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, draw: Any) -> Any:
        if not 0 <= draw < self._count:
            raise IndexError(draw)
        return seed_of(self._master, draw)


def seed_of(master: int, draw: int) -> int:
    """The `Scenario.seed` of a draw: 63 bits of SeedSequence(master, spawn_key=(draw,))."""
    sequence = np.random.SeedSequence(master, spawn_key=(draw,))
    return int(sequence.generate_state(1, np.uint64)[0]) >> 1  # must fit a signed column


@dataclass(frozen=True)
class Study:
    """Many runs of one scenario: every combination of varied values with every seed.

    With C combinations, run k is draw k // C of combination k % C. A draw has the same seed in all
    combinations, so these are compared on the same plants, priors and noise.
    """

    script: str  # name of the packaged scenario, or path of its script
    scenario: Scenario
    # values by name: of fields of the scenario, of a comparison's logs and methods, or of laws
    vary: Mapping[str, tuple[Any, ...]]
    seeds: Sequence[int]
    # entries of the manifest: everything else that the results depend on, as JSON values
    settings: Mapping[str, Any]
    # flags of `nsaid run` that turn the script's scenario into this one
    arguments: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.seeds) * len(self.combinations)

    @cached_property
    def combinations(self) -> list[dict[str, Any]]:
        """All combinations of the varied values; the last name varies fastest."""
        return [
            dict(zip(self.vary, values, strict=True))
            for values in itertools.product(*self.vary.values())
        ]

    def what(self, number: int) -> Row:
        """The first columns of a run's row: number, draw, seed and the varied values."""
        draw, combination = divmod(number, len(self.combinations))
        first = {"run": number, "draw": draw, "seed": self.seeds[draw]}
        return first | self.combinations[combination]

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the script."""
        return digest_of(self.script)

    @property
    def manifest(self) -> dict[str, Any]:
        """Everything that the results depend on, as JSON values."""
        return {
            "script": self.script,
            "script_sha256": self.digest,
            "scenario": json.loads(self.scenario.to_json()),
            **self.settings,
            "versions": versions(),
            "arguments": list(self.arguments),
        }


def repeated(command: str, manifest: Mapping[str, Any], flags: Mapping[str, Sequence[Any]]) -> str:
    """The command line that repeats a study, with the flags that have values."""
    words = ["nsaid", command, manifest["script"], *manifest["arguments"]]
    for flag, values in flags.items():
        words += [f"--{flag}", ",".join(map(str, values))] if values else []
    return shlex.join(words)


@contextmanager
def in_folder(
    folder: Path, own: Sequence[str], quiet: bool, done: str = "{task.completed}/{task.total}"
) -> Iterator[Bar]:
    """Context in which the folder of a study belongs to it; yields a bar of progress.

    `own` are files of such a study, `done` is the format of the bar's count.

    Raises:
        FolderInUse: another process is writing into the folder.
        NotWritten: the folder cannot be created.
        BadRun: the folder holds other files only.
    """
    OutputFolder(folder).check(own)
    with OutputFolder(folder).locked(), counted(quiet, done) as bar:
        yield bar


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
    done: list[_Made] = []
    with in_folder(folder, own, quiet) as bar:
        write(done)
        try:
            task = bar.add_task("", total=total)
            for found in made(lambda words: bar.update(task, description=words)):
                done.append(found)
                bar.advance(task)
        finally:
            bar.stop()
            write(done)
            page, files = draw(done)
            files = [page.write_html(folder), *files]
        if not quiet:
            print_page(page, Console(highlight=False), files)
    return page.result, done


def write_csv(path: Path, heads: Sequence[str], rows: Iterable[dict[str, Any]]) -> None:
    """Writes rows as CSV, with empty fields for missing entries."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, heads, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    OutputFile(path).write_text(stream.getvalue())
