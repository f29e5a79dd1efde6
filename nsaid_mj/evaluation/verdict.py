"""The verdict on a run: one line with the outcome and the figures behind it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..parameters import Array
from ..system import SecondOrderSystem

CONVERGED = 1e-2  # largest distance to the true set, or ± along any direction, over ‖θ̂/scale‖
PREDICTS = 1e-3  # largest force residual on a held-out trajectory, used if the truth is unknown
CONTRADICTED = 1e-2  # smallest share of the actuator forces left unexplained by every θ
_MARGIN = 3.0  # factor on the smallest possible residual, within which an estimate has converged
_FASTER = "--law efficient does in seconds what this law does in hours"


def verdict(summary: dict[str, Any]) -> str:
    """The outcome of a run in one line: a judgement, a colon, and the figures it is based on.

    The first that applies: a run that did not complete *ended early*; a motion that no θ of the
    structure explains *contradicts* it, judged from the measurements alone (`misfit`), or, for a
    simulated plant, because every θ leaves more than `CONTRADICTED` of the forces on a held-out
    trajectory unexplained; an estimate within `CONVERGED` of the true set has *converged*;
    one that is closer to it than the prior is *still converging*. If the truth is unknown, the
    stated confidence and, unless the filter's innovations show that the structure explains the
    motion, the force residual replace the distance: with noisy sensors the residual stays large. A
    misfit of `some` is told with the widening of the intervals, or as gains that drift.
    """
    if summary["status"] != "completed":
        signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
        return f"ended early: {summary['status']} at t = {summary['status_time']:.4g} s{signal}"
    if summary.get("misfit") == "contradicts":
        times = summary["misfit_contradictions"]
        return (
            f"the motion contradicts this structure: {len(times)} times in the last "
            f"{summary['misfit_seconds']:.3g} s the innovations exceeded chance, first at t = "
            f"{times[0]:.4g} s; look for a delay, a lag, a reversed sign or a force left out"
        )
    residual, floor = summary.get("force_residual_ratio"), summary.get("force_residual_floor")
    if floor is not None and floor > CONTRADICTED:
        return (
            f"the motion contradicts this structure: no parameters explain more than "
            f"{100 * (1 - floor):.3g} % of the actuator forces on a held-out trajectory"
        )
    distance, first = (summary.get(f"theta_perp_ratio{end}") for end in ("", "_initial"))
    if residual is None:  # no held-out trajectory: the run's own last part has to do
        residual = summary.get("force_residual_ratio_measured")
    predicts = "" if residual is None else f", force residual {_share(residual)}"
    if distance is not None:
        arrived, nearer = distance <= CONVERGED, first is None or distance < first
        where = f"{_share(distance)} from the true set{predicts}"
    else:
        stated = summary.get("confidence")
        worst = None if stated is None else stated["deviation_largest"]
        best = max(PREDICTS, _MARGIN * (floor or 0.0))
        explained = summary.get("misfit") == "none" and worst is not None
        if explained and residual is not None and residual > best:
            predicts += " by noise of the measured accelerations"
        arrived = explained or (residual is not None and residual <= best)
        arrived = arrived and (worst is None or worst <= CONVERGED)
        nearer = True
        known = "" if worst is None else f"least known direction to ±{_share(worst)}"
        where = ", ".join(filter(None, (known, predicts.removeprefix(", "))))
        where = where or "no measure of convergence available"
    if drift := summary.get("misfit_drift"):
        where += f"; gains drift by up to {100 * drift:.2g} % a minute"
    elif summary.get("misfit") == "some":
        where += (
            f"; the structure leaves something over, for which the intervals are "
            f"{summary['misfit_widening']:.2g} times wider"
        )
    if arrived:
        return f"converged: {where}"
    if summary["law"] in {"memory", "efficient"}:
        advice = "try a longer run or a motion with more excitation"
    elif summary.get("gains_held"):
        advice = "this law holds the actuator gains at their assumed values"
    else:
        advice = _FASTER
    return f"{'still converging' if nearer else 'not converging'}: {where}; {advice}"


def residual_floor(system: SecondOrderSystem, W: Array | None) -> float | None:
    """The smallest force residual ratio of any θ on regressors W (k, n, p).

    It is the square root of the smallest generalised eigenvalue of WᵀW with respect to that of the
    actuator columns: the part of the actuator forces that remains when plant and gains are fitted
    to this motion. None if there is no motion, or if the actuators exert no force along it.
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
    left = forces - u @ (u.T @ forces)  # residual of the best fit of the plant's parameters
    _, R = np.linalg.qr(forces)
    return float(np.linalg.svd(np.linalg.solve(R.T, left.T), compute_uv=False)[-1])


def _share(value: float) -> str:
    return f"{100 * value:.2g} %"
