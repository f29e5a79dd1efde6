"""Choice of the structure of a robot that stands and walks, and the rows of its fit.

First the forces on all feet are taken out of all rows, whether they touch or not: that needs no
knowledge of contact. Its fit tells the feet's loads, and these tell which legs swing. Then only
forces that may act are taken out, so that swinging legs have rows of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import scipy

from ....base import Finding
from ....core import Array, Sums
from ....lab import INTERVAL
from ....robots import RobotModel
from ...logs.pd_law import feedback_in
from ...logs.recordings import Recordings
from ..choose.columns import SPEEDS
from ..choose.cutoff import NARROWER
from ..fit import Fit, inflation, minimise, tempered_fit
from ..joint_checks import GUESSED, NOMINAL, STATED
from ..problem import FitProblem
from ..result import JointStructure, Options, Structured
from ..smoothing import Filter
from .feet import feet_of, imu_pose
from .odometry import with_odometry
from .offsets import Offsets, displaced, estimated
from .rows import BANDS, BASE, FRICTIONS, Ground, GroundRows, total_mass
from .sensors import sensors_of, with_sensors
from .stance import Stance, stance

_CUTOFF = 20.0  # of the rows [Hz]: the steps of a gait
_SLOW = 4.0  # without an accelerometer: what standing feet tell of the base's motion
_FAST = 200.0  # at which regressors are computed, at least [Hz]: contact forces jump
_ROWS = 2.5  # rows per second over the cut-off: more hold nothing new
_MOST_ROWS = 6000.0  # of all logs
_SPEED = 4  # index of the first s of tanh(v/s): 0.05 rad/s
_LEADS = (0.0, 0.005, 0.01)
# by which dry friction may turn before the velocity does [s]: MuJoCo's `frictionloss` stops a joint
# by v̇ = −100 v with its default `solreffriction`, so that its force imitates rotor inertia
_LAG = 1e-3  # by which a PD law may act late on the measured motion [s]: a loop at 1 kHz
_STEPS = (0.006, 0.001)  # between trial delays [s]: the cost is a parabola within the last alone
_PASSES = 2  # of estimating the base's acceleration by the loads under an estimate
_REACH = 0.06  # largest delay [s]
_DOUBTED = 5e-3  # standard deviation of a delay that is not sought [s]


def structured_ground(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    report: Callable[[str], None],
) -> Structured:
    """Finds feet, IMU, stance and delay of a walking robot and makes the rows of its fit.

    `recordings` are training logs, `validation` is a log excluded from the fit, or None; `report`
    is called with the name of every stage.
    """
    assert recordings.imu is not None
    feet, said = feet_of(robot, recordings.contacts)
    pose, where = imu_pose(robot, recordings.imu)
    report("taking the feet's forces out of the rows")
    measured = recordings.imu.accelerometer is not None
    cutoff = min(options.cutoff or (_CUTOFF if measured else _SLOW), 0.2 * recordings.rate)
    chosen = filter_of(recordings, cutoff)
    law = feedback_in(recordings) if recordings.feedback is None else None
    rows = GroundRows(robot, recordings, chosen, Ground(feet, pose, law=law), _SPEED)
    rows.expect(*expected_gains(rows))
    k = len(robot.joints)
    delay = np.zeros(k) if options.delay is None else options.delay
    fit = minimise(rows.problem(delay))
    report("finding which legs swing")
    for _ in () if measured else range(_PASSES):
        rows = rows.like(with_odometry(rows, _stance(rows, fit, delay)))
        fit = minimise(rows.problem(delay), start=fit.theta)
    rows, seen = _released(rows, fit, delay)
    findings = [said, where, *_swing(rows, seen), *_damping(rows), *_implied(rows)]
    findings += [*_sensors(rows, seen), *_without_accelerometer(rows)]
    report("finding how dry friction turns")
    fit = _with_friction(rows, fit, delay)
    report("comparing IMU and joints")
    rows, fit, offsets = _allowed(rows, fit, delay)
    findings += offsets.findings([foot.name for foot in feet])
    interval = None
    others: list[float] = []
    if options.delay is None and recordings.imu.accelerometer is None:
        others = [_DOUBTED]
    elif options.delay is None:
        report("finding the commands' delay")
        common, deviation = _delay(rows, fit)
        delay = np.full(k, common)
        half = INTERVAL * deviation
        interval = (common - half, common + half)
        others = [common + deviation]
    fit = _with_friction(rows, fit, delay)
    problem = rows.problem(delay)
    checked = None
    if validation is not None:
        own = rows.like(validation, replace(rows.ground, touching=None, answer=None))
        own = _released(own, fit, delay)[0]
        if own.ground.at_step:
            own = own.like(ground=_answered(own, fit.theta))
        checked = own.problem(delay)
    return Structured(
        problem,
        _alternatives(rows, delay, others),
        checked,
        tuple(_structures(rows, delay, interval)),
        tuple(findings),
        cutoff,
        delay,
        doubts=offsets.changes,
        columns=rows.terms(rows.space)[0],
        rotors=rows.terms(rows.space)[1],
    )


def _allowed(rows: GroundRows, fit: Fit, delay: Array) -> tuple[GroundRows, Fit, Offsets]:
    """The rows in which errors of IMU and feet are allowed for, their fit, and these errors.

    A large error of the IMU hides others, and which feet bear load, so it is found first.
    """
    total = 0.0
    if rows.law is not None:
        rows.ground = _answered(rows, fit.theta)
    for last in (False, False, True):
        problem = rows.problem(delay)
        fit, share = tempered_fit(problem, fit.theta)
        offsets = estimated(rows, problem, fit.theta, delay, share)
        if last or not offsets.of_imu.any():
            break
        total = total + offsets.of_imu
        changed = displaced(rows.ground, offsets.entries, offsets.of_imu)
        if offsets.at_steps_alone:  # which changes no foot's load by much
            rows = rows.like(ground=changed)
            continue
        rows = rows.like(ground=replace(changed, touching=None))
        fit = minimise(rows.problem(delay), start=fit.theta)
        rows, _ = _released(rows, fit, delay)
    if offsets.value.any():
        rows = rows.like(ground=displaced(rows.ground, offsets.entries, offsets.value))
    return rows, fit, offsets._replace(value=offsets.value + total)


def _answered(rows: GroundRows, theta: Array) -> Ground:
    """The rows' ground, with what the base does at steps of held targets."""
    answer = [np.zeros((0, BASE)) for _ in rows.recordings.segments]
    for number in range(len(rows.motions)):
        answer[rows.position(number)] = rows.answer(number, theta)
    return replace(rows.ground, answer=tuple(answer))


