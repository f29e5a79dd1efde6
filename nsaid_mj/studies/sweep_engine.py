"""Who makes the runs of a sweep: joblib on this machine's processors, or on a cluster's."""

from __future__ import annotations

import importlib
import math
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import joblib

from ..errors import InvalidInput, UnknownName
from ..experiment.scenario import Scenario
from .sweep_worker import Job, supervised

ENGINES = ("loky", "dask")
_UNFIT = "`python -m nsaid_mj.studies.sweep_worker` on a worker's machine says why."


@dataclass(frozen=True)
class Engine:
    """Who makes the runs.

    Attributes:
        name: `loky` is processes of this machine; `dask` is a cluster.
        address: of the cluster's scheduler.
        jobs: how many runs at once; None is as many as there are processors.
        timeout: wall time of a run after which it counts as hung [s]; None is two minutes, and
            twenty times its simulated time.
    """

    name: str = "loky"
    address: str | None = None
    jobs: int | None = None
    timeout: float | None = None

    def __post_init__(self) -> None:
        if self.name not in ENGINES:
            raise UnknownName("engine", self.name, ENGINES)
        if (self.name == "loky") != (self.address is None):
            expected = "none for loky, which is local" if self.address else "a cluster's"
            raise InvalidInput("address", expected, self.address, "tcp://host:8786 is Dask's form.")
        if self.jobs is not None and self.jobs < 1:
            raise InvalidInput("jobs", "a number ≥ 1", self.jobs, "Leave it out.")
        if self.timeout is not None and not (math.isfinite(self.timeout) and self.timeout > 0):
            raise InvalidInput("timeout", "seconds > 0", self.timeout, "Leave it out.")

    def time(self, scenario: Scenario) -> float:
        """The wall time that a run of a scenario may take [s]."""
        return self.timeout or 120.0 + 20.0 * (scenario.duration + scenario.held_out)

    def make(
        self, numbers: Sequence[int], job: Callable[[int], Job], longest: float
    ) -> Iterator[dict[str, Any]]:
        """Yields the figures of runs as they are known, in any order.

        A worker that dies takes all that joblib has under way with it. Those runs are repeated one
        at a time, where a worker's death is the fault of one run. (A run that dies or hangs does
        so in its worker's child, and does not come here.)

        Args:
            numbers: which runs.
            job: what each of them is.
            longest: the longest time that one of them may take [s].

        Raises:
            InvalidInput: the engine is not there, or its workers cannot make any run.
        """
        patience = 60.0 + 2 * longest  # as long without any row, and a worker has gone silently

        def parallel(some: Sequence[int], begun: list[int]) -> Iterator[dict[str, Any]]:
            return self._parallel(some, job, begun, patience)

        with self._open() as broken:
            waiting = dict.fromkeys(numbers)
            while waiting:
                begun: list[int] = []
                try:
                    for row in parallel(list(waiting), begun):
                        if "unfit" in row:
                            raise InvalidInput(
                                "engine", "workers that can import nsaid_mj", row["unfit"], _UNFIT
                            )
                        del waiting[row["run"]]
                        yield row
                except broken:
                    for number in begun:
                        if number in waiting:
                            del waiting[number]
                            try:
                                yield from list(parallel([number], []))
                            except broken:
                                yield {"run": number, "failure": "its worker died"}

    def _parallel(
        self,
        numbers: Sequence[int],
        job: Callable[[int], Job],
        begun: list[int],
        patience: float,
    ) -> Iterator[dict[str, Any]]:
        """Rows of runs by joblib; it says which runs have begun."""
        at_once = self.jobs or (joblib.cpu_count() if self.name == "loky" else -1)

        def tasks() -> Iterator[Any]:
            for number in numbers:
                begun.append(number)
                yield joblib.delayed(supervised)(job(number))

        in_turn = at_once == 1  # joblib then starts no worker, and cannot lose patience
        settings: dict[str, Any] = {"n_jobs": at_once, "pre_dispatch": "n_jobs", "batch_size": 1}
        parallel: Any = partial(joblib.Parallel, timeout=None if in_turn else patience, **settings)
        yield from parallel(return_as="generator_unordered")(tasks())

    @contextmanager
    def _open(self) -> Iterator[tuple[type[Exception], ...]]:
        """Makes joblib use the engine; yields the exceptions that say that workers have died."""
        broken: tuple[type[Exception], ...] = (BrokenExecutor, multiprocessing.TimeoutError)
        if self.name == "loky":
            with joblib.parallel_config("loky"):
                yield broken
        else:
            distributed = _package("distributed", "dask")
            with (
                self._reached(
                    lambda: distributed.Client(self.address, set_as_default=False)
                ) as client,
                joblib.parallel_config("dask", client=client),
            ):
                yield (*broken, distributed.KilledWorker)

    def _reached(self, connect: Callable[[], Any]) -> Any:
        try:
            return connect()
        except (OSError, ValueError) as error:
            raise InvalidInput(
                "address", f"that of a {self.name} cluster which answers", self.address, str(error)
            ) from error


def _package(name: str, extra: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidInput(
            "engine", "one whose package is installed", extra, f"pip install 'nsaid-mj[{extra}]'"
        ) from error
