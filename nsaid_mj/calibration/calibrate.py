"""Plant and actuators of a tree of joints from its logs: structure, fit, intervals, verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ..errors import InvalidInput, UnknownName
from ..parameters import Array
from .checks import fit_checks, gain_checks, structure_checks
from .data import Recordings, RobotModel
from .findings import Finding, UnusableLog
from .fit import Fit, Gramians, gramians, minimise
from .joints import BASIC, SPEEDS, JointRows
from .least_squares import least_squares
from .precision import inflation, precision, tempered
from .problem import Problem, folds, without
from .result import Curves, Identification, JointFit
from .selection import choose
from .smoothing import Filter, filter_for
from .statements import combinations_in_words, parameters_in_words, suggest, verdict

_FOLDS = 5
_STATED, _GUESSED, _NOMINAL = 0.15, 2.0, 0.3
# standard deviations of log k: of a command stated in N or N·m (tolerance of torque constants and
# losses of gears), of one in unknown units, of a gain from the model file
_WEAKER = 0.1  # least gain of a joint over the largest guess
_ONLINE = 0.5  # seconds between the steps of an estimate along the log

Told = Callable[[str], None]


def calibrate(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None = None,
    *,
    columns: frozenset[str] | None = None,
    coupled: tuple[tuple[int, int], ...] = (),
    delay: Array | None = None,
    known: Mapping[str, float] | None = None,
    cutoff: float | None = None,
    online: bool = False,
    findings: tuple[Finding, ...] = (),
    told: Told = lambda _: None,
) -> Identification:
    """Identifies the parameters of a robot from prepared recordings.

    Args:
        robot: a tree of joints.
        recordings: training logs.
        validation: a log that takes no part in the fit; None to hold out parts of the training.
        columns: friction columns of all joints, names of `joints.COLUMNS`; None to choose them.
        coupled: pairs of coupled joints.
        delay: (k,) delays of the commands [s]; None to search for them.
        known: values of parameters by name or label [SI].
        cutoff: of the rows' filter [Hz]; None for the motion's bandwidth.
        online: whether to record the estimate along the log.
        findings: what was noticed before.
        told: called with the name of every stage, for progress.

    Raises:
        UnusableLog: the log cannot be used; all findings are attached.
        UnknownName: a known parameter does not exist.
        InvalidInput: a known value is not physical.
    """
    begin = time.perf_counter()
    told("filtering")
    chosen = filter_for(recordings, cutoff)
    rows = JointRows(robot, recordings, chosen, np.ones(len(robot.joints)))
    gain, spread = expected_gains(robot, rows, recordings.command_units)
    rows.gain = gain
    told("choosing columns and delays")
    choice, notes = choose(rows, coupled, delay, columns)
    found = [*robot.findings, *recordings.findings, *findings, *notes]
    found += fit_checks(rows, choice)
    _refuse(found)
    told("fitting")
    problem = with_known(rows.problem(choice, gain, spread), known or {})
    fit, share = tempered_fit(problem)
    found += gain_checks(robot, fit.theta[problem.space.actuators], gain, recordings.command_units)
    _refuse(found)
    told("estimating intervals")
    exact = precision(problem, fit, share)
    if columns is None:
        simple = replace(choice, columns=(BASIC,) * len(robot.joints))
        other = with_known(rows.problem(simple, gain, spread), known or {})
        exact = exact._replace(structure=_structural(problem, fit, other, share))
    told("predicting held-out parts")
    held_out, plain = _held_out(problem, share)
    found += structure_checks(robot, held_out)
    at = problem.space.actuators
    checked = None
    if validation is not None:
        other_rows = JointRows(robot, validation, chosen_at(chosen, validation), gain)
        checked = other_rows.problem(choice, gain, spread)
    ls = least_squares(problem, fit.theta[at])
    nrmse = problem.nrmse(fit.theta)
    joints = tuple(
        JointFit(
            name,
            float(nrmse[j]),
            float(held_out[j]),
            float(plain[j]),
            None if checked is None else float(checked.nrmse(fit.theta)[j]),
            None if checked is None else float(checked.nrmse(ls)[j]),
            tuple(sorted(choice.columns[j])),
            SPEEDS[choice.speed[j]],
            float(choice.delay[j]),
        )
        for j, name in enumerate(robot.joints)
    )
    explains, sentence = verdict(joints)
    parameters = parameters_in_words(problem, fit, exact, spread)
    return Identification(
        robot,
        recordings,
        explains,
        sentence,
        joints,
        parameters,
        combinations_in_words(problem, fit, exact),
        _anchor(problem, known or {}, spread),
        suggest(problem, exact, parameters),
        tuple(sorted(found, key=lambda f: ("refusal", "warning", "note").index(f.level))),
        fit.theta,
        exact.deviation,
        exact.covariance,
        _curves(problem, fit.theta),
        None if checked is None else _curves(checked, fit.theta),
        _along(problem, share) if online else None,
        chosen.cutoff,
        time.perf_counter() - begin,
    )


def expected_gains(
    robot: RobotModel, rows: JointRows, units: tuple[str, ...]
) -> tuple[Array, Array]:
    """(k,) gains expected beforehand, and (k,) standard deviations of their logarithms.

    A command in N or N·m has the gain of the model file, usually 1. In any other unit the gain is
    guessed from the torque that the model's inertias need for the motion; as a wrist's friction may
    be far larger than that, no joint's guess is below a tenth of the largest.
    """
    inertial = np.concatenate(
        [robot.model.inertias[i].toDynamicParameters() for i in range(1, robot.model.njoints)]
    )
    torque = rows.links @ inertial
    u = rows.commands(np.zeros(len(robot.joints)))
    counts = np.maximum(rows.usable.sum(axis=0), 1)
    rms = [np.sqrt(np.sum((x * rows.usable) ** 2, axis=0) / counts) for x in (torque, u)]
    guess = rms[0] / np.maximum(rms[1], 1e-12)
    guess = np.maximum(guess, _WEAKER * guess.max())
    stated = np.array([unit in ("N·m", "N") for unit in units])
    nominal = ~stated & (robot.gain != 1)
    gain = np.where(stated | nominal, robot.gain, guess)
    return gain, np.where(stated, _STATED, np.where(nominal, _NOMINAL, _GUESSED))


def chosen_at(chosen: Filter, recordings: Recordings) -> Filter:
    """The same cut-off at another rate."""
    return filter_for(recordings, chosen.cutoff)


def with_known(problem: Problem, known: Mapping[str, float]) -> Problem:
    """The problem with parameters held at known values.

    Raises:
        UnknownName: there is no such parameter.
        InvalidInput: a value is not finite, or not positive where it must be.
    """
    prior, fixed, space = problem.prior.copy(), problem.known.copy(), problem.space
    for name, value in known.items():
        names = space.names if name in space.names else space.labels
        if name not in names:
            raise UnknownName("parameter", name, [*space.names, *space.labels])
        index = names.index(name)
        positive = (
            any(
                place.start <= index < place.stop and block.geometry == "positive"
                for block, place in space
            )
            or space.units[index] == "kg"
        )
        if not np.isfinite(value) or (positive and not value > 0):
            raise InvalidInput(name, "a number > 0" if positive else "a number", value, "")
        block = next(p for b, p in space if p.start <= index < p.stop)
        if space.units[index] == "kg" and block.stop - block.start == 10:
            prior[block] *= value / prior[index]  # the whole link grows, and stays physical
        prior[index], fixed[index] = value, True
    return replace(problem, prior=prior, known=fixed)


def tempered_fit(problem: Problem) -> tuple[Fit, Array]:
    """The fit in which rows count as effectively independent ones, and (n,) rows per such row."""
    fit = minimise(problem)
    share = inflation(problem, fit.theta)
    fit = minimise(problem, tempered(problem, share), fit.theta)
    return fit, share


def _held_out(problem: Problem, share: Array) -> tuple[Array, Array]:
    """(n,), (n,) NRMSE of held-out fifths: of the fit, and of weighted least squares."""
    at = problem.space.actuators
    found = []
    for part in folds(problem, _FOLDS):
        rest, own = without(problem, part), problem.select(part)
        theta = minimise(rest, tempered(rest, share)).theta
        plain = least_squares(rest, theta[at])
        found.append((own.nrmse(theta), own.nrmse(plain)))
    ours, theirs = (np.array(side) for side in zip(*found, strict=True))
    return _rms(ours), _rms(theirs)


def _rms(values: Array) -> Array:
    """rms over folds, of those with usable rows."""
    counts = np.maximum(np.isfinite(values).sum(axis=0), 1)
    return np.sqrt(np.nansum(values**2, axis=0) / counts)


def _structural(problem: Problem, fit: Fit, other: Problem, share: Array) -> Array:
    """(p,) half the change of θ̂ with the basic columns only; 0 for parameters that go."""
    theta = minimise(other, tempered(other, share)).theta
    index = {name: i for i, name in enumerate(other.space.names)}
    return np.array(
        [
            0.5 * abs(theta[index[name]] - fit.theta[i]) if name in index else 0.0
            for i, name in enumerate(problem.space.names)
        ]
    )


def _along(problem: Problem, share: Array) -> tuple[Array, Array]:
    """Times (K,) and estimates (K, p) along the log: steps on all rows so far, from the last θ̂."""
    ends = np.flatnonzero(np.diff(np.floor(problem.t / _ONLINE), append=np.inf))
    theta, start, total = problem.prior, 0, None
    times, estimates = [], []
    for end in ends + 1:
        own = problem.select(np.arange(start, end))
        part = gramians(own)
        part = Gramians(part.sums / share[:, None, None], part.counts / share)
        total = part if total is None else total + part
        start = end
        if (total.counts > 0).all():
            theta = minimise(problem, total, theta).theta
        times.append(problem.t[end - 1])
        estimates.append(theta)
    return np.array(times), np.array(estimates)


def _curves(problem: Problem, theta: Array) -> Curves:
    """Measured and predicted commands."""
    at = problem.space.actuators
    index = np.arange(len(at))
    measured = -problem.Y[:, index, at]
    predicted = measured + problem.residual(theta)[:, : len(at)] / theta[at]
    return Curves(problem.t, problem.segment, measured, predicted, problem.usable)


def _anchor(problem: Problem, known: Mapping[str, float], spread: Array) -> str:
    if known:
        return "the known " + ", ".join(f"{name} = {value:g}" for name, value in known.items())
    if (spread < _NOMINAL).all():
        return "commands stated in N·m or N (± 15 %) and the inertias of the model file"
    return "the inertias of the model file: one weighed link or one calibrated gain would fix it"


def _refuse(found: list[Finding]) -> None:
    if any(f.level == "refusal" for f in found):
        raise UnusableLog(tuple(found))
