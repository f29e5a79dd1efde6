"""Compares models of an arm by the errors of their open-loop simulations on logs."""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...base import CHOICES, InvalidInput
from ...core import Array, JointScales, JointTree, Prior, SensorLevels
from ...lab import Toolbox
from ...robots import (
    BadRobot,
    Identified,
    MjcfFile,
    RobotModel,
    with_inertias,
)
from ..logs.recordings import LogSegment, Recordings
from ..servos.export import rollout, write_by_toolbox, write_servo_mjcf
from ..servos.identify import identify_servos
from ..servos.logs import DELAYS, ServoLog, ServoLogs, late
from .calibrate import calibrate
from .choose.columns import BASIC
from .choose.joint_search import structured_arm
from .export import departures, identified
from .models import load_robot_model
from .result import Options

HORIZONS = (0.2, 2.0, np.inf)
"""Times after which a simulation restarts from the measured state [s]."""

IDENTIFIED, SYSID, STOCK = CHOICES["fitted model"]

_DEFAULT = Options()
_NOISY = SensorLevels(position=1e-4, velocity=1e-3)  # the toolbox's chunks start at smoothed states
Report = Callable[[str], None]
_Part = tuple[list[Array], Array]  # (N, n) errors over every horizon and one row; (N, n) changes


class Score(NamedTuple):
    """How well a model predicts logs."""

    model: str
    # (3, n) mean absolute error of each joint's position over each of `HORIZONS` [rad or m]; NaN
    # where it is not defined
    errors: Array
    # (n,) rms error of the position one row ahead over the rms change from row to row: predicting
    # no change gives 1
    one_step: Array
    seconds: float  # CPU time of fit and simulation [s]


def compare_servos(
    given: ServoLogs, models: Sequence[str | Path], report: Report = lambda _: None
) -> tuple[Score, ...]:
    """Scores of models on logs of a servo arm, the last that of its delayed target.

    `given` are the arm and its logs, without loads; `models` are MJCF files with a position servo
    on every joint, and names of `CHOICES`; `report` is called with the name of every stage.

    Raises:
        BadRobot: a file lacks a joint or its servo.
        InvalidInput: a half of the logs is too short for a fit.
        NoEstimate: `mujoco.sysid` lacks its own dependencies.
    """
    if {SYSID, STOCK} & {str(model) for model in models}:
        Toolbox()

    def parts(model: str) -> list[_Part]:
        if model in CHOICES["fitted model"]:
            return _fitted_servos(given, model, report)
        file = MjcfFile(Path(model))
        joints = given.robot.joints
        missing = [joint for joint in joints if joint not in file.joints]
        if missing or not file.drives(joints):
            remedy = f"All models need a position servo on each of {', '.join(joints)}."
            raise BadRobot(model, ", ".join(missing), "a joint or its servo is missing", remedy)
        return [_apart(Path(model), given, log, None) for log in given.logs]

    scores = [_scored(str(model), parts, report) for model in models]
    n = len(given.robot.joints)
    used = np.ones(sum(len(log.t) for log in given.logs))
    followed = np.full((len(HORIZONS), n), np.nan)
    for j in range(n):
        joint = [log.joint(j) for log in given.logs]
        followed[-1, j] = min(late(joint, used, delay) for delay in DELAYS)
    return *scores, Score("the target, late", followed, np.full(n, np.nan), 0.0)


