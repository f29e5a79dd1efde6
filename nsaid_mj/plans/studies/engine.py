"""Executes the runs of a sweep in other processes, whose crash or hang loses no other run.

On this machine they are those of a pool of the package `pebble`, on a cluster Dask's own workers.
"""

import importlib
import math
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any

from pebble import ProcessExpired, ProcessPool

from ...base import CHOICES, InvalidInput
from ...lab import Scenario
from .one_run import Job, attempt, attempt_in_thread, prepare_process
from .study import MOST_JOBS, check_count, processors

_STARTS = 3  # pools of which no process starts, one after the other, before the sweep gives up
_TICK = 0.5  # time between two looks at a cluster's scheduler [s]
_SILENCE = 10.0  # time without a connection after which the scheduler counts as dead [s]
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# processes use one thread each, and import nothing from the current folder
_ENVIRONMENT = {"PYTHONSAFEPATH": "1", **dict.fromkeys(_THREADS, "1")}


@dataclass(frozen=True)
class Engine:
    """Executes runs in parallel.

    Raises:
        UnknownName: there is no such engine.
        InvalidInput: an attribute is out of range, or the address does not fit the engine.
    """

    name: str = "local"  # `local` for processes on this machine, `dask` for a cluster
    address: str | None = None  # address of the cluster's scheduler; None for local processes
    jobs: int | None = None  # number of parallel runs; None for the number of processors
    # wall time after which a run counts as hung [s]; None for two minutes plus twenty times its
    # simulated time
    timeout: float | None = None

    def __post_init__(self) -> None:
        CHOICES.check("engine", self.name)
        if (self.name == "local") != (self.address is None):
            expected = "none for local processes" if self.address else "a cluster's"
            raise InvalidInput("address", expected, self.address, "tcp://host:8786 is Dask's form.")
        if self.jobs is not None:
            check_count("jobs", self.jobs, "Omit it for all processors.", MOST_JOBS)
        if self.timeout is not None and not (math.isfinite(self.timeout) and self.timeout > 0):
            raise InvalidInput("timeout", "seconds > 0", self.timeout, "Omit it for the default.")

    def time(self, scenario: Scenario) -> float:
        """The wall time after which a run of a scenario counts as hung [s]."""
        return self.timeout or 120.0 + 20.0 * (scenario.duration + scenario.held_out)

    def make(self, numbers: Sequence[int], job: Callable[[int], Job]) -> Iterator[dict[str, Any]]:
        """Executes runs and yields their figures as they become available, in any order.

        Args:
            numbers: the runs.
            job: what to execute for a number; called when its turn has come.

        Yields:
            The run's number as `run`, and its figures or the reason of its `failure`.

        Raises:
            InvalidInput: the engine is not available or has died, or its workers cannot execute any
                run.
        """
        missing = dict.fromkeys(numbers)
        failed_starts = 0
        while missing:
            before = len(missing)
            try:
                for number, figures in self._executed(map(job, list(missing))):
                    del missing[number]
                    yield {"run": number} | figures
            except BrokenExecutor as error:  # processes were killed before their first run
                failed_starts = failed_starts + 1 if len(missing) == before else 1
                if failed_starts == _STARTS:
                    remedy = "Use fewer --jobs; processes may be killed for want of memory."
                    raise InvalidInput("engine", "processes that start", error, remedy) from error

    def _executed(self, jobs: Iterator[Job]) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yields number and figures of every job, with as many in progress as there are places."""
        with self._opened() as workers:
            running: dict[Future[Any], Job] = {}
            while True:
                for job in islice(jobs, max(0, workers.places - len(running))):
                    running[workers.submit(job)] = job
                if not running:
                    return
                done, _ = wait(running, _TICK, FIRST_COMPLETED)
                workers.check()
                for future in done:
                    job = running.pop(future)
                    yield job.number, workers.figures(future, job)

    @contextmanager
    def _opened(self) -> Iterator["_Processes | _Cluster"]:
        """The workers of the engine; none is left at the end."""
        workers = _Processes(self.jobs) if self.name == "local" else self._cluster()
        try:
            yield workers
        finally:
            workers.close()

    def _cluster(self) -> "_Cluster":
        try:
            return _Cluster(importlib.import_module("distributed"), self.address, self.jobs)
        except ImportError as error:
            expected = "one whose package is installed"
            remedy = "pip install 'nsaid-mj[dask]'"
            raise InvalidInput("engine", expected, "dask", remedy) from error
        except (OSError, ValueError) as error:
            expected = f"that of a running {self.name} cluster"
            raise InvalidInput("address", expected, self.address, str(error)) from error


def _context() -> Any:
    """How processes are started: on Linux as forks of one that has imported what runs need.

    That one has a single thread, so that a fork of it is safe; elsewhere each process imports all.
    """
    if not sys.platform.startswith("linux"):
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([attempt.__module__])
    return context


class _Processes:
    """A pool of processes on this machine."""

    def __init__(self, jobs: int | None):
        self.places = jobs or processors()
        self._before = {name: os.environ.get(name) for name in _ENVIRONMENT}
        os.environ.update(_ENVIRONMENT)  # inherited by the processes
        self._pool = ProcessPool(self.places, initializer=prepare_process, context=_context())

    def submit(self, job: Job) -> Future[Any]:
        try:
            return self._pool.schedule(attempt, [job], timeout=job.timeout)
        except RuntimeError as error:
            raise BrokenExecutor(str(error)) from error

    def check(self) -> None:
        """Raises `BrokenExecutor` if processes die while they start."""
        if not self._pool.active:
            raise BrokenExecutor("processes die while they start")

    def figures(self, future: Future[Any], job: Job) -> dict[str, Any]:
        """The figures of a finished run, or how its process failed."""
        try:
            return future.result()
        except TimeoutError:
            return {"failure": f"not finished within {job.timeout:g} s"}
        except ProcessExpired as error:
            code = error.exitcode
            how = signal.strsignal(-code) if code < 0 else f"exit code {code}"
            return {"failure": f"its process died: {how}"}

    def close(self) -> None:
        """Ends the processes, with or without a run."""
        self._pool.stop()
        self._pool.join()
        for name, value in self._before.items():
            del os.environ[name]
            if value is not None:
                os.environ[name] = value


class _Cluster:
    """The workers of a Dask cluster, which Dask starts again when they die.

    A run that kills its worker is repeated a few times by Dask before it counts as lost.
    """

    def __init__(self, distributed: Any, address: str | None, jobs: int | None):
        self._killed = distributed.KilledWorker
        self._address = address
        self._jobs = jobs
        self._client = distributed.Client(address, set_as_default=False)
        self._tasks: dict[Future[Any], Any] = {}  # Dask forgets a task that nobody refers to
        self._seen = time.monotonic()
        self._threads = 1

    @property
    def places(self) -> int:
        """One run for each thread of a worker, at most `jobs`; workers may come and go."""
        with suppress(OSError):  # of a scheduler that does not answer; see `check`
            self._threads = max(1, sum(self._client.nthreads().values()))
        return min(self._threads, self._jobs or self._threads)

    def submit(self, job: Job) -> Future[Any]:
        finished: Future[Any] = Future()
        self._tasks[finished] = self._client.submit(attempt_in_thread, job, pure=False)
        self._tasks[finished].add_done_callback(finished.set_result)
        return finished

    def check(self) -> None:
        """Raises `InvalidInput` if the scheduler is gone."""
        if self._client.status == "running":
            self._seen = time.monotonic()
        elif time.monotonic() > self._seen + _SILENCE:
            raise self._gone()

    def _gone(self) -> InvalidInput:
        return InvalidInput(
            "address",
            "a scheduler that keeps running",
            f"none any more at {self._address}",
            "Start the cluster again; the same command then resumes the sweep.",
        )

    def figures(self, future: Future[Any], job: Job) -> dict[str, Any]:
        """The figures of a finished run, or how its worker failed."""
        try:
            return self._tasks.pop(future).result()
        except self._killed:
            return {"failure": f"its worker died, or did not finish within {job.timeout:g} s"}
        except CancelledError as error:  # by the client, when it loses the scheduler
            raise self._gone() from error
        except Exception as error:
            expected = "workers that can import nsaid_mj"
            remedy = "Install it on every machine."
            raise InvalidInput("engine", expected, str(error), remedy) from error

    def close(self) -> None:
        """Leaves the cluster, which goes on; runs in progress are cancelled."""
        self._tasks.clear()
        self._client.close()
