"""Persistence of excitation of a run's motion, and the decay of the excited error."""

from dataclasses import replace

import numpy as np

from ...core import Array, Nullspace, PersistenceMonitor
from ..contacts import rows_along
from ..loop import Run
from .figures import last_tenth, stride_of
from .statistics import Excitation, finite
from .truth import Truth

_WINDOW_ROWS = 100  # regressors per window, about


def excitation_of(run: Run, truth: Truth | None) -> Excitation:
    """Excitation by a run's motion, and decay of the errors that the theory sends to zero."""
    record = run.record
    system = run.system
    level_, level_perp, share_perp = _levels(run, truth)
    dv = first_tenth(record["v_hat"] - record["v"])
    found = Excitation(pe_level=finite(level_), velocity_error_rms_initial=finite(_rms(dv)))
    if truth is None:
        return found
    stride = stride_of(len(record), system)
    rows = slice(None, None, stride)
    t = record.log.t[rows]
    W = rows_along(system, record.log, rows, record.log.v[rows], truth.theta_at(t))
    since = truth.epoch(t) == truth.epoch(t[-1])
    stack = (W[since] * system.space.scale).reshape(-1, system.p)
    error = np.einsum("kij,kj->ki", W, record.rows("theta_hat", rows))
    return replace(
        found,
        pe_level_perp=finite(level_perp),
        pe_share_perp=finite(share_perp),
        r_excited=Nullspace.of(stack).r,
        excited_error_rms_initial=finite(_rms(first_tenth(error))),
        excited_error_rms=finite(_rms(last_tenth(error))),
    )


def _levels(run: Run, truth: Truth | None) -> tuple[float, float | None, float | None]:
    """Smallest levels of excitation over the run's complete windows; 0 if there is no window.

    The first is ε₀ of (2) for W(t, x, v̂, θ̂) [N·m·s]. If the truth is known, the second is ε₀ of
    (75), and the third the smallest ratio of a window's level to its total excitation
    (δ₀ ∫ ‖W‖² dτ)^½, None if no window has enough rows to excite every direction. Windows in which
    a fault changes the truth are skipped.
    """
    scenario = run.scenario
    log = run.record.log
    system = run.system
    window = round(scenario.pe_window / (scenario.dt * scenario.record_every))
    stride = max(1, window // _WINDOW_ROWS)
    dt = stride * scenario.record_every * scenario.dt
    rows = np.arange(0, len(log.t), stride)
    t = log.t[rows]
    v_hat = run.record.rows("v_hat", rows)
    theta_hat = run.record.rows("theta_hat", rows)
    per_window = max(1, window // stride)
    full: list[float] = []
    perpendicular: list[float] = []
    shares: list[float] = []
    for start in range(0, len(t) - per_window + 1, per_window):
        k = slice(start, start + per_window)
        if truth is not None:
            epoch = truth.epoch(t[k])
            if epoch[0] != epoch[-1]:
                continue
            W = rows_along(system, log, rows[k], log.v[rows[k]], truth.theta_at(t[k]))
            W *= system.space.scale
            P_perp = truth.nullspace_at(float(t[start])).P_perp
            perpendicular.append(PersistenceMonitor.level_of(W, dt, P_perp))
            if W.shape[0] * W.shape[1] >= P_perp.shape[1]:
                everything = np.sqrt(len(W)) * dt * np.linalg.norm(W)
                shares.append(perpendicular[-1] / (everything or np.inf))
        W = rows_along(system, log, rows[k], v_hat[k], theta_hat[k])
        full.append(PersistenceMonitor.level_of(W * system.space.scale, dt))
    if truth is None:
        return min(full, default=0.0), None, None
    share = float(min(shares)) if shares else None
    return min(full, default=0.0), min(perpendicular, default=0.0), share


def first_tenth(rows: Array) -> Array:
    """The first tenth of rows (N, …), at least one."""
    return rows[: max(1, len(rows) // 10)]


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(rows**2)))
