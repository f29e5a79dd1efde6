"""Executes the runs of a sweep in a child process, whose crash or hang loses no other run.

An engine's worker (a local process of joblib, or a thread on a cluster) executes no run itself. It
keeps one child process, sends it one run at a time as a line of JSON, and waits for a line in
answer. If the child crashes or times out, its current run is lost and the next gets a new child.
"""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

from ..bounds import without_nonfinite
from ..errors import NsaidError
from ..experiment.library import digest_of

if TYPE_CHECKING:
    from ..evaluation import Truth
    from ..experiment.loop import SimulatedRun

_START = 300.0  # timeout for a child's imports [s]
_STARTS = 3  # children that may be killed in their imports before their run counts as lost
_WATCH = 0.5  # time between two checks of the engine's process [s]
_GRACE = 10.0  # after a run's timeout, at which a child without a worker exits by itself [s]
_LEFT_OUT = {"versions", "status_remedy"}  # keys of a summary with equal values in many runs
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class Job(NamedTuple):
    """A run to execute."""

    number: int  # number of the run in its sweep
    script: str  # name of a packaged scenario, or path of the script that defines its types
    digest: str  # SHA-256 of the script, to detect a different version of it
    scenario: str  # the scenario as JSON
    timeout: float  # wall time after which the run counts as hung [s]


def supervised(job: Job, engine: int | None = None) -> dict[str, Any]:
    """Executes a job in this thread's child process.

    `engine` is its process ID, if its workers are local processes: when that process is gone, the
    worker ends, and its child with it.

    Returns:
        The run's number and figures by key, or its number and the reason of a `failure`. If a
        child process cannot import this package, the number, the reason as `failure`, and `unfit`.
    """
    if engine not in (None, os.getpid()):
        _end_with(engine)
    child = _child_for(job)
    if child.fault:
        unfit = {} if child.killed else {"unfit": True}
        return {"run": job.number, "failure": child.fault} | unfit
    with TemporaryDirectory(prefix="nsaid-sweep-", ignore_cleanup_errors=True) as folder:
        return {"run": job.number} | child.ask(job, folder)


def _child_for(job: Job) -> _Child:
    """This thread's child process, a new one if none serves the job."""
    child: _Child | None = getattr(_mine, "child", None)
    if child is not None and child.serves(job):
        return child
    if child is not None:
        child.stop()
    for _ in range(_STARTS):
        child = _mine.child = _Child(job)
        if not child.killed:
            return child
    return _mine.child


@cache
def _end_with(engine: int) -> None:
    """Ends this worker process, and its child with it, when the engine's process is gone.

    A killed engine cannot notify its workers, and a worker waiting for a long run would not detect
    it. The engine may even be gone before the worker has imported this module.
    """

    def watch() -> None:
        while os.getppid() == engine:
            time.sleep(_WATCH)
        os._exit(1)  # closes the child's standard input, at which it ends

    threading.Thread(target=watch, daemon=True).start()


_mine = threading.local()  # a worker on a cluster may have several threads, each with a child


