"""Executes the runs of a sweep with joblib, on local processes or on a cluster."""

import _thread
import importlib
import math
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import joblib

from ..errors import InvalidInput
from ..experiment.choices import ENGINES, check_choice
from ..experiment.scenario import Scenario
from .study import MOST_JOBS, check_count
from .sweep_worker import Job, supervised

_UNFIT = "Run `python -m nsaid_mj.studies.sweep_worker` on a worker's machine to see why."


@dataclass(frozen=True)
class Engine:
    """Executes runs in parallel.

    Raises:
        UnknownName: there is no such engine.
        InvalidInput: an attribute is out of range, or the address does not fit the engine.
    """

    name: str = "loky"  # `loky` for processes on this machine, `dask` for a cluster
    address: str | None = None  # address of the cluster's scheduler; None for loky
    jobs: int | None = None  # number of parallel runs; None for the number of processors
    # wall time after which a run counts as hung [s]; None for two minutes plus twenty times its
    # simulated time
    timeout: float | None = None

    def __post_init__(self) -> None:
        check_choice("engine", self.name, ENGINES)
        if (self.name == "loky") != (self.address is None):
            expected = "none for loky, which is local" if self.address else "a cluster's"
            raise InvalidInput("address", expected, self.address, "tcp://host:8786 is Dask's form.")
        if self.jobs is not None:
            check_count("jobs", self.jobs, "Omit it for all processors.", MOST_JOBS)
        if self.timeout is not None and not (math.isfinite(self.timeout) and self.timeout > 0):
            raise InvalidInput("timeout", "seconds > 0", self.timeout, "Omit it for the default.")

    def time(self, scenario: Scenario) -> float:
        """The wall time after which a run of a scenario counts as hung [s]."""
        return self.timeout or 120.0 + 20.0 * (scenario.duration + scenario.held_out)

    def make(
        self, numbers: Sequence[int], job: Callable[[int], Job], longest: float
    ) -> Iterator[dict[str, Any]]:
        """Executes runs and yields their figures as they become available, in any order.

        If a worker dies, joblib loses all runs in progress. They are repeated one at a time, so
        that a crash can be attributed to one run. A run that crashes or hangs, or takes longer than
        `longest` [s], does so in a child process of its worker, so the worker survives.

        Raises:
            InvalidInput: the engine is not available or has died, or its workers cannot execute any
                run.
        """
        patience = 60.0 + 2 * longest  # time without a row after which a worker must have died
        parallel = partial(self._parallel, job, patience)
        with self._open() as broken:
            waiting = dict.fromkeys(numbers)
            while waiting:
                begun: list[int] = []
                try:
                    for row in parallel(list(waiting), begun):
                        del waiting[row["run"]]
                        yield _fit(row)
                except broken:
                    for number in begun:
                        if number in waiting:
                            del waiting[number]
                            try:
                                rows = list(parallel([number], []))
                            except broken:
                                rows = [{"run": number, "failure": "its worker died"}]
                            yield from map(_fit, rows)

    def _parallel(
        self, job: Callable[[int], Job], patience: float, numbers: Sequence[int], begun: list[int]
    ) -> Iterator[dict[str, Any]]:
        """Yields the rows of runs from joblib; appends the number of every started run."""
        local = self.name == "loky"
        at_once = self.jobs or (joblib.cpu_count() if local else -1)
        engine = os.getpid() if local else None

        def tasks() -> Iterator[Any]:
            for number in numbers:
                begun.append(number)
                yield joblib.delayed(supervised)(job(number), engine)

        in_turn = at_once == 1  # joblib then starts no worker and has no timeout
        settings: dict[str, Any] = {"n_jobs": at_once, "pre_dispatch": "n_jobs", "batch_size": 1}
        parallel: Any = partial(joblib.Parallel, timeout=None if in_turn else patience, **settings)
        yield from parallel(return_as="generator_unordered")(tasks())

    @contextmanager
    def _open(self) -> Iterator[tuple[type[Exception], ...]]:
        """Makes joblib use the engine; yields the exceptions that indicate a dead worker."""
        broken: tuple[type[Exception], ...] = (BrokenExecutor, multiprocessing.TimeoutError)
        if self.name == "loky":
            with _isolated(), joblib.parallel_config("loky"):
                yield broken
        else:
            try:
                distributed: Any = importlib.import_module("distributed")
                client = distributed.Client(self.address, set_as_default=False)
            except ImportError as error:
                expected, remedy = "one whose package is installed", "pip install 'nsaid-mj[dask]'"
                raise InvalidInput("engine", expected, "dask", remedy) from error
            except (OSError, ValueError) as error:
                expected = f"that of a running {self.name} cluster"
                raise InvalidInput("address", expected, self.address, str(error)) from error
            with (
                client,
                watched(client, self.address),
                joblib.parallel_config("dask", client=client),
            ):
                yield (*broken, distributed.KilledWorker)


@contextmanager
def _isolated() -> Iterator[None]:
    """Context in which new Pythons, such as joblib's, import nothing from the current folder."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        del os.environ["PYTHONSAFEPATH"]
        if before is not None:
            os.environ["PYTHONSAFEPATH"] = before


def _fit(row: dict[str, Any]) -> dict[str, Any]:
    """A row of a worker that can execute runs."""
    if "unfit" in row:
        raise InvalidInput("engine", "workers that can import nsaid_mj", row["failure"], _UNFIT)
    return row


_SILENCE = 10.0  # time without a connection after which the scheduler counts as dead [s]


@contextmanager
def watched(client: Any, address: str | None) -> Iterator[None]:
    """Context in which the scheduler's death ends the main thread's wait with `InvalidInput`."""
    dead, done = threading.Event(), threading.Event()

    def watch() -> None:
        seen = time.monotonic()
        while not done.wait(0.5):
            if client.status == "running":
                seen = time.monotonic()
            elif time.monotonic() > seen + _SILENCE:
                dead.set()
                _thread.interrupt_main()  # it waits in joblib, which would not notice
                return

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    except (KeyboardInterrupt, Exception) as error:
        lost = dead.is_set() or (isinstance(error, Exception) and client.status != "running")
        if not lost:
            raise
        raise InvalidInput(
            "address",
            "a scheduler that keeps running",
            f"none any more at {address}",
            "Start the cluster again; the same command then resumes the sweep.",
        ) from error
    finally:
        done.set()
        thread.join()
