"""Tracking errors, effort and the Lyapunov function of a controller along a simulated motion."""

from dataclasses import dataclass, fields, replace

import numpy as np

from ...core import Array, ConeMetric, Log, Metric, SecondOrderSystem
from ...lab import Tracker, Truth

_ROUNDING = 64 * np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class ControlledMotion:
    """A controlled motion of N samples, with the plant's true state."""

    t: Array  # (N,) times [s]
    q: Array  # (N, m) true positions
    v: Array  # (N, n) true velocities
    u: Array  # (N, n_u) commands
    theta_hat: Array  # (N, p) the controller's estimate
    error: Array  # (N, n) from the true to the desired position, as tangent steps [m or rad]
    status: str = ""  # how it ended; empty if completed

    def error_of(self, system: SecondOrderSystem, unit: str) -> Array:
        """(N, ·) the errors of the coordinates with a unit."""
        return self.error[:, [own == f"{unit}/s" for own in system.velocity_units]]


def figures(
    motion: ControlledMotion, system: SecondOrderSystem, tracker: Tracker, last: float
) -> dict[str, float | str]:
    """Errors by unit over the last seconds, and efforts, of a motion.

    They are `rms_rad`, `rms_m`, `peak_rad`, `peak_m` where there are such coordinates, infinite if
    the motion ended early; `effort`, the largest command as a share of its limit; `saturated`, the
    share of samples with a command at its limit; `status`.
    """
    late = motion.t > motion.t[-1] - last
    found: dict[str, float | str] = {}
    for unit in ("rad", "m"):
        error = motion.error_of(system, unit)
        if error.shape[1]:
            lost = np.inf if motion.status else 0.0
            found[f"rms_{unit}"] = lost + float(np.sqrt(np.mean(error[late] ** 2)))
            found[f"peak_{unit}"] = lost + float(np.abs(error[late]).max())
    low, high = tracker.limits
    share = np.where(motion.u > 0, motion.u / high, motion.u / np.where(low < 0, low, -np.inf))
    found["effort"] = float(share.max())
    found["saturated"] = float(np.mean(np.any(share > 1 - 1e-9, axis=1)))
    return found | {"status": motion.status or "completed"}


def lyapunov(
    motion: ControlledMotion,
    system: SecondOrderSystem,
    tracker: Tracker,
    metric: Metric,
    theta: Array,
) -> Array:
    """(N,) V = ½ sᵀ M s + D_ψ(θ‖θ̂) under the true θ (p,) [J]."""
    V = metric.divergence(theta, motion.theta_hat)
    for k, (t, q, v) in enumerate(zip(motion.t.tolist(), motion.q, motion.v, strict=True)):
        s = v - tracker.reference(t, q, v)[0]
        V[k] += 0.5 * s @ system.mass_matrix(np.concatenate([q, v]), theta) @ s
    return V


def rise_bounds(
    motion: ControlledMotion,
    system: SecondOrderSystem,
    tracker: Tracker,
    metric: ConeMetric,
    theta: Array,
) -> Array:
    """(N−1,) bounds on the rise of V between two samples by discretisation [J].

    While the command is held, W(t, x, v_r, v̇_r, u) θ̂ = K_d s + d, and V̇ = −sᵀ (K_d s + d) exactly:
    its integral, by Simpson's rule, is what holding the command does to V. The adaptation's own
    error is the defect of d/dt ∇ψ(θ̂) = −Wᵀ s over the step, times θ̂ − θ.
    """
    bounds = np.empty(len(motion.t) - 1)
    slopes = [metric.mu * metric.mirror(theta_hat)[0] for theta_hat in motion.theta_hat]
    middles = system.midpoints(Log.unchecked(motion.t, motion.q, motion.v, motion.u), hermite=True)
    for k in range(len(bounds)):
        first, last = (
            (motion.t[j], motion.q[j], motion.v[j], motion.theta_hat[j]) for j in (k, k + 1)
        )
        t, theta_hat = (0.5 * (first[j] + last[j]) for j in (0, 3))
        middle = t, middles.q[k], middles.v[k], theta_hat
        step = float(last[0] - first[0])
        power = 0.0
        moved = slopes[k + 1] - slopes[k]
        for weight, (t, q, v, theta_hat) in ((1, first), (4, middle), (1, last)):
            v_r, a_r = tracker.reference(float(t), q, v)
            slope = system._W(float(t), q, v, v_r, a_r, motion.u[k]).T @ (v - v_r)
            power += weight / 6 * step * float(slope @ theta_hat)
            moved += weight / 6 * step * slope
        adaptation = abs(float((motion.theta_hat[k] - theta) @ moved))
        bounds[k] = max(0.0, -power) + adaptation
    return bounds + _ROUNDING * metric.cancelling


def lyapunov_rises(
    motion: ControlledMotion, truth: Truth, tracker: Tracker, metric: ConeMetric
) -> tuple[int, float]:
    """Number of steps in which V rose beyond its bound, and the largest rise over V(0).

    Steps in which a fault changes the truth do not count.
    """
    epochs = truth.epoch(motion.t)
    system = truth.system
    rises = [np.zeros(0)]
    violations = 0
    V_0 = np.inf
    for epoch in np.unique(epochs):
        rows = epochs == epoch
        columns = {f.name: getattr(motion, f.name)[rows] for f in fields(motion)[:-1]}
        part = replace(motion, **columns)
        theta = truth.theta_at(float(part.t[-1]))
        V = lyapunov(part, system, tracker, metric, theta)
        bounds = rise_bounds(part, system, tracker, metric, theta)
        violations += int(np.count_nonzero(~(np.diff(V) <= bounds)))
        rises.append(np.diff(V))
        V_0 = V[0] if epoch == 0 else V_0
    return violations, float(np.concatenate(rises).max(initial=0.0) / V_0)