def _released(rows: GroundRows, fit: Fit, delay: Array) -> tuple[GroundRows, Stance]:
    """The rows in which legs that surely swing have their own, and what the feet do.

    Where the base has no accelerometer, its acceleration is that which the loaded feet tell.
    """
    seen, _ = with_sensors(rows, _stance(rows, fit, delay))
    ground = replace(rows.ground, touching=seen.touching)
    imu = rows.recordings.imu
    moved = with_odometry(rows, seen) if imu is None or imu.accelerometer is None else None
    return rows.like(moved, ground), seen


def filter_of(recordings: Recordings, cutoff: float) -> Filter:
    """The filter of the rows: from 200 Hz on, with as many rows as its cut-off needs."""
    every = max(1, int(recordings.rate / _FAST))
    rate = recordings.rate / every
    seconds = sum(len(segment.log.t) for segment in recordings.segments) / recordings.rate
    least = max(rate / (_ROWS * cutoff), rate * seconds / _MOST_ROWS)
    return Filter(cutoff, recordings.rate, every, max(1, int(least)))


def _sensors(rows: GroundRows, seen: Stance) -> Iterator[Finding]:
    """What sensors in the feet say, compared with the implied forces."""
    found = sensors_of(rows, seen)
    feet = [foot.name for foot in rows.ground.feet]
    if found is not None:
        yield from found.findings(feet)
    elif rows.recordings.contacts.force:
        names = ", ".join(rows.recordings.contacts.force)
        text = f"{names} are not used: the robot has {len(feet)} feet ({', '.join(feet)})"
        yield Finding("note", "foot_sensors", "", text, "Name one column for each in [contacts].")


def _stance(rows: GroundRows, fit: Fit, delay: Array) -> Stance:
    mass = total_mass(rows.robot, len(rows.space)) @ fit.theta
    whole = sum(float(inertia.mass) for inertia in list(rows.robot.model.inertias)[1:])
    return stance(rows, fit.theta, delay, float(mass) * whole)


