"""Plant and actuators from prepared logs: structure, fit, intervals, verdict."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...base import Finding
from ...core import Array
from ...robots import RobotModel
from ..logs import signals
from ..logs.recordings import Recordings
from ..logs.unusable import UnusableLog
from .choose.structured import structured
from .dry_mass import added_mass, of_parameters, off_file, stated_mass, with_dry_mass
from .fit import Fit, Precision, minimise, precision, tempered, tempered_fit
from .hypotheses import without_contradicted
from .identifiability import (
    combinations_in_words,
    common_scale,
    idle_values,
    informed,
    parameters_in_words,
    suggest,
)
from .joints import TRUSTED, nearest_friction
from .links import check_loads
from .problem import FitProblem, Mask, folds, least_squares
from .residuals import Followed, doubts, followed, widened
from .result import (
    BatchFit,
    Curves,
    Identification,
    JointStructure,
    Options,
    Structured,
    recording_shifts,
    statistics_of,
)
from .vehicle_loads import carried_by
from .verdict import GOOD, UNPHYSICAL, only_unbounded, verdict

_FOLDS = 5
_BY_LOAD = ", or weigh a load that one of two logs carries: --load."
_BY_KNOWN = ", a mass or a moment of inertia that acts in the motion: --known."
_POOR = 0.5  # NRMSE above which a joint's motion is not explained
_RESTING = 0.2  # of the commands' variation in training: below it, a validation log hardly moves
_WHITE = 1.3  # level of noise in every second row over that in all rows
_DEFAULT = Options()


def calibrate(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None = None,
    options: Options = _DEFAULT,
    report: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identifies the parameters of a robot from prepared recordings.

    `validation` is a log excluded from the fit; None to hold out parts of the training logs.
    `report` is called with the name of every stage, for progress.

    Raises:
        UnusableLog: the log cannot be used; all findings are attached.
        UnknownName: a known parameter does not exist.
        InvalidInput: a known value is not physical.
    """
    begin = time.perf_counter()
    known = dict(options.known)
    dry = stated_mass(robot, known)
    if dry is not None:
        options = replace(options, apart=max(options.apart, off_file(robot, dry)))
        robot = with_dry_mass(robot, dry)
    check_loads(options.loads, [segment.source for segment in recordings.segments])
    for payload in carried_by(robot, options.loads):
        known |= payload.known
    found = [*options.contradicted, *robot.findings, *recordings.findings]
    if validation is not None:
        found += [f for f in _of_validation(validation) if f not in found]
    _refuse(found)
    made = structured(robot, recordings, validation, options, report)
    found += made.findings
    _refuse(found)
    report("fitting and estimating intervals")
    fitted = _estimated(robot, made, known, options.apart)
    if known:
        report("comparing given values with the log and the model file")
        other = without_contradicted(robot, recordings, fitted, options)
        if other is not None:
            return calibrate(robot, recordings, validation, other, report)
    theta = fitted.fit.theta
    covariance = fitted.exact.covariance
    tried = made.suspects(theta)
    left = followed(fitted.problem, theta, covariance, fitted.share, tried, made.noisier)
    report("predicting held-out parts")
    joints = _joints(fitted, robot, recordings)
    doubted, exact = _judged(fitted, left, joints, robot.held)
    logs = (recordings, validation)
    found = [*found, *doubted]
    fitted = fitted._replace(exact=exact)
    result = _identification(robot, logs, fitted, joints, found, known, begin)
    # elastic gears may cause an apparent offset in the held-out parts of one log, not in another
    vain = {p.label for p in result.parameters if p.low <= 0 <= p.high}
    level = options.level | {
        joint.name
        for joint in joints
        if "spring" not in joint.columns and f"offset of {joint.name}" in vain
    }
    if options.columns is None and level != options.level:
        report("fitting without an offset whose interval holds 0")
        return calibrate(robot, recordings, validation, replace(options, level=level), report)
    return result


def _estimated(
    robot: RobotModel, made: Structured, known: Mapping[str, float], apart: float
) -> BatchFit:
    """The fit of a structure with known values, and its precision.

    `apart` is a relative standard deviation of the scale beside that of the prior.
    """
    told = of_parameters(robot, known)

    def own(each: FitProblem) -> FitProblem:
        return informed(each, told, robot.weightless)

    problem = own(made.problem)
    fit, share = tempered_fit(problem)
    exact = precision(problem, fit, share)
    changes = [_change(problem, fit, own(other), share) for other in made.alternatives]
    changes += [_change(problem, fit, own(other), share, True) for other in made.rivals]
    if made.doubts is not None:
        changes += list(made.doubts)
    if apart:
        changes.append(apart * fit.theta)
    if changes:
        exact = exact._replace(structure=np.array(changes))
    return BatchFit(made, problem, fit, exact, share)


