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
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from .. import evaluation
from ..dynamics.motions import Motion
from ..errors import BadRun, InvalidInput
from ..evaluation.figures import actuator_ratio_error
from ..experiment.library import digest_of
from ..experiment.loop import DRIFT, ended
from ..experiment.scenario import Scenario
from ..experiment.setup import Seeds, draw_for, laws_for, plant_for, trajectory
from ..identifiers import Identifier, State, Status
from ..identifiers.base import Estimates
from ..identifiers.memory.law import MemoryIdentifier
from ..identifiers.nullspace_aid import NullspaceIdentifier, side_by_side
from ..log import Log
from ..nullspace import Nullspace, structural
from ..parameters import Array
from ..plants import Plant, Sensors
from .sweep import opened, seed_of
from .sweep_results import MANIFEST, ROWS, TABLE, Group, Row, Sweep, read, told, write_table
from .sweep_worker import CONVERGED

FIGURES = {
    "theta_perp_ratio": "distance at end",
    "actuator_ratio_error": "actuators' shares",
    "conserved_drift": "conserved drift",
    "time_to_converge": "converged after [s]",
}
"""Columns that are told, and in which words."""
QUANTILES = {"median": 0.5, "90 %": 0.9, "worst": 1.0}

MARK = 0.5  # how often a run is looked at [s]
_PIECE = 500  # steps, about, that a group of identifiers makes before it looks up
_GROUP = 32  # identifiers that share a motion, at most: one batch
_PLANTS = 32  # plants whose logs are held at once
_LINES = 40  # of lost runs on the terminal

Seen = Callable[[float], object]
"""Called with how many runs, or parts of runs, are done since it was called last."""


@dataclass(frozen=True)
class Plan:
    """Which runs there are. Draw i is `sweep.seed_of(scenario.seed, i)`, however many there are.

    Attributes:
        script: the scenario's packed name, or its script's path.
        scenario: what is run; its seed is the master seed.
        runs: how many.
        shared: one plant and one motion, those of the scenario, and a prior for every draw; else
            draw i is what `nsaid run` makes of its seed, its own truth and motion included.
        arguments: flags of `nsaid run` that made the scenario.

    Raises:
        InvalidInput: there is nothing to run.
    """

    script: str
    scenario: Scenario
    runs: int
    shared: bool = True
    arguments: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _at_least_one("runs", self.runs, "256 give distributions.")

    @property
    def manifest(self) -> dict[str, Any]:
        """What the results depend on: as a sweep's that varies nothing."""
        return {
            "script": self.script,
            "script_sha256": digest_of(self.script),
            "scenario": json.loads(self.scenario.to_json()),
            "montecarlo": {"shared": self.shared},
            "vary": {},
            "master_seed": self.scenario.seed,
            "runs": self.runs,
            "versions": evaluation.versions(),
            "arguments": list(self.arguments),
        }


@dataclass(eq=False)
class Course:
    """What a plant did, and its truth, which is read after the fact only.

    Attributes:
        scenario: what was run.
        plant: that moved.
        log: what was measured, as far as it is sound.
        status: how it ended.
        time: when [s].
    """

    scenario: Scenario
    plant: Plant
    log: Log
    status: Status
    time: float

    def __post_init__(self) -> None:
        self.system = threading.Lock()  # some work in room of their own: one thread at a time

    @cached_property
    def truth(self) -> Array:
        """(p,) the true θ at its end."""
        return self.plant.truth_at(self.time)

    @cached_property
    def nullspace(self) -> Nullspace:
        """P_s(θ) of it."""
        rng = np.random.default_rng(Seeds.of(self.scenario.seed).structure)
        return structural(self.plant.system, self.truth, rng)

    def ratio(self, theta_hat: Array) -> Array:
        """(...,) ‖P̄_⊥ᵀ θ̂_s‖ / ‖θ̂_s‖ of estimates (..., p)."""
        return self.nullspace.ratio(theta_hat / self.plant.system.space.scale)


# -- data ------------------------------------------------------------------------------------------


def simulate(scenarios: Sequence[Scenario], pool: Executor) -> list[Course]:
    """Makes every scenario's plant and drives it, as `experiment.run` does.

    Compiled drives in threads give the bits of one after the other, under feedback too.
    `mujoco.rollout` cannot: its initial states leave out userdata, where our callbacks have their
    numbers. `mujoco.batch` gives the same bits as fast, but knows no driver that looks.
    """
    plants = [plant_for(scenario) for scenario in scenarios]
    if len({id(plant.passive) for plant in plants}) == 1:  # MuJoCo has one callback for all
        with plants[0].running():
            return list(pool.map(_drive, scenarios, plants))
    courses = []
    for scenario, plant in zip(scenarios, plants, strict=True):
        with plant.running():
            courses.append(_drive(scenario, plant))
    return courses


