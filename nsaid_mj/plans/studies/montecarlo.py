"""`nsaid montecarlo`: many runs of one scenario in one process.

Plants are simulated first, then identifiers follow their logs. Both happen in compiled code that
releases the GIL, so that threads run in parallel. If all runs share one plant, the motion's stages
are computed once for a group of identifiers.

The result of a run depends only on its number, not on how many runs there are or run in parallel.
"""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed, wait
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...base import InvalidInput, Stopwatch
from ...core import (
    Array,
    Estimates,
    Identifier,
    Log,
    NullspaceIdentifier,
    State,
    Status,
)
from ...lab import (
    Following,
    Scenario,
    Setup,
    Truth,
)
from .study import MOST_JOBS, DrawnSeeds, Row, Study, check_count, processors, seed_of

_PIECE = 500  # time steps in a segment, approximately; progress is reported after each
_GROUP = 32  # identifiers that share a motion, at most: one batch
_PLANTS = 32  # plants whose logs are in memory at the same time
JOBS = "The default is the number of processors."

Seen = Callable[[float], object]
"""Called with the progress since the last call, in runs, also fractional."""


def montecarlo_plan(
    script: str,
    scenario: Scenario,
    runs: int,
    shared: bool = True,
    arguments: tuple[str, ...] = (),
) -> Study:
    """The runs of a Monte Carlo study: draws of a scenario whose own seed is the master seed.

    Args:
        script: name of the packaged scenario, or path of its script.
        scenario: what is run.
        runs: number of runs.
        shared: whether all draws share the scenario's plant and motion and differ in the prior
            only; otherwise a draw equals `nsaid run` with its seed, including truth and motion.
        arguments: flags of `nsaid run` that turn the script's scenario into this one.

    Raises:
        InvalidInput: `runs` is less than 1 or too large, or a shared plant leaves nothing to draw.
    """
    check_count("runs", runs, "256 runs give distributions.")
    if shared and scenario.prior == "nominal":
        raise InvalidInput(
            "prior",
            "`drawn`, if all runs share one plant",
            scenario.prior,
            "Add --own-plants: with `nominal`, runs differ in the truth and not in the prior.",
        )
    settings = {
        "montecarlo": {"shared": shared},
        "vary": {},
        "master_seed": scenario.seed,
        "runs": runs,
    }
    return Study(script, scenario, {}, DrawnSeeds(scenario.seed, runs), settings, arguments)


@dataclass(eq=False)
class DrawnMotion:
    """The simulated motion of one plant, and its truth, which is read only after identification.

    The log ends with the first measurement that is not finite; status and time [s] say how.
    """

    setup: Setup
    log: Log
    status: Status
    time: float

    def __post_init__(self) -> None:
        self.workspace = threading.Lock()  # some systems have a single workspace
        self.truth = Truth(self.setup, self.time)

    def ratio(self, theta_hat: Array) -> Array:
        """(...,) distance ‖P̄_⊥ᵀ θ̂_s‖ / ‖θ̂_s‖ of estimates (..., p) to the true set at the end."""
        return self.truth.nullspace.ratio(theta_hat / self.setup.system.space.scale)


# -- data ------------------------------------------------------------------------------------------


def simulate(
    scenarios: Sequence[Scenario], pool: Executor, stopped: threading.Event | None = None
) -> list[DrawnMotion]:
    """Builds and drives every scenario's plant, with results identical to those of a run.

    Compiled drives in threads give the same bits as sequential ones, with feedback too.
    `mujoco.rollout` cannot be used: its initial states omit userdata, which our callbacks need.
    `mujoco.batch` is equally fast and gives the same bits, but has no feedback drivers.
    """
    setups = [Setup.of(scenario) for scenario in scenarios]
    if len({id(setup.plant.passive) for setup in setups}) == 1:  # MuJoCo has one callback for all
        with setups[0].plant.running():
            return _driven(setups, pool, stopped or threading.Event())
    courses = []
    for setup in setups:
        with setup.plant.running():
            courses.append(_drive(setup, stopped or threading.Event()))
    return courses


def _driven(setups: Sequence[Setup], pool: Executor, stopped: threading.Event) -> list[DrawnMotion]:
    """Drives running plants in parallel; after Ctrl-C, returns only when all have stopped."""
    futures = [pool.submit(_drive, setup, stopped) for setup in setups]
    try:
        return [future.result() for future in futures]
    except BaseException:
        stopped.set()
        raise
    finally:
        wait(futures)


def _drive(setup: Setup, stopped: threading.Event) -> DrawnMotion:
    """Drives a running plant for the scenario's duration, or until `stopped`."""
    log = setup.simulate(partial(_check, stopped))
    end = setup.plant.ended(log.at(-1))
    status = end[0] if end else Status.completed
    time = float(log.t[-1])
    return DrawnMotion(setup, log.first(len(log.t) - bool(end)), status, time)


# -- identification --------------------------------------------------------------------------------


class Draw:
    """An identifier along a log, and its estimates (p,) at the times of every check [s]."""

    def __init__(self, identifier: Identifier, log: Log):
        self.following = Following(identifier, log)
        self.t = [self.following.state.t]
        self.theta_hat = [self.following.state.theta_hat]

    def absorb(self, log: Log, state: State, estimates: Estimates, due: np.ndarray) -> None:
        """Absorbs the estimates of a segment; those at rows `due` are checked and stored."""
        estimates = self.following.absorb(log, state, estimates, due)
        due = due[due < len(estimates.pivot)]
        self.t += [float(t) for t in log.t[due]]
        self.theta_hat += list(estimates.theta_hat[due].copy())


