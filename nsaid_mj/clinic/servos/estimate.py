"""Estimates of all joints of a servo arm: fits, covariances, and the source of kp."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...base import Finding
from ...core import Array, Indices
from ..identify.choose.servo_effects import effects_of
from ..identify.problem import Mask
from .fit import (
    DAMPING,
    DELAY,
    FRICTION,
    GRAVITY,
    OFFSET,
    JointFit,
    OutputError,
    ServoPrior,
    clusters,
    minimise,
    spreads,
    zeros,
)
from .joint_fits import Arm, JointFits, fit_free, weigh
from .logs import DELAYS, TRAVEL, ServoLog, ServoLogs, late
from .simulation import JointLog

_KNOWN = 0.25  # deviation of ln g, and its change with play, below which gravity determines kp
_LEAST_SAG = 0.25  # variation of a joint's sinking under its load, over the deviation of its zero
_CONTRADICTS = 0.8  # residual with an own kp over that with the others' mean, below which it stays
UNITS = ("mrad", "mm")  # of a thousandth of a hinge's and a slide's position
_NEARLY = 0.8  # error over that of a simple prediction, above which the model explains nothing
_STILL = 1e-3  # error of a simple prediction for a joint that hardly moves [rad or m]


class JointEstimate(NamedTuple):
    """The estimate of one servo."""

    name: str  # name of the joint
    x: Array  # (5,) ln θ̂ of T [s], f [rad], g [rad/(N·m)], a [s²], d [s]
    # (5, 5) covariance of ln θ̂, by differences between logs or blocks; 0 for fixed ones. If a load
    # was weighed, g is that under the true masses
    covariance: Array
    # (6,) quantiles of Student's t, which turn deviations of T, f, kp, a, d and T + d into 95 %
    # intervals
    quantile: Array
    gravity: bool  # whether gravity determines kp; otherwise kp is a convention
    # change of ln kp by an offset between the zeros of target and position, which is part of the
    # covariance
    offset: float
    error: float  # mean absolute residual [rad or m], of the samples in use
    # the same without a model: the target at the best delay, or a constant position, whichever is
    # closer
    simple: float
    zero: float = OFFSET  # the offset [rad or m]
    limit: float = np.inf  # at which the servo saturated [N·m or N]; inf if it did not
    slides: bool = False  # whether the joint is a slide, whose f is in m and whose g is in m/N
    travel: float = np.inf  # between its extreme positions [rad or m]
    without: Array = np.zeros((0, 5))  # (G, 5) change of ln θ̂ without each log or block

    @property
    def judged(self) -> bool:
        """Whether it moves enough for a comparison of the model with a simple prediction."""
        return self.simple > _STILL

    @property
    def poor(self) -> bool:
        """Whether a simple prediction is nearly as good as the model."""
        return self.judged and self.error > self.nearly

    @property
    def nearly(self) -> float:
        """Error above which a simple prediction is nearly as good [rad or m]."""
        return _NEARLY * self.simple

    @property
    def theta(self) -> Array:
        """(5,) θ̂."""
        return np.exp(self.x)

    @property
    def unit(self) -> str:
        """Unit of a thousandth of its position."""
        return UNITS[self.slides]

    def widened(self, place: int, deviation: float) -> JointEstimate:
        """The estimate with a further deviation of one entry of θ, in that entry's unit."""
        covariance = self.covariance.copy()
        covariance[place, place] += (deviation / self.theta[place]) ** 2
        return self._replace(covariance=covariance)


class MassScale(NamedTuple):
    """The common scale, from a load."""

    log: float  # ln s of the true masses over those of the model file
    deviation: float  # its standard deviation
    quantile: float  # quantile of Student's t
    place: Array  # (3,) the load's centre of mass in the frame of the joint that carries it [m]
    deviations: Array  # (3,) standard deviations of the place [m]; 0 where it was known


class ArmEstimate(NamedTuple):
    """The estimate of an arm."""

    joints: tuple[JointEstimate, ...]  # estimates of all joints, under the masses of the model file
    used: Array  # (N,) 1 of samples in use, 0 of masked ones, of the logs in their order
    scale: MassScale | None  # scale of the masses; None without a load
    findings: tuple[Finding, ...] = ()  # effects beyond the servos' equation


