"""What a log says for or against a hypothesis: how well a model's forces explain its commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from ...base import pin
from ...core import Array
from ...robots import RobotModel
from . import signals
from .recordings import Recordings

_ROWS = 800  # at most, for the model's forces
DELAYS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16)  # of commands, common to all joints [s]
EXACT = 0.005  # relative error of forces below which hypotheses are equally good
_PARSIMONY = 0.4  # handicap [log of the error] of a command of the other sign


@dataclass(frozen=True)
class LogMotion:
    """All segments in one piece, low-passed alike.

    Attributes:
        q: (N, n) positions.
        slopes: (N, n) their derivatives.
        v: (N, n) velocities.
        a: (N, n) derivatives of the velocities.
        u: (N, n_u) commands.
        usable: (N, n) whether a row may be used.
        file: (N,) name of the file of each row.
        segment: (N,) number of the segment of each row.
        rate: rows per second [Hz].
    """

    q: Array
    slopes: Array
    v: Array
    a: Array
    u: Array
    usable: np.ndarray
    file: np.ndarray
    segment: np.ndarray
    rate: float

    def part(self, rows: np.ndarray) -> LogMotion:
        """The motion of some rows, as a mask or a slice."""
        own = {k: x[rows] for k, x in vars(self).items() if k != "rate"}
        return replace(self, **own)


def motion_of(recordings: Recordings, scale: float = 4.0) -> LogMotion:
    """The motion, filtered at a multiple of the frequency of the positions themselves.

    The band follows the log's own clock, right or wrong. `scale` is the multiple.
    """
    rate = recordings.rate
    logs = [segment.log for segment in recordings.segments]
    cut = min(max(scale * _frequency([log.q for log in logs], rate), 20 / _longest(logs)), rate / 5)
    parts = []
    for number_, segment in enumerate(recordings.segments):
        _, q, v, u = segment.log
        slopes = v if q.shape[1] != v.shape[1] else np.gradient(q, 1 / rate, axis=0)
        soft = [signals.low_pass(x, cut / (0.5 * rate)) for x in (slopes, v, u)]
        a = np.gradient(soft[1], 1 / rate, axis=0)
        of = np.full(len(q), segment.source), np.full(len(q), number_)
        parts.append((q, *soft[:2], a, soft[2], segment.usable, *of))
    return LogMotion(*(np.concatenate(part) for part in zip(*parts, strict=True)), rate=rate)


def _longest(logs: Sequence[Any]) -> float:
    return max(float(log.t[-1] - log.t[0]) for log in logs)


def _frequency(paths: Sequence[Array], rate: float) -> float:
    """The largest frequency, over the coordinates, below which 99 % of their power lies [Hz]."""
    q = max(paths, key=len)
    window = np.hanning(len(q))[:, None]
    power = np.abs(np.fft.rfft(scipy.signal.detrend(q, axis=0) * window, axis=0)) ** 2
    share = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
    bins = np.array([np.searchsorted(column, 0.99) for column in share.T])
    return float(np.median(bins) * rate / len(q))


def limits(robot: RobotModel, name: str) -> tuple[float, float, float]:
    """Lowest and highest position and largest speed of a joint; infinite without a limit."""
    model = robot.model
    joint = model.joints[model.getJointId(name)]
    if joint.nq != 1:
        return -np.inf, np.inf, 6.0
    low = float(model.lowerPositionLimit[joint.idx_q])
    high = float(model.upperPositionLimit[joint.idx_q])
    fastest = float(model.velocityLimit[joint.idx_v])
    bounded = high > low and high - low < 1e3
    return (
        low if bounded else -np.inf,
        high if bounded else np.inf,
        fastest if 0 < fastest < 1e3 else 6.0,
    )


def multiplied(what: str, joints: Sequence[int], factor: float) -> Callable[[LogMotion], LogMotion]:
    """The motion with positions or velocities of some joints multiplied by a factor."""

    def apply(motion: LogMotion) -> LogMotion:
        scale = np.ones(motion.v.shape[1])
        scale[list(joints)] = factor
        if what == "position":
            return replace(motion, q=motion.q * scale, slopes=motion.slopes * scale)
        return replace(motion, v=motion.v * scale, a=motion.a * scale)

    return apply


def scaled(joints: Sequence[int], factor: float, motion: LogMotion) -> LogMotion:
    """The motion with positions and velocities of some joints multiplied by a factor."""
    return multiplied("position", joints, factor)(multiplied("velocity", joints, factor)(motion))


def correlation(a: Array, b: Array) -> Array:
    """(k, l) correlation of columns of a (N, k) with columns of b (N, l); 0 for constant ones."""
    centred = [x - x.mean(axis=0) for x in (a, b)]
    sizes = [np.linalg.norm(x, axis=0) for x in centred]
    dot = centred[0].T @ centred[1]
    scale = np.outer(*sizes)
    return np.divide(dot, scale, out=np.zeros_like(dot), where=scale > 0)


def forces_of(
    robot: RobotModel, motion: LogMotion, gravity: Array | None = None
) -> tuple[Array, Array]:
    """(N, n) weight and (N, n) inertial forces of the model's links along a motion."""
    model = robot.model
    if gravity is not None:
        model = pin.Model(model)
        model.gravity = pin.Motion(gravity, np.zeros(3))
    data = model.createData()
    whole = np.empty(motion.v.shape)
    weight = np.empty(motion.v.shape)
    rows = zip(robot.system.position(motion.q), motion.v, motion.a, strict=True)
    for k, (q, v, a) in enumerate(rows):
        whole[k] = pin.rnea(model, data, q, v, a)
        weight[k] = pin.computeGeneralizedGravity(model, data, q)
    return weight, whole - weight


