"""Many runs of one scenario in one process, data first: `nsaid montecarlo`.

Plants are driven first, and then identifiers follow the logs, both in compiled code during which
other threads run. With one plant for all, what its motion alone decides of every step is computed
once for a group of identifiers; those of trees with the paper's law have one SIMD lane each.

A run's number says all about it: how many there are, and how many at once, changes no bit.
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ..errors import BadRun, InvalidInput
from ..evaluation import Truth, converged_at
from ..evaluation.figures import actuator_ratio_error
from ..experiment.following import CHECK, Following, due_rows
from ..experiment.loop import ended
from ..experiment.scenario import Scenario
from ..experiment.setup import Setup
from ..identifiers import Identifier, State, Status
from ..identifiers.base import Estimates
from ..identifiers.nullspace_aid import NullspaceIdentifier, side_by_side
from ..log import Log
from ..parameters import Array
from ..reporting.progress import announcing
from ..system import Motion
from .study import Study
from .sweep import opened, seed_of
from .sweep_results import MANIFEST, ROWS, TABLE, Group, Row, Sweep, digits, read, write_table

FIGURES = {
    "theta_perp_ratio": "distance at end",
    "actuator_ratio_error": "actuators' shares",
    "conserved_drift": "conserved drift",
    "time_to_converge": "converged after [s]",
}
"""Columns that are printed, and in which words."""
QUANTILES = {"median": 0.5, "90 %": 0.9, "worst": 1.0}

_PIECE = 500  # steps, about, that a group of identifiers makes before it looks up
_GROUP = 32  # identifiers that share a motion, at most: one batch
_PLANTS = 32  # plants whose logs are held at once
_LINES = 40  # of lost runs on the terminal

Seen = Callable[[float], object]
"""Called with the number of runs, or parts of runs, done since the last call."""


@dataclass(frozen=True)
class Plan(Study):
    """Which runs there are. Draw i is `sweep.seed_of(scenario.seed, i)`, however many there are.

    Attributes:
        script: the scenario's packed name, or its script's path.
        scenario: what is run; its seed is the master seed.
        arguments: flags of `nsaid run` that made the scenario.
        runs: how many.
        shared: one plant and one motion, those of the scenario, and a prior for every draw; else
            draw i is what `nsaid run` makes of its seed, its own truth and motion included.

    Raises:
        InvalidInput: there is nothing to run.
    """

    runs: int
    shared: bool = True

    def __post_init__(self) -> None:
        _at_least_one("runs", self.runs, "256 give distributions.")

    @property
    def manifest(self) -> dict[str, Any]:
        """What the results depend on: as a sweep's that varies nothing."""
        return self.manifest_of(
            montecarlo={"shared": self.shared},
            vary={},
            master_seed=self.scenario.seed,
            runs=self.runs,
        )


@dataclass(eq=False)
class Course:
    """What a plant did, and its truth, which is read after the fact only.

    Attributes:
        setup: what was simulated.
        log: what was measured, as far as it is sound.
        status: how it ended.
        time: when [s].
    """

    setup: Setup
    log: Log
    status: Status
    time: float

    def __post_init__(self) -> None:
        self.workspace = threading.Lock()  # some systems have one workspace: one thread at a time
        self.truth = Truth(self.setup, self.time)

    def ratio(self, theta_hat: Array) -> Array:
        """(...,) ‖P̄_⊥ᵀ θ̂_s‖ / ‖θ̂_s‖ of estimates (..., p) from the true set at the end."""
        return self.truth.nullspace.ratio(theta_hat / self.setup.system.space.scale)


# -- data ------------------------------------------------------------------------------------------


def simulate(scenarios: Sequence[Scenario], pool: Executor) -> list[Course]:
    """Makes every scenario's plant and drives it, as `experiment.run` does.

    Compiled drives in threads give the bits of one after the other, under feedback too.
    `mujoco.rollout` cannot: its initial states leave out userdata, where our callbacks have their
    numbers. `mujoco.batch` gives the same bits as fast, but knows no driver that looks.
    """
    setups = [Setup.of(scenario) for scenario in scenarios]
    if len({id(setup.plant.passive) for setup in setups}) == 1:  # MuJoCo has one callback for all
        with setups[0].plant.running():
            return list(pool.map(_drive, setups))
    courses = []
    for setup in setups:
        with setup.plant.running():
            courses.append(_drive(setup))
    return courses