def _drive(scenario: Scenario, plant: Plant) -> Course:
    """Drives a plant that is running."""
    seeds, prior = Seeds.of(scenario.seed), draw_for(scenario, plant)
    driver = scenario.excitation.build(plant.system, prior, np.random.default_rng(seeds.excitation))
    noise = scenario.noise if scenario.sensors == "noisy" else None
    sensors = Sensors(noise, np.random.default_rng(seeds.sensors))
    log = trajectory(plant, driver, scenario.steps, sensors)
    end = ended(plant, log.at(-1))
    status = end[0] if end else Status.completed
    time = float(log.t[-1])
    return Course(scenario, plant, log.first(len(log.t) - bool(end)), status, time)


# -- identification --------------------------------------------------------------------------------


class Following:
    """An identifier on its way along a log.

    Attributes:
        law: the identifier.
        state: where it is.
        ended: when it could not go on [s]; None as long as it can.
        drift: of the conserved quantity, relative, the largest at any mark.
        marks: times [s] and estimates (p,), every `MARK` seconds.
    """

    def __init__(self, law: Identifier, log: Log):
        self.law, self.state = law, law.init(log.at(0))
        self.ended: float | None = None
        self.drift = 0.0
        self.marks = [(self.state.t, self.state.theta_hat)]
        self._conserved = float(law.conserved(self.state.theta_hat))

    def look(self, log: Log, state: State, made: Estimates, marks: np.ndarray) -> None:
        """Takes what following a stretch has led to; in rows `marks`, as `experiment.run` does."""
        if state.status is not Status.completed:
            self.ended = float(log.t[len(made.pivot)])
        marks = marks[marks < len(made.pivot)]
        now = self.law.conserved(made.theta_hat[marks]) + made.spent[marks]
        drift = np.abs(now / self._conserved - 1)
        wrong = ~(drift <= DRIFT) & self.law.conserves
        if wrong.any():
            first = int(np.argmax(wrong))
            k = int(marks[first])
            self.ended, marks, drift = float(log.t[k]), marks[: first + 1], drift[: first + 1]
            state = state._replace(
                t=self.ended, v_hat=made.v_hat[k].copy(), theta_hat=made.theta_hat[k].copy(),
                status=Status.adaptation_too_fast,
            )  # fmt: skip
        self.state = state
        self.drift = max(self.drift, float(drift.max(initial=0.0)))
        self.marks += [(float(log.t[k]), made.theta_hat[k].copy()) for k in marks]


def identify(
    course: Course, draws: Sequence[tuple[int, Scenario]], seen: Seen = float
) -> list[Row]:
    """Follows a course's log from the prior of every draw, and judges where that has led.

    Args:
        course: what the plant did.
        draws: number and scenario of each; the scenario's seed draws the prior.
        seen: is told of progress.
    """
    begin, steps = time.perf_counter(), max(1, len(course.log.t) - 1)
    runs = follow(course, [scenario for _, scenario in draws], seen)
    cost = 1e6 * (time.perf_counter() - begin) / (len(runs) * steps)
    return [_row(*draw, course, run, cost) for draw, run in zip(draws, runs, strict=True)]


def follow(course: Course, scenarios: Sequence[Scenario], seen: Seen = float) -> list[Following]:
    """The identifiers of scenarios on a course's log, side by side, to its end or their own."""
    log = course.log
    with course.system:
        runs = [Following(_law(scenario, course.plant), log) for scenario in scenarios]
    every = max(1, round(MARK / course.scenario.dt))
    piece, last = every * max(1, round(_PIECE / every)), len(log.t) - 1
    for at in range(0, last, piece):
        part = log.part(at, at + piece + 1)
        rows = np.arange(1, len(part.t))
        marks = rows[((at + rows) % every == 0) | (at + rows == last)]
        going = [run for run in runs if run.ended is None]
        if not going:
            break
        with course.system:
            motion = _shared(going[0].law, part)
        with course.system if motion is None else nullcontext():
            for run, made in zip(going, _made(going, part, motion), strict=True):
                run.look(part, *made, marks)
        seen(len(runs) * (len(part.t) - 1) / last)
    return runs


def _law(scenario: Scenario, plant: Plant) -> Identifier:
    """A scenario's identifier, about a plant's truth."""
    prior = draw_for(scenario, plant)
    return laws_for(replace(scenario, rivals={}), plant.system, prior)[""]


