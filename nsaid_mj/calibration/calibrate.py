"""Plant and actuators from prepared logs: structure, fit, intervals, verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..evaluation.result import Parameter, gravest_first
from ..parameters import Array
from .arms import structured_arm
from .checks import structure_checks
from .data import Recordings, RobotModel
from .findings import Finding, UnusableLog
from .fit import Fit, minimise
from .joints import TRUSTED, nearest_friction
from .law_result import Fitted
from .least_squares import least_squares
from .payloads import check_loads, payloads
from .precision import inflation, precision, tempered
from .problem import Problem, folds
from .residuals import doubts, followed, widened, with_doubts
from .result import Curves, Identification, JointFit
from .scale import common_scale, idle_values, rescaled, with_known
from .statements import combinations_in_words, parameters_in_words, suggest, verdict
from .structure import Options, Structured
from .vehicles import structured_vehicle

_FOLDS = 5
_DEFAULT = Options()


def calibrate(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None = None,
    options: Options = _DEFAULT,
    *,
    known: Mapping[str, float] | None = None,
    findings: tuple[Finding, ...] = (),
    told: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identifies the parameters of a robot from prepared recordings.

    Args:
        robot: the model.
        recordings: training logs.
        validation: a log that takes no part in the fit; None to hold out parts of the training.
        options: of the structure.
        known: values of parameters by name or label [SI].
        findings: earlier ones.
        told: called with the name of every stage, for progress.

    Raises:
        UnusableLog: the log cannot be used; all findings are attached.
        UnknownName: a known parameter does not exist.
        InvalidInput: a known value is not physical.
    """
    begin, known = time.perf_counter(), dict(known or {})
    if options.loads:
        check_loads(options.loads, [segment.source for segment in recordings.segments])
        for payload in payloads(robot.model, options.loads):
            known |= payload.known
    found = [*robot.findings, *recordings.findings, *findings]
    if validation is not None:
        found += [f for f in validation.findings if f not in found]
    _refuse(found)
    build = structured_arm if robot.system is None else structured_vehicle
    made = build(robot, recordings, validation, options, told)
    found += made.findings
    _refuse(found)
    told("fitting")
    problems = [made.problem, *made.alternatives]
    if robot.weightless:
        problems = [rescaled(each, known) for each in problems]
    problem, *others = (with_known(each, known) for each in problems)
    fit, share = tempered_fit(problem)
    told("estimating intervals")
    exact = precision(problem, fit, share)
    if others:
        changes = np.array([_change(problem, fit, other, share) for other in others])
        exact = exact._replace(structure=changes)
    stated = bool((made.spread < TRUSTED).all())
    left = followed(
        problem, fit.theta, exact.covariance, share, made.suspects(fit.theta), made.noisier
    )
    told("predicting held-out parts")
    joints = _joints(made, problem, fit.theta, share, robot)
    held_out = np.array([joint.held_out for joint in joints])
    if robot.system is not None:
        found += [_not_judged(joint.name) for joint in joints if np.isnan(joint.held_out)]
    found += doubts(problem, exact, left, held_out)
    exact = widened(exact, left)
    unexplained = structure_checks(tuple(joint.name for joint in joints), _worse(joints))
    found += unexplained
    if unexplained:
        doubted = _doubted(problem, [f.where for f in unexplained], robot.system is None)
        exact = exact._replace(
            structure=np.vstack([exact.structure, np.diag(exact.theta * doubted)])
        )
    scale = common_scale(problem, exact, fit.theta, stated, robot.weightless, known)
    found += idle_values(problem, scale, known)
    explains, sentence = scale.judged(*with_doubts(*verdict(joints, robot.system is None), found))
    common = np.zeros(len(fit.theta)) if scale.fixed else scale.weights
    parameters = parameters_in_words(problem, fit, exact, made.spread, common)
    level = options.level | _without_offset(joints, parameters)
    if options.columns is None and level != options.level:
        told("fitting without an offset whose interval holds 0")
        options = replace(options, level=level)
        return calibrate(
            robot, recordings, validation, options, known=known, findings=findings, told=told
        )
    return Identification(
        explains=explains,
        verdict=sentence,
        parameters=parameters,
        findings=gravest_first(found),
        robot=robot,
        recordings=recordings,
        joints=joints,
        combinations=combinations_in_words(problem, fit, exact),
        anchor=scale.words,
        suggestion="" if explains == "no" else suggest(problem, exact, parameters),
        theta=fit.theta,
        deviation=exact.deviation,
        covariance=exact.covariance,
        friction=nearest_friction(problem, fit.theta),
        curves=_curves(problem, fit.theta),
        validation=None if made.checked is None else _curves(made.checked, fit.theta),
        law=None,
        cutoff=made.cutoff,
        seconds=time.perf_counter() - begin,
        fitted=Fitted(made, problem, exact, share, options.coupled),
    )