def compare_arms(
    robot: RobotModel,
    recordings: Recordings,
    models: Sequence[str | Path],
    options: Options = _DEFAULT,
    report: Report = lambda _: None,
) -> tuple[Score, ...]:
    """Scores of models on logs of an arm driven by force, the last that of a constant velocity.

    `models` are files or names of models with the joints of the robot, for which the recordings
    were prepared, and `IDENTIFIED` and `SYSID`; `options` are those of the identified model's
    structure. Commands are forces over the gains (`gear`, `gainprm`) of a model's file, 1 in a
    URDF.

    Raises:
        BadRobot: a file has other joints.
        InvalidInput: no segment lasts as long as the second horizon.
        UnusableLog: a half of the logs cannot be used.
        NoEstimate: `mujoco.sysid` finds none, or lacks its own dependencies.
    """
    if SYSID in map(str, models):
        Toolbox()

    def parts(model: str) -> list[_Part]:
        if model in (IDENTIFIED, SYSID):
            return _fitted_arm(robot, recordings, options, model, report)
        own = load_robot_model(model)
        if set(robot.joints) - set(own.joints):
            expected = f"All models need the joints {', '.join(robot.joints)}."
            raise BadRobot(model, ", ".join(own.joints), "it has other joints", expected)
        if own.joints != robot.joints:
            own = load_robot_model(model, joints=robot.joints)
        return [_departed(own, Identified.nominal(own), recordings)]

    scores = [_scored(str(model), parts, report) for model in models]
    return *scores, _constant_velocity(recordings)


def _scored(model: str, parts: Callable[[str], list[_Part]], report: Report) -> Score:
    """A model's score."""
    report(f"simulating {model}")
    begin = time.process_time()
    found = parts(model)
    *errors, ahead = (np.concatenate(each) for each in zip(*(e for e, _ in found), strict=True))
    size = np.sqrt(np.mean(np.concatenate([change for _, change in found]) ** 2, axis=0))
    ratio = np.sqrt(np.mean(ahead**2, axis=0)) / np.where(size > 0, size, np.nan)
    mean = np.array([np.abs(error).mean(axis=0) for error in errors])
    return Score(model, mean, ratio, time.process_time() - begin)


def _apart(path: Path, given: ServoLogs, log: ServoLog, delay: Array | None) -> _Part:
    """Errors (N, n) of a log over every horizon and one row ahead, and its changes (N, n)."""
    horizons = (*HORIZONS, 0.0)
    errors = [
        (rollout(path, given.robot.joints, log, delay, h) - log.position)[1:] for h in horizons
    ]
    return errors, np.diff(log.position, axis=0)


def _fitted_servos(given: ServoLogs, model: str, report: Report) -> list[_Part]:
    """Errors on every log with the servos that a method identifies from the other half."""
    logs = list(given.logs)
    if len(logs) == 1:
        logs = logs[0].halves()
    found = []
    halves = logs[::2], logs[1::2]
    for number, (own, rest) in enumerate((halves, halves[::-1]), start=1):
        part = given._replace(logs=tuple(rest))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "fitted.xml")
            if model == IDENTIFIED:
                result = identify_servos(part, report)
                delay = np.array([servo.delay for servo in result.servos])
                write_servo_mjcf(result, path)
            else:
                report(f"fitting half {number} of 2 by {model}, which takes minutes")
                delay = np.asarray(write_by_toolbox(part, path, model == SYSID))
            found += [_apart(path, given, log, delay) for log in own]
    return found


def _departed(robot: RobotModel, values: Identified, recordings: Recordings) -> _Part:
    """Errors of a model driven by force, over every horizon and one row, and the log's changes."""
    errors = [departures(robot, values, recordings, h) for h in (*HORIZONS, 0.0)]
    if not len(errors[1]):
        expected = f"a segment of {HORIZONS[1]:g} s"
        remedy = "Use a log without so many gaps."
        raise InvalidInput("log", expected, "shorter ones", remedy)
    return errors, np.concatenate([np.diff(s.log.q, axis=0) for s in recordings.segments])