def estimate(given: ServoLogs, report: Callable[[str], None] = lambda _: None) -> ArmEstimate:
    """Fits every joint alone, masks windows with external forces, and fits again.

    Where gravity does not determine kp, it is the geometric mean over the joints where it does, or
    the model file's if there are none, unless the residual is then larger. Logs with a load are
    fitted after the free ones, together. The model file's largest forces apply where the logs show
    them. `report` is called with the name of every stage.
    """
    robot = given.robot
    logs = given.logs
    limits = np.asarray(robot.limits, dtype=np.float64)
    fitted = fit_free([log for log in logs if not log.loaded], limits, report)
    if given.load is not None:
        report("weighing the load")
        return _with_load(*weigh(given, fitted), given)
    cluster = clusters(logs)
    zero = zeros(logs)
    slide = robot.system.slides
    known = _with_kp(fitted, given, cluster, zero)
    judged = []
    effects = []
    spread = spreads(fitted.fits, cluster, zero[:, None])
    for j, (fit, found) in enumerate(zip(fitted.fits, spread, strict=True)):
        one = _judged(
            robot.joints[j],
            fit.of.logs,
            fit.x,
            fit.residual,
            fitted.used,
            covariance=found.covariance,
            quantile=np.array([found.quantile(c) for c in _directions(fit.x)]),
            gravity=bool(known[j]),
            offset=float(found.moved[GRAVITY, 0]),
            zero=float(zero[j]),
            slides=slide[j],
            without=found.without,
        )
        if not one.poor:
            named = effects_of(one.name, one.unit, fit, cluster)
            effects += named
            effects += _play(one, *found.play)
            for effect in named:
                one = one.widened(FRICTION, 0.25 * _change(effect, fit))  # half of what it changes
        judged.append(one)
    return ArmEstimate(tuple(judged), fitted.used, None, tuple(effects))


def _change(effect: Finding, fit: OutputError[JointFit]) -> float:
    """Change of a joint's friction over kp by an effect, with speed or by its mean load."""
    size = float(effect.data["size"])  # type: ignore[arg-type]
    if effect.data["effect"] != "load":
        return size
    load = np.concatenate([log.load for log in fit.of.logs])
    return size * float(np.exp(fit.x[GRAVITY]) * np.abs(load).mean())


_PLACES = (
    "beyond the motor's encoder",
    "between the servo's encoder and the log's",
    "within the servo's loop, before its encoder",
)


def _play(joint: JointEstimate, place: int, width: float) -> list[Finding]:
    """Reports play of a width [rad or m] in a joint's gear, at one of `_PLACES`."""
    if not width > joint.zero:  # less cannot be told from the encoder's steps
        return []
    size = f"{1e3 * width:.2g} {joint.unit}"
    text = f"its gear has play of about {size}, {_PLACES[place]}; intervals include what twice as "
    text += "much would change"
    remedy = "The exported servo has none, and imitates it by its other numbers."
    data = {"place": _PLACES[place], "width": width}
    return [Finding("note", "play", joint.name, text, remedy, data)]


def _with_kp(fitted: JointFits, given: ServoLogs, cluster: Indices, zero: Array) -> Mask:
    """(n,) joints whose kp gravity determines; in `fitted`, the others are refitted with theirs."""
    fits = fitted.fits
    spread = spreads(fits, cluster, zero[:, None])
    known = np.zeros(len(fits), dtype=bool)
    for j, (of, fit) in enumerate(zip(spread, fits, strict=True)):
        error, simple, travel = _errors(fit.of.logs, fit.residual, fitted.used)
        follows = travel > TRAVEL and not (simple > _STILL and error > _NEARLY * simple)
        known[j] = follows and _reveals(of.covariance[GRAVITY, GRAVITY], of.moved[GRAVITY, 1])
    x = np.array([fit.x for fit in fits])
    known &= _sag(given.logs, x) > _LEAST_SAG * zero
    common = _common(x, known, given.kp)
    for j in np.flatnonzero(~known):
        prior = ServoPrior(fits[j].prior.mean.copy(), fits[j].prior.deviation.copy())
        prior.mean[GRAVITY] = common[j]
        prior.deviation[GRAVITY] = 0.0
        fixed = minimise(fits[j].of, fits[j].x, prior)
        unsure = spread[j].covariance[GRAVITY, GRAVITY] > (2 * _KNOWN) ** 2
        if unsure or fits[j].sigma > _CONTRADICTS * fixed.sigma:
            fits[j] = fixed  # else the links' inertia reveals that kp is another
    return known


