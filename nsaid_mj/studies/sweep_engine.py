"""Executes the runs of a sweep in parallel, on this machine or on a Dask cluster.

A thread here, or a worker of the cluster, executes no run itself: see `sweep_worker`.
"""

from __future__ import annotations

import importlib
import math
import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple

from ..errors import InvalidInput, UnknownName
from ..experiment.scenario import Scenario
from .study import MOST_JOBS, check_count
from .sweep_worker import Job, stop_children, supervised

ENGINES = ("local", "dask")
_UNFIT = "Run `python -m nsaid_mj.studies.sweep_worker` on a worker's machine to see why."
_POLL = 0.5  # time between two checks of the scheduler [s]
_SILENCE = 10.0  # time without a connection after which the scheduler counts as dead [s]


class _Pool(NamedTuple):
    """Executes `jobs` runs at the same time; `lost` is the error of a worker that died."""

    executor: Executor
    jobs: int
    check: Callable[[], object] = lambda: None
    lost: type[Exception] | tuple[()] = ()


@dataclass(frozen=True)
class Engine:
    """Executes runs in parallel.

    Attributes:
        name: `local` for this machine, `dask` for a cluster.
        address: of the cluster's scheduler; None for this machine.
        jobs: number of parallel runs; None for the number of processors.
        timeout: wall time after which a run counts as hung [s]; None for two minutes plus twenty
            times its simulated time.

    Raises:
        UnknownName: there is no such engine.
        InvalidInput: an attribute is out of range, or the address does not fit the engine.
    """

    name: str = "local"
    address: str | None = None
    jobs: int | None = None
    timeout: float | None = None

    def __post_init__(self) -> None:
        if self.name not in ENGINES:
            raise UnknownName("engine", self.name, ENGINES)
        if (self.name == "local") != (self.address is None):
            expected = "none for the engine `local`" if self.address else "a cluster's"
            raise InvalidInput("address", expected, self.address, "tcp://host:8786 is Dask's form.")
        if self.jobs is not None:
            check_count("jobs", self.jobs, "Omit it for all processors.", MOST_JOBS)
        if self.timeout is not None and not (math.isfinite(self.timeout) and self.timeout > 0):
            raise InvalidInput("timeout", "seconds > 0", self.timeout, "Omit it for the default.")

    def time(self, scenario: Scenario) -> float:
        """The wall time after which a run of a scenario counts as hung [s]."""
        return self.timeout or 120.0 + 20.0 * (scenario.duration + scenario.held_out)

    def make(self, numbers: Sequence[int], job: Callable[[int], Job]) -> Generator[dict[str, Any]]:
        """Executes runs and yields their figures as they become available, in any order.

        A run that crashes or hangs does so in a child process, without loss of others. The
        cluster gives a run whose worker dies to other workers, until it has lost several.

        Raises:
            InvalidInput: the engine is not available or has died, or its workers cannot execute any
                run.
        """
        todo, running = iter(numbers), dict[Future[dict[str, Any]], int]()
        with self._open(running) as pool:
            while True:
                for number in islice(todo, pool.jobs - len(running)):
                    running[pool.executor.submit(supervised, job(number))] = number
                if not running:
                    return
                done, _ = wait(running, _POLL, FIRST_COMPLETED)
                pool.check()
                for future in done:
                    number = running.pop(future)
                    try:
                        row = future.result()
                    except pool.lost:
                        row = {"run": number, "failure": "its worker died"}
                    if "unfit" in row:
                        expected = "workers that can import nsaid_mj"
                        raise InvalidInput("engine", expected, row["failure"], _UNFIT)
                    yield row

    @contextmanager
    def _open(self, running: dict[Future[Any], int]) -> Iterator[_Pool]:
        """Opens the engine; runs that are still `running` at its end are abandoned."""
        if self.name == "local":
            jobs = self.jobs or os.cpu_count() or 1
            pool = ThreadPoolExecutor(jobs)
            try:
                yield _Pool(pool, jobs)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                while wait(running, 0.1).not_done:
                    stop_children()  # some may just have been started again
                stop_children()
                pool.shutdown()
        else:
            with self._connected() as client:
                jobs = self.jobs or max(1, sum(client.nthreads().values()))
                lost = importlib.import_module("distributed").KilledWorker
                cluster = client.get_executor(pure=False)
                try:
                    yield _Pool(cluster, jobs, watched(client), lost)
                finally:
                    cluster.shutdown(wait=False)

    @contextmanager
    def _connected(self) -> Iterator[Any]:
        """A client of the cluster; errors after the scheduler's death become `InvalidInput`."""
        try:
            distributed: Any = importlib.import_module("distributed")
            client = distributed.Client(self.address, set_as_default=False)
        except ImportError as error:
            expected, remedy = "one whose package is installed", "pip install 'nsaid-mj[dask]'"
            raise InvalidInput("engine", expected, "dask", remedy) from error
        except (OSError, ValueError) as error:
            expected = f"that of a running {self.name} cluster"
            raise InvalidInput("address", expected, self.address, str(error)) from error
        with client:
            try:
                yield client
            except Exception as error:
                if client.status == "running" and not isinstance(error, CancelledError):
                    raise
                raise InvalidInput(
                    "address",
                    "a scheduler that keeps running",
                    f"none any more at {self.address}",
                    "Start the cluster again; the same command then resumes the sweep.",
                ) from error


def watched(client: Any) -> Callable[[], None]:
    """A check of a client's scheduler, which raises TimeoutError once that is silent too long."""
    seen = time.monotonic()

    def check() -> None:
        nonlocal seen
        if client.status == "running":
            seen = time.monotonic()
        elif time.monotonic() > seen + _SILENCE:
            raise TimeoutError("the scheduler is silent")

    return check
