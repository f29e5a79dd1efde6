"""Initial values of the output-error fit by regression on moving samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import optimize

from ...parameters import Array
from ..logs import signals
from .simulation import JointLog

_CUT = 5.0  # of the filter on both sides [Hz]
_MOVING = 0.05  # slower samples stick, where friction has no sign [rad/s]
_SMOOTH = 0.02  # s of tanh(v/s) [rad/s]
_DELAYS = np.arange(0.005, 0.125, 0.01)  # tried [s]
_ROUNDS = 5  # of reweighting
LEAST = (1e-3, 1e-5, 1e-6, 1e-6)
"""Of T, f, g, a: a logarithm needs more than 0."""


def start(logs: Sequence[JointLog]) -> Array:
    """(5,) θ by robust non-negative regression of u(t − d) − q on q̇, sgn q̇, Γ + M_jj q̈ and q̈.

    Velocity and acceleration are derivatives of the low-passed position; the target is low-passed
    alike. The delay is the one with the least residual.

    Args:
        logs: of one joint, not empty.
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
