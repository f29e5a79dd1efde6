"""One run of a sweep, as a process of the engine executes it."""

import hashlib
import multiprocessing
import os
import threading
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ...base import NsaidError
from ...core import Status
from ...lab import (
    Scenario,
    SimulatedRun,
    Truth,
    evaluate,
    load,
)
from ...lab import run as run_scenario
from ...robots import scenarios

_LEFT_OUT = {"versions", "status_remedy"}  # keys of a summary with equal values in many runs


def digest_of(script: str) -> str:
    """SHA-256 of a scenario's script, given by packaged name or path."""
    path = scenarios().get(script, Path(script))
    return hashlib.sha256(path.read_bytes()).hexdigest()


class Job(NamedTuple):
    """A run to execute."""

    number: int  # number of the run in its sweep
    script: str  # name of a packaged scenario, or path of the script that defines its types
    digest: str  # SHA-256 of the script, to detect a different version of it
    scenario: str  # the scenario as JSON
    timeout: float  # wall time after which the run counts as hung [s]


def attempt(job: Job) -> dict[str, Any]:
    """Executes a job.

    Returns:
        The run's figures by key, or the reason of its `failure`, which may be an error in the
        script.
    """
    try:
        return {"failure": None} | _figures_of(job)
    except NsaidError as error:
        return {"failure": str(error)}
    except (Exception, SystemExit) as error:
        return {"failure": f"{type(error).__name__}: {error}"}


def _figures_of(job: Job) -> dict[str, Any]:
    """The figures of a job's run; its record is not kept."""
    loaded = _loaded(job.script)
    if digest_of(job.script) != job.digest:
        return {"failure": f"{job.script} has changed since the sweep was started"}
    if loaded != job.digest:
        return {"failure": f"its worker has loaded another version of {job.script}; restart it"}
    scenario = Scenario.from_json(job.scenario)
    with TemporaryDirectory(prefix="nsaid-sweep-", ignore_cleanup_errors=True) as folder:
        return figures(run_scenario(scenario, Path(folder)))


@cache
def _loaded(script: str) -> str:
    """Loads a script, which defines the types of its scenario; its digest at that time."""
    digest = digest_of(script)
    load(script)
    return digest


def figures(run: SimulatedRun) -> dict[str, Any]:
    """Scalar entries of a run's summary by key, dotted if nested, and `time_to_converge`."""
    truth = Truth.of(run)
    converged = {"time_to_converge": time_to_converge(run, truth)}
    return converged | _scalars(evaluate(run, truth).summary())


def _scalars(summary: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    scalars: dict[str, Any] = {}
    for key, value in summary.items():
        if isinstance(value, dict) and key not in _LEFT_OUT:
            scalars |= _scalars(value, f"{prefix}{key}.")
        elif not isinstance(value, list | dict) and key not in _LEFT_OUT:
            scalars[prefix + key] = value
    return scalars


def time_to_converge(run: SimulatedRun, truth: Truth) -> float | None:
    """The time from which the distance to the true set stays small [s].

    See `Truth.converged_at`. None if it does not stay small, or if the run ended early.
    """
    if run.ending.status is not Status.completed:
        return None
    t = run.record["t"]
    return truth.converged_at(t, run.record["theta_hat"])


# -- the process it runs in ------------------------------------------------------------------------


def prepare_process() -> None:
    """Prepares a process of a local pool: it prints nothing, and ends when the sweep's is gone.

    Importing this module has imported what every run needs, before the time of a run counts.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A killed sweep cannot end its processes, and a long run would not notice."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


_alone = threading.Lock()  # MuJoCo's callbacks are those of a whole process


def attempt_in_thread(job: Job) -> dict[str, Any]:
    """Executes a job in a thread of a cluster's worker, whose process ends if the run hangs.

    Dask then starts the worker again; a worker executes one run at a time.
    """
    with _alone:
        clock = threading.Timer(job.timeout, os._exit, (1,))
        clock.daemon = True
        clock.start()
        try:
            return attempt(job)
        finally:
            clock.cancel()
