"""One run of a sweep, in a process of its own that may die or hang without harm to others.

An engine's worker (joblib's local process, or a thread of a cluster's) makes no run itself. It
keeps one child process, hands it a run at a time as a line of JSON and waits for a line in answer.
A child that dies or does not answer in time costs the run it was at; the next run gets a new one.
"""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import json
import os
import signal
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import NsaidError
from ..experiment.library import digest_of

if TYPE_CHECKING:
    from ..evaluation import Truth
    from ..experiment.loop import SimulatedRun

_START = 300.0  # time that a child has for its imports [s]
_GRACE = 10.0  # beyond its time a child that nobody watches any more ends itself [s]
_LEFT_OUT = {"versions", "status_remedy"}  # of a summary: the same for many runs
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class Job(NamedTuple):
    """A run to be made.

    Attributes:
        number: of the run in its sweep.
        script: the packed name or the path of the scenario that defines the types.
        digest: of the script's text, so that no other version of it is run.
        scenario: what to run, as JSON.
        timeout: wall time that it may take [s].
    """

    number: int
    script: str
    digest: str
    scenario: str
    timeout: float


def supervised(job: Job) -> dict[str, Any]:
    """Figures of a run by key, or why there are none as its `failure`; always with its number.

    Where no run could be made at all, for want of a process that imports this package, `unfit`
    says so.
    """
    child: _Child | None = getattr(_mine, "child", None)
    if child is None or not child.serves(job):
        if child is not None:
            child.stop()
        child = _mine.child = _Child(job)
        if child.fault:
            return {"run": job.number, "unfit": child.fault}
    with TemporaryDirectory(prefix="nsaid-sweep-", ignore_cleanup_errors=True) as folder:
        return {"run": job.number} | child.ask(job, folder)


_mine = threading.local()  # a cluster's worker may have several threads, each with a child


class _Child:
    """A process that makes runs, seen from the one that waits for them."""

    def __init__(self, job: Job):
        self._key = job.script, job.digest
        self._process = subprocess.Popen(
            [sys.executable, "-m", "nsaid_mj.studies.sweep_worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_ONE_THREAD},
            encoding="utf-8",
        )
        atexit.register(self.stop)
        self.fault = self._wait(_START)[1]  # imports are no part of a run's time

    def serves(self, job: Job) -> bool:
        """Whether it is alive and of the job's script."""
        same = self._key == (job.script, job.digest)
        return same and not self.fault and self._process.poll() is None

    def ask(self, job: Job, folder: str) -> dict[str, Any]:
        """What the run has found, or how the process failed."""
        answer, self.fault = self._wait(job.timeout, json.dumps([*job, folder]) + "\n")
        return {"failure": self.fault} if self.fault else json.loads(answer)

    def _wait(self, timeout: float, question: str = "") -> tuple[str, str]:
        """The process's next line, and "" or what has become of it instead."""
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
        except BaseException:  # Ctrl-C: nobody will ask for the answer
            self.stop()
            raise
        finally:
            timer.cancel()
            timer.join()
        if expired.is_set():
            self._process.wait()  # dead now, or the next run would still take it for alive
        if answer.endswith("\n"):
            return answer, ""
        if expired.is_set():
            return "", f"no end within {timeout:g} s"
        code = self._process.wait()
        how = signal.strsignal(-code) if code < 0 else f"exit code {code}"
        return "", f"its process died: {how}"

    def stop(self) -> None:
        """Ends the process, and waits until it has."""
        atexit.unregister(self.stop)
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
        try:
            self._process.wait(0.5)  # its own way out, if it has none of its own making
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


# -- in the child ------------------------------------------------------------------------------


def serve() -> None:
    """Makes the runs that come on the standard input, until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the sweep's: a run cut off is no row
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a scenario prints must not pass for an answer

    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        *words, folder = json.loads(line)
        job = Job(*words)
        faulthandler.dump_traceback_later(job.timeout + _GRACE, exit=True)
        answer = _attempt(job, Path(folder))
        faulthandler.cancel_dump_traceback_later()
        print(answer, file=answers, flush=True)


def _attempt(job: Job, folder: Path) -> str:
    """The figures of a run as JSON, or why it has none: an error of a scenario's script too."""
    from ..experiment.loop import run
    from ..experiment.scenario import Scenario

    try:
        _types_of(job.script)
        if digest_of(job.script) != job.digest:
            return _failure(f"{job.script} is not what the sweep was started with")
        found = figures(run(Scenario.from_json(job.scenario), folder))
        return json.dumps(found, ensure_ascii=False, allow_nan=False)
    except NsaidError as error:
        return _failure(str(error))
    except (Exception, SystemExit) as error:
        return _failure(f"{type(error).__name__}: {error}")


def _failure(why: str) -> str:
    return json.dumps({"failure": why}, ensure_ascii=False)


@cache
def _types_of(script: str) -> None:
    """Loads a script, for the types that its scenario is made of."""
    from ..experiment.library import load

    load(script)


def figures(run: SimulatedRun) -> dict[str, Any]:
    """The plain figures of a run's summary by key, dotted where nested, and `time_to_converge`."""
    from .. import evaluation
    from ..reporting.warmup import mark_warm

    truth = evaluation.truth_of(run)
    converged = {"time_to_converge": time_to_converge(run, truth)}
    summary = evaluation.summarize(run, truth)
    mark_warm(run)
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
    """From when on the distance to the true set stays small; see `evaluation.converged_at` [s].

    None where it does not, or where the run ended before its time.
    """
    from ..evaluation import converged_at
    from ..identifiers import Status

    if run.ending.status is not Status.completed:
        return None
    t = run.record["t"]
    return converged_at(t, truth.distance(t, run.record["theta_hat"]))


if __name__ == "__main__":
    serve()
