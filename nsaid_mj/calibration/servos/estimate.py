"""All joints of a servo arm: fits, windows with foreign forces, covariances, the origin of kp."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from ...parameters import Array, Indices
from ...structure.joints import moving_joints, slides
from ..data import RobotModel
from ..findings import Finding
from ..payloads import Load
from ..problem import Mask
from .covariance import OFFSET, clusters, covariance_of, zeros
from .effects import effects_of
from .fit import GRAVITY, JointFit, OutputError, Prior, minimise, undisturbed
from .logs import ServoLog, weighed, without_armature
from .simulation import JointLog, simulate
from .start import start
from .weighing import Weighed, weigh

_DELAY = 0.015  # before the log [s]
_SPREAD = np.array([3.0, 3.0, 3.0, 1.0, 1.5])
# standard deviations of ln θ before the log: T, f and g nearly free; a within a factor of 7 of that
# of a critically damped servo, T²/4, and delays of serial buses within 20
_SWEEPS = 8  # at most, over all joints, with the loads of the others' simulated motion
_SETTLED = 0.2  # change of that motion, over the residual, at which they end
_KNOWN = 0.25  # deviation of ln g, and its change with play, below which gravity determines kp
_PRIOR_DEGREES = 4.0  # of freedom that the other joints' variances add
_UNTOLD = 2.0  # standard deviation of ln θ above which a joint says nothing of the others
_SATURATES = 0.97  # largest robust residual with a limit of force over that without, to accept it
UNITS = ("mrad", "mm")  # of a thousandth of a hinge's and a slide's position
DELAYS = np.arange(0.0, 0.31, 0.01)  # of a target that follows perfectly [s]


class JointEstimate(NamedTuple):
    """The estimate of one servo.

    Attributes:
        x: (5,) ln θ̂ of T [s], f [rad], g [rad/(N·m)], a [s²], d [s].
        covariance: (5, 5) of ln θ̂, from scores clustered by log or block; 0 for fixed ones.
        quantile: of Student's t, which turns deviations into 95 % intervals.
        gravity: whether gravity determines kp; otherwise it is a convention.
        offset: change of ln kp by an offset between the zeros of target and position, which is part
            of the covariance.
        error: mean absolute residual [rad or m], of the samples in use.
        simple: the same without a model: the target at the best delay, or a constant position,
            whichever is closer.
        scaled: standard deviation of ln kp under the true masses, or under the file's if no load
            was weighed.
        zero: the offset [rad or m].
        limit: force or torque at which the servo saturated in the logs [N·m or N]; inf if it did
            not.
        slides: whether the joint is a slide, whose f is in m and whose g is in m/N.
    """

    x: Array
    covariance: Array
    quantile: float
    gravity: bool
    offset: float
    error: float
    simple: float
    scaled: float
    zero: float = OFFSET
    limit: float = np.inf
    slides: bool = False

    @property
    def theta(self) -> Array:
        """(5,) θ̂."""
        return np.exp(self.x)

    @property
    def unit(self) -> str:
        """Unit of a thousandth of its position."""
        return UNITS[self.slides]


class MassScale(NamedTuple):
    """The common scale, from a load.

    Attributes:
        log: ln s of the true masses over those of the model file.
        deviation: its standard deviation.
        quantile: of Student's t.
        place: (3,) of the load's centre in the frame of the joint that carries it [m].
        deviations: (3,) of the place [m]; 0 where it was known.
    """

    log: float
    deviation: float
    quantile: float
    place: Array
    deviations: Array


class Estimate(NamedTuple):
    """The estimate of an arm.

    Attributes:
        joints: of every joint, under the masses of the model file.
        used: (N,) 1 of samples in use, 0 of masked ones, of the logs in their order.
        scale: of the masses; None without a load.
        findings: effects beyond the servos' equation.
    """

    joints: tuple[JointEstimate, ...]
    used: Array
    scale: MassScale | None
    findings: tuple[Finding, ...] = ()


def estimate(
    robot: RobotModel,
    logs: Sequence[ServoLog],
    kp: Array,
    told: Callable[[str], None] = lambda _: None,
    load: Load | None = None,
    limits: Array | None = None,
) -> Estimate:
    """Fits every joint alone, masks windows with foreign forces, and fits again.

    Where gravity does not determine kp, it is the geometric mean over the joints where it does, or
    the model file's if there are none. Logs with a load are fitted after the free ones, together.

    Args:
        robot: the model.
        logs: at least one; free ones come before those with a load.
        kp: (n,) of the model file [N·m/rad or N/m].
        told: called with the name of every stage.
        load: that the loaded logs carry.
        limits: (n,) largest force of every servo by the model file [N·m or N], used where the logs
            show it; None without.
    """
    free = [log for log in logs if not log.loaded]
    loaded = [log for log in logs if log.loaded]
    limits = np.full(len(kp), np.inf) if limits is None else limits
    slide = [slides(joint) for joint in moving_joints(robot.model)]
    fitted = _free_of_loads(robot, free, limits, told)
    free, fits, priors, used = fitted
    if load is not None:
        told("weighing the load")
        loaded = [log._replace(limit=free[0].limit) for log in loaded]
        rest = np.ones(sum(len(log.t) for log in loaded))
        found = weigh(robot, [*free, *loaded], load, fits, priors, np.append(used, rest))
        return _with_load(found, [*free, *loaded], kp, slide)
    cluster, zero = clusters(logs), zeros(logs)
    simulated = [fitted.simulated(j) for j in range(len(kp))]
    spread = [
        covariance_of(own, fit, prior, cluster, zero[[j]])
        for j, (own, fit, prior) in enumerate(zip(simulated, fits, priors, strict=True))
    ]
    known = np.array([_reveals(C[GRAVITY, GRAVITY], moved[GRAVITY, 1]) for C, moved in spread])
    common = _common(fits, known, kp)
    for j in np.flatnonzero(~known):
        mean, deviation = priors[j].mean.copy(), priors[j].deviation.copy()
        mean[GRAVITY], deviation[GRAVITY] = common[j], 0.0
        priors[j] = Prior(mean, deviation)
        fits[j] = minimise(simulated[j], fits[j].x, priors[j])
    judged, effects = [], []
    for j, (own, fit, prior) in enumerate(zip(simulated, fits, priors, strict=True)):
        covariance, offset = covariance_of(own, fit, prior, cluster, zero[[j]])
        change, sure = float(offset[GRAVITY, 0]), bool(known[j])
        one = _judged(own.logs, fit, sure, used, cluster, covariance, change)
        judged.append(one._replace(zero=float(zero[j]), slides=slide[j]))
        effects += effects_of(robot.joints[j], UNITS[slide[j]], own, fit, prior, cluster)
    return Estimate(_moderated(judged, cluster), used, None, tuple(effects))


class _Fitted(NamedTuple):
    """Fits of every joint to the free logs.

    Attributes:
        logs: with the loads of their simulated motion.
        fits: of every joint.
        priors: of its parameters.
        used: (N,) 1 of samples in use.
    """

    logs: list[ServoLog]
    fits: list[OutputError]
    priors: list[Prior]
    used: Array

    def simulated(self, j: int) -> JointFit:
        """The simulation of a joint."""
        return JointFit([log.joint(j) for log in self.logs], self.used)

    def refitted(self, logs: list[ServoLog]) -> _Fitted:
        """Fits to the logs with other loads or limits."""
        found = self._replace(logs=logs)
        fits = [
            minimise(found.simulated(j), fit.x, prior)
            for j, (fit, prior) in enumerate(zip(self.fits, self.priors, strict=True))
        ]
        return found._replace(fits=fits)


def _free_of_loads(
    robot: RobotModel,
    logs: list[ServoLog],
    limits: Array,
    told: Callable[[str], None],
) -> _Fitted:
    """Fits of all joints to the free logs, without windows of foreign forces."""
    told("fitting every servo alone")
    found = _Fitted(logs, [], [], np.ones(sum(len(log.t) for log in logs)))
    for j in range(len(limits)):
        own = found.simulated(j)
        first = np.log(start(own.logs))
        guess = np.r_[first[:3], 2 * first[0] - np.log(4), np.log(_DELAY)]
        found.priors.append(Prior(guess, _SPREAD))
        found.fits.append(minimise(own, first, found.priors[-1]))
    used = found.used
    for j, fit in enumerate(found.fits):
        used = used * undisturbed(found.simulated(j).logs, fit.residual, fit.sigma)
    told("fitting all servos together, without foreign forces")
    found = _together(robot, found._replace(used=used))
    limited = _saturated(found, limits)
    if np.isfinite(limited).any():
        found = found.refitted([log._replace(limit=limited) for log in found.logs])
        found = _together(robot, found)
    return found


def _together(robot: RobotModel, found: _Fitted) -> _Fitted:
    """The fits with the loads of all joints' simulated motion, until that settles."""
    model, before = without_armature(robot.model), np.inf
    for _ in range(_SWEEPS):
        thetas = [np.exp(fit.x) for fit in found.fits]
        moved = [
            np.column_stack([simulate(log.joint(j), theta) for j, theta in enumerate(thetas)])
            for log in found.logs
        ]
        change = np.sqrt(np.mean((np.concatenate(moved) - before) ** 2, axis=0))
        if np.all(change < [_SETTLED * fit.sigma for fit in found.fits]):
            break
        before = np.concatenate(moved)
        found = found.refitted(
            [weighed(model, log, q) for log, q in zip(found.logs, moved, strict=True)]
        )
    return found