def _directions(x: Array) -> Array:
    """(6, 5) combinations of x (5,): its entries, and T + d."""
    return np.vstack([np.eye(5), [np.exp(x[DAMPING]), 0.0, 0.0, 0.0, np.exp(x[DELAY])]])


def _reveals(variance: float, play: float) -> bool:
    """Whether gravity determines ln kp, judging by its variance and its sensitivity to backlash.

    A lightly loaded joint sinks by its gear's backlash, which resembles a soft servo.
    """
    return bool(max(np.sqrt(variance), abs(play)) < _KNOWN)


def _sag(logs: Sequence[ServoLog], x: Array) -> Array:
    """(n,) variation of the joints' deflection under gravity along logs [rad or m], at x (n, 5)."""
    load = np.concatenate([log.load for log in logs])
    return np.exp(x[:, GRAVITY]) * load.std(axis=0)


def _common(x: Array, known: Mask, kp: Array) -> Array:
    """(n,) ln g where gravity does not determine it: the others' mean, or the model file's."""
    g = x[known, GRAVITY]
    return np.full(len(kp), g.mean()) if len(g) else -np.log(kp)


def _with_load(fit: OutputError[Arm], used: Array, given: ServoLogs) -> ArmEstimate:
    """The estimate of all joints and of the scale, from their common fit."""
    n = len(given.kp)
    arm = fit.of
    own = fit.of.logs(fit.x)
    cluster = clusters(given.logs)
    zero = zeros(given.logs)
    slide = given.robot.system.slides
    (spread,) = spreads([fit], np.tile(cluster, n), [zero])
    whole = spread.covariance
    moved = spread.moved
    x = fit.x[:-4].reshape(n, -1).copy()
    residuals = fit.residual.reshape(n, -1)
    at = np.arange(n) * x.shape[1]
    known = np.array(
        [_reveals(whole[k, k], moved[k, n + j]) for j, k in enumerate((at + GRAVITY).tolist())]
    )
    known &= _sag(given.logs, x) > _LEAST_SAG * zero
    x[~known, GRAVITY] = _common(x, known, given.kp)[~known]
    joints = []
    scale = len(fit.x) - 4
    for j, one in enumerate(x):
        directions = np.zeros((6, len(fit.x)))
        directions[:, at[j] : at[j] + len(one)] = _directions(one)
        directions[GRAVITY, scale] = 1.0  # −ln kp = ln g + ln μ − ln m
        made = _judged(
            given.robot.joints[j],
            [log.joint(j) for log in own],
            one,
            residuals[j] * arm.unit[j],
            used,
            covariance=directions[:5] @ whole @ directions[:5].T,
            quantile=np.array([spread.quantile(c) for c in directions]),
            gravity=bool(known[j]),
            offset=float(moved[at[j] + GRAVITY, j]) if known[j] else 0.0,
            zero=float(zero[j]),
            slides=slide[j],
        )
        joints.append(made)
    deviation = np.sqrt(np.diag(whole)[scale:])
    quantile = spread.quantile(np.eye(len(fit.x))[scale])
    log = float(fit.prior.mean[scale] - fit.x[scale])
    mass = MassScale(log, float(deviation[0]), quantile, fit.x[scale + 1 :], deviation[1:])
    return ArmEstimate(tuple(joints), used, mass)


def _judged(
    name: str, logs: Sequence[JointLog], x: Array, residual: Array, used: Array, **own: Any
) -> JointEstimate:
    """An estimate x (5,) with its `own` figures, and the error of predictions without a model."""
    error, simple, travel = _errors(logs, residual, used)
    limit = logs[0].limit
    return JointEstimate(name, x, error=error, simple=simple, limit=limit, travel=travel, **own)


def _errors(logs: Sequence[JointLog], residual: Array, used: Array) -> tuple[float, float, float]:
    """Mean absolute error of a fit, that without a model, and the joint's travel [rad or m]."""
    position = np.concatenate([log.position for log in logs])
    constant = np.abs(position - np.median(position[used > 0])) @ used / used.sum()
    best = min(late(logs, used, delay) for delay in DELAYS)
    error = float(np.abs(residual) @ used / used.sum())
    return error, min(best, float(constant)), float(np.ptp(position))