def _made(
    runs: Sequence[Following], log: Log, motion: Motion | None
) -> Iterator[tuple[State, Estimates]]:
    """What every run's identifier does on a stretch, from where it is."""
    if motion is None:
        yield from (run.law.follow(run.state, log) for run in runs)
    else:
        laws = [run.law for run in runs if isinstance(run.law, NullspaceIdentifier)]
        yield from side_by_side(laws, [run.state for run in runs], log, motion)


def _shared(law: Identifier, log: Log) -> Motion | None:
    """What all identifiers of one kind can share on a log; None for a law that goes its own way."""
    if isinstance(law, NullspaceIdentifier) and not isinstance(law, MemoryIdentifier):
        return law.motion(log)
    return None


def _row(draw: int, scenario: Scenario, course: Course, run: Following, cost: float) -> Row:
    """What has become of a run."""
    status, t = course.status, course.time
    if run.ended is not None:
        status, t = run.state.status, run.ended
    theta = run.state.theta_hat
    return _what(draw, scenario) | {
        "failure": None,
        "status": status.words,
        "status_time": t,
        "theta_perp_ratio_initial": float(course.ratio(run.marks[0][1])),
        "theta_perp_ratio": float(course.ratio(theta)),
        "actuator_ratio_error": actuator_ratio_error(course.plant.system, theta, course.truth),
        "conserved_drift": run.drift if run.law.conserves else None,
        "time_to_converge": _converged(course, run) if status is Status.completed else None,
        "identifier_us_per_step": cost,
    }


def _converged(course: Course, run: Following) -> float | None:
    """From which mark on the distance to the true set stays small [s]; None where it does not."""
    t, theta = (np.array(part) for part in zip(*run.marks, strict=True))
    far = np.flatnonzero(course.ratio(theta) > CONVERGED)
    if not len(far):
        return float(t[0])
    return float(t[far[-1] + 1]) if far[-1] + 1 < len(t) else None


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
        jobs: how many at once; as many as processors where nobody says.
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
            _ = course.nullspace  # before threads ask for it
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
        TextColumn("{task.description}"), BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} runs"), TimeRemainingColumn(),
        console=Console(stderr=True), transient=True, disable=quiet,
    )  # fmt: skip
    try:
        with bar, (folder / ROWS).open("a", encoding="utf-8") as stream:
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
    last = [row | dict.fromkeys(FIGURES) if row["status"] != Status.completed.words else row
            for row in sweep.rows]  # fmt: skip
    group = Group({}, last)
    return {key: {name: group.quantile(key, share) for name, share in QUANTILES.items()}
            for key in FIGURES}  # fmt: skip


def lost(sweep: Sweep) -> list[Row]:
    """Runs that ended before their time."""
    return [row for row in sweep.rows if row["status"] != Status.completed.words]


def cost(sweep: Sweep) -> float:
    """What a step of a run's identifier takes of a thread's time, the median of all runs [µs]."""
    return float(np.median([row["identifier_us_per_step"] for row in sweep.rows]))


def document(sweep: Sweep) -> dict[str, Any]:
    """What `nsaid montecarlo --json` prints."""
    found = {key: {name: value if np.isfinite(value) else None for name, value in each.items()}
             for key, each in quantiles(sweep).items()}  # fmt: skip
    columns = ("run", "seed", "status", "status_time")
    return {
        "folder": str(sweep.folder),
        "runs": sweep.manifest["runs"],
        "quantiles": found,
        "lost": [{key: row[key] for key in columns} for row in lost(sweep)],
        "identifier_us_per_step": cost(sweep),
    }


def tell(sweep: Sweep) -> None:
    """Prints the figures' quantiles, the lost runs, and where the files are."""
    console, gone = Console(highlight=False), lost(sweep)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for head in ("", *QUANTILES):
        table.add_column(head, justify="right" if head else "left", no_wrap=True)
    for key, each in quantiles(sweep).items():
        table.add_row(FIGURES[key], *(told(value) for value in each.values()))
    shared = sweep.manifest["montecarlo"]["shared"]
    kind = "priors on one motion" if shared else "plants, each with its motion"
    console.print(f"[bold]{sweep.folder.name}[/bold]: {len(sweep.rows)} {kind}, {len(gone)} lost")
    console.print(table)
    for row in gone[:_LINES]:
        again = "" if shared else f"\n    {sweep.command(row)}"
        console.print(f"  [red]run {row['run']}[/red] (seed {row['seed']}): {row['status']} at "
                      f"{row['status_time']:.3g} s{again}", soft_wrap=True)  # fmt: skip
    if len(gone) > _LINES:
        console.print(f"  … and {len(gone) - _LINES} more")
    console.print(f"  identifier {cost(sweep):.2g} µs of a thread per run and step\n"
                  f"  table      {sweep.folder / TABLE}\n"
                  f"  plots      nsaid report {sweep.folder}", soft_wrap=True)  # fmt: skip