def _drive(setup: Setup) -> Course:
    """Drives a plant that is running."""
    log = setup.simulate()
    end = ended(setup.plant, log.at(-1))
    status = end[0] if end else Status.completed
    time = float(log.t[-1])
    return Course(setup, log.first(len(log.t) - bool(end)), status, time)


# -- identification --------------------------------------------------------------------------------


class Draw:
    """An identifier on its way along a log, and its estimates at every check.

    Attributes:
        following: the identifier's state along the log.
        t: times of the checks [s].
        theta_hat: (p,) estimates at the checks.
    """

    def __init__(self, identifier: Identifier, log: Log):
        self.following = Following(identifier, log)
        self.t = [self.following.state.t]
        self.theta_hat = [self.following.state.theta_hat]

    def absorb(self, log: Log, state: State, estimates: Estimates, due: np.ndarray) -> None:
        """Takes over what following a stretch has given; rows `due` are checked and kept."""
        estimates = self.following.absorb(log, state, estimates, due)
        due = due[due < len(estimates.pivot)]
        self.t += [float(t) for t in log.t[due]]
        self.theta_hat += list(estimates.theta_hat[due].copy())


def identify(
    course: Course, draws: Sequence[tuple[int, Scenario]], seen: Seen = float
) -> list[Row]:
    """Follows a course's log from the prior of every draw, and judges where that has led.

    Args:
        course: what the plant did.
        draws: number and scenario of each; the scenario's seed draws the prior.
        seen: is called as the work proceeds.
    """
    begin, steps = time.perf_counter(), max(1, len(course.log.t) - 1)
    runs = follow(course, [scenario for _, scenario in draws], seen)
    cost = 1e6 * (time.perf_counter() - begin) / (len(runs) * steps)
    return [_row(*draw, course, run, cost) for draw, run in zip(draws, runs, strict=True)]


def follow(course: Course, scenarios: Sequence[Scenario], seen: Seen = float) -> list[Draw]:
    """The identifiers of scenarios on a course's log, side by side, to its end or their own."""
    log, dt = course.log, course.setup.scenario.dt
    with course.workspace:
        runs = [Draw(_identifier(course, scenario), log) for scenario in scenarios]
    every = max(1, round(CHECK / dt))
    piece, last = every * max(1, round(_PIECE / every)), len(log.t) - 1
    for at in range(0, last, piece):
        part = log.part(at, at + piece + 1)
        due = due_rows(at, len(part.t), dt, last)
        going = [run for run in runs if run.following.ended is None]
        if not going:
            break
        with course.workspace:
            motion = _shared(going[0].following.identifier, part)
        with course.workspace if motion is None else nullcontext():
            for run, found in zip(going, _followed(going, part, motion), strict=True):
                run.absorb(part, *found, due)
        seen(len(runs) * (len(part.t) - 1) / last)
    return runs


def _identifier(course: Course, scenario: Scenario) -> Identifier:
    """A scenario's own identifier, with its prior about the truth of a course's plant."""
    setup = course.setup.with_prior_of(scenario)
    return replace(setup, scenario=replace(scenario, rivals={})).identifiers()[""]


def _followed(
    runs: Sequence[Draw], log: Log, motion: Motion | None
) -> Iterator[tuple[State, Estimates]]:
    """What every run's identifier makes of a stretch, from where it is."""
    following = [run.following for run in runs]
    if motion is None:
        yield from (each.identifier.follow(each.state, log) for each in following)
    else:
        laws = [each.identifier for each in following]
        own = [law for law in laws if isinstance(law, NullspaceIdentifier)]
        yield from side_by_side(own, [each.state for each in following], log, motion)


def _shared(identifier: Identifier, log: Log) -> Motion | None:
    """What identifiers of one kind share on a log; None where each goes its own way."""
    if isinstance(identifier, NullspaceIdentifier) and identifier.memory is None:
        return identifier.motion(log)
    return None


