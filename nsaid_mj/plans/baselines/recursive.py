"""Recursive estimators: least squares on the normalised form (17), and a Kalman filter."""

from typing import Any

import numpy as np
from scipy import signal

from ...base import NoEstimate
from ...core import Array, Log, SecondOrderSystem, SensorLevels
from .base import MethodEstimate, Problem
from .least_squares import central_rows, window

_SPREAD = 0.3  # standard deviation of the prior, in θ/scale
_ROUGHNESS = 1e-4  # standard deviation of the differences' error, relative to the acting forces
_MODEL = 1e-3  # standard deviation of Heun's error, relative to the change of v in a time step
_EXACT = 1e-4  # standard deviation assumed for exact velocities, relative to their rms
_CURVATURE = 1e-6  # step of the finite differences of v̇ along v, relative to the rms of v


def normalised(problem: Problem) -> MethodEstimate:
    """Recursive least squares on the normalised form (17): W θ/k₁ = 0 with the first gain known.

    Rows come from central differences. If velocity noise is stated, all columns first pass through
    one causal low-pass filter and are decimated. The initial estimate is the prior, with a standard
    deviation of 0.3 of the scale; the forgetting factor is 1.
    """
    system, log, prior, noise = problem
    W = central_rows(system, log)
    note = ""
    response = np.ones(1)
    if noise.velocity > 0:
        rate = 1 / log.step
        cutoff = min(0.5 * rate / window(log), 0.2 * rate)
        sections = signal.butter(2, cutoff, fs=rate, output="sos")
        settled = int(rate / cutoff)
        every = max(1, int(rate / (4 * cutoff)))
        W = _filtered(sections, W)[settled::every]
        response = _filtered(sections, np.eye(1, 4 * settled)[0])
        note = f"cut-off {cutoff:.3g} Hz"
    scale = system.space.scale
    start = prior / scale
    known_gain = system.space.actuators[0]
    free = np.delete(np.arange(system.p), known_gain)
    variance = (_ROUGHNESS * np.sqrt(np.mean((np.abs(W) @ np.abs(start)) ** 2, axis=0))) ** 2
    variance += _acceleration_noise(system, log, prior, noise, response) ** 2
    phi = start[free]
    P = _SPREAD**2 * np.eye(len(free))
    known = W[..., known_gain] * start[known_gain]
    for Y, y in zip(W[..., free], known, strict=True):
        PY = P @ Y.T
        gain = np.linalg.solve(Y @ PY + np.diag(variance), PY.T).T
        phi = phi - gain @ (Y @ phi + y)
        P -= gain @ PY.T
        P = 0.5 * (P + P.T)
    theta_s = start.copy()
    theta_s[free] = phi
    return MethodEstimate(scale * theta_s, note)


def _filtered(sections: Any, x: Array) -> Array:
    """x (N, ...) through a causal filter of second-order sections, along the first axis."""
    return np.asarray(signal.sosfilt(sections, x, axis=0), dtype=np.float64)


def _acceleration_noise(
    system: SecondOrderSystem, log: Log, prior: Array, noise: SensorLevels, response: Array
) -> Array:
    """(n,) standard deviation of M̂ v̇ caused by velocity noise, under the prior.

    v̇ is a central difference, filtered with the given impulse response.
    """
    k = np.linspace(0, len(log.t) - 1, 20).astype(int)
    M = system.mass_matrix(np.hstack([log.q, log.v])[k], prior)
    row = np.sqrt(np.mean(np.sum(M**2, axis=2), axis=0))
    difference = np.convolve(response, [1.0, 0.0, -1.0]) / (2 * float(np.median(np.diff(log.t))))
    return row * noise.velocity * np.linalg.norm(difference)


def kalman(problem: Problem) -> MethodEstimate:
    """Extended Kalman filter with state (v, θ/scale) and measurement v; v̇ of (29), θ̇ = 0.

    Measured positions are used as they are. As W θ = M v̇ + … = 0, ∂v̇/∂θ = −M⁻¹ W; ∂v̇/∂v is
    computed by finite differences, and the prediction by Heun's method.

    Raises:
        NoEstimate: M̂ is not positive definite.
    """
    system, log, prior, noise = problem
    n = system.n
    p = system.p
    scale = system.space.scale
    size = np.maximum(np.sqrt(np.mean(log.v**2, axis=0)), 1e-9)
    change = np.sqrt(np.mean(np.diff(log.v, axis=0) ** 2, axis=0))
    R = np.diag(np.maximum(noise.velocity, _EXACT * size) ** 2)
    Q = np.diag((_MODEL * np.maximum(change, 1e-9)) ** 2)
    v = log.v[0].copy()
    theta_s = prior / scale
    P = np.zeros((n + p, n + p))
    P[:n, :n], P[n:, n:] = R, _SPREAD**2 * np.eye(p)
    A = np.eye(n + p)
    step = _CURVATURE * size
    for k in range(len(log.t) - 1):
        t = log.t[k]
        q = log.q[k]
        u = log.u[k]
        h = log.t[k + 1] - log.t[k]
        theta = scale * theta_s
        a, W, pivot = system.evaluate_at(t, q, v, u, v, theta)
        later = v + h * a
        a_later, W_later, pivot_later = system.evaluate_at(
            t + h, log.q[k + 1], later, u, later, theta
        )
        if not min(pivot, pivot_later) > 0:
            raise NoEstimate(f"M̂ not positive definite at t = {t:.3g} s", "Use a better prior.")
        J = np.empty((n, n))
        for j in range(n):
            moved = v.copy()
            moved[j] += step[j]
            J[:, j] = (system.evaluate_at(t, q, moved, u, moved, theta).a - a) / step[j]
        A[:n, :n] = np.eye(n) + h * J + 0.5 * (h * J) @ (h * J)
        A[:n, n:] = -0.5 * h * np.linalg.solve(system._mass_tensor(q) @ theta, W + W_later) * scale
        P = A @ P @ A.T
        P[:n, :n] += Q
        v = v + 0.5 * h * (a + a_later)
        gain = np.linalg.solve(P[:n, :n] + R, P[:n]).T
        move = gain @ (log.v[k + 1] - v)
        v = v + move[:n]
        theta_s = theta_s + move[n:]
        P = P - gain @ P[:n]
        P = 0.5 * (P + P.T)
    return MethodEstimate(scale * theta_s)
