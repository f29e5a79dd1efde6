"""Fits of all joints of a servo arm to logs without a payload, and windows with external forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import optimize

from ...logs import signals
from ...parameters import Array
from .fit import (
    ARMATURE,
    DAMPING,
    DELAY,
    JointFit,
    OutputError,
    Prior,
    minimise,
    undisturbed,
    weights,
)
from .logs import ServoLog, coupled
from .simulation import JointLog

_DELAY = 0.015  # before the log [s]
_SPREAD = np.array([3.0, 3.0, 3.0, 2.5, 1.5])
# standard deviations of ln θ before the log: T, f and g nearly free; a within a factor of 130 of
# that of a critically damped servo, T²/4, and delays of serial buses within 20
_ALIKE = np.array([1.0, 3.0, 3.0, 2.5, 0.5])
# the same about T and d that the joints have in common, within factors of 7 and 2.7
_SWEEPS = 8  # at most, over all joints, with the loads of the others' simulated motion
_SETTLED = 0.2  # change of that motion, over the residual, at which they end
_LOWER = 0.97  # largest robust residual with a limit of force over that without, to accept it
_CUT = 5.0  # of the start's filter on both sides [Hz]
_MOVING = 0.05  # slower samples stick, where friction has no sign [rad/s]
_SMOOTH = 0.02  # s of tanh(v/s) [rad/s]
_DELAYS = np.arange(0.005, 0.125, 0.01)  # tried [s]
_ROUNDS = 5  # of reweighting
LEAST = (1e-3, 1e-5, 1e-6, 1e-6)
"""Of T, f, g, a: a logarithm needs more than 0."""


class Fitted(NamedTuple):
    """Fits of every joint to the free logs."""

    logs: list[ServoLog]  # with the loads of their simulated motion
    fits: list[OutputError[JointFit]]  # of every joint
    used: Array  # (N,) 1 of samples in use

    def simulated(self, j: int) -> JointFit:
        """The simulation of a joint."""
        return JointFit([log.joint(j) for log in self.logs], self.used)

    def refitted(self, logs: list[ServoLog]) -> Fitted:
        """Fits to the logs with other loads or limits."""
        found = self._replace(logs=logs)
        fits = [minimise(found.simulated(j), fit.x, fit.prior) for j, fit in enumerate(self.fits)]
        return found._replace(fits=fits)


def fit_free(
    logs: list[ServoLog],
    limits: Array,
    report: Callable[[str], None],
) -> Fitted:
    """Fits of all joints to the free logs, without windows of external forces."""
    report("fitting every servo alone")
    found = Fitted(logs, [], np.ones(sum(len(log.t) for log in logs)))
    for j in range(len(limits)):
        own = found.simulated(j)
        found.fits.append(minimise(own, *alone(own.logs)))
    used = found.used
    for j, fit in enumerate(found.fits):
        used = used * undisturbed(found.simulated(j).logs, fit.residual, fit.sigma)
    report("fitting all servos together, without external forces")
    found = _together(logs, _alike(found._replace(used=used)))
    limited = _saturated(found, limits)
    if np.isfinite(limited).any():
        found = _together([log._replace(limit=limited) for log in logs], found)
    return found


def alone(logs: Sequence[JointLog]) -> tuple[Array, Prior]:
    """(5,) initial ln θ, and the uninformative prior of a joint."""
    first = np.log(start(logs))
    return first, Prior(np.r_[first[:3], _critical(first[0]), np.log(_DELAY)], _SPREAD)


def _alike(found: Fitted) -> Fitted:
    """Priors of T, a and d about the joints' common values.

    Slow motion determines only the sum of a joint's T and d, so the other joints serve as prior:
    servos of one arm are alike, and one bus carries their targets.
    """
    at = np.array([DAMPING, DELAY])
    x = np.array([fit.x[at] for fit in found.fits])
    variances = np.empty_like(x)
    for j, fit in enumerate(found.fits):
        rows = weights(found.simulated(j), fit.residual, fit.sigma)
        H = (fit.jacobian.T * rows) @ fit.jacobian + np.diag(fit.prior.deviation**-2.0)
        variances[j] = np.diag(np.linalg.inv(H))[at]
    weight = 1 / (_ALIKE[at] ** 2 + variances)
    (T, d), deviation = np.average(x, axis=0, weights=weight), _ALIKE.copy()
    deviation[at] = np.sqrt(_ALIKE[at] ** 2 + 1 / weight.sum(axis=0))  # the mean is uncertain, too
    fits = []
    for fit in found.fits:
        mean = fit.prior.mean.copy()
        mean[[DAMPING, ARMATURE, DELAY]] = T, _critical(T), d
        fits.append(fit._replace(prior=Prior(mean, deviation)))
    return found._replace(fits=fits)


def _critical(T: float) -> float:
    """ln a of a critically damped servo, T²/4, from ln T."""
    return 2 * T - float(np.log(4))


def _together(logs: Sequence[ServoLog], found: Fitted) -> Fitted:
    """The fits with the loads of all joints' simulated motion, until that settles.

    The logs are without the loads of accelerations; `found` are fits to start from.
    """
    before = np.inf
    for _ in range(_SWEEPS):
        theta = np.exp([fit.x for fit in found.fits])
        moved, exerting = zip(*(coupled(log, theta) for log in logs), strict=True)
        now = np.concatenate(moved)
        change = np.sqrt(np.mean((now - before) ** 2, axis=0))
        if np.all(change < [_SETTLED * fit.sigma for fit in found.fits]):
            break
        before, found = now, found.refitted(list(exerting))
    return found


def _saturated(found: Fitted, limits: Array) -> Array:
    """(n,) limits of the servos' forces [N·m or N] where the logs show them; else inf.

    Model files state limits that the servo does not have, so a limit must lower the residual.
    """
    out, logs = np.full(len(limits), np.inf), [log._replace(limit=limits) for log in found.logs]
    limited = found._replace(logs=logs)
    for j, fit in enumerate(found.fits):
        own = limited.simulated(j)
        if np.isinf(limits[j]) or np.array_equal(own.residual(fit.x), fit.residual):
            continue
        if minimise(own, fit.x, fit.prior).sigma < _LOWER * fit.sigma:
            out[j] = limits[j]
    return out


def start(logs: Sequence[JointLog]) -> Array:
    """(5,) θ by robust non-negative regression of u(t − d) − q on q̇, sgn q̇, Γ + M_jj q̈ and q̈.

    Velocity and acceleration are derivatives of the low-passed position; the target is low-passed
    alike. The delay is the one with the least residual. The logs are those of one joint, not empty.
    """
    best, found = np.inf, np.array([0.1, 0.01, 0.1, 2e-3, 0.015])
    for delay in _DELAYS:
        A, y = (np.concatenate(part) for part in zip(*(_rows(x, delay) for x in logs), strict=True))
        if len(y) < 20:
            continue
        theta, error = _robust(A, y)
        if error < best:
            best, found = error, np.r_[np.maximum(theta, LEAST), delay]
    return found


def _rows(log: JointLog, delay: float) -> tuple[Array, Array]:
    """(N, 4) columns and (N,) left sides of the samples that move, on an even grid."""
    step = float(np.median(np.diff(log.t)))
    t = np.arange(log.t[0], log.t[-1], step)
    cut = min(0.8, 2 * _CUT * step)
    if len(t) < 20:
        return np.zeros((0, 4)), np.zeros(0)
    held = log.target[np.clip(np.searchsorted(log.t, t - delay, side="right") - 1, 0, None)]
    q, u = (signals.low_pass(x, cut) for x in (np.interp(t, log.t, log.position), held))
    v = np.gradient(q, step)
    acceleration = np.gradient(v, step)
    gravity, inertia = (np.interp(t, log.t, x) for x in (log.load, log.inertia))
    A = np.column_stack([v, np.tanh(v / _SMOOTH), gravity + inertia * acceleration, acceleration])
    moving = np.abs(v) > _MOVING
    return A[moving] / log.stiffer, (u - q)[moving]


def _robust(A: Array, y: Array) -> tuple[Array, float]:
    """(4,) non-negative coefficients by reweighting of absolute residuals, and their mean."""
    weight, theta, error = np.ones(len(y)), np.zeros(4), np.inf
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        theta = optimize.nnls(A / size * root[:, None], y * root)[0] / size
        residual = np.abs(y - A @ theta)
        error = float(residual.mean())
        weight = 1 / np.maximum(residual, 0.1 * error + 1e-12)
    return theta, error