def _saturated(found: _Fitted, limits: Array) -> Array:
    """(n,) limits of the servos' forces [N·m or N] where the logs show them; else inf.

    Model files state limits that the servo does not have, so a limit must lower the residual.
    """
    out, logs = np.full(len(limits), np.inf), [log._replace(limit=limits) for log in found.logs]
    limited = found._replace(logs=logs)
    for j, fit in enumerate(found.fits):
        own = limited.simulated(j)
        if np.isinf(limits[j]) or np.array_equal(own.residual(fit.x), fit.residual):
            continue
        if minimise(own, fit.x, found.priors[j]).sigma < _SATURATES * fit.sigma:
            out[j] = limits[j]
    return out


def _reveals(variance: float, play: float) -> bool:
    """Whether gravity determines ln kp: by its variance, and by its change with play of the gear.

    A joint that carries little weight sinks by its gear's play, which looks like a soft servo.
    """
    return bool(max(np.sqrt(variance), abs(play)) < _KNOWN)


def _common(fits: Sequence[OutputError], known: Mask, kp: Array) -> Array:
    """(n,) ln g where gravity does not determine it: the others' mean, or the model file's."""
    g = [fit.x[GRAVITY] for fit, sure in zip(fits, known, strict=True) if sure]
    return np.full(len(kp), float(np.mean(g))) if g else np.asarray(-np.log(kp), np.float64)


