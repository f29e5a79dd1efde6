"""Output error of one joint: the parameters whose open-loop simulation follows the log best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...parameters import Array, Indices
from .simulation import JointLog, simulate

NAMES = ("T", "f", "g", "a", "d")
GRAVITY = NAMES.index("g")
_STEP = 0.04  # of central differences of ln θ: smooths over samples that stick or slip
_ROUNDS, _TRIES = 40, 8  # of the fit; of a step
_ENOUGH = 1e-5  # relative decrease of the cost at which the fit ends
_LONGEST = 1.0  # step of ln θ
EFFECTIVE = 1.5  # independent samples per second: residuals of a simulation are correlated
_WINDOW = 2.0  # in which foreign forces are looked for [s]
_FAR = 6.0  # residual of such a window over the median one


class Prior(NamedTuple):
    """What is known before the log, of ln θ.

    Attributes:
        mean: (5,) of ln θ.
        deviation: (5,) standard deviations; 0 of a parameter that is fixed.
    """

    mean: Array
    deviation: Array

    @property
    def free(self) -> Indices:
        """Indices of the parameters that are fitted."""
        return np.flatnonzero(self.deviation > 0)


class OutputError(NamedTuple):
    """The residual of a fit.

    Attributes:
        x: (5,) ln θ̂.
        residual: (N,) simulated minus measured position [rad or m], all logs in a row.
        sigma: robust rms of the residual [rad or m]; the loss is quadratic up to twice that.
        jacobian: (N, k) derivatives of the residual by the free ln θ.
    """

    x: Array
    residual: Array
    sigma: float
    jacobian: Array

    @property
    def theta(self) -> Array:
        """(5,) T [s], f [rad], g [rad/(N·m)], a [s²], d [s]."""
        return np.exp(self.x)


def minimise(logs: Sequence[JointLog], x: Array, prior: Prior, used: Array) -> OutputError:
    """Levenberg–Marquardt on Σ soft-L1(residual), each sample weighted by its share of the time.

    Args:
        logs: of one joint.
        x: (5,) ln θ to start from.
        prior: of ln θ.
        used: (N,) 1 of samples that count, 0 of masked ones.
    """
    x = np.where(prior.deviation > 0, x, prior.mean)
    residual, damping = _residual(logs, x), 1e-3
    for _ in range(3):  # the scale of the loss follows the fit
        sigma, before = _winsorised(residual[used > 0]), x
        x, residual, damping = _descend(logs, x, residual, prior, used, sigma, damping)
        if np.abs(x - before).max() < _STEP:
            break
    return OutputError(x, residual, sigma, _jacobian(logs, x, prior.free))


def weights(logs: Sequence[JointLog], residual: Array, used: Array, sigma: float) -> Array:
    """(N,) weights of squared residuals [1/rad²]: independent samples over the robust variance."""
    spacing = np.concatenate([np.gradient(log.t) for log in logs])
    rows = np.minimum(1.0, EFFECTIVE * spacing) * used
    return rows / sigma**2 / np.sqrt(1 + (residual / (2 * sigma)) ** 2)


def _descend(
    logs: Sequence[JointLog],
    x: Array,
    residual: Array,
    prior: Prior,
    used: Array,
    sigma: float,
    damping: float,
) -> tuple[Array, Array, float]:
    """x, residual and damping at the minimum of the cost with a given scale of the loss."""
    free = prior.free
    precision = prior.deviation[free] ** -2.0

    def cost(x: Array, residual: Array) -> float:
        loss = 2 * (2 * sigma) ** 2 * (np.sqrt(1 + (residual / (2 * sigma)) ** 2) - 1)
        rows = weights(logs, 0 * residual, used, sigma)
        return float(rows @ loss + precision @ (x - prior.mean)[free] ** 2)

    value = cost(x, residual)
    for _ in range(_ROUNDS):
        jacobian = _jacobian(logs, x, free)
        weighted = jacobian.T * weights(logs, residual, used, sigma)
        H = weighted @ jacobian + np.diag(precision)
        slope = weighted @ residual + precision * (x - prior.mean)[free]
        gain = 0.0
        for _ in range(_TRIES):
            step = -np.linalg.solve(H + damping * np.diag(np.diag(H)), slope)
            trial = x.copy()
            trial[free] += np.clip(step, -_LONGEST, _LONGEST)
            after = _residual(logs, trial)
            gain = value - cost(trial, after)
            if gain > 0:
                break
            damping *= 5
        if gain <= 0:
            break
        x, residual, value, damping = trial, after, value - gain, max(damping / 5, 1e-6)
        if gain < _ENOUGH * value:
            break
    return x, residual, min(damping, 1.0)


def _residual(logs: Sequence[JointLog], x: Array) -> Array:
    theta = np.exp(x)
    return np.concatenate([simulate(log, theta) - log.position for log in logs])


def _jacobian(logs: Sequence[JointLog], x: Array, free: Indices) -> Array:
    """(N, k) central differences of the residual."""
    columns = []
    for i in free:
        step = np.zeros(len(x))
        step[i] = _STEP
        columns.append((_residual(logs, x + step) - _residual(logs, x - step)) / (2 * _STEP))
    return np.column_stack(columns)


def _winsorised(residual: Array) -> float:
    """Robust rms [rad or m]: residuals count up to twice of it."""
    size = np.abs(residual)
    sigma = float(np.sqrt(np.mean(size**2)))
    for _ in range(10):
        sigma = float(np.sqrt(np.mean(np.minimum(size, 2 * sigma) ** 2)))
    return max(sigma, 1e-6)


def windows(logs: Sequence[JointLog]) -> Indices:
    """(N,) number of the two-second window that each sample belongs to, over all logs."""
    found, count = [], 0
    for log in logs:
        own = ((log.t - log.t[0]) / _WINDOW).astype(int)
        found.append(own + count)
        count += own[-1] + 1
    return np.concatenate(found)


def undisturbed(logs: Sequence[JointLog], fit: OutputError) -> Array:
    """(N,) 1, or 0 in windows whose residual is far above that of others in which the joint moves.

    A gripper that rests on a table, or a hand that pushes the arm, shows as such a window.
    """
    window = windows(logs)
    count = np.bincount(window)
    rms = np.sqrt(np.bincount(window, fit.residual**2) / np.maximum(count, 1))
    position = np.concatenate([log.position for log in logs])
    mean = np.bincount(window, position) / np.maximum(count, 1)
    travel = np.bincount(window, np.abs(position - mean[window])) / np.maximum(count, 1)
    moving = travel > fit.sigma
    usual = np.median(rms[moving]) if moving.any() else np.inf
    return np.where(rms > max(_FAR * usual, 2 * fit.sigma), 0.0, 1.0)[window]