def _row(draw: int, scenario: Scenario, course: Course, run: Draw, cost: float) -> Row:
    """What has become of a run."""
    status, t, following = course.status, course.time, run.following
    if following.ended is not None:
        status, t = following.state.status, following.ended
    theta, system, truth = following.state.theta_hat, course.setup.system, course.truth.theta
    converged = None
    if status is Status.completed:
        converged = converged_at(np.array(run.t), course.ratio(np.array(run.theta_hat)))
    return _what(draw, scenario) | {
        "failure": None,
        "status": status.words,
        "status_time": t,
        "theta_perp_ratio_initial": float(course.ratio(run.theta_hat[0])),
        "theta_perp_ratio": float(course.ratio(theta)),
        "actuator_ratio_error": actuator_ratio_error(system, theta, truth),
        "conserved_drift": following.drift if following.identifier.conserves else None,
        "time_to_converge": converged,
        "identifier_us_per_step": cost,
    }


def _what(draw: int, scenario: Scenario) -> Row:
    return {"run": draw, "draw": draw, "seed": scenario.seed}


# -- all of it -------------------------------------------------------------------------------------


def monte_carlo(
    scenario: Scenario, runs: int, jobs: int | None = None, shared: bool = True
) -> list[Row]:
    """Makes all runs.

    Args:
        scenario: what is run; its seed is the master seed, and its rivals are left out.
        runs: how many.
        jobs: how many at once; None is as many as there are processors.
        shared: see `Plan`.

    Returns:
        A row for every run, in their order: how it ended, and the figures of its last estimate.

    Raises:
        InvalidInput: there is nothing to run, or nobody to run it.
        NsaidError: the scenario cannot be started.
    """
    _at_least_one("runs", runs, "256 give distributions.")
    rows = [row for part in _rows(scenario, range(runs), jobs, shared) for row in part]
    return sorted(rows, key=lambda row: row["run"])


def _rows(
    scenario: Scenario, todo: Sequence[int], jobs: int | None, shared: bool, seen: Seen = float
) -> Iterator[list[Row]]:
    """Rows of the draws to do, as they are known."""
    jobs = (os.cpu_count() or 1) if jobs is None else jobs
    _at_least_one("jobs", jobs, "2 use two processors.")
    draws = [(k, replace(scenario, seed=seed_of(scenario.seed, k))) for k in todo]
    pool = ThreadPoolExecutor(jobs)
    try:
        if shared:
            (course,) = simulate([scenario], pool)
            _ = course.truth.nullspace  # before threads ask for it
            groups = [(course, group) for group in grouped(draws, jobs)]
            yield from _identified(groups, pool, seen)
            return
        for at in range(0, len(draws), _PLANTS):
            batch = draws[at : at + _PLANTS]
            courses = simulate([own for _, own in batch], pool)
            groups = [(course, [draw]) for course, draw in zip(courses, batch, strict=True)]
            yield from _identified(groups, pool, seen)
    finally:
        pool.shutdown(cancel_futures=True)