def expected_gains(rows: GroundRows) -> tuple[Array, Array]:
    """(k,) expected gains and (k,) standard deviations of their logarithms, as of an arm's motors.

    Gains of commands in unknown units are those with which the motors carry the file's links best.
    """
    own = np.abs(rows.robot.gain)
    stated = np.array([unit in ("N·m", "N") for unit in rows.recordings.command_units])
    nominal = ~stated & (own != 1)
    problem = rows.problem(np.zeros(len(own)))
    at = problem.space.actuators
    links = np.zeros(len(problem.space), dtype=bool)
    links[: 10 * (rows.robot.model.njoints - 1)] = True
    force = problem.Y[:, :BASE, links] @ problem.prior[links]
    size = np.maximum(force.std(axis=0), 1e-9)
    X = (-problem.Y[:, :BASE][:, :, at] / size[:, None]).reshape(-1, len(at))
    scale = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-12)
    found = scipy.optimize.nnls(X / scale, (force / size).ravel())[0] / scale
    typical = float(np.median(found[found > 0])) if (found > 0).any() else 1.0
    guess = np.full(len(own), typical)
    guess[rows.driven] = np.clip(found, 0.1 * typical, 10 * typical)
    gain = np.where(stated | nominal, own, guess)
    return gain, np.where(stated, STATED, np.where(nominal, NOMINAL, GUESSED))


def _without_accelerometer(rows: GroundRows) -> Iterator[Finding]:
    """What is taken in place of the base's specific force, where nothing measures it."""
    if rows.recordings.imu is None or rows.recordings.imu.accelerometer is not None:
        return
    text = "without an accelerometer the base's acceleration is taken from the feet that bear "
    text += f"load, as if they stood still; it is used up to {rows.chosen.cutoff:g} Hz, and no "
    text += "delay of the commands is sought"
    remedy = "Log the IMU's specific force, too."
    yield Finding("warning", "no_accelerometer", "base", text, remedy)


def _swing(rows: GroundRows, seen: Stance) -> Iterator[Finding]:
    """How long each foot bears load, and which ones never swing."""
    names = [foot.name for foot in rows.ground.feet]
    shares = ", ".join(
        f"{name} {100 * share:.0f} %" for name, share in zip(names, seen.share, strict=True)
    )
    text = f"by the balance of the legs, the feet bear load for these shares of the log: {shares}"
    data = {"share": dict(zip(names, seen.share.tolist(), strict=True))}
    yield Finding("note", "stance", "", text, data=data)
    never = [n for n, share in zip(names, seen.swinging, strict=True) if share < _RARE]
    if never:
        text = "these feet hardly leave the ground, so that their own mass cannot be told from the "
        text += "ground's force and stays the file's"
        remedy = "Add a motion that lifts them: a trot, or a leg waved."
        yield Finding("note", "never_in_swing", ", ".join(never), text, remedy)


_RARE = 0.01  # share of swing below which a foot counts as never released


class _Trials:
    """Fits of other delays and dry friction, each from the best one before.

    Attributes:
        best: the fit of least cost so far.
    """

    def __init__(self, rows: GroundRows, fit: Fit, delay: Array):
        self._rows = rows
        self._problem = rows.problem(delay)
        self._share = inflation(self._problem, fit.theta)
        self.best = fit._replace(cost=np.inf)  # of other weights

    def cost(self, delay: Array, speed: int, lead: float, band: int) -> float:
        """The cost of a delay (k,) and of dry friction; see `GroundRows.sums`."""
        sums = self._rows.sums(delay, speed, lead, band)
        parts = Sums(sums.sums / self._share[:, None, None], sums.counts / self._share)
        found = minimise(self._problem, parts, self.best.theta)
        if found.cost < self.best.cost:
            self.best = found
        return found.cost


def _with_friction(rows: GroundRows, fit: Fit, delay: Array) -> Fit:
    """Gives rows the dry friction with the least cost, and returns the fit with it.

    Its speed, lead and band are common to all joints.
    """
    trials = _Trials(rows, fit, delay)

    @cache
    def cost(speed: int, lead: int, band: int) -> float:
        return trials.cost(delay, speed, _LEADS[lead], band)

    best = rows.speed, _LEADS.index(rows.lead), rows.band
    counts = len(SPEEDS), len(_LEADS), len(BANDS)
    while True:
        near = [
            (*best[:k], best[k] + step, *best[k + 1 :])
            for k, count in enumerate(counts)
            for step in (-1, 1)
            if 0 <= best[k] + step < count
        ]
        found = min((best, *near), key=lambda each: cost(*each))
        if found == best:
            break
        best = found
    rows.speed = best[0]
    rows.lead = _LEADS[best[1]]
    rows.band = best[2]
    return trials.best


