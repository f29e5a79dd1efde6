"""Output-error fit: parameters of the open-loop simulation closest to the log, and covariances."""

from collections.abc import Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy import stats

from ...core import Array, Indices
from .logs import ServoLog
from .simulation import NONE, Effects, JointLog, simulate

DAMPING, FRICTION, GRAVITY, ARMATURE, DELAY = range(5)
"""Places of T, f, g, a and d in θ."""
STEP = 0.04  # of central differences of ln θ; smooths over samples that stick or slip
_ROUNDS = 40  # of the fit; of a step
_TRIES = 8
_ENOUGH = 1e-5  # relative decrease of the cost at which the fit ends
_LONGEST = 1.0  # step of ln θ
EFFECTIVE = 1.5  # independent samples per second, since residuals of a simulation are correlated
PLAY = 2.0
"""Half the usual play of a servo's gears, over the deviation of its zero: makers of hobby servos
with steps of 1.5 mrad state up to 9 mrad of play, and fine encoders come with finer gears."""
_WINDOW = 2.0  # in which external forces are detected [s]
_FAR = 6.0  # residual of such a window over the median one


class ServoPrior(NamedTuple):
    """Prior knowledge of the parameters."""

    mean: Array  # (k,) means of the parameters x, which are logarithms except for a place
    deviation: Array  # (k,) standard deviations; 0 of a parameter that is fixed

    @property
    def free(self) -> Indices:
        """Indices of the parameters that are fitted."""
        return np.flatnonzero(self.deviation > 0)


class Simulated(Protocol):
    """Open-loop simulations whose parameters are fitted."""

    used: Array  # (N,) 1 of samples that count, 0 of masked ones
    spacing: Array  # (N,) time that each sample stands for [s]

    def residual(self, x: Array) -> Array:
        """(N,) simulated minus measured position."""
        ...

    def jacobian(self, x: Array, free: Indices) -> Array:
        """(N, k) central differences of the residual by the free parameters."""
        ...

    def moved(self, x: Array, zero: Array) -> Array:
        """(N, 2 n) change of the residual by effects that the logs cannot reveal.

        First by offsets `zero` (n,) [rad or m] of the joints' targets, then by backlash: a joint is
        displaced by `PLAY` times that in the direction of its load.
        """
        ...


_Of = TypeVar("_Of", bound=Simulated)


class OutputError(NamedTuple, Generic[_Of]):
    """A fit of simulations to logs."""

    of: _Of  # the simulations
    prior: ServoPrior
    x: Array  # (k,) minimiser; of a joint ln θ̂ of T [s], f [rad], g [rad/(N·m)], a [s²], d [s]
    residual: Array  # (N,) simulated minus measured position [rad or m], all logs in a row
    sigma: float  # robust rms of the residual [rad or m]; the loss is quadratic up to twice that
    jacobian: Array  # (N, free) derivatives of the residual by the free parameters


def _play(log: JointLog, zero: Array, g: Array) -> Array:
    """(N,) change of the target that moves a joint as play of `PLAY` times its `zero` does."""
    sunk = g * log.load / log.stiffer
    side = sunk / (np.abs(sunk) + zero / 4)  # friction holds a joint that hardly sinks
    return -PLAY * zero * (side - side.mean())  # a constant side is an offset


class JointFit:
    """The simulation of one joint, in samples marked by used (N,), 1 or 0, with further effects."""

    def __init__(self, logs: Sequence[JointLog], used: Array, effects: Effects = NONE):
        self.logs = logs
        self.used = used
        self.effects = effects
        self.spacing = np.concatenate([np.gradient(log.t) for log in logs])

    def residual(self, x: Array) -> Array:
        """(N,) residual [rad or m] at (5,) ln θ."""
        theta = np.exp(x)
        own = self.effects
        return np.concatenate([simulate(log, theta, own) - log.position for log in self.logs])

    def moved(self, x: Array, zero: Array) -> Array:
        """(N, 2) change of the residual by an offset `zero` (1,) of the targets, and by play."""
        g = np.exp(x[GRAVITY])
        found = []
        for shift in (lambda _: zero, lambda log: _play(log, zero, g)):
            logs = [log._replace(target=log.target + shift(log)) for log in self.logs]
            found.append(JointFit(logs, self.used).residual(x) - self.residual(x))
        return np.column_stack(found)

    def jacobian(self, x: Array, free: Indices) -> Array:
        """(N, k) derivatives by the free ln θ."""
        columns = []
        for i in free:
            step = np.zeros(len(x))
            step[i] = STEP
            columns.append((self.residual(x + step) - self.residual(x - step)) / (2 * STEP))
        return np.column_stack(columns)