def _with_load(
    found: Weighed, logs: Sequence[ServoLog], kp: Array, slide: Sequence[bool]
) -> Estimate:
    """The estimate of all joints and of the scale, from their common fit."""
    n, fit, own = len(kp), found.fit, found.arm.logs(found.fit.x)
    cluster = clusters(logs)
    zero = zeros(logs)
    whole, moved = covariance_of(found.arm, fit, found.prior, np.tile(cluster, n), zero)
    pairs = [found.joint(j) for j in range(n)]
    at = np.arange(n) * len(pairs[0][0].x)
    known = np.array([
        _reveals(whole[k, k], moved[k, n + j]) for j, k in enumerate((at + GRAVITY).tolist())
    ])  # fmt: skip
    common, joints, scale = _common([f for f, _ in pairs], known, kp), [], len(fit.x) - 4
    for j, (one, _) in enumerate(pairs):
        logs_of, place = [log.joint(j) for log in own], slice(at[j], at[j] + len(one.x))
        if not known[j]:
            one.x[GRAVITY] = common[j]
        apart = np.zeros(len(fit.x))  # ln kp = ln s − ln g = ln m − ln μ − ln g
        apart[[at[j] + GRAVITY, scale]] = 1.0
        offset = float(moved[at[j] + GRAVITY, j]) if known[j] else 0.0
        made = _judged(
            logs_of, one, bool(known[j]), found.used, cluster, whole[place, place], offset
        )
        scaled = float(np.sqrt(apart @ whole @ apart))
        joints.append(made._replace(scaled=scaled, zero=float(zero[j]), slides=slide[j]))
    deviation = np.sqrt(np.diag(whole)[scale:])
    return Estimate(
        _moderated(joints, cluster),
        found.used,
        MassScale(
            float(found.prior.mean[scale] - fit.x[scale]),
            float(deviation[0]),
            joints[0].quantile,
            fit.x[scale + 1 :],
            deviation[1:],
        ),
    )


def _moderated(joints: Sequence[JointEstimate], cluster: Indices) -> tuple[JointEstimate, ...]:
    """Estimates whose variances are not too small by chance, because of few clusters.

    A variance from five logs is off by a factor of two or more. The servos of an arm are alike, so
    the mean of their variances is known better: it counts as four further degrees of
    freedom (Smyth, Statistical Applications in Genetics and Molecular Biology 3(1), 2004), where it
    is larger. kp is left as it is: gravity differs from joint to joint.
    """
    own = np.array([np.diag(joint.covariance) for joint in joints])
    told = (own > 0) & (own < _UNTOLD**2)
    mean = np.where(told, own, 0.0).sum(axis=0) / np.maximum(told.sum(axis=0), 1)
    degrees = float(cluster.max())
    wider = (degrees * own + _PRIOR_DEGREES * mean) / (degrees + _PRIOR_DEGREES)
    factor = np.sqrt(np.where(own > 0, np.maximum(wider, own) / np.maximum(own, 1e-300), 1.0))
    factor[:, GRAVITY] = 1.0
    return tuple(
        joint._replace(covariance=joint.covariance * np.outer(f, f))
        for joint, f in zip(joints, factor, strict=True)
    )


def _judged(
    logs: Sequence[JointLog],
    fit: OutputError,
    gravity: bool,
    used: Array,
    cluster: Indices,
    covariance: Array,
    offset: float,
) -> JointEstimate:
    """An estimate with its covariance, and the error of predictions without a model."""
    position = np.concatenate([log.position for log in logs])
    constant = np.abs(position - np.median(position[used > 0])) @ used / used.sum()
    best = min(late(logs, used, delay) for delay in DELAYS)
    return JointEstimate(
        fit.x,
        covariance,
        float(stats.t.ppf(0.975, max(int(cluster.max()), 1))),
        gravity,
        offset,
        float(np.abs(fit.residual) @ used / used.sum()),
        min(best, float(constant)),
        float(np.sqrt(covariance[GRAVITY, GRAVITY])),
        limit=logs[0].limit,
    )


def late(logs: Sequence[JointLog], used: Array, delay: float) -> float:
    """Mean absolute error of the target at a delay [rad or m], of the samples (N,) in use."""
    errors = [
        log.target[np.clip(np.searchsorted(log.t, log.t - delay, side="right") - 1, 0, None)]
        - log.position
        for log in logs
    ]
    return float(np.abs(np.concatenate(errors)) @ used / used.sum())
