"""Persistence of excitation of a run's motion, and the decay of the excited error."""

import numpy as np

from ..experiment.loop import Run
from ..nullspace import level, split
from ..parameters import Array
from .figures import last_tenth, states, stride_of
from .truth import Truth

_WINDOW_ROWS = 100  # regressors per window, about


def persistence_figures(run: Run, truth: Truth | None) -> dict[str, float | None]:
    """Smallest levels of excitation over the run's complete windows; 0 if there is no window.

    `pe_level` is ε₀ of (2) for W(t, x, v̂, θ̂) [N·m·s]. If the truth is known, `pe_level_perp` is ε₀
    of (75), and `pe_share_perp` the smallest ratio of a window's level to its total excitation
    (δ₀ ∫ ‖W‖² dτ)^½, None if no window has enough rows to excite every direction. Windows in which
    a fault changes the truth are skipped.
    """
    scenario, log, system = run.scenario, run.record.log, run.system
    rows = round(scenario.pe_window / (scenario.dt * scenario.record_every))
    stride = max(1, rows // _WINDOW_ROWS)
    dt = stride * scenario.record_every * scenario.dt
    t, x, v, u = states(log, stride)
    v_hat, theta_hat = (
        run.record.rows(name, slice(None, None, stride)) for name in ("v_hat", "theta_hat")
    )
    per_window = max(1, rows // stride)
    full: list[float] = []
    perpendicular: list[float] = []
    shares: list[float] = []
    for start in range(0, len(t) - per_window + 1, per_window):
        k = slice(start, start + per_window)
        if truth is not None:
            epoch = truth.epoch(t[k])
            if epoch[0] != epoch[-1]:
                continue
            _, W = system.evaluate(t[k], x[k], v[k], u[k], truth.theta_at(t[k]))
            W *= system.space.scale
            P_perp = truth.nullspace_at(float(t[start])).P_perp
            perpendicular.append(level(W, dt, P_perp))
            if W.shape[0] * W.shape[1] >= P_perp.shape[1]:
                everything = np.sqrt(len(W)) * dt * np.linalg.norm(W)
                shares.append(perpendicular[-1] / (everything or np.inf))
        _, W = system.evaluate(t[k], x[k], v_hat[k], u[k], theta_hat[k])
        full.append(level(W * system.space.scale, dt))
    found: dict[str, float | None] = {"pe_level": min(full, default=0.0)}
    if truth is not None:
        found["pe_level_perp"] = min(perpendicular, default=0.0)
        found["pe_share_perp"] = float(min(shares)) if shares else None
    return found


def motion_figures(run: Run, truth: Truth | None) -> dict[str, float | int]:
    """Directions not excited by the run's motion, and errors that the theory sends to zero.

    `velocity_error_rms_initial` is rms Δv over the first tenth of the run [SI], see Theorem 1 (70);
    `judge` gives that of the last tenth. If the truth is known, `r_excited` counts the directions
    that the motion leaves unexcited, after the fault if there is one, and `excited_error_rms` and
    `excited_error_rms_initial` are the rms of W(t, x, v, θ) θ̂ = W(t, x, v, θ) P̄_⊥ θ̄_P⊥ over the
    last and the first tenth, see Lemma 1 (74).
    """
    record, system = run.record, run.system
    dv = first_tenth(record["v_hat"] - record["v"])
    settled: dict[str, float | int] = {"velocity_error_rms_initial": _rms(dv)}
    if truth is None:
        return settled
    stride = stride_of(len(record), system)
    t, x, v, u = states(record.log, stride)
    _, W = system.evaluate(t, x, v, u, truth.theta_at(t))
    since = truth.epoch(t) == truth.epoch(t[-1])
    stack = (W[since] * system.space.scale).reshape(-1, system.p)
    error = np.einsum("kij,kj->ki", W, record.rows("theta_hat", slice(None, None, stride)))
    return {
        "r_excited": split(stack).r,
        **settled,
        "excited_error_rms_initial": _rms(first_tenth(error)),
        "excited_error_rms": _rms(last_tenth(error)),
    }


def first_tenth(rows: Array) -> Array:
    """The first tenth of rows (N, …), at least one."""
    return rows[: max(1, len(rows) // 10)]


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(rows**2)))