def identify(
    course: DrawnMotion, draws: Sequence[tuple[int, Scenario]], seen: Seen = float
) -> list[Row]:
    """Identifies from the prior of every draw along a course's log, and judges the last estimates.

    A draw is its number and its scenario, whose seed draws the prior. Returns one row per draw.
    """
    begin = time.perf_counter()
    watch = Stopwatch()
    runs = follow(course, [scenario for _, scenario in draws], seen)
    spent = time.perf_counter() - begin - watch.compiling
    cost = 1e6 * max(spent, 0.0) / (len(runs) * max(1, len(course.log.t) - 1))
    return [_row(*draw, course, run, cost) for draw, run in zip(draws, runs, strict=True)]


def follow(course: DrawnMotion, scenarios: Sequence[Scenario], seen: Seen = float) -> list[Draw]:
    """Runs the identifiers of scenarios along a course's log, to its end or until they fail."""
    log = course.log
    dt = course.setup.scenario.dt
    with course.workspace:
        setups = [
            replace(course.setup.with_prior_of(own), scenario=replace(own, rivals={}))
            for own in scenarios
        ]
        runs = [Draw(setup.identifiers()[""], log) for setup in setups]
    every = Following.every(dt)
    piece = every * max(1, round(_PIECE / every))
    last = len(log.t) - 1
    for at in range(0, last, piece):
        part = log.part(at, at + piece + 1)
        due = Following.due(at, len(part.t), dt, last)
        going = [run for run in runs if run.following.ended is None]
        if not going:
            break
        with course.workspace:
            motion = NullspaceIdentifier.shared_motion(going[0].following.identifier, part)
        with course.workspace if motion is None else nullcontext():
            laws = [run.following.identifier for run in going]
            states = [run.following.state for run in going]
            steps = NullspaceIdentifier.followed_together(laws, states, part, motion)
            for run, found in zip(going, steps, strict=True):
                run.absorb(part, *found, due)
                seen((len(part.t) - 1) / last)
        seen((len(runs) - len(going)) * (len(part.t) - 1) / last)
    return runs


def _row(draw: int, scenario: Scenario, course: DrawnMotion, run: Draw, cost: float) -> Row:
    """The row of results of a run."""
    status = course.status
    t = course.time
    following = run.following
    if following.ended is not None:
        status = following.state.status
        t = following.ended
    theta = following.state.theta_hat
    converged = None
    if status is Status.completed:
        converged = course.truth.converged_at(np.array(run.t), np.array(run.theta_hat))
    return {
        "run": draw,
        "draw": draw,
        "seed": scenario.seed,
        "failure": None,
        "status": status.words,
        "status_time": t,
        "theta_perp_ratio_initial": float(course.ratio(run.theta_hat[0])),
        "theta_perp_ratio": float(course.ratio(theta)),
        "actuator_ratio_error": course.truth.gain_ratio_error(theta),
        "conserved_drift": following.drift if following.identifier.conserves else None,
        "time_to_converge": converged,
        "identifier_us_per_step": cost,
    }


# -- the whole study -------------------------------------------------------------------------------


def rows_of(
    scenario: Scenario, todo: Sequence[int], jobs: int | None, shared: bool, report: Seen = float
) -> Iterator[list[Row]]:
    """Yields groups of rows of the draws to do, as they become available.

    If the caller stops iterating, the threads stop at their next report of progress.
    """
    jobs = processors() if jobs is None else jobs
    check_count("jobs", jobs, JOBS, MOST_JOBS)
    draws = [(k, replace(scenario, seed=seed_of(scenario.seed, k))) for k in todo]
    pool = ThreadPoolExecutor(jobs)
    stopped = threading.Event()

    def seen(progress: float) -> None:
        _check(stopped)
        report(progress)

    try:
        if shared:
            (course,) = simulate([scenario], pool, stopped)
            _ = course.truth.nullspace  # computed before the threads use it
            groups = [(course, group) for group in grouped(draws, jobs)]
            yield from _identified(groups, pool, seen)
            return
        for at in range(0, len(draws), _PLANTS):
            batch = draws[at : at + _PLANTS]
            courses = simulate([own for _, own in batch], pool, stopped)
            groups = [(course, [draw]) for course, draw in zip(courses, batch, strict=True)]
            yield from _identified(groups, pool, seen)
    finally:
        stopped.set()
        pool.shutdown(cancel_futures=True)


class _Stopped(Exception):
    """Ends a thread whose result is no longer needed."""


def _check(stopped: threading.Event) -> None:
    if stopped.is_set():
        raise _Stopped


def grouped(draws: Sequence[Any], jobs: int) -> list[Sequence[Any]]:
    """Splits the draws of one course into groups, at least one per thread if there are enough."""
    size = max(1, min(_GROUP, -(-len(draws) // jobs)))
    return [draws[at : at + size] for at in range(0, len(draws), size)]


def _identified(
    groups: Sequence[tuple[DrawnMotion, Sequence[tuple[int, Scenario]]]], pool: Executor, seen: Seen
) -> Iterator[list[Row]]:
    """Yields the rows of groups of draws, as they become available."""
    for done in as_completed([pool.submit(identify, *group, seen) for group in groups]):
        yield done.result()