def _judged(
    fitted: BatchFit, left: Sequence[Followed], joints: Sequence[JointStructure], arm: bool
) -> tuple[list[Finding], Precision]:
    """Findings about the structure, and the precision widened by them.

    `left` are the suspects found. With `arm` the parts are joints; a vehicle has velocities.
    """
    held_out = np.array([joint.held_out for joint in joints])
    found = []
    fitted_ones = np.atleast_1d(fitted.problem.usable.any(axis=0))
    for joint, used in zip(joints, fitted_ones.tolist(), strict=True):
        if not arm and used and np.isnan(joint.held_out):
            text = "no actuator drives it and it hardly moves, so its prediction is not judged"
            remedy = "Record a motion that accelerates it."
            found.append(Finding("note", "hardly_moved", joint.name, text, remedy))
    problem = fitted.problem
    exact = fitted.exact
    found += doubts(problem, exact, left, held_out)
    exact = widened(exact, left)
    checked = [np.nan if joint.validation is None else joint.validation for joint in joints]
    worse = np.where(np.isnan(held_out), np.nan, np.fmax(held_out, checked))
    unexplained = structure_checks(tuple(joint.name for joint in joints), worse)
    foreign = unphysical(joints) if arm else []
    base = np.array([joint.name.startswith("base ") for joint in joints])
    others = [f.where for f in (*foreign, *unexplained) if not f.where.startswith("base ")]
    if others:
        share = _doubted(problem, others, arm)
        structure = np.vstack([exact.structure, np.diag(exact.theta * share)])
        exact = exact._replace(structure=structure)
    if (worse[base] >= GOOD).any():
        structure = np.vstack([exact.structure, _without_each(fitted, base)])
        exact = exact._replace(structure=structure)
    return [*found, *foreign, *unexplained], exact


def _without_each(fitted: BatchFit, base: Mask) -> Array:
    """(6, p) changes of θ̂ in fits without one balance of a walking robot's base, of mask (n,).

    The balances are more than the unknowns need. If the feet, the legs' lengths or the IMU are not
    as assumed, each asks for other values, by as much as these may be wrong.
    """
    problem = fitted.problem
    left_out = np.eye(len(base), dtype=bool)[base]
    others = [replace(problem, usable=problem.usable & ~one) for one in left_out]
    changes = [_change(problem, fitted.fit, each, fitted.share, rival=True) for each in others]
    return np.array(changes)


def _identification(
    robot: RobotModel,
    logs: tuple[Recordings, Recordings | None],
    fitted: BatchFit,
    joints: tuple[JointStructure, ...],
    found: list[Finding],
    known: Mapping[str, float],
    begin: float,
) -> Identification:
    """The result of a fit that began at a time [s], with what was found, in words.

    `logs` are those of training and of validation.
    """
    made, problem, fit, exact = fitted[:4]
    recordings, validating = logs
    gain_spread = problem.spread[problem.space.actuators]
    stated = bool((gain_spread < TRUSTED).all())
    scale = common_scale(problem, exact, fit.theta, stated, robot.weightless, known)
    if not robot.jointed or robot.floating:  # carries no load that one of two logs lacks
        scale = scale._replace(remedy=scale.remedy.replace(_BY_LOAD, _BY_KNOWN))
    found = [*found, *idle_values(problem, scale, of_parameters(robot, known))]
    explains, sentence = verdict(joints, found, scale, robot.held)
    common = np.zeros(2 * fit.theta.shape) if scale.fixed else scale.weights
    parameters = parameters_in_words(problem, fit, exact, gain_spread, common)
    if not recordings.turns_only and "manoeuvring" not in joints[0].columns:
        found += added_mass(robot, parameters)
    checked = None
    if validating is not None and made.checked is not None:
        checked = _curves(made.checked, fit.theta, validating)
    return Identification(
        explains=explains,
        verdict=sentence,
        parameters=parameters,
        findings=Finding.gravest_first(found),
        robot=robot,
        recordings=recordings,
        joints=joints,
        combinations=combinations_in_words(problem, fit, exact),
        anchor=scale.words,
        suggestion="" if explains == "no" else suggest(problem, exact, parameters),
        theta=fit.theta,
        deviation=exact.deviation,
        covariance=exact.covariance,
        friction=nearest_friction(problem, fit.theta, len(robot.joints)),
        statistics=statistics_of(joints),
        predictions=_curves(problem, fit.theta, recordings),
        validation=checked,
        law=None,
        cutoff=made.cutoff,
        seconds=time.perf_counter() - begin,
        fitted=fitted,
    )


