"""Executes the runs of a sweep, on this machine or on a Dask cluster."""

import importlib
import logging
import math
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any

from ..errors import InvalidInput, UnknownName
from ..experiment.scenario import Scenario
from .study import MOST_JOBS, check_count
from .sweep_worker import Child, Job, keep_children, supervised

ENGINES = ("local", "dask")
_UNFIT = "Run `python -m nsaid_mj.studies.sweep_worker` on a worker's machine to see why."
_LOST = "Start the cluster again; the same command then resumes the sweep."

_Running = dict[Future[dict[str, Any]], int]
_Workers = tuple[Executor, int, tuple[type[Exception], ...], Callable[[], bool]]


@dataclass(frozen=True)
class Engine:
    """Executes runs in parallel.

    Raises:
        UnknownName: there is no such engine.
        InvalidInput: an attribute is out of range, or the address does not fit the engine.
    """

    name: str = "local"  # `local` for processes on this machine, `dask` for a cluster
    address: str | None = None  # address of the cluster's scheduler; None for `local`
    jobs: int | None = None  # number of parallel runs; None for the number of processors
    # wall time after which a run counts as hung [s]; None for two minutes plus twenty times its
    # simulated time
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

    def make(
        self, numbers: Sequence[int], job: Callable[[int], Job]
    ) -> Generator[dict[str, Any], None, None]:
        """Executes runs and yields their figures as they become available, in any order.

        A run that crashes or hangs does so in a child process of its worker and loses no other.

        Raises:
            InvalidInput: the engine is not available or has died, or its workers cannot execute any
                run.
        """
        waiting, running = iter(numbers), _Running()
        with (self._local if self.name == "local" else self._cluster)(running) as workers:
            pool, at_once, died, alive = workers
            while True:
                for number in islice(waiting, at_once - len(running)):
                    running[pool.submit(supervised, job(number))] = number
                if not running:
                    return
                done = wait(running, 1.0, FIRST_COMPLETED).done
                if not alive() or any(future.cancelled() for future in done):
                    expected, got = "a scheduler that keeps running", "none any more at "
                    raise InvalidInput("address", expected, f"{got}{self.address}", _LOST)
                for future in done:
                    number = running.pop(future)
                    try:
                        row = future.result()
                    except died:
                        row = {"run": number, "failure": "its worker died"}
                    if "unfit" in row:
                        expected = "workers that can import nsaid_mj"
                        raise InvalidInput("engine", expected, row["failure"], _UNFIT)
                    yield row

    @contextmanager
    def _local(self, running: _Running) -> Iterator[_Workers]:
        """Threads of this process, each with a child; at the end they are stopped."""
        at_once, children = self.jobs or os.cpu_count() or 1, set[Child]()
        with ThreadPoolExecutor(at_once, initializer=keep_children, initargs=(children,)) as pool:
            try:
                yield pool, at_once, (), lambda: True
            finally:
                while wait(running, 0.1).not_done:  # runs that are not needed any more
                    for child in list(children):
                        child.kill()
                for child in list(children):
                    child.stop()

    @contextmanager
    def _cluster(self, running: _Running) -> Iterator[_Workers]:
        """The threads of a cluster's workers, and the exception of a run whose worker died.

        When the scheduler dies, Dask cancels its runs; one submitted meanwhile never ends.
        """
        try:
            distributed: Any = importlib.import_module("distributed")
            client = distributed.Client(self.address, set_as_default=False)
        except ImportError as error:
            expected, remedy = "one whose package is installed", "pip install 'nsaid-mj[dask]'"
            raise InvalidInput("engine", expected, "dask", remedy) from error
        except (OSError, ValueError) as error:
            expected = f"that of a running {self.name} cluster"
            raise InvalidInput("address", expected, self.address, str(error)) from error
        # our own error says more than its traceback
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        with client:
            at_once = self.jobs or max(1, sum(client.nthreads().values()))
            pool, died = client.get_executor(pure=False), (distributed.KilledWorker,)
            yield pool, at_once, died, lambda: client.status == "running"
