"""All joints of a servo arm: fits, windows with foreign forces, covariances, and kp's source."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from ...parameters import Array, Indices
from ..data import RobotModel
from .fit import GRAVITY, OutputError, Prior, minimise, undisturbed, weights
from .logs import ServoLog, coupled
from .simulation import JointLog, simulate
from .start import start

_GUESS = np.array([np.nan, np.nan, np.nan, 2e-3, 0.015])  # a [s²] and d [s]; others by regression
_SPREAD = np.array([3.0, 3.0, 3.0, 0.5, 1.5])
# standard deviations of ln θ before the log: T, f and g nearly free; published armatures of hobby
# servos over their kp lie within a factor of 2.7 of 2e-3 s², delays of serial buses within 20
_SWEEPS = 2  # over all joints, each with the loads of the others' simulated motion
_KNOWN = 0.25  # relative deviation of g below which gravity tells kp
_NUMERICAL = 0.01  # relative accuracy of the simulation itself, by arms with known servos
_FEWEST = 5  # logs that serve as clusters; fewer are cut into blocks
_BLOCK = 10.0  # shortest of them [s]
_BLOCKS = 20  # at most, in one log
_OFFSET = 2e-3  # standard deviation of the target's zero against the position's [rad or m]
_DELAYS = np.arange(0.0, 0.31, 0.01)  # of a target that follows perfectly [s]


class JointEstimate(NamedTuple):
    """What the logs say of one servo.

    Attributes:
        x: (5,) ln θ̂ of T [s], f [rad], g [rad/(N·m)], a [s²], d [s].
        covariance: (5, 5) of ln θ̂, from scores clustered by log or block; 0 of what was fixed.
        quantile: of Student's t, which turns deviations into 95 % intervals.
        gravity: whether gravity tells kp; otherwise it is a convention.
        offset: change of ln kp by an offset of 2 mrad between the zeros of target and position,
            which is part of the covariance.
        error: mean absolute residual [rad or m], of the samples in use.
        simple: the same of what needs no model: the target at the delay that suits best, or a
            constant position, whichever is closer.
    """

    x: Array
    covariance: Array
    quantile: float
    gravity: bool
    offset: float
    error: float
    simple: float

    @property
    def theta(self) -> Array:
        """(5,) θ̂."""
        return np.exp(self.x)


def estimate(
    robot: RobotModel,
    logs: Sequence[ServoLog],
    kp: Array,
    told: Callable[[str], None] = lambda _: None,
) -> tuple[tuple[JointEstimate, ...], Array]:
    """Fits every joint alone, masks windows with foreign forces, and fits again.

    Where gravity does not tell kp, it is the geometric mean of the joints where it does, or the
    model file's if there are none.

    Args:
        robot: the model.
        logs: at least one.
        kp: (n,) of the model file [N·m/rad or N/m].
        told: called with the name of every stage.

    Returns:
        The estimate of each joint, and (N,) 1 of samples in use, 0 of masked ones.
    """
    joints = [[log.joint(j) for log in logs] for j in range(len(kp))]
    used = np.ones(sum(len(log.t) for log in logs))
    cluster = clusters(logs)
    told("fitting every servo alone")
    priors, fits = [], []
    for own in joints:
        first = np.log(start(own))
        prior = Prior(np.where(np.isnan(_GUESS), first, np.log(_GUESS)), _SPREAD)
        priors.append(prior)
        fits.append(minimise(own, first, prior, used))
    for own, fit in zip(joints, fits, strict=True):
        used = used * undisturbed(own, fit)
    for _ in range(_SWEEPS):
        told("fitting all servos together, without foreign forces")
        logs = [
            coupled(
                robot,
                log,
                np.column_stack([simulate(log.joint(j), f.theta) for j, f in enumerate(fits)]),
            )
            for log in logs
        ]
        joints = [[log.joint(j) for log in logs] for j in range(len(kp))]
        fits = [
            minimise(own, fit.x, prior, used)
            for own, fit, prior in zip(joints, fits, priors, strict=True)
        ]
    parts = zip(joints, fits, priors, strict=True)
    spread = np.array([_covariance(*part, used, cluster)[0][GRAVITY, GRAVITY] for part in parts])
    known = np.sqrt(spread) < _KNOWN
    g = [fit.x[GRAVITY] for fit, sure in zip(fits, known, strict=True) if sure]
    common = np.full(len(kp), np.mean(g)) if g else -np.log(kp)
    for j in np.flatnonzero(~known):
        mean, deviation = priors[j].mean.copy(), priors[j].deviation.copy()
        mean[GRAVITY], deviation[GRAVITY] = common[j], 0.0
        priors[j] = Prior(mean, deviation)
        fits[j] = minimise(joints[j], fits[j].x, priors[j], used)
    parts = zip(joints, fits, priors, known, strict=True)
    return tuple(_judged(*part, used, cluster) for part in parts), used


def clusters(logs: Sequence[ServoLog]) -> Indices:
    """(N,) number of the cluster of each sample: its log, or a block of time of few logs."""
    if len(logs) >= _FEWEST:
        return np.repeat(np.arange(len(logs)), [len(log.t) for log in logs])
    length = max(_BLOCK, sum(log.t[-1] - log.t[0] for log in logs) / _BLOCKS)
    found, count = [], 0
    for log in logs:
        own = ((log.t - log.t[0]) / length).astype(int) + count
        found.append(own)
        count = own[-1] + 1
    return np.concatenate(found)


def _covariance(
    logs: Sequence[JointLog], fit: OutputError, prior: Prior, used: Array, cluster: Indices
) -> tuple[Array, float]:
    """(5, 5) of ln θ̂, and the change of ln kp by an offset of the target's zero.

    The covariance is that of the jackknife over clusters, each left out by one Gauss–Newton step,
    plus the prior's part A⁻¹ P A⁻¹, plus that of the offset. Residuals of a simulation are
    correlated over seconds, and a motion that the structure misses is missed throughout a log:
    independent residuals would make intervals many times too narrow.
    """
    weight = weights(logs, fit.residual, used, fit.sigma)
    free, P = prior.free, np.diag(prior.deviation[prior.free] ** -2.0)
    weighted = fit.jacobian * weight[:, None]
    H, count = weighted.T @ fit.jacobian + P, int(cluster.max()) + 1
    A = np.linalg.inv(H)
    shifts = []
    for k in range(count):
        own = cluster == k
        rest = H - weighted[own].T @ fit.jacobian[own]
        shifts.append(np.linalg.solve(rest, weighted[own].T @ fit.residual[own]))
    jackknife = np.cov(np.array(shifts).T, bias=True) * max(count - 1, 1)
    moved = A @ weighted.T @ _offset_effect(logs, fit)
    out, offset = np.zeros((len(fit.x), len(fit.x))), np.zeros(len(fit.x))
    own = _NUMERICAL**2 * np.eye(len(free))
    out[np.ix_(free, free)] = jackknife + A @ P @ A + np.outer(moved, moved) + own
    offset[free] = moved
    return out, float(offset[GRAVITY])


def _offset_effect(logs: Sequence[JointLog], fit: OutputError) -> Array:
    """(N,) change of the simulated positions by an offset of the targets [rad or m]."""
    moved = [log._replace(target=log.target + _OFFSET) for log in logs]
    after = [simulate(log, fit.theta) - log.position for log in moved]
    return np.concatenate(after) - fit.residual


def _judged(
    logs: Sequence[JointLog],
    fit: OutputError,
    prior: Prior,
    gravity: bool,
    used: Array,
    cluster: Indices,
) -> JointEstimate:
    """An estimate with its covariance, and what predictions without a model achieve."""
    position = np.concatenate([log.position for log in logs])
    constant = np.abs(position - np.median(position[used > 0])) @ used / used.sum()
    late = min(_late(logs, used, delay) for delay in _DELAYS)
    covariance, offset = _covariance(logs, fit, prior, used, cluster)
    return JointEstimate(
        fit.x,
        covariance,
        float(stats.t.ppf(0.975, max(int(cluster.max()), 1))),
        bool(gravity),
        offset,
        float(np.abs(fit.residual) @ used / used.sum()),
        min(late, float(constant)),
    )


def _late(logs: Sequence[JointLog], used: Array, delay: float) -> float:
    """Mean absolute error of the target at a delay [rad or m]."""
    errors = [
        log.target[np.clip(np.searchsorted(log.t, log.t - delay, side="right") - 1, 0, None)]
        - log.position
        for log in logs
    ]
    return float(np.abs(np.concatenate(errors)) @ used / used.sum())
