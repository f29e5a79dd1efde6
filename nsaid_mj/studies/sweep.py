"""`nsaid sweep`: many runs of one scenario, with varied fields and drawn seeds.

joblib distributes the runs over local processes or a cluster. The result of a run depends only on
its number, not on the number of workers or on the order in which they finish. A row is appended to
`rows.jsonl` as soon as its run is finished, so a killed sweep can be resumed.
"""

import errno
import itertools
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress as Bar

from ..bounds import without_nonfinite
from ..errors import BadRun, InvalidInput, NotWritten
from ..experiment.scenario import Scenario, with_fields
from ..pages.progress import counted
from ..resources import atomic_write, check_own, locked, write_json, writing
from .study import Study, check_count
from .sweep_engine import Engine
from .sweep_results import MANIFEST, ROWS, Row, Sweep, read, write_table
from .sweep_worker import Job


def seed_of(master: int, draw: int) -> int:
    """The `Scenario.seed` of a draw: 63 bits of SeedSequence(master, spawn_key=(draw,))."""
    sequence = np.random.SeedSequence(master, spawn_key=(draw,))
    return int(sequence.generate_state(1, np.uint64)[0]) >> 1  # must fit a signed column


@dataclass(frozen=True)
class Plan(Study):
    """The runs of a sweep: every combination of the varied fields with every seed.

    With C combinations, run k is draw k // C of combination k % C. A draw has the same seed in all
    combinations, so these are compared on the same plants, priors and noise. The scenario's own
    seed is the master seed.

    Raises:
        InvalidInput: there is nothing to run, a value is duplicate or not valid in the scenario.
    """

    vary: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)  # values by dotted field name
    seeds: int = 10  # number of draws

    def __post_init__(self) -> None:
        check_count("seeds", self.seeds, "100 seeds give distributions.")
        for path, values in self.vary.items():
            if not values or len(set(values)) < len(values):
                raise InvalidInput(path, "values without duplicates", values, "Give each once.")
            if path == "seed":
                remedy = "Give --seeds, the number of draws, and --seed, the master seed."
                raise InvalidInput("seed", "a field other than the seed", "seed", remedy)
        runs = self.seeds * math.prod(len(values) for values in self.vary.values())
        check_count("runs", runs, "Vary fewer fields, or use fewer values or seeds.")
        _ = self.scenarios

    @cached_property
    def combinations(self) -> list[dict[str, Any]]:
        """All combinations of the varied fields' values; the last field varies fastest."""
        return [
            dict(zip(self.vary, values, strict=True))
            for values in itertools.product(*self.vary.values())
        ]

    @cached_property
    def scenarios(self) -> list[Scenario]:
        """The scenario of every combination, still with the master seed."""
        return [with_fields(self.scenario, values) for values in self.combinations]

    def __len__(self) -> int:
        return self.seeds * len(self.combinations)

    def what(self, number: int) -> Row:
        """The first columns of a run's row: number, draw, seed and the varied fields."""
        draw, combination = divmod(number, len(self.combinations))
        seed = seed_of(self.scenario.seed, draw)
        return {"run": number, "draw": draw, "seed": seed} | self.combinations[combination]

    def run(self, number: int) -> Scenario:
        """The scenario of a run, with its own seed."""
        draw, combination = divmod(number, len(self.combinations))
        return replace(self.scenarios[combination], seed=seed_of(self.scenario.seed, draw))

    @property
    def manifest(self) -> dict[str, Any]:
        """Everything that the results depend on, as JSON values."""
        return self.manifest_of(
            vary={path: list(values) for path, values in self.vary.items()},
            seeds=self.seeds,
            master_seed=self.scenario.seed,
            runs=len(self),
        )