def _joints(
    made: Structured, problem: Problem, theta: Array, share: Array, robot: RobotModel
) -> tuple[JointFit, ...]:
    """How well every velocity is predicted, also by least squares with the gains of θ (p,).

    The held-out error is NaN for velocities of a vehicle that hardly moves in them.
    """
    held_out, plain = _held_out(problem, share)
    if robot.system is not None:
        held_out[problem.hardly_moved(theta, robot.system.velocity_units)] = np.nan
    nrmse, judged, bested = problem.nrmse(theta), None, None
    if made.checked is not None:
        least = least_squares(problem, theta[problem.space.actuators])
        judged, bested = made.checked.nrmse(theta), made.checked.nrmse(least)
    return tuple(
        JointFit(
            velocity.name,
            float(nrmse[j]),
            float(held_out[j]),
            float(plain[j]),
            None if judged is None else float(judged[j]),
            None if bested is None else float(bested[j]),
            velocity.columns,
            velocity.friction_speed,
            velocity.delay,
        )
        for j, velocity in enumerate(made.velocities)
    )


def _without_offset(joints: Sequence[JointFit], parameters: Sequence[Parameter]) -> frozenset[str]:
    """Joints with an offset whose interval holds 0 and that is not needed for a spring's rest.

    Held-out parts of one log may ask for an offset where gears twist; another log does not.
    """
    vain = {p.label for p in parameters if p.low <= 0 <= p.high}
    return frozenset(
        joint.name
        for joint in joints
        if "spring" not in joint.columns and f"offset of {joint.name}" in vain
    )


def _worse(joints: Sequence[JointFit]) -> Array:
    """(n,) the larger NRMSE of held-out parts and validation; NaN where none is judged."""
    return np.array(
        [
            joint.held_out
            if joint.validation is None or np.isnan(joint.held_out)
            else np.fmax(joint.held_out, joint.validation)
            for joint in joints
        ]
    )


def _not_judged(name: str) -> Finding:
    return Finding(
        "note",
        "hardly_moved",
        name,
        "no actuator drives it and it hardly moves, so its prediction is not judged",
        "Record a motion that accelerates it.",
    )


def _doubted(problem: Problem, names: list[str], arm: bool) -> Array:
    """(p,) 1 at parameters of velocities that the structure does not explain, else 0.

    Their intervals are widened by their own size. On a vehicle every parameter acts on several
    velocities, so all are doubted.
    """
    if not arm:
        return np.ones(len(problem.space))
    own = [any(label.endswith(f" of {n}") for n in names) for label in problem.space.labels]
    return np.array(own, dtype=np.float64)


def tempered_fit(problem: Problem) -> tuple[Fit, Array]:
    """The fit whose rows count as effectively independent ones, and (n,) rows per such row."""
    fit = minimise(problem)
    share = inflation(problem, fit.theta)
    return minimise(problem, tempered(problem, share), fit.theta), share


def _held_out(problem: Problem, share: Array) -> tuple[Array, Array]:
    """(n,), (n,) NRMSE of held-out fifths: of the fit, and of weighted least squares.

    Squares are summed over all fifths and divided by those of the whole log's forces: a joint that
    idles in one fifth has hardly any there.
    """
    at, total, counts = problem.space.actuators, 0.0, np.zeros(problem.Y.shape[1])
    for rest, own in folds(problem, _FOLDS):
        if not rest.usable.any():
            continue
        theta = minimise(rest, tempered(rest, share)).theta
        rows = own.usable.sum(axis=0)
        errors = [own.nrmse(x, problem) for x in (theta, least_squares(rest, theta[at]))]
        total = total + rows * np.where(rows > 0, errors, 0.0) ** 2
        counts += rows
    ours, theirs = np.sqrt(np.where(counts > 0, total / np.maximum(counts, 1), np.nan))
    return ours, theirs


def _change(problem: Problem, fit: Fit, other: Problem, share: Array) -> Array:
    """(p,) change of θ̂ under another structure that counts as one standard deviation.

    It is the whole change, times the ratio of the residuals' variances where the other structure
    explains the log less well; 0 for parameters that the other lacks.
    """
    found = minimise(other, tempered(other, share), _start(problem, fit, other))
    both = (fit.levels > 0) & (found.levels > 0)  # 0 for joints that are at rest throughout
    plausible = np.exp(np.mean(np.log(fit.levels[both] / found.levels[both])))
    index = {name: i for i, name in enumerate(other.space.names)}
    change = np.zeros(len(problem.space))
    for i, name in enumerate(problem.space.names):
        if name in index:
            change[i] = min(1.0, plausible) * (found.theta[index[name]] - fit.theta[i])
    return change


def _start(problem: Problem, fit: Fit, other: Problem) -> Array:
    """The other structure's prior, with the estimate in place of the parameters of both."""
    start, index = other.prior.copy(), {n: i for i, n in enumerate(problem.space.names)}
    for i, name in enumerate(other.space.names):
        if name in index:
            start[i] = fit.theta[index[name]]
    return start


def _curves(problem: Problem, theta: Array) -> Curves:
    """Measured and predicted commands where every velocity has an actuator, else forces."""
    at, n = problem.space.actuators, problem.Y.shape[1]
    own = problem.Y[:, np.arange(n), at] if len(at) == n else np.zeros((0, n))
    if len(at) == n and np.count_nonzero(problem.Y[:, :, at]) <= np.count_nonzero(own):
        measured = -own
        predicted = measured + problem.residual(theta) / theta[at]
    else:
        measured = -problem.actuation(theta)
        predicted = measured + problem.residual(theta)
    return Curves(problem.t, problem.segment, measured, predicted, problem.usable)


def _refuse(found: list[Finding]) -> None:
    if any(f.level == "refusal" for f in found):
        raise UnusableLog(gravest_first(found))
