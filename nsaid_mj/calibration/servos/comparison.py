"""Models of a servo arm, judged by what users count: how far they depart from logs, open loop."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...errors import BadRobot
from ...parameters import Array
from ...robot.mjcf_file import compile_file
from ...robot.mjcf_tree import joint_names
from .estimate import DELAYS, late
from .export import rollout, write_servo_mjcf
from .identify import ServoLogs, identify_servos, servos_in
from .logs import ServoLog

HORIZONS = (0.2, 2.0, np.inf)
"""Times after which a simulation starts again from the measured state [s]."""

IDENTIFIED = "identified"
"""Name of the model that is fitted to the logs: each half of them is predicted from the other."""


class Score(NamedTuple):
    """How well a model predicts logs.

    Attributes:
        model: its name.
        errors: (3, n) mean absolute error of each joint's position over each of `HORIZONS` [rad or
            m]; NaN where it is not defined.
        one_step: (n,) rms error of the position one row ahead over the rms change from row to row:
            1 is what predicting no change has.
        seconds: what fitting and simulating took [s].
    """

    model: str
    errors: Array
    one_step: Array
    seconds: float


def compare_models(
    given: ServoLogs,
    models: Sequence[str | Path],
    told: Callable[[str], None] = lambda _: None,
) -> tuple[Score, ...]:
    """Scores of models on logs of one arm, the last that of a target that is followed late.

    Args:
        given: the arm and its logs, without loads.
        models: MJCF files with a position servo on every joint of the arm, and `IDENTIFIED`.
        told: called with the name of every stage.

    Raises:
        BadRobot: a file lacks a joint or its servo.
        InvalidInput: a half of the logs is too short to be fitted.
    """
    scores = []
    for model in models:
        told(f"simulating {model}")
        begin = time.perf_counter()
        if str(model) == IDENTIFIED:
            parts = _identified(given, told)
        else:
            _check(Path(model), given.robot.joints)
            parts = [_apart(Path(model), given, log, None) for log in given.logs]
        errors, one_step = _score(parts)
        scores.append(Score(str(model), errors, one_step, time.perf_counter() - begin))
    return *scores, _followed_late(given)


def _check(path: Path, joints: Sequence[str]) -> None:
    """Checks that a file has a position servo on every joint."""
    names = joint_names(compile_file(path)[1])
    missing = [joint for joint in joints if joint not in names]
    if missing or servos_in(path, joints) is None:
        remedy = f"All models need a position servo on each of {', '.join(joints)}."
        raise BadRobot(str(path), ", ".join(missing), "a joint or its servo is missing", remedy)


def _apart(
    path: Path, given: ServoLogs, log: ServoLog, delay: Array | None
) -> tuple[list[Array], Array]:
    """Errors (N, n) of a log over every horizon and one row ahead, and its changes (N, n)."""
    horizons = (*HORIZONS, 0.0)
    errors = [
        (rollout(path, given.robot.joints, log, delay, h) - log.position)[1:] for h in horizons
    ]
    return errors, np.diff(log.position, axis=0)


def _score(parts: Sequence[tuple[list[Array], Array]]) -> tuple[Array, Array]:
    """(3, n) mean absolute errors and (n,) relative rms errors one row ahead."""
    *errors, ahead = (np.concatenate(each) for each in zip(*(e for e, _ in parts), strict=True))
    change = np.concatenate([c for _, c in parts])
    size = np.sqrt(np.mean(change**2, axis=0))
    ratio = np.sqrt(np.mean(ahead**2, axis=0)) / np.where(size > 0, size, np.nan)
    return np.array([np.abs(error).mean(axis=0) for error in errors]), ratio


def _identified(given: ServoLogs, told: Callable[[str], None]) -> list[tuple[list[Array], Array]]:
    """Errors of every log with the servos identified from the other half of the logs."""
    logs = list(given.logs)
    if len(logs) == 1:
        half = len(logs[0].t) // 2
        logs = [_part(logs[0], slice(None, half)), _part(logs[0], slice(half, None))]
    found = []
    for own, rest in ((logs[::2], logs[1::2]), (logs[1::2], logs[::2])):
        result = identify_servos(given._replace(logs=tuple(rest)), told)
        delays = np.array([servo.delay for servo in result.servos])
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "identified.xml")
            write_servo_mjcf(result, path)
            found += [_apart(path, given, log, delays) for log in own]
    return found


def _part(log: ServoLog, rows: slice) -> ServoLog:
    """A part of a log."""
    q, u, load, inertia = (x[rows] for x in (log.position, log.target, log.load, log.inertia))
    return ServoLog(log.source, log.t[rows], u, q, load, inertia)


def _followed_late(given: ServoLogs) -> Score:
    """The score of the target itself, at the delay that suits each joint best."""
    found, used = [], np.ones(sum(len(log.t) for log in given.logs))
    for j in range(len(given.robot.joints)):
        joint = [log.joint(j) for log in given.logs]
        found.append(min(late(joint, used, delay) for delay in DELAYS))
    errors = np.full((len(HORIZONS), len(found)), np.nan)
    errors[-1] = found
    return Score("the target, late", errors, np.full(len(found), np.nan), 0.0)
