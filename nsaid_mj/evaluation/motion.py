"""What a run's motion has excited, and what has settled with it."""

from __future__ import annotations

import numpy as np

from ..experiment.loop import Run
from ..nullspace import split
from ..parameters import Array
from ..persistence import level
from .rows import states, stride_of
from .truth import nullspace_at

_WINDOW_ROWS = 100  # how many regressors judge one window's excitation


def persistence_levels(run: Run) -> tuple[float, float, float | None]:
    """Smallest ε₀ of (2) for W(t, x, v̂, θ̂) and of (75) over the run's whole windows, or 0.

    A window in which the truth jumps does not count.

    Returns:
        Both levels [N·m·s]; the smallest share that (75)'s has of (δ₀ ∫ ‖W‖² dτ)^½ of its window,
        all excitation in it. None where no whole window has rows enough for every direction.
    """
    scenario, record, system = run.scenario, run.record, run.plant.system
    rows = round(scenario.pe_window / (scenario.dt * scenario.record_every))
    stride = max(1, rows // _WINDOW_ROWS)
    dt = stride * scenario.record_every * scenario.dt
    t, x, v, u = states(record, stride)
    v_hat, theta_hat = record["v_hat"][::stride], record["theta_hat"][::stride]
    per_window = max(1, rows // stride)
    full: list[float] = []
    perpendicular: list[float] = []
    shares: list[float] = []
    for start in range(0, len(t) - per_window + 1, per_window):
        k = slice(start, start + per_window)
        struck = run.plant.struck(t[k])
        if struck[0] != struck[-1]:
            continue
        _, W = system.evaluate(t[k], x[k], v[k], u[k], run.plant.truth_at(t[k]))
        W *= system.space.scale
        P_perp = nullspace_at(run, bool(struck[0])).P_perp
        perpendicular.append(level(W, dt, P_perp))
        if W.shape[0] * W.shape[1] >= P_perp.shape[1]:
            everything = np.sqrt(len(W)) * dt * np.linalg.norm(W)
            shares.append(perpendicular[-1] / (everything or np.inf))
        _, W = system.evaluate(t[k], x[k], v_hat[k], u[k], theta_hat[k])
        full.append(level(W * system.space.scale, dt))
    if not full:
        return 0.0, 0.0, None
    return min(full), min(perpendicular), float(min(shares)) if shares else None


def motion_figures(run: Run) -> dict[str, float | int]:
    """What this run's own motion has excited, and how far that has settled.

    `r_excited` counts the directions left unexcited, since the fault if any. The others are what
    Theorem 1 (70) and Lemma 1 (74) send to 0, rms over the first tenth and the last [SI]:
    `velocity_error` is Δv, whose last tenth `judge` has; `excited_error` is W(t, x, v, θ) θ̂, which
    is W(t, x, v, θ) P̄_⊥ θ̄_P⊥.
    """
    record, system = run.record, run.plant.system
    stride = stride_of(record, system)
    t, x, v, u = states(record, stride)
    _, W = system.evaluate(t, x, v, u, run.plant.truth_at(t))
    since = run.plant.struck(t) == run.plant.struck(t[-1])
    stack = (W[since] * system.space.scale).reshape(-1, system.p)
    error = np.einsum("kij,kj->ki", W, record["theta_hat"][::stride])
    first, last = _first_and_last(error)
    return {
        "r_excited": split(stack).r,
        "velocity_error_rms_initial": _first_and_last(record["v_hat"] - record["v"])[0],
        "excited_error_rms_initial": first,
        "excited_error_rms": last,
    }


def _first_and_last(error: Array) -> tuple[float, float]:
    """rms of an error (N, n) over the first and the last tenth of its rows."""
    tenth = max(1, len(error) // 10)
    first, last = (float(np.sqrt(np.mean(part**2))) for part in (error[:tenth], error[-tenth:]))
    return first, last
