"""Figures of an estimate, whatever method it is from."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..experiment.loop import Run, held_out
from ..experiment.record import Record
from ..nullspace import regressor_stack, split
from ..parameters import Array
from ..system import SecondOrderSystem
from .rows import states, stride_of
from .truth import distance, true_nullspace, true_theta


class Judge:
    """Judges any method's estimates of one plant, after the fact, by the same figures.

    Args:
        run: whose plant it is; its identifiers and its record are not looked at.
    """

    def __init__(self, run: Run):
        self._system, self._truth = run.plant.system, true_theta(run)
        self._nullspace = true_nullspace(run)
        self._rows = held_out_rows(
            self._system, held_out(run), None if run.plant.mismatches else self._truth
        )

    def __call__(self, theta_hat: Array) -> dict[str, float | None]:
        """Distance to the true set, error of the actuators' shares, and force residual."""
        system = self._system
        return {
            "theta_perp_ratio": float(self._nullspace.ratio(theta_hat / system.space.scale)),
            "actuator_ratio_error": actuator_ratio_error(system, theta_hat, self._truth),
            "force_residual_ratio": residual_ratio(system, self._rows, theta_hat),
        }


def judge(run: Run, name: str, later: Record | None) -> dict[str, Any]:
    """How near one identifier's last estimate is to the true set, and how well it predicts."""
    suffix = f"_{name}" if name else ""
    record, system, truth = run.record, run.plant.system, true_theta(run)
    theta = record[f"theta_hat{suffix}"]
    ratio = distance(run, record["t"][[0, -1]], theta[[0, -1]])
    dv = record[f"v_hat{suffix}"] - record["v"]
    return {
        "theta_perp_ratio": float(ratio[1]),
        "theta_perp_ratio_initial": float(ratio[0]),
        "plant_direction_error": plant_direction_error(system, theta[-1], truth),
        "actuator_ratio_error": actuator_ratio_error(system, theta[-1], truth),
        "force_residual_ratio": force_residual_ratio(
            system, later, theta[-1], None if run.plant.mismatches else truth
        ),
        "velocity_error_rms": float(np.sqrt(np.mean(dv[-max(1, len(dv) // 10) :] ** 2))),
    }


def actuator_ratio_error(system: SecondOrderSystem, theta_hat: Array, truth: Array) -> float:
    """max |(k̂_i/k_i)/mean(k̂/k) − 1| over the actuator parameters; 0 where there is only one."""
    ratio = theta_hat[system.space.actuators] / truth[system.space.actuators]
    return float(np.max(np.abs(ratio / np.mean(ratio) - 1))) if len(ratio) > 1 else 0.0


def plant_direction_error(system: SecondOrderSystem, theta_hat: Array, truth: Array) -> float:
    """Sine of the angle between what is observable of the estimated and the true plant.

    The plant is θ/scale without its actuators; what is observable of it, were the actuator forces
    known, is orthogonal to the nullspace of the plant's own columns of W. 0 is right up to a
    common scale, and 1 is at right angles.
    """
    plant = np.setdiff1d(np.arange(system.p), system.space.actuators)
    rng = np.random.default_rng(0)
    W = regressor_stack(system, truth, rng)[:, plant]
    basis = split(W).P_perp
    estimated, true = ((theta / system.space.scale)[plant] @ basis for theta in (theta_hat, truth))
    cosine = estimated @ true / (np.linalg.norm(estimated) * np.linalg.norm(true))
    return float(np.sqrt(max(0.0, 1 - cosine**2)))


def force_residual_ratio(
    system: SecondOrderSystem,
    later: Record | None,
    theta_hat: Array,
    truth: Array | None,
) -> float | None:
    """rms of W(t, x, v, v̇) θ̂ with the true v̇, over rms of the actuator forces under θ̂.

    Args:
        system: the structure.
        later: a trajectory that the estimate has not seen.
        theta_hat: (p,) the estimate.
        truth: (p,) θ of (29), for the true v̇; None where the plant does what no θ can say: v̇ is
            then the difference of measured velocities, half-way between samples.

    Returns:
        None where the plant has no later trajectory, or is not driven on it.
    """
    return residual_ratio(system, held_out_rows(system, later, truth), theta_hat)


def held_out_rows(
    system: SecondOrderSystem, later: Record | None, truth: Array | None
) -> Array | None:
    """(k, n, p) W on a later trajectory; see the ratio above."""
    if later is None:
        return None
    stride = stride_of(later, system)
    if truth is not None:
        t, x, v, u = states(later, stride)
        _, W = system.evaluate(t, x, v, u, truth)
    else:
        t, x, v, u, a = _half_way(later, system, stride)
        W = system.regressor(t, x, v, a, u)
    return W


def residual_ratio(system: SecondOrderSystem, W: Array | None, theta_hat: Array) -> float | None:
    """rms of W θ̂, W (k, n, p), over rms of the actuator forces; None where there are none."""
    if W is None:
        return None
    actuators = system.space.actuators  # they are in F alone: their part of W is their force
    force = W[..., actuators] @ theta_hat[actuators]
    if not force.any():
        return None
    return float(np.sqrt(np.mean((W @ theta_hat) ** 2) / np.mean(force**2)))


def _half_way(
    record: Record, system: SecondOrderSystem, stride: int
) -> tuple[Array, Array, Array, Array, Array]:
    """(t, x, v, u, v̇) half-way between neighbouring rows, of every stride-th row."""
    k = np.arange(0, len(record) - 1, stride)
    t, q, v, u = record["t"], record["q"], record["v"], record["u"][k]
    steps = [0.5 * system.difference(q[i], q[i + 1]) for i in k]
    middle = np.array([system.integrate(q[i], step) for i, step in zip(k, steps, strict=True)])
    mean = 0.5 * (v[k] + v[k + 1])
    rate = (v[k + 1] - v[k]) / (t[k + 1] - t[k])[:, None]
    return 0.5 * (t[k] + t[k + 1]), np.hstack([middle, mean]), mean, u, rate
