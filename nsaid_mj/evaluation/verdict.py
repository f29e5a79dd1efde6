"""One line that says what a run has come to, and the figure it rests on."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..parameters import Array
from ..system import SecondOrderSystem

CONVERGED = 1e-2  # distance to the true set, and ± along the least known direction, of ‖θ̂/scale‖
PREDICTS = 1e-3  # force residual on another trajectory, where there is no truth to compare with
CONTRADICTED = 1e-2  # share of the actuator forces that no θ of the structure explains
_MARGIN = 3.0  # an estimate whose residual is within this factor of the best possible has arrived
_FASTER = "--law memory does in seconds what this law does in hours"


def verdict(summary: dict[str, Any]) -> str:
    """The outcome of a run in one line: a judgement, a colon, and the figure that carries it.

    In this order: a run that did not complete *ended early*; a structure that leaves more than
    `CONTRADICTED` of the forces on a held-out trajectory unexplained whatever θ is, is
    *contradicted by the motion*; an estimate within `CONVERGED` of the true set has *converged*;
    any other is *still converging* as long as it has come nearer. Where there is no truth the
    stated confidence and the residual on the held-out trajectory take the place of the distance.

    Args:
        summary: of a run, see `summarize`; keys that need a truth may be absent.
    """
    if summary["status"] != "completed":
        signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
        return f"ended early: {summary['status']} at t = {summary['status_time']:.4g} s{signal}"
    residual, floor = summary.get("force_residual_ratio"), summary.get("force_residual_floor")
    if floor is not None and floor > CONTRADICTED:
        return (
            f"the motion contradicts this structure: no parameters explain more than "
            f"{100 * (1 - floor):.3g} % of the actuator forces on another trajectory"
        )
    distance, first = (summary.get(f"theta_perp_ratio{end}") for end in ("", "_initial"))
    predicts = "" if residual is None else f", forces on another trajectory to {_share(residual)}"
    if distance is not None:
        arrived, nearer = distance <= CONVERGED, first is None or distance < first
        where = f"{_share(distance)} from the true set{predicts}"
    else:
        stated = summary.get("confidence")
        worst = None if stated is None else stated["deviation_largest"]
        best = max(PREDICTS, _MARGIN * (floor or 0.0))
        arrived = residual is not None and residual <= best
        arrived = arrived and (worst is None or worst <= CONVERGED)
        nearer = True
        known = "" if worst is None else f"the least known direction to ±{_share(worst)}"
        where = ", ".join(filter(None, (known, predicts.removeprefix(", "))))
        where = where or "nothing to judge it by"
    if arrived:
        return f"converged: {where}"
    if summary["law"] == "memory":
        advice = "a longer run or a livelier motion brings more"
    elif summary.get("gains_held"):
        advice = "this law holds the actuator gains at their assumed values"
    else:
        advice = _FASTER
    return f"{'still converging' if nearer else 'not converging'}: {where}; {advice}"


def residual_floor(system: SecondOrderSystem, W: Array | None) -> float | None:
    """The smallest force residual ratio that any θ has on regressors W (k, n, p).

    It is the square root of the smallest generalised eigenvalue of WᵀW against that of the actuator
    columns: what is left of the actuator forces when plant and gains are fitted to this very
    motion. None where there is no motion, or the actuators do nothing on it.
    """
    if W is None:
        return None
    actuators = system.space.actuators
    plant = np.setdiff1d(np.arange(system.p), actuators)
    rows = (W * system.space.scale).reshape(-1, system.p)
    forces = rows[:, actuators]
    forces = forces[:, forces.any(axis=0)]
    if not forces.size:
        return None
    u, s, _ = np.linalg.svd(rows[:, plant], full_matrices=False)
    u = u[:, s > 1e-10 * s[0]]
    left = forces - u @ (u.T @ forces)  # what the best plant leaves of each actuator's force
    _, R = np.linalg.qr(forces)
    return float(np.linalg.svd(np.linalg.solve(R.T, left.T), compute_uv=False)[-1])


def _share(value: float) -> str:
    return f"{100 * value:.2g} %"