def minimise(of: _Of, x: Array, prior: ServoPrior) -> OutputError[_Of]:
    """Levenberg–Marquardt on Σ soft-L1(residual), each sample weighted by its share of the time.

    It starts from x (k,), of which `prior` is the prior.
    """
    x = np.where(prior.deviation > 0, x, prior.mean)
    residual = of.residual(x)
    damping = 1e-3
    for _ in range(3):  # the scale of the loss follows the fit
        sigma = _winsorised(residual[of.used > 0])
        before = x
        x, residual, damping = _descend(of, x, residual, prior, sigma, damping)
        if np.abs(x - before).max() < STEP:
            break
    return OutputError(of, prior, x, residual, sigma, of.jacobian(x, prior.free))


def weights(simulated: Simulated, residual: Array, sigma: float) -> Array:
    """(N,) weights of squared residuals: independent samples over the robust variance."""
    rows = np.minimum(1.0, EFFECTIVE * simulated.spacing) * simulated.used
    return rows / sigma**2 / np.sqrt(1 + (residual / (2 * sigma)) ** 2)


def _descend(
    simulated: Simulated, x: Array, residual: Array, prior: ServoPrior, sigma: float, damping: float
) -> tuple[Array, Array, float]:
    """x, residual and damping at the minimum of the cost with a given scale of the loss."""
    free = prior.free
    precision = prior.deviation[free] ** -2.0

    def cost(x: Array, residual: Array) -> float:
        loss = 2 * (2 * sigma) ** 2 * (np.sqrt(1 + (residual / (2 * sigma)) ** 2) - 1)
        rows = weights(simulated, 0 * residual, sigma)
        return float(rows @ loss + precision @ (x - prior.mean)[free] ** 2)

    value = cost(x, residual)
    for _ in range(_ROUNDS):
        jacobian = simulated.jacobian(x, free)
        weighted = jacobian.T * weights(simulated, residual, sigma)
        H = weighted @ jacobian + np.diag(precision)
        slope = weighted @ residual + precision * (x - prior.mean)[free]
        gain = 0.0
        for _ in range(_TRIES):
            step = -np.linalg.solve(H + damping * np.diag(np.diag(H)), slope)
            trial = x.copy()
            trial[free] += np.clip(step, -_LONGEST, _LONGEST)
            after = simulated.residual(trial)
            gain = value - cost(trial, after)
            if gain > 0:
                break
            damping *= 5
        if gain <= 0:
            break
        x = trial
        residual = after
        value = value - gain
        damping = max(damping / 5, 1e-6)
        if gain < _ENOUGH * value:
            break
    return x, residual, min(damping, 1.0)


def _winsorised(residual: Array) -> float:
    """Robust rms [rad or m]: residuals are clipped at twice its value."""
    size = np.abs(residual)
    sigma = float(np.sqrt(np.mean(size**2)))
    for _ in range(10):
        sigma = float(np.sqrt(np.mean(np.minimum(size, 2 * sigma) ** 2)))
    return max(sigma, 1e-6)


def _blocks(logs: Sequence[JointLog | ServoLog], length: float) -> Indices:
    """(N,) number of the block of time, of a length [s], of each sample, over all logs."""
    found = []
    count = 0
    for log in logs:
        own = ((log.t - log.t[0]) / length).astype(int) + count
        found.append(own)
        count = own[-1] + 1
    return np.concatenate(found)


def undisturbed(logs: Sequence[JointLog], residual: Array, sigma: float) -> Array:
    """(N,) 1, or 0 in windows whose residual is far above that of others with motion.

    Causes are, for example, a gripper that rests on a table or a hand that pushes the arm.
    """
    window = _blocks(logs, _WINDOW)
    count = np.bincount(window)
    rms = np.sqrt(np.bincount(window, residual**2) / np.maximum(count, 1))
    position = np.concatenate([log.position for log in logs])
    mean = np.bincount(window, position) / np.maximum(count, 1)
    travel = np.bincount(window, np.abs(position - mean[window])) / np.maximum(count, 1)
    moving = travel > sigma
    usual = np.median(rms[moving]) if moving.any() else np.inf
    return np.where(rms > max(_FAR * usual, 2 * sigma), 0.0, 1.0)[window]


OFFSET = 2e-3
"""Largest standard deviation of a target's zero against the position's [rad or m]."""
_NUMERICAL = 0.01  # relative accuracy of the simulation itself, by arms with known servos
_FEWEST = 5  # logs that serve as clusters; fewer are divided into blocks
_BLOCK = 10.0  # shortest of them [s]
_BLOCKS = 20  # at most, in one log
_TICKS = 4 / 3  # the same in steps of the encoder, where those are finer