def _joints(
    fitted: BatchFit, robot: RobotModel, recordings: Recordings
) -> tuple[JointStructure, ...]:
    """How well every velocity is predicted, also by least squares with the gains of the fit.

    The held-out error is NaN for velocities of a vehicle that hardly moves in them.
    """
    made = fitted.made
    problem = fitted.problem
    theta = fitted.fit.theta
    held_out, plain = _held_out(problem, fitted.share, theta)
    if not robot.jointed:
        held_out[problem.hardly_moved(theta, robot.system.velocity_units)] = np.nan
    errors = {"fit": problem.nrmse(theta), "held_out": held_out, "least_squares": plain}
    if made.checked is not None:
        least = least_squares(problem, theta[problem.space.actuators])
        errors["validation"] = _validated(problem, made.checked, theta)
        errors["validation_least_squares"] = _validated(problem, made.checked, least)
    errors["force"] = problem.forces(theta)
    if problem.whole is not None:
        own = replace(problem, whole=None).forces(theta)
        errors["alone"] = held_out * errors["force"] / np.where(own > 0, own, np.nan)
    if robot.jointed:
        base = len(made.velocities) - len(robot.joints)  # velocities without a motor, if it floats
        errors["noise"] = np.append(np.zeros(base), _command_noise(recordings, made.cutoff))
        errors["limit"] = np.append(np.full(base, np.inf), np.abs(robot.gain) * robot.limits)
    units = ["N" if unit.startswith("m") else "N·m" for unit in robot.system.velocity_units]
    return tuple(
        replace(velocity, unit=unit, **{key: float(values[j]) for key, values in errors.items()})
        for j, (velocity, unit) in enumerate(zip(made.velocities, units, strict=True))
    )


def _command_noise(recordings: Recordings, cutoff: float) -> Array:
    """(n,) white noise of commands below a cut-off [Hz], over their standard deviation.

    0 for a motor under a PD law, whose force also has the noise of positions, without commands, and
    where every second row shows another level, as what is then seen is no white noise.
    """
    log = max((segment.log for segment in recordings.segments), key=lambda log: len(log.t))
    white, coarse = (np.array([signals.noise(x) for x in log.u[::k].T]) for k in (1, 2))
    white = np.where(coarse < _WHITE * white, white, 0.0)
    varied = np.sqrt(np.maximum(log.u.var(axis=0) - white**2, 0.0))
    known = (varied > 0) & (recordings.feedback is None)
    passed = np.sqrt(min(2 * cutoff / recordings.rate, 1.0))
    return np.where(known, passed * white / np.where(varied > 0, varied, 1.0), 0.0)


def _validated(problem: FitProblem, checked: FitProblem, theta: Array) -> Array:
    """(n,) NRMSE of the rows of a validation log at θ (p,).

    Where its commands hardly vary, as of a joint at rest, all of their variation may be noise; the
    error is then relative to that of the training logs.
    """
    still = checked.forces(theta) < _RESTING * problem.forces(theta)
    return np.where(still, checked.nrmse(theta, problem), checked.nrmse(theta))


def _of_validation(validation: Recordings) -> list[Finding]:
    """Its findings; those of a joint name the log, as all others are of the training logs."""
    files = list(dict.fromkeys(s.source for s in validation.segments))
    name = f"validation log {', '.join(files)}"
    return [
        f
        if any(f.where.startswith(file) for file in files)
        else replace(f, where=", ".join(filter(None, (name, f.where))))
        for f in validation.findings
    ]


def structure_checks(names: tuple[str, ...], held_out: Array) -> list[Finding]:
    """Joints whose motion the structure does not explain."""
    text = (
        "the structure does not explain this motion: held-out NRMSE {:.0f} %, where predicting the "
        "mean gives 100 %"
    )
    pairs = zip(names, held_out.tolist(), strict=True)
    return [
        Finding(
            "warning",
            "unexplained",
            name,
            text.format(100 * x),
            _OF_BASE if name.startswith("base ") else _OF_JOINT,
            {"nrmse": x},
        )
        for name, x in pairs
        if x >= _POOR
    ]