def _fitted_arm(
    robot: RobotModel, recordings: Recordings, options: Options, model: str, report: Report
) -> list[_Part]:
    """Errors on each half of the logs, with the values identified from the other half."""
    segments = list(recordings.segments)
    if len(segments) == 1:
        (one,), half = segments, len(segments[0].log.t) // 2
        segments = [
            one._replace(log=one.log.part(*rows), usable=one.usable[slice(*rows)])
            for rows in ((0, half), (half, len(one.log.t)))
        ]
    found = []
    halves = segments[::2], segments[1::2]
    for number, (own, rest) in enumerate((halves, halves[::-1]), start=1):
        part = replace(recordings, segments=tuple(rest))
        if model == IDENTIFIED:
            fitted = calibrate(robot, part, options=options, report=report)
            values = identified(fitted)
            delays = [joint.delay for joint in fitted.joints]
        else:
            report(f"fitting half {number} of 2 by sysid, at most {Toolbox.BUDGET:g} CPU s")
            values, delays = by_toolbox(robot, part)
        late = tuple(delayed(segment, delays) for segment in own)
        found.append(_departed(robot, values, replace(recordings, segments=late)))
    return found


def _constant_velocity(recordings: Recordings) -> Score:
    """The score of a motion that keeps the velocity measured at the start of every horizon."""
    errors = []
    for horizon in HORIZONS:
        samples = max(1, round(min(horizon, 1e6) * recordings.rate))
        found = []
        for segment in recordings.segments:
            log = segment.log
            rows = np.arange(len(segment.log.t) - 1)
            start = rows - rows % samples
            ahead = (log.t[rows + 1] - log.t[start])[:, None]
            found.append(np.abs(log.q[start] + ahead * log.v[start] - log.q[rows + 1]))
        errors.append(np.concatenate(found).mean(axis=0))
    return Score("constant velocity", np.array(errors), np.full(errors[0].shape, np.nan), 0.0)


def by_toolbox(
    robot: RobotModel, recordings: Recordings, budget: float = Toolbox.BUDGET
) -> tuple[Identified, Array]:
    """The values that `mujoco.sysid` finds in logs, and (n,) delays of the commands [s].

    It fits links, rotors, viscous and Coulomb friction, and gains. Initial values are those of
    `nsaid identify`: the model file's links, and frictions and gains guessed from the log. The
    commands' delays and the speeds at which Coulomb friction saturates are also those of `nsaid
    identify`; they are not fitted. Joint parameters are searched between a tenth and ten times the
    initial value, within the budget of CPU time [s].

    Raises:
        NoEstimate: the toolbox is not installed, or no segment lasts half a second.
        UnusableLog: the logs cannot be used.
    """
    made = structured_arm(robot, recordings, None, Options(columns=BASIC), lambda _: None)
    space = made.problem.space
    n = len(robot.joints)
    prior = Prior(space, made.problem.prior, 0.0).draw(np.random.default_rng(0))
    speeds = np.array([joint.friction_speed for joint in made.velocities])
    one = np.ones(n)
    rotor, viscous, coulomb, gain = prior[-4 * n :].reshape(4, n)
    masses = prior[: -4 * n : 10]
    scales = JointScales(masses, np.ones_like(masses), viscous, coulomb, gain, one, one, rotor)
    system = JointTree.checked(robot.model, scales, speeds)
    logs = [delayed(s, made.delays).log for s in recordings.segments]
    sign = np.sign(robot.gain)
    logs = [log._replace(q=robot.system.position(log.q), u=log.u * sign) for log in logs]
    theta, _ = Toolbox().fitted(system, logs, prior, _NOISY, budget)
    rotor, viscous, coulomb, gain = theta[-4 * n :].reshape(4, n)
    model = with_inertias(robot.model, theta[: -4 * n].reshape(-1, 10), rotor)
    found = Identified(model, viscous, coulomb, speeds, gain * sign, "mujoco.sysid")
    return found, made.delays


def delayed(segment: LogSegment, delays: Sequence[float] | Array) -> LogSegment:
    """A segment whose commands arrive late, by (n,) delays [s]."""
    log = segment.log
    late = [np.interp(log.t - d, log.t, u) for d, u in zip(delays, log.u.T, strict=True)]
    return segment._replace(log=log._replace(u=np.column_stack(late)))