def thinned(motion: LogMotion) -> tuple[np.ndarray, LogMotion]:
    """At most so many rows that the model's forces take little time, and their motion."""
    rows = np.arange(0, len(motion.q), max(1, len(motion.q) // _ROWS))
    return rows, motion.part(rows)


def late(motion: LogMotion, joint: int, delay: float, rows: np.ndarray) -> Array:
    """Commands (k,) of a joint that act after a delay [s], at some rows (k,)."""
    before = np.maximum(rows - round(delay * motion.rate), 0)
    before = np.where(motion.segment[before] == motion.segment[rows], before, rows)
    return np.asarray(motion.u[before, joint])


def columns_of(motion: LogMotion, joint: int) -> list[Array]:
    """Acceleration, velocity and direction (N,) of a joint: rotor and friction."""
    v = motion.v[:, joint]
    size = max(float(np.sqrt(np.mean(v**2))), 1e-12)
    return [motion.a[:, joint], v, np.tanh(v / (0.1 * size))]


class Explained:
    """Least squares of commands by a constant, columns times positive numbers, and free columns."""

    def __init__(self, columns: Sequence[Array], free: Sequence[Array] = ()):
        X = np.column_stack([*columns, *free, *(-x for x in free)])
        X = X - X.mean(axis=0)
        size = np.sqrt(np.mean(X**2, axis=0))
        self._Q, self._R = np.linalg.qr(X[:, size > 0] / size[size > 0])

    def error(self, u: Array, sign: int) -> float:
        """What is left of sign · u (N,), as a share of its deviation."""
        y = u - u.mean()
        total = float(np.sqrt(np.sum(y**2)))
        if total <= 0:
            return np.nan
        along = self._Q.T @ (y / total)
        left = scipy.optimize.nnls(self._R, sign * along)[1]
        return float(np.sqrt(max(1 - along @ along + left**2, 0.0)))


def driven_joints(robot: RobotModel, motion: LogMotion) -> list[int]:
    """Joints with a motor, a command that changes, and enough rows."""
    return [
        j
        for j, name in enumerate(robot.joints)
        if name not in robot.passive
        and motion.usable[:, j].sum() > 50
        and np.std(motion.u[motion.usable[:, j], j]) > 0  # 0 also where its squares underflow
    ]


def misfit(
    robot: RobotModel,
    motion: LogMotion,
    handicap: float = _PARSIMONY,
    gravity: Array | None = None,
) -> float:
    """Geometric mean, over the joints, of the commands' errors under the model's links.

    A command may have any gain and constant, its joint friction and a rotor. The ratio of weight
    and inertia is the model's. A command of the other sign has a `handicap` [log of the error].
    NaN of a robot without masses, or if nothing moves.
    """
    if robot.weightless:
        return np.nan
    joints = driven_joints(robot, motion)
    if not joints:
        return np.nan
    rows, few = thinned(motion)
    force = np.sum(forces_of(robot, few, gravity), axis=0)
    turned = np.exp(handicap)
    errors = np.full((len(DELAYS), len(joints)), np.nan)
    for k, j in enumerate(joints):
        use = few.usable[:, j]
        model = Explained([x[use] for x in (force[:, j], *columns_of(few, j))])
        for d, delay in enumerate(DELAYS):
            u = late(motion, j, delay, rows[use])
            errors[d, k] = min(model.error(u, 1), turned * model.error(u, -1))
    if np.isnan(errors).all():
        return np.nan
    return float(np.exp(np.nanmean(np.log(np.maximum(errors, EXACT)), axis=1).min()))
