"""`nsaid compare`: identification methods on the same logs, evaluated by the same figures.

The scenario's plant is driven once for every seed and every level of noise. All methods get the
first part of the log, the structure, the same prior and the sensors' stated levels. Their estimates
are then compared with the plant's truth.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...base import CHOICES, InvalidInput, NoEstimate, NsaidError, OutputFile, single_threaded
from ...core import ConventionalAID, IdentifierConfig, Log, NullspaceAID, SensorLevels
from ...lab import (
    Judge,
    Scenario,
    Setup,
    Toolbox,
    Truth,
)
from ...report import Page, Result
from ..baselines import BATCH, Method, MethodEstimate, Problem, follow
from . import compare_report
from .compare_report import BOUND, DEFAULT, PRIOR, row_of, runs_of, sensors
from .study import Row, Study, carried_out, write_csv

COMPARE_FILES = ("compare.json", "compare.csv")


MOST_LOGGED = 1e7
"""Largest number of time steps of a log, which every method keeps in memory."""


def comparison_plan(
    script: str,
    scenario: Scenario,
    methods: tuple[str, ...] = DEFAULT,
    seeds: tuple[int, ...] = (0, 1, 2),
    durations: tuple[float, ...] = (10.0, 20.0),
    noises: tuple[float, ...] = (0.0,),
    budget: float | None = None,
    bound: bool = False,
    arguments: tuple[str, ...] = (),
) -> Study:
    """The methods of a comparison and their logs.

    Args:
        script: name of the packaged scenario, or path of its script.
        scenario: what is driven; the methods replace its identifier.
        methods: names; see `CHOICES`.
        seeds: seeds of truth, prior, excitation and sensors.
        durations: lengths of log for the methods [s].
        noises: multiples of the scenario's noise; 0 for exact sensors.
        budget: CPU time of the search by `sysid` [s]; None for `Toolbox.BUDGET`.
        bound: whether the Cramér–Rao bound of every noisy log is computed.
        arguments: flags of `nsaid run` that turn the script's scenario into this one.

    Raises:
        UnknownName: a method is unknown.
        InvalidInput: a list is empty or has duplicates, or a value is out of range.
    """
    for name in methods:
        CHOICES.check("method", name)
    lists = {"methods": methods, "seeds": seeds, "durations": durations, "noises": noises}
    for name, values in lists.items():
        if not values or len(set(values)) < len(values):
            raise InvalidInput(name, "one or more, no duplicates", values, "Give each once.")
    if not isinstance(scenario.identifier, NullspaceAID):
        kind = type(scenario.identifier).__name__
        remedy = "Compare a scenario with that identifier; the methods include the others."
        raise InvalidInput("scenario", "the identifier NullspaceAID", kind, remedy)
    budget = Toolbox.BUDGET if budget is None else budget
    _check_logs(scenario.dt, seeds, durations, noises, budget, bound)
    compared = (PRIOR, *((BOUND,) if bound else ()), *methods)
    vary = {"noise": noises, "duration": durations, "method": compared}
    settings = {"scenario": scenario.to_json(), **lists, "budget": budget, "bound": bound}
    return Study(script, scenario, vary, seeds, settings, arguments)


def _check_logs(
    dt: float,
    seeds: Sequence[int],
    durations: Sequence[float],
    noises: Sequence[float],
    budget: float,
    bound: bool,
) -> None:
    """Raises `InvalidInput` where a number of a comparison is out of range; see `plan`."""
    if bound and not any(noises):
        raise InvalidInput(
            "bound", "noisy sensors", "exact ones, whose bound is 0", "Add --sensors noisy."
        )
    if min(seeds) < 0:
        raise InvalidInput("seeds", "whole numbers ≥ 0", seeds, "0:3 is 0,1,2.")
    if not all(np.isfinite(s) and s >= 0 for s in noises):
        raise InvalidInput("noises", "multiples ≥ 0", noises, "1 is the scenario's.")
    if not budget > 0:
        raise InvalidInput("budget", "seconds > 0", budget, f"The default is {Toolbox.BUDGET:g}.")
    shortest = 3 * dt
    if not all(np.isfinite(d) and d >= shortest for d in durations):
        remedy = "Give longer durations."
        raise InvalidInput("durations", f"times ≥ {shortest:g} s", durations, remedy)
    if max(durations) > MOST_LOGGED * dt:
        expected = f"at most {MOST_LOGGED:.0e} steps of {dt:g} s"
        remedy = "Logs are kept in memory: give shorter durations."
        raise InvalidInput("durations", expected, durations, remedy)


def compared_at(study: Study, noise: float) -> list[str]:
    """The prior, the bound if there is one at this multiple of the noise, and the methods."""
    return [name for name in study.vary["method"] if noise or name != BOUND]


def compare(study: Study, report: Callable[[str], object] = lambda _: None) -> Iterator[Row]:
    """Yields the rows of a comparison as they become available; `report` receives each stage."""
    warm = False
    for seed in study.seeds:
        for noise in study.vary["noise"]:
            report(f"seed {seed}, {sensors(noise)}: driving the plant")
            names = compared_at(study, noise)
            try:
                world = ComparedPlant(study, seed, noise)
            except NsaidError as error:
                for duration in study.vary["duration"]:
                    for name in names:
                        yield row_of(name, seed, noise, duration, failure=str(error))
                continue
            if not warm:
                world.warm_up()
                warm = True
            for duration in study.vary["duration"]:
                for name in names:
                    report(f"seed {seed}, {sensors(noise)}, {duration:g} s: {name}")
                    yield world.row(name, duration)


class ComparedPlant:
    """The log of one plant, the methods, and the truth for their evaluation.

    Raises:
        NsaidError: the plant cannot be built, or diverges.
    """

    def __init__(self, study: Study, seed: int, noise: float):
        self._key = seed, noise
        scenario = _scenario(study, seed, noise)
        self._setup = setup = Setup.of(scenario)
        plant = setup.plant
        identifiers = setup.identifiers()
        with plant.running():
            log = setup.simulate()
        if not plant.is_sound(log):
            raise NoEstimate(f"the plant diverged ({plant.diverged})", "Use a smaller dt.")
        levels = scenario.noise.levels if noise else SensorLevels()
        self._problem = Problem(setup.system, log, setup.prior, levels)
        self._judges: dict[int, Judge] = {}
        self._methods: dict[str, Method] = {
            **{name: partial(follow, i) for name, i in identifiers.items() if name},
            **{name: method for name, method in BATCH.items() if name in study.vary["method"]},
            PRIOR: lambda problem: MethodEstimate(problem.prior),
            "sysid": partial(_by_toolbox, budget=study.settings["budget"]),
        }

    def warm_up(self) -> None:
        """Runs every fast method once, so that no wall time includes compilation."""
        short = self._problem._replace(log=self._problem.log.first(64))
        for name, method in self._methods.items():
            if name != "sysid":
                _attempt(method, short)

    def row(self, name: str, duration: float) -> Row:
        """Runs one method on the first `duration` [s] of the log and evaluates its estimate."""
        problem = self._problem._replace(log=self._problem.log.until(duration))
        begin = time.perf_counter()
        if name == BOUND:
            return self._bound(duration, problem.log)
        estimate, failure = _attempt(self._methods[name], problem)
        wall: float | None = time.perf_counter() - begin
        if name == PRIOR:
            wall = None
        if estimate is None:
            return row_of(name, *self._key, duration, wall_s=wall, failure=failure)
        figures = self._judge(duration)(estimate.theta)
        row = row_of(name, *self._key, duration, wall_s=wall, note=estimate.note)
        return row | figures

    def _bound(self, duration: float, log: Log) -> Row:
        """The figures of estimates that attain the Cramér–Rao bound."""
        try:
            figures = self._judge(duration).bound(log, self._setup.scenario.noise.levels)
        except NsaidError as error:
            return row_of(BOUND, *self._key, duration, failure=str(error))
        return row_of(BOUND, *self._key, duration) | figures

    def _judge(self, duration: float) -> Judge:
        """The judge of estimates at a time [s], as faults change the truth."""
        truth = Truth(self._setup, duration)
        epoch = int(truth.epoch(duration))
        if epoch not in self._judges:
            self._judges[epoch] = Judge(truth)
        return self._judges[epoch]


def _scenario(study: Study, seed: int, noise: float) -> Scenario:
    """The scenario of one log, with a prior in the cone, as some laws require."""
    base = study.scenario
    identifier = base.identifier
    assert isinstance(identifier, NullspaceAID)  # checked by `plan`
    rivals: dict[str, IdentifierConfig] = {
        law: replace(identifier, law=law)
        for law in CHOICES["law of a run"]
        if law in study.vary["method"]
    }
    if "conventional" in study.vary["method"]:
        known = base.rivals.get("conventional")
        rivals["conventional"] = known or ConventionalAID(K=identifier.K, gain=identifier.gain)
    level = replace(
        base.noise,
        position=noise * base.noise.position,
        velocity=noise * base.noise.velocity,
        encoder_step=noise * base.noise.encoder_step,
    )
    return replace(
        base,
        identifier=replace(identifier, law="cone", barrier=identifier.barrier or 1.0),
        rivals=rivals,
        sensors="noisy" if noise else "ideal",
        noise=level if noise else base.noise,
        duration=max(study.vary["duration"]),
        seed=seed,
    )


def _by_toolbox(problem: Problem, budget: float) -> MethodEstimate:
    """The estimate of `mujoco.sysid` within a budget of CPU time [s]."""
    system, log, prior, noise = problem
    return MethodEstimate(*Toolbox().fitted(system, [log], prior, noise, budget))


def _attempt(method: Method, problem: Problem) -> tuple[MethodEstimate | None, str]:
    """A method's estimate and "", or None and the reason of the failure."""
    try:
        with np.errstate(all="ignore"):  # estimates that are not finite are handled below
            estimate = method(problem)
    except NsaidError as error:
        return None, str(error)
    except np.linalg.LinAlgError as error:
        return None, f"linear algebra: {error}"
    if not np.isfinite(estimate.theta).all():
        return None, "the estimate is not finite"
    return estimate, ""


# -- output ------------------------------------------------------------------------------------


def write(folder: Path, study: Study, rows: Sequence[Row]) -> None:
    """Writes compare.json, with all rows and the plan, and compare.csv; may raise `NotWritten`."""
    OutputFile(folder / COMPARE_FILES[0]).write_json(study.manifest | {"cells": rows})
    write_csv(folder / COMPARE_FILES[1], list(row_of("", 0, 0.0, 0.0)), rows)


@single_threaded
def run_comparison(study: Study, folder: Path, quiet: bool = False) -> tuple[Result, list[Row]]:
    """Runs a comparison, writes its files, and prints its page; see `carried_out`."""
    columns = sum(len(compared_at(study, noise)) for noise in study.vary["noise"])
    total = columns * len(study.seeds) * len(study.vary["duration"])

    def draw(rows: list[Row]) -> tuple[Page, list[Path]]:
        page = compare_report.page_of(runs_of(folder, study.manifest, rows))
        return page, [folder / name for name in COMPARE_FILES]

    made = partial(compare, study)
    write_all = partial(write, folder, study)
    return carried_out(folder, COMPARE_FILES[:1], total, made, write_all, draw, quiet)