def unphysical(joints: Sequence[JointStructure]) -> list[Finding]:
    """Joints whose commands least squares predict far better than possible masses and frictions.

    A command that only compensates weight while a hand moves the robot is a function of its
    position, without inertia, or with a negative one.
    """
    text = (
        "no possible masses and frictions predict its command as well as least squares without "
        "bounds, {:.2g} % against {:.2g} %: another force than the logged one moved the joint, "
        "such as a hand, or its zero or axis is not the model's"
    )
    return [
        Finding(
            "warning",
            UNPHYSICAL,
            joint.name,
            text.format(100 * joint.held_out, 100 * joint.least_squares),
            _OF_OTHERS,
            {"nrmse": joint.held_out, "least_squares": joint.least_squares},
        )
        for joint in joints
        if only_unbounded(joint)
    ]


_OF_OTHERS = (
    "Record a motion that its motor makes, without anything that touches the robot; check zero, "
    "sign and axis of the joint."
)
_OF_JOINT = (
    "Check its axis in the model, its unit and sign in the map, and whether anything touched the "
    "robot."
)
_OF_BASE = (
    "Check where the feet are in the model, the length of its shanks, and whether anything but the "
    "feet touched something."
)


def _doubted(problem: FitProblem, names: list[str], arm: bool) -> Array:
    """(p,) 1 at parameters of velocities that the structure does not explain, else 0.

    Their intervals are widened by their own size. On a vehicle every parameter acts on several
    velocities, so all are marked.
    """
    if not arm:
        return np.ones(len(problem.space))
    own = [any(label.endswith(f" of {n}") for n in names) for label in problem.space.labels]
    return np.array(own, dtype=np.float64)


def _held_out(problem: FitProblem, share: Array, start: Array) -> tuple[Array, Array]:
    """(n,), (n,) NRMSE of held-out fifths: of fits from `start` (p,), of weighted least squares.

    Squares are summed over all fifths and divided by those of the whole log's forces, because a
    joint may stand still in one of the fifths.
    """
    at = problem.space.actuators
    total = 0.0
    counts = np.zeros(problem.Y.shape[1])
    for rest, own in folds(problem, _FOLDS):
        if not rest.usable.any():
            continue
        theta = minimise(rest, tempered(rest, share), start).theta
        rows = own.usable.sum(axis=0)
        errors = [own.nrmse(x, problem) for x in (theta, least_squares(rest, theta[at]))]
        total = total + rows * np.where(rows > 0, errors, 0.0) ** 2
        counts += rows
    ours, theirs = np.sqrt(np.where(counts > 0, total / np.maximum(counts, 1), np.nan))
    return ours, theirs


def _change(
    problem: FitProblem, fit: Fit, other: FitProblem, share: Array, rival: bool = False
) -> Array:
    """(p,) change of θ̂ under another structure that counts as one standard deviation.

    It is the whole change, times the ratio of the residual variances if the other structure
    explains the log less well; 0 for parameters that the other lacks. Of a `rival`, which predicts
    the log as well, it is the whole change, and parameters that it lacks are 0 in it.
    """
    _, own, theirs = np.intersect1d(problem.space.names, other.space.names, return_indices=True)
    start = other.prior.copy()
    change = np.zeros(len(problem.space))
    start[theirs] = fit.theta[own]
    start = np.where(other.known, other.prior, start)
    found = minimise(other, tempered(other, share), start)
    if rival:
        change = -fit.theta * ~np.isin(problem.space.names, other.space.names)
        change[own] = found.theta[theirs] - fit.theta[own]
        return change
    both = (fit.levels > 0) & (found.levels > 0)  # 0 for joints that are at rest throughout
    plausible = np.exp(np.mean(np.log(fit.levels[both] / found.levels[both])))
    change[own] = min(1.0, plausible) * (found.theta[theirs] - fit.theta[own])
    return change


def _curves(problem: FitProblem, theta: Array, recordings: Recordings) -> Curves:
    """Measured and predicted commands where every velocity has an actuator, else forces."""
    t = problem.t + recording_shifts(recordings)[problem.segment]
    at = problem.space.actuators
    n = problem.Y.shape[1]
    measured = -problem.actuation(theta)
    unit = 1.0
    if len(at) == n:
        own = problem.Y[:, np.arange(n), at]
        if np.count_nonzero(problem.Y[:, :, at]) <= np.count_nonzero(own):
            measured = -own
            unit = theta[at]
    predicted = measured + problem.residual(theta) / unit
    return Curves(t, problem.segment, measured, predicted, problem.usable)


def _refuse(found: list[Finding]) -> None:
    if Finding.refused(found):
        raise UnusableLog(Finding.gravest_first(found))