def run(
    plan: Plan, folder: Path, engine: Engine | None = None, quiet: bool = False, retry: bool = False
) -> Sweep:
    """Executes the runs that are missing in a folder.

    After Ctrl-C, finished runs are kept and the same call resumes the sweep. The default engine is
    local processes. `retry` repeats runs without a result.

    Raises:
        FolderInUse: another process is writing into the folder.
        NotWritten: the folder cannot be written.
        BadRun: the folder holds another sweep.
    """
    engine = engine or Engine()
    longest = max(engine.time(scenario) for scenario in plan.scenarios)
    of = "{task.completed}/{task.total} {task.fields[lost]} without result"

    def job(number: int) -> Job:
        scenario = plan.run(number)
        return Job(number, plan.script, plan.digest, scenario.to_json(), engine.time(scenario))

    with opened(folder, plan.manifest, quiet, of) as (found, append, bar):
        known = {k: row for k, row in found.items() if not retry or row["failure"] is None}
        lost = sum(row["failure"] is not None for row in known.values())
        task = bar.add_task(folder.name, total=len(plan), completed=len(known), lost=lost)
        todo = [number for number in range(len(plan)) if number not in known]
        for figures in engine.make(todo, job, longest):
            row = plan.what(figures["run"]) | figures
            append(row)
            lost += row["failure"] is not None
            bar.update(task, advance=1, lost=lost)
    return read(folder)


@contextmanager
def opened(
    folder: Path, manifest: dict[str, Any], quiet: bool, done: str
) -> Iterator[tuple[dict[int, Row], Callable[[Row], None], Bar]]:
    """Creates a sweep's folder, or reads what an earlier run of the same plan wrote.

    Yields the rows of earlier runs by number, a function that appends a row and syncs the disk,
    and a bar; `done` is the format of its count. The folder is locked within the context; at its
    end the table of all rows is written. Damaged rows are made again.

    Raises:
        FolderInUse: another process is writing into the folder.
        NotWritten: the folder cannot be written; rows on a full disk are kept.
        BadRun: it holds another sweep, or rows of an unknown one.
    """
    check_own(folder, (MANIFEST, ROWS))
    rows, remedy = folder / ROWS, "Make room on the disk; the same command then resumes"
    with counted(quiet, done) as bar, locked(folder):
        known = _resumed(folder, manifest, partial(bar.console.print, highlight=False))
        with writing(rows):
            flags = os.O_WRONLY | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
            descriptor = os.open(rows, flags)
        try:
            with os.fdopen(descriptor, "ab", buffering=0) as stream:

                def append(row: Row) -> None:
                    plain = without_nonfinite(row)
                    line = json.dumps(plain, ensure_ascii=False, allow_nan=False) + "\n"
                    with writing(rows, remedy):
                        if stream.write(line.encode()) < len(line.encode()):
                            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                        os.fsync(descriptor)

                yield known, append, bar
        except BaseException:
            with suppress(NotWritten, BadRun):  # the original error says more
                write_table(folder)
            raise
        write_table(folder)


def _resumed(
    folder: Path, manifest: dict[str, Any], say: Callable[[str], object]
) -> dict[int, Row]:
    """The rows of an existing sweep; for a new one, creates the files."""
    rows = folder / ROWS
    wanted = json.loads(json.dumps(manifest))
    if not (folder / MANIFEST).is_file() and not (rows.is_file() and rows.stat().st_size):
        write_json(folder / MANIFEST, manifest)
        with atomic_write(rows):
            return {}
    there = read(folder)
    before = there.manifest
    differ = [key for key in wanted if key != "arguments" and wanted[key] != before.get(key)]
    if differ:
        raise BadRun(
            folder,
            f"it holds another sweep; {', '.join(differ)} differ",
            "Give another folder with --out, or delete this one",
        )
    if not (folder / MANIFEST).is_file():
        write_json(folder / MANIFEST, before)
    if there.damaged:
        say(f"{there.damaged}; they are made again")
    if not rows.is_file() or there.intact != rows.read_bytes():
        with atomic_write(rows) as partial:  # without damaged and incomplete lines
            partial.write_bytes(there.intact)
    return {row["run"]: row for row in there.rows}