def _damping(rows: GroundRows) -> Iterator[Finding]:
    """Where the damping of a PD law is: no motion tells it from viscous friction."""
    if rows.recordings.feedback is not None:
        text = "viscous friction below contains the damping of the motors' PD law: only their sum "
        text += "acts on the motion, and kd of a controller is seldom exact. So the exported "
        text += "model's motors need kp (target − position) alone"
        yield Finding("note", "damping", "", text)


def _implied(rows: GroundRows) -> Iterator[Finding]:
    """Whether measured torques are those of a PD law whose targets step."""
    if rows.recordings.feedback is not None or rows.law is None:
        return
    joints = [joint for joint, kp in zip(rows.robot.joints, rows.law[0], strict=True) if kp]
    ranges = [
        f"{name} {values.min():.3g} to {values.max():.3g}"
        for name, values in zip(("kp", "kd"), rows.law[:, rows.law[0] > 0], strict=True)
    ]
    text = f"the commands are torques of a PD law whose targets step ({', '.join(ranges)}, in the "
    text += "commands' units): only the targets' part is taken to act late. If the law ran no "
    text += "faster than the log, rotor inertia and viscous friction would be larger, by kd and kp "
    text += "times half of a row's time; their intervals allow for it"
    remedy = "Log the torques faster, or as a mean from row to row."
    yield Finding("note", "implied_law", ", ".join(joints), text, remedy)


def _delay(rows: GroundRows, fit: Fit) -> tuple[float, float]:
    """The common delay of the commands with the least cost, and its standard deviation [s]."""
    k = len(rows.robot.joints)
    trials = _Trials(rows, fit, np.zeros(k))

    @cache
    def cost(late: float) -> float:
        return trials.cost(np.full(k, late), rows.speed, rows.lead, rows.band)

    best = 0.0
    for step in _STEPS:
        while abs(best) < _REACH:
            near = min((best - step, best, best + step), key=cost)
            if near == best:
                break
            best = near
    before, here, after = (cost(best + side * step) for side in (-1, 0, 1))
    curvature = before - 2 * here + after
    if curvature <= 0:
        return best, step
    shift = float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5))
    return best + shift * step, max(step / np.sqrt(curvature), 1e-4)


def _structures(
    rows: GroundRows, delay: Array, interval: tuple[float, float] | None
) -> Iterator[JointStructure]:
    for label in rows.robot.system.rate_labels[:BASE]:
        yield JointStructure(f"base {label}", delay=float(delay[0]), delay_interval=interval)
    for joint, late in zip(rows.robot.joints, delay, strict=True):
        speed = SPEEDS[rows.speed]
        yield JointStructure(
            joint,
            columns=FRICTIONS,
            friction_speed=speed,
            delay=float(late),
            delay_interval=interval,
        )


def _alternatives(rows: GroundRows, delay: Array, others: Sequence[float]) -> Iterator[FitProblem]:
    """Other plausible problems: another delay, friction speed, lead or band, and cut-off."""
    for other in others:
        yield rows.problem(np.full(len(delay), other))
    for speed in {max(rows.speed - 2, 0), min(rows.speed + 2, len(SPEEDS) - 1)} - {rows.speed}:
        yield rows.problem(delay, speed)
    for lead in _LEADS:
        if lead != rows.lead:
            yield rows.problem(delay, lead=lead)
    for band in {max(rows.band - 1, 0), min(rows.band + 1, len(BANDS) - 1)} - {rows.band}:
        yield rows.problem(delay, band=band)
    if rows.recordings.feedback is not None:
        yield rows.problem(delay, lag=_LAG)
    elif rows.law is not None:
        yield rows.problem(delay, lag=0.5 / rows.recordings.rate)
    chosen = filter_of(rows.recordings, NARROWER * rows.chosen.cutoff)
    yield rows.like(chosen=chosen).problem(delay)
