"""`nsaid compare`: identification methods on the same logs, evaluated by the same figures.

The scenario's plant is driven once for every seed and every level of noise. All methods get the
first part of the log, the structure, the same prior and the sensors' stated levels. Their estimates
are then compared with the plant's truth.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .. import evaluation
from ..baselines import BATCH, Estimate, Method, Problem, follow
from ..baselines.sysid import BUDGET, sysid
from ..errors import InvalidInput, NoEstimate, NsaidError
from ..evaluation.bound import bound_figures, cramer_rao
from ..evaluation.result import Result
from ..experiment.choices import LAWS as OURS
from ..experiment.choices import METHODS, check_choice
from ..experiment.scenario import Scenario
from ..experiment.setup import Setup, is_sound
from ..laws import ConventionalAID, IdentifierConfig, NullspaceAID
from ..log import EXACT, Log
from ..numerics.threads import single_threaded
from ..pages.page import Page
from ..resources import write_json
from . import compare_report
from .compare_report import BOUND, DEFAULT, PRIOR, Cell, sensors
from .study import Study, carried_out, write_csv

FILES = ("compare.json", "compare.csv")


MOST_LOGGED = 1e7
"""Largest number of time steps of a log, which every method keeps in memory."""


@dataclass(frozen=True)
class Plan(Study):
    """The methods of a comparison and their logs.

    Raises:
        UnknownName: a method is unknown.
        InvalidInput: a list is empty or has duplicates, or a value is out of range.
    """

    methods: tuple[str, ...] = DEFAULT  # names; see `METHODS`
    seeds: tuple[int, ...] = (0, 1, 2)  # seeds of truth, prior, excitation and sensors
    durations: tuple[float, ...] = (10.0, 20.0)  # lengths of log for the methods [s]
    noises: tuple[float, ...] = (0.0,)  # multiples of the scenario's noise; 0 for exact sensors
    budget: float = BUDGET  # CPU time of the search by `sysid` [s]
    bound: bool = False  # whether the Cramér–Rao bound of every noisy log is computed

    def __post_init__(self) -> None:
        for name in self.methods:
            check_choice("method", name, METHODS)
        for name in ("methods", "seeds", "durations", "noises"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise InvalidInput(name, "one or more, no duplicates", values, "Give each once.")
        if not isinstance(self.scenario.identifier, NullspaceAID):
            kind = type(self.scenario.identifier).__name__
            remedy = "Compare a scenario with that identifier; the methods include the others."
            raise InvalidInput("scenario", "the identifier NullspaceAID", kind, remedy)
        if self.bound and not any(self.noises):
            raise InvalidInput(
                "bound", "noisy sensors", "exact ones, whose bound is 0", "Add --sensors noisy."
            )
        if min(self.seeds) < 0:
            raise InvalidInput("seeds", "whole numbers ≥ 0", self.seeds, "0:3 is 0,1,2.")
        if not all(np.isfinite(s) and s >= 0 for s in self.noises):
            raise InvalidInput("noises", "multiples ≥ 0", self.noises, "1 is the scenario's.")
        if not self.budget > 0:
            raise InvalidInput("budget", "seconds > 0", self.budget, f"The default is {BUDGET:g}.")
        shortest = 3 * self.scenario.dt
        if not all(np.isfinite(d) and d >= shortest for d in self.durations):
            remedy = "Give longer durations."
            raise InvalidInput("durations", f"times ≥ {shortest:g} s", self.durations, remedy)
        if max(self.durations) > MOST_LOGGED * self.scenario.dt:
            expected = f"at most {MOST_LOGGED:.0e} steps of {self.scenario.dt:g} s"
            remedy = "Logs are kept in memory: give shorter durations."
            raise InvalidInput("durations", expected, self.durations, remedy)

    def names(self, noise: float) -> tuple[str, ...]:
        """The prior, the bound if there is one at this multiple of the noise, and the methods."""
        return (PRIOR, *((BOUND,) if self.bound and noise else ()), *self.methods)

    @property
    def manifest(self) -> dict[str, Any]:
        """Everything that the results depend on, as JSON values; the scenario as JSON text."""
        own = {f.name: getattr(self, f.name) for f in fields(self)[len(fields(Study)) :]}
        return self.manifest_of(**own) | {"scenario": self.scenario.to_json()}


def compare(plan: Plan, report: Callable[[str], object] = lambda _: None) -> Iterator[Cell]:
    """Yields the cells of a comparison as they become available; `report` receives each stage."""
    warm = False
    for seed in plan.seeds:
        for noise in plan.noises:
            report(f"seed {seed}, {sensors(noise)}: driving the plant")
            names = plan.names(noise)
            try:
                world = World(plan, seed, noise)
            except NsaidError as error:
                for duration in plan.durations:
                    yield from (Cell(m, seed, noise, duration, failure=str(error)) for m in names)
                continue
            if not warm:
                world.warm_up()
                warm = True
            for duration in plan.durations:
                for name in names:
                    report(f"seed {seed}, {sensors(noise)}, {duration:g} s: {name}")
                    yield world.cell(name, duration)


class World:
    """The log of one plant, the methods, and the truth for their evaluation.

    Raises:
        NsaidError: the plant cannot be built, or diverges.
    """

    def __init__(self, plan: Plan, seed: int, noise: float):
        self._key = seed, noise
        scenario = _scenario(plan, seed, noise)
        self._setup = setup = Setup.of(scenario)
        plant, identifiers = setup.plant, setup.identifiers()
        with plant.running():
            log = setup.simulate()
        if not is_sound(plant, log):
            raise NoEstimate(f"the plant diverged ({plant.diverged})", "Use a smaller dt.")
        levels = scenario.noise.levels if noise else EXACT
        self._problem = Problem(setup.system, log, setup.prior, levels)
        self._judges: dict[int, evaluation.Judge] = {}
        self._methods: dict[str, Method] = {
            **{name: partial(follow, i) for name, i in identifiers.items() if name},
            **{name: method for name, method in BATCH.items() if name in plan.methods},
            PRIOR: lambda problem: Estimate(problem.prior),
            "sysid": lambda problem: Estimate(*sysid(problem, plan.budget)),
        }

    def warm_up(self) -> None:
        """Runs every fast method once, so that no wall time includes compilation."""
        short = self._problem._replace(log=self._problem.log.first(64))
        for name, method in self._methods.items():
            if name != "sysid":
                _attempt(method, short)

    def cell(self, name: str, duration: float) -> Cell:
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
            return Cell(name, *self._key, duration, wall_s=wall, failure=failure)
        figures = self._judge(duration)(estimate.theta)
        cell = Cell(name, *self._key, duration, wall_s=wall, note=estimate.note)
        return replace(cell, **figures)  # pyright: ignore[reportArgumentType]

    def _bound(self, duration: float, log: Log) -> Cell:
        """The figures of estimates that attain the Cramér–Rao bound."""
        truth = evaluation.Truth(self._setup, duration)
        try:
            covariance = cramer_rao(truth, log, self._setup.scenario.noise.levels)
        except NsaidError as error:
            return Cell(BOUND, *self._key, duration, failure=str(error))
        figures = bound_figures(truth, self._judge(duration), covariance)
        return replace(Cell(BOUND, *self._key, duration), **figures)  # pyright: ignore[reportArgumentType]

    def _judge(self, duration: float) -> evaluation.Judge:
        """The judge of estimates at a time [s], as faults change the truth."""
        truth = evaluation.Truth(self._setup, duration)
        epoch = int(truth.epoch(duration))
        if epoch not in self._judges:
            self._judges[epoch] = evaluation.Judge(truth)
        return self._judges[epoch]


def _scenario(plan: Plan, seed: int, noise: float) -> Scenario:
    """The scenario of one log, with a prior in the cone, as some laws require."""
    base = plan.scenario
    identifier = base.identifier
    assert isinstance(identifier, NullspaceAID)  # checked by the plan
    rivals: dict[str, IdentifierConfig] = {
        law: replace(identifier, law=law) for law in OURS if law in plan.methods
    }
    if "conventional" in plan.methods:
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
        duration=max(plan.durations),
        seed=seed,
    )


def _attempt(method: Method, problem: Problem) -> tuple[Estimate | None, str]:
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


def write(folder: Path, plan: Plan, cells: Sequence[Cell]) -> None:
    """Writes compare.json, with all cells and the plan, and compare.csv; may raise `NotWritten`."""
    document = plan.manifest | {"cells": [asdict(cell) for cell in cells]}
    write_json(folder / FILES[0], document)
    names = [f.name for f in fields(Cell)]
    write_csv(folder / FILES[1], names, (asdict(cell) for cell in cells))


@single_threaded
def run(plan: Plan, folder: Path, quiet: bool = False) -> tuple[Result, list[Cell]]:
    """Runs a comparison, writes its files and plots, and prints its page; see `carried_out`."""
    columns = sum(len(plan.names(noise)) for noise in plan.noises)
    total = columns * len(plan.seeds) * len(plan.durations)

    def draw(cells: list[Cell]) -> tuple[Page, list[Path]]:
        drawn = compare_report.lines(cells)
        plots = compare_report.write_pictures(folder, drawn)
        page = compare_report.page_of(folder, cells, drawn, plan.manifest)
        return page, [*(folder / name for name in FILES), *plots]

    made, write_all = partial(compare, plan), partial(write, folder, plan)
    return carried_out(folder, FILES[:1], total, made, write_all, draw, quiet)
