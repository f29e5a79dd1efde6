"""What the user tells of a robot, against its logs and its model file.

A known value or a weighed load is a hypothesis as any other, and fixes the scale of everything. The
fit without it predicts it: from the log, the other told values, and the masses of the model file. A
told value outside the interval of that prediction is contradicted, and takes no part in the result.
A load is also tried on the other bodies and in the other logs, as its place is told, too: where it
fits the logs far better, that is named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...base import Finding
from ...core import number
from ...lab import INTERVAL
from ...robots import RobotModel
from ..logs.recordings import Recordings
from .dry_mass import of_parameters
from .fit import information, minimise, tempered
from .identifiability import index_of, informed
from .links import CarriedLoads, ball_at
from .loads import Load
from .problem import FitProblem, Mask
from .result import BatchFit, Options
from .vehicle_loads import carried_by
from .verdict import CONTRADICTED

_TOLD = 0.1  # relative standard deviation of a told value, such as a data sheet's motor constant
_FILE_OFF = 5.0  # factor by which masses of a file may be wrong, as of a solid for a hollow body
_BETTER = 10.0  # fall of the cost, the negative log-likelihood, that is no chance
_MOVED = 0.1  # relative change of a gain by another place of a load that matters
_UNITS = {1000.0: "thousand", 0.001: "thousandth"}  # ratios of units of one quantity
_SAME_UNIT = 1.5  # factor within which a ratio is that of units


class _Told(NamedTuple):
    """A value that the user told."""

    index: int  # of its parameter
    value: float  # [SI]
    known: Mapping[str, float]  # what is held in the fit because of it, by name or label
    load: Load | None = None  # the load whose mass it is

    def words(self, problem: FitProblem) -> str:
        """What was told."""
        label = problem.space.labels[self.index]
        unit = problem.space.units[self.index]
        return f"{label} = {number(self.value, significant=3)} {unit}"


class _Predicted(NamedTuple):
    """A parameter as a fit predicts it without its told value."""

    value: float
    low: float  # the interval of told values that contradict neither log nor file
    high: float

    def holds(self, told: float) -> bool:
        """Whether a told value is possible."""
        return self.low <= told <= self.high


def without_contradicted(
    robot: RobotModel, recordings: Recordings, fitted: BatchFit, options: Options
) -> Options | None:
    """The options without a told value that logs or model file contradict; None if none is."""
    problem = fitted.problem
    told = []
    for name, value in of_parameters(robot, options.known).items():
        told.append(_Told(index_of(problem, name), value, {name: value}))
    for each in carried_by(robot, options.loads):
        better = None
        if robot.jointed:
            better = _elsewhere(robot, recordings, fitted, each, options)
        if better is not None:
            return better
        if each.known:
            place = problem.space[each.block.name].start
            told.append(_Told(place, float(each.prior[0]), each.known, each.load))
    for each, by, words in _outside(robot, fitted, told):
        loads = tuple(
            x._replace(weighed=False) if x._replace(source="") == each.load else x
            for x in options.loads
        )
        alone = len(told) == 1 and 1 / _FILE_OFF < each.value / by.value < _FILE_OFF
        apart = abs(float(np.log(each.value / by.value))) if alone else 0.0  # or the file is wrong
        return replace(
            options,
            known={k: v for k, v in options.known.items() if k not in each.known},
            loads=loads,
            contradicted=(*options.contradicted, _finding(problem, each, by, words)),
            apart=max(options.apart, apart / INTERVAL),
        )
    return None


# -- told values -----------------------------------------------------------------------------------


def _outside(
    robot: RobotModel, fitted: BatchFit, told: Sequence[_Told]
) -> Iterator[tuple[_Told, _Predicted, str]]:
    """Told values outside the interval of their prediction, that, and what predicts it.

    Of two values that contradict each other, the one that contradicts the file comes first. Values
    that agree overrule the file, unless its masses would be off by more than any file's.
    """

    def predicted(each: _Told, others: Sequence[_Told]) -> _Predicted:
        known = {name: value for other in others for name, value in other.known.items()}
        return _prediction(robot, fitted, each.index, known)

    against_file = [(each, predicted(each, ()), _FILE) for each in told]
    against_file = [found for found in against_file if not found[1].holds(found[0].value)]
    if len(told) == 1:
        yield from against_file
        return
    apart = []
    for each in told:
        by = predicted(each, [other for other in told if other is not each])
        if not by.holds(each.value):
            apart.append((each, by, "the other known values"))
    for each, by, words in against_file:
        far = not by.low / _FILE_OFF <= each.value <= by.high * _FILE_OFF
        if far or any(each is other for other, *_ in apart):
            yield each, by, words
    yield from apart


def _prediction(
    robot: RobotModel, fitted: BatchFit, index: int, known: Mapping[str, float]
) -> _Predicted:
    """A parameter by the fit with known values of others alone."""
    problem = informed(fitted.made.problem, known, robot.weightless)
    parts = tempered(problem, fitted.share)
    theta = minimise(problem, parts).theta
    free = np.flatnonzero(~problem.known)
    hessian = sum(information(problem, parts, theta))
    covariance = problem.space.inverse(np.asarray(hessian), free)
    value = float(theta[index])
    sd = float(np.hypot(np.sqrt(covariance[index, index]), _TOLD * abs(value)))
    for rival in fitted.made.rivals:  # that explain the log as well
        other = informed(rival, known, robot.weightless)
        if other.space.names == problem.space.names:
            apart = minimise(other, tempered(other, fitted.share)).theta[index] - value
            sd = float(np.hypot(sd, apart))
    if value > 0 and problem.space.geometries[index] != "free":
        factor = float(np.exp(min(INTERVAL * sd / value, 50.0)))
        return _Predicted(value, value / factor, value * factor)
    return _Predicted(value, value - INTERVAL * sd, value + INTERVAL * sd)


_FILE = "the masses of the model file"


def _finding(problem: FitProblem, told: _Told, by: _Predicted, words: str) -> Finding:
    """Reports a contradicted value, first of all findings."""
    ends = " to ".join(number(x, significant=2) for x in (by.low, by.high))
    text = (
        f"the given {told.words(problem)} contradicts the log and {words}: without it, the fit "
        f"gives {number(by.value, significant=3)} ({ends})"
    )
    ratio = told.value / by.value
    if ratio > 0:
        text += f"; the given value is {number(ratio, significant=2)} times that"
    text += ", and was not used"
    for factor, name in _UNITS.items():
        if 1 / _SAME_UNIT < ratio / factor < _SAME_UNIT:
            text += f". It seems to be a {name} times the value in that unit"
    remedy = "Check its unit and its gear ratio. If it is right, correct the masses of the model "
    remedy += "file, or give a second known value."
    if told.load is not None:
        remedy = "Weigh it again, and check which log and which link carried it."
        remedy += " If all is right, correct the masses of the model file."
    data = {"told": told.value, "fit": by.value, "low": by.low, "high": by.high}
    return Finding("warning", CONTRADICTED, problem.space.labels[told.index], text, remedy, data)


# -- loads elsewhere -------------------------------------------------------------------------------


def _elsewhere(
    robot: RobotModel,
    recordings: Recordings,
    fitted: BatchFit,
    carried: CarriedLoads,
    options: Options,
) -> Options | None:
    """The options with a load where it fits the logs far better; None if it fits where it is told.

    All bodies and the other logs are tried. Where it fits as well, but changes no gain, no matter.
    """
    problem = fitted.problem
    at = problem.space.actuators
    files = list(dict.fromkeys(s.source for s in recordings.segments))
    told = carried.sources
    others = frozenset(files) - told
    sets = dict.fromkeys([told, others, *map(lambda file: frozenset([file]), files)])
    if not told or not others:
        return None
    bodies = range(1, robot.model.njoints)
    own = carried.place.start // 10 + 1
    trials = [(body, told) for body in bodies] + [(own, s) for s in sets if s != told]
    trials += [(body, others) for body in bodies if body != own]
    found = []
    for body, sources in trials:
        mask = np.array([s.source in sources for s in recordings.segments])[problem.segment]
        moved = _moved(problem, robot, carried, body, mask)
        start = fitted.fit.theta.copy()
        place = problem.space[carried.block.name]
        start[place] = moved.prior[place]
        fit = minimise(moved, tempered(moved, fitted.share), start)
        found.append((fit.cost, body, sources, fit.theta))
    cost, body, sources, theta = min(found, key=lambda trial: trial[0])
    gained = fitted.fit.cost - cost
    gains = np.abs(np.log(theta[at] / fitted.fit.theta[at]))
    if gained < _BETTER or (gains < _MOVED).all():
        return None
    names = _names(robot)
    alike = [names[b - 1] for c, b, s, _ in found if c < cost + _BETTER and s == sources]
    where = " or ".join(dict.fromkeys([names[body - 1], *alike]))
    logs = ", ".join(file for file in files if file in sources)
    factor = float(np.exp(np.median(np.log(theta[at] / fitted.fit.theta[at]))))
    mass = float(carried.prior[0])
    text = (
        f"the load of {mass:g} kg, given at {names[own - 1]} in {', '.join(sorted(told))}, "
        f"contradicts the logs: they fit far better with it at {where} in {logs} (the "
        f"log-likelihood rises by {gained:.0f}, and gains become {number(factor, significant=2)} "
        "times those at the given place); its mass was not used"
    )
    remedy = "Check where it was and which log carried it; then give, if it is so, "
    remedy += " ".join(f"`--load {file}:{mass:g}kg@{names[body - 1]}`" for file in logs.split(", "))
    data = {"link": names[body - 1], "logs": sorted(sources), "gained": gained, "factor": factor}
    finding = Finding("warning", CONTRADICTED, "load", text, remedy + ".", data)
    kept = [x for x in options.loads if x._replace(source="") != carried.load]
    moved = [Load(file, mass, names[body - 1], None, False) for file in sorted(sources)]
    return replace(options, loads=(*kept, *moved), contradicted=(*options.contradicted, finding))


def _names(robot: RobotModel) -> list[str]:
    """Names by which `carrier` finds the links behind all joints: of bodies, or else of joints."""
    model = robot.model
    pairs = zip(robot.system.body_names, list(model.names)[1:], strict=True)
    return [body if model.existFrame(body) else joint for body, joint in pairs]


def _moved(
    problem: FitProblem, robot: RobotModel, carried: CarriedLoads, body: int, rows: Mask
) -> FitProblem:
    """The problem with a load fixed to the body behind a joint, in rows (N,) alone."""
    place = problem.space[carried.block.name]
    link = slice(10 * body - 10, 10 * body)
    Y = problem.Y.copy()
    Y[:, :, place] = problem.Y[:, :, link] * rows[:, None, None]
    prior = problem.prior.copy()
    prior[place] = ball_at(robot.model, body, float(carried.prior[0]))
    known = problem.known.copy()
    known[place] = False
    known[place.start] = bool(carried.known)
    limb = problem.size.limb.copy()
    limb[place] = limb[link.start]
    size = problem.size._replace(limb=limb)
    return replace(problem, Y=Y, prior=prior, known=known, size=size)