class _Child:
    """A child process that executes runs, as seen from its worker."""

    def __init__(self, job: Job):
        self._key = job.script, job.digest
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "nsaid_mj.studies.sweep_worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_ONE_THREAD},
            encoding="utf-8",
        )
        atexit.register(self.stop)
        self.fault = self._wait(_START)[1]  # imports do not count towards a run's timeout

    @property
    def killed(self) -> bool:
        """Whether a signal ended the process, so that a retry may succeed."""
        return (self._process.poll() or 0) < 0

    def serves(self, job: Job) -> bool:
        """Whether the process is alive and has loaded the job's script."""
        same = self._key == (job.script, job.digest)
        return same and not self.fault and self._process.poll() is None

    def ask(self, job: Job, folder: str) -> dict[str, Any]:
        """The run's figures, or how the process failed."""
        answer, self.fault = self._wait(job.timeout, json.dumps([*job, folder]) + "\n")
        return {"failure": self.fault} if self.fault else json.loads(answer)

    def _wait(self, timeout: float, question: str = "") -> tuple[str, str]:
        """Sends a question; returns the answered line and "", or "" and how the process failed."""
        assert self._process.stdin is not None and self._process.stdout is not None
        expired = threading.Event()

        def expire() -> None:
            expired.set()
            self._process.kill()

        timer = threading.Timer(timeout, expire)
        timer.daemon = True
        timer.start()
        try:
            self._process.stdin.write(question)
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        except BaseException:  # Ctrl-C: the answer is not needed any more
            self.stop()
            raise
        finally:
            timer.cancel()
            timer.join()
        if expired.is_set():
            self._process.wait()  # else `poll` could still report it as alive
        if answer.endswith("\n"):
            return answer, ""
        if expired.is_set():
            return "", f"not finished within {timeout:g} s"
        code = self._process.wait()
        how = signal.strsignal(-code) if code < 0 else f"exit code {code}"
        return "", f"its process died: {how}"

    def stop(self) -> None:
        """Stops the process and waits for it."""
        atexit.unregister(self.stop)
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
        try:
            self._process.wait(0.5)  # it exits when its standard input is closed
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


# -- in the child ------------------------------------------------------------------------------


def serve() -> None:
    """Executes the runs that arrive on the standard input, until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the sweep
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # output of a scenario's script must not be taken for an answer

    print("ready", file=answers, flush=True)
    for line in iter(_questions().get, ""):
        *words, folder = json.loads(line)
        job = Job(*words)
        faulthandler.dump_traceback_later(job.timeout + _GRACE, exit=True)
        answer = _attempt(job, Path(folder))
        faulthandler.cancel_dump_traceback_later()
        print(answer, file=answers, flush=True)


def _questions() -> queue.SimpleQueue[str]:
    """The lines of the standard input; the process ends when it is closed.

    It is closed when the worker is gone, which can then no longer kill an endless run.
    """
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line)
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    return lines


def _attempt(job: Job, folder: Path) -> str:
    """The figures of a run as JSON, or its failure, which may be an error in the script."""
    from ..experiment.loop import run
    from ..experiment.scenario import Scenario

    try:
        _types_of(job.script)
        if digest_of(job.script) != job.digest:
            return _failure(f"{job.script} has changed since the sweep was started")
        found = figures(run(Scenario.from_json(job.scenario), folder))
        return json.dumps(without_nonfinite(found), ensure_ascii=False, allow_nan=False)
    except NsaidError as error:
        return _failure(str(error))
    except (Exception, SystemExit) as error:
        return _failure(f"{type(error).__name__}: {error}")


def _failure(why: str) -> str:
    return json.dumps({"failure": why}, ensure_ascii=False)


@cache
def _types_of(script: str) -> None:
    """Loads a script, which defines the types of its scenario."""
    from ..experiment.library import load

    load(script)


def figures(run: SimulatedRun) -> dict[str, Any]:
    """Scalar entries of a run's summary by key, dotted if nested, and `time_to_converge`."""
    from .. import evaluation

    truth = evaluation.truth_of(run)
    converged = {"time_to_converge": time_to_converge(run, truth)}
    summary = evaluation.summary_of(evaluation.evaluate(run, truth))
    return {"failure": None} | converged | _plain(summary)


def _plain(summary: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in summary.items():
        if isinstance(value, dict) and key not in _LEFT_OUT:
            found |= _plain(value, f"{prefix}{key}.")
        elif not isinstance(value, list | dict) and key not in _LEFT_OUT:
            found[prefix + key] = value
    return found


def time_to_converge(run: SimulatedRun, truth: Truth) -> float | None:
    """The time from which the distance to the true set stays small [s].

    See `evaluation.converged_at`. None if it does not stay small, or if the run ended early.
    """
    from ..evaluation import converged_at
    from ..laws import Status

    if run.ending.status is not Status.completed:
        return None
    t = run.record["t"]
    return converged_at(t, truth.distance(t, run.record["theta_hat"]))


if __name__ == "__main__":
    serve()
