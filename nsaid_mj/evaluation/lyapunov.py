"""The paper's V (66) along a run, what it may rise by, and the assumption (46) on its start."""

from __future__ import annotations

import numpy as np

from ..experiment.loop import Run
from ..experiment.record import Record
from ..identifiers import Identifier
from ..identifiers.nullspace_aid import NullspaceIdentifier
from ..parameters import Array
from ..system import SecondOrderSystem
from .rows import NUMBERS, states
from .truth import Truth

_UNSOLVED = 1e-6  # share of V(0) that an implicit step may miss its solution by


def conserved_drift(run: Run) -> float | None:
    """The largest relative drift of what the run's own law conserves; None where nothing is."""
    identifier = run.identifiers[""]
    if not identifier.conserves:
        return None
    conserved = kept(identifier, run.record)
    return float(np.max(np.abs(conserved / conserved[0] - 1)))


def lyapunov_figures(run: Run, truth: Truth) -> dict[str, float | int]:
    """How well the run's own law lets V fall, under the true θ."""
    record, identifier, V = run.record, run.identifiers[""], energy(run, truth)
    rises, bound = lyapunov_rises(V, identifier, record)
    rises[np.diff(truth.struck(record["t"]))] = 0.0  # where the truth jumped, and V with it
    stepped = identifier.implicit(record["t"])
    if "" in run.states:
        slack = identifier.slack(run.states[""], truth.theta)
        bound = bound + stepped * (slack + _UNSOLVED * V[0])
    else:
        rises[stepped] = 0.0  # only a memory could judge its steps
    return {
        "lyapunov_violations": int(np.count_nonzero(rises > bound)),
        "lyapunov_largest_rise": float(rises.max(initial=0.0) / (V[0] or np.inf)),
        "lyapunov_bound": float(np.max(bound, initial=0.0) / (V[0] or np.inf)),
    }


def energy(run: Run, truth: Truth) -> Array:
    """(N,) V of the scenario's own identifier, under the true θ of each row's time."""
    system, identifier, record = run.system, run.identifiers[""], run.record
    struck = truth.struck(record["t"])
    V = lyapunov(system, identifier, record, truth.initial)
    if not struck.any():
        return V
    return np.where(struck, lyapunov(system, identifier, record, truth.theta), V)


def lyapunov(
    system: SecondOrderSystem, identifier: Identifier, record: Record, truth: Array
) -> Array:
    """(N,) V = ½ Δvᵀ M(x, θ) Δv + ½ Δθᵀ Γ⁻¹ Δθ (66), with the true θ.

    Parameters that an identifier holds do not count: they have no Γ⁻¹.
    """
    dv = record["v_hat"] - record["v"]
    x = np.hstack([record["q"], record["v"]])
    rows = max(1, NUMBERS // (system.n * system.p))
    momentum = [
        system.W_M(x[k : k + rows], dv[k : k + rows]) @ truth for k in range(0, len(x), rows)
    ]
    kinetic = np.einsum("ki,ki->k", dv, np.concatenate(momentum))
    return 0.5 * kinetic + identifier.divergence(truth, record["theta_hat"])


def lyapunov_rises(V: Array, identifier: Identifier, record: Record) -> tuple[Array, Array]:
    """By how much V rose from each row to the next, and what the integrator may be blamed for.

    Returns:
        (N−1,) rises, ≤ 0 where V fell; (N−1,) bounds.

    V̇ = −Δvᵀ M K Δv ≤ 0 (69) holds for the exact flow. RK4 makes an error in each step; the same
    error shows in θ̂ᵀ Γ⁻¹ θ̂, which (30) conserves exactly and which is half of V's second term
    but for Δθ in place of θ̂. The bound is that measured defect over the run, per row, plus the
    rounding of V itself.
    """
    conserved = kept(identifier, record)
    defect = np.max(np.abs(np.diff(conserved)), initial=0.0)
    sizes = np.maximum(V[1:], conserved[1:]) + identifier.cancelling
    rounding = 8 * np.finfo(float).eps * sizes
    return np.diff(V), defect + rounding


def kept(identifier: Identifier, record: Record) -> Array:
    """(N,) the law's conserved quantity along a record, with what implicit steps have taken."""
    return identifier.conserved(record["theta_hat"]) + record["spent"]


def assumption_46(run: Run, truth: Truth) -> tuple[float | None, float]:
    """The margin of (46), negative where it fails, and λ_min(M(x, θ)) over the run.

    (46) asks for √(λ_max(Γ) Δθ(t₀)ᵀ Γ⁻¹ Δθ(t₀)) + ε ≤ λ_min(M(x, θ)), which mixes units: it is
    evaluated as it stands, in SI units. Without it M̂ may lose definiteness; most runs do without.
    """
    identifier, theta = run.identifiers[""], truth.initial
    _, x, _, _ = states(run.record.log, max(1, len(run.record) // 200))
    least = float(np.linalg.eigvalsh(run.system.mass_matrix(x, theta)).min())
    constant = not run.scenario.identifier.in_cone
    if not (constant and isinstance(identifier, NullspaceIdentifier) and identifier.conserves):
        return None, least  # (46) speaks of a constant Γ of full rank
    error = identifier.conserved(run.prior - theta)
    gain = identifier.metric.Gamma
    largest = gain.max() if gain.ndim == 1 else np.linalg.eigvalsh(gain)[-1]
    return float(least - np.sqrt(largest * error)), least