def grouped(draws: Sequence[Any], jobs: int) -> list[Sequence[Any]]:
    """Draws of one course, as many together as leaves every thread some."""
    size = max(1, min(_GROUP, -(-len(draws) // jobs)))
    return [draws[at : at + size] for at in range(0, len(draws), size)]


def _identified(
    groups: Sequence[tuple[Course, Sequence[tuple[int, Scenario]]]], pool: Executor, seen: Seen
) -> Iterator[list[Row]]:
    """Rows of groups of draws, as they are known."""
    for done in as_completed([pool.submit(identify, *group, seen) for group in groups]):
        yield done.result()


def _at_least_one(name: str, number: int, remedy: str) -> None:
    if number < 1:
        raise InvalidInput(name, "a number ≥ 1", number, remedy)


def run(plan: Plan, folder: Path, jobs: int | None = None, quiet: bool = False) -> Sweep:
    """Makes the runs that a folder does not have yet, and writes what a sweep would.

    Stopped by Ctrl-C, it keeps what it has; the same call goes on from there.

    Args:
        plan: which runs.
        folder: where to write; it is made.
        jobs: how many runs at once.
        quiet: show no progress.

    Raises:
        BadRun: the folder cannot be written, or holds something else.
        NsaidError: as for `monte_carlo`.
    """
    _at_least_one("jobs", 1 if jobs is None else jobs, "2 use two processors.")
    if folder.is_dir() and not (folder / MANIFEST).is_file() and any(folder.iterdir()):
        raise BadRun(folder, "it holds something else", "Give another folder with --out")
    known = opened(folder, plan.manifest)
    todo = [number for number in range(plan.runs) if number not in known]
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} runs"),
        TimeRemainingColumn(),
        console=Console(stderr=True, quiet=quiet),
        transient=True,
        disable=quiet,
    )
    try:
        with (
            bar,
            announcing(bar.console),
            (folder / ROWS).open("a", encoding="utf-8") as stream,
        ):
            task = bar.add_task(folder.name, total=plan.runs, completed=len(known))
            seen = partial(bar.advance, task)
            for rows in _rows(plan.scenario, todo, jobs, plan.shared, seen):
                for row in rows:
                    line = json.dumps(row, ensure_ascii=False, allow_nan=False)
                    stream.write(line + "\n")
                stream.flush()
    finally:
        write_table(folder)
    return read(folder)


# -- the terminal ----------------------------------------------------------------------------------


def quantiles(sweep: Sweep) -> dict[str, dict[str, float]]:
    """Quantiles of the figures, by name; infinite where so many runs are lost, or never get there.

    A lost run is worse than any other.
    """
    last = [
        row | dict.fromkeys(FIGURES) if row["status"] != Status.completed.words else row
        for row in sweep.rows
    ]
    group = Group({}, last)
    return {
        key: {name: group.quantile(key, share) for name, share in QUANTILES.items()}
        for key in FIGURES
    }


def lost(sweep: Sweep) -> list[Row]:
    """Runs that ended before their time."""
    return [row for row in sweep.rows if row["status"] != Status.completed.words]


def cost(sweep: Sweep) -> float:
    """What a step of a run's identifier takes of a thread's time, the median of all runs [µs]."""
    return float(np.median([row["identifier_us_per_step"] for row in sweep.rows]))


def document(sweep: Sweep) -> dict[str, Any]:
    """What `nsaid montecarlo --json` prints."""
    found = {
        key: {name: value if np.isfinite(value) else None for name, value in each.items()}
        for key, each in quantiles(sweep).items()
    }
    columns = ("run", "seed", "status", "status_time")
    return {
        "folder": str(sweep.folder),
        "runs": sweep.manifest["runs"],
        "quantiles": found,
        "lost": [{key: row[key] for key in columns} for row in lost(sweep)],
        "identifier_us_per_step": cost(sweep),
    }


def print_summary(sweep: Sweep) -> None:
    """Prints the figures' quantiles, the lost runs, and where the files are."""
    console, gone = Console(highlight=False), lost(sweep)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for head in ("", *QUANTILES):
        table.add_column(head, justify="right" if head else "left", no_wrap=True)
    for key, each in quantiles(sweep).items():
        table.add_row(FIGURES[key], *(digits(value) for value in each.values()))
    shared = sweep.manifest["montecarlo"]["shared"]
    kind = "priors on one motion" if shared else "plants, each with its motion"
    console.print(f"[bold]{sweep.folder.name}[/bold]: {len(sweep.rows)} {kind}, {len(gone)} lost")
    console.print(table)
    for row in gone[:_LINES]:
        again = "" if shared else f"\n    {sweep.command(row)}"
        console.print(
            f"  [red]run {row['run']}[/red] (seed {row['seed']}): {row['status']} at "
            f"{row['status_time']:.3g} s{again}",
            soft_wrap=True,
        )
    if len(gone) > _LINES:
        console.print(f"  … and {len(gone) - _LINES} more")
    console.print(
        f"  identifier {cost(sweep):.2g} µs of a thread per run and step\n"
        f"  table      {sweep.folder / TABLE}\n"
        f"  plots      nsaid report {sweep.folder}",
        soft_wrap=True,
    )