def clusters(logs: Sequence[ServoLog]) -> Indices:
    """(N,) number of the cluster of each sample: its log, or a block of time of few logs."""
    if len(logs) >= _FEWEST:
        return np.repeat(np.arange(len(logs)), [len(log.t) for log in logs])
    duration = sum(log.t[-1] - log.t[0] for log in logs)
    return _blocks(logs, max(_BLOCK, duration / _BLOCKS))


def zeros(logs: Sequence[ServoLog]) -> Array:
    """(n,) standard deviations of the zeros of targets against those of positions [rad or m].

    They are steps of the encoders, which truncate: small changes from sample to sample.
    """
    changes = np.abs(np.concatenate([np.diff(log.position, axis=0) for log in logs]))
    ticks = [np.quantile(own[own > 0], 0.05) if own.any() else np.inf for own in changes.T]
    return np.minimum(_TICKS * np.array(ticks), OFFSET)


class Spread(NamedTuple):
    """Uncertainty of k fitted parameters."""

    covariance: Array  # (k, k) covariance of the parameters
    moved: Array  # (k, 2 n) their change by offsets of the zeros, and by play
    free: Indices  # (f,) indices of the fitted ones
    jackknife: Array  # (f, f) part of the covariance from differences between clusters
    information: Array  # (G, f, f) information of every cluster
    inverse: Array  # (f, f) inverse of all clusters' information and the prior's
    without: Array = np.zeros((0, 0))  # (G, k) change of the parameters without each cluster

    def quantile(self, direction: Array) -> float:
        """Of Student's t, for the 95 % interval of a combination of the parameters (k,).

        If one log contains most of the information about it, there are fewer degrees of freedom
        than clusters: Satterthwaite's (Bell and McCaffrey, Survey Methodology 28, 2002), more where
        the jackknife is a small part of the variance, and at most those of equal clusters.
        """
        c = direction[self.free]
        most = len(self.information) - 1
        part = float(c @ self.jackknife @ c)
        if part <= 0:
            return float(stats.t.ppf(0.975, most))
        own = self.information
        A = self.inverse
        left_out = np.linalg.solve(
            np.linalg.inv(A) - own, np.broadcast_to(c, own[..., 0].shape)[..., None]
        )[..., 0]
        scores = np.einsum("gij,gj->gi", own, left_out)
        seen = scores @ A
        M = np.diag(np.einsum("gi,gi->g", scores, left_out)) - 2 * seen @ scores.T
        M += seen @ own.sum(axis=0) @ seen.T
        M += M.mean() - M.mean(axis=0) - M.mean(axis=1)[:, None]
        whole = direction @ self.covariance @ direction
        degrees = np.trace(M) ** 2 / np.sum(M**2) * (whole / part) ** 2
        return float(stats.t.ppf(0.975, np.clip(degrees, 1.0, most)))


def covariance_of(fit: OutputError, cluster: Indices, zero: Array) -> Spread:
    """The covariance of a fit's parameters, and their change by offsets `zero` (n,) and by play.

    The covariance is that of the jackknife over clusters, each left out by one Gauss–Newton step,
    plus the prior's part A⁻¹ P A⁻¹, plus that of the zeros. Residuals of a simulation are
    correlated over seconds, and model errors persist throughout a log: treating residuals as
    independent would make intervals many times too narrow. Play is not included: it causes no
    residual, and hardly moves joints whose load keeps its sign.
    """
    weight = weights(fit.of, fit.residual, fit.sigma)
    free = fit.prior.free
    P = np.diag(fit.prior.deviation[free] ** -2.0)
    weighted = fit.jacobian * weight[:, None]
    count = int(cluster.max()) + 1
    H = weighted.T @ fit.jacobian + P
    shifts = []
    information = np.empty((count, *H.shape))
    for k in range(count):
        own = cluster == k
        information[k] = weighted[own].T @ fit.jacobian[own]
        score = weighted[own].T @ fit.residual[own]
        shifts.append(np.linalg.solve(H - information[k], score))
    A: Array = np.asarray(np.linalg.inv(H), dtype=np.float64)
    apart = np.array(shifts) - np.mean(shifts, axis=0)
    jackknife = apart.T @ apart * max(count - 1, 1) / count
    out = np.zeros((len(fit.x), len(fit.x)))
    offset = fit.of.moved(fit.x, zero)
    moved = np.zeros((len(fit.x), offset.shape[1]))
    moved[free] = A @ weighted.T @ offset
    own = _NUMERICAL**2 * np.eye(len(free))
    out[np.ix_(free, free)] = jackknife + A @ P @ A + own
    by_zero = moved[:, : len(zero)]
    without = np.zeros((count, len(fit.x)))
    without[:, free] = shifts
    return Spread(out + by_zero @ by_zero.T, moved, free, jackknife, information, A, without)
