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
from .truth import true_theta

_UNSOLVED = 1e-6  # share of V(0) that an implicit step may miss its solution by


def lyapunov_figures(run: Run) -> dict[str, float | int | None]:
    """How well the run's own law keeps what it conserves, and lets V fall, under the true θ."""
    record, law, V = run.record, run.identifiers[""], energy(run)
    rises, bound = lyapunov_rises(V, law, record)
    rises[np.diff(run.plant.struck(record["t"]))] = 0.0  # where the truth jumped, and V with it
    stepped = law.implicit(record["t"])
    if "" in run.states:
        slack = law.slack(run.states[""], true_theta(run))
        bound = bound + stepped * (slack + _UNSOLVED * V[0])
    else:
        rises[stepped] = 0.0  # only a memory could judge its steps
    conserved = kept(law, record)
    drift = float(np.max(np.abs(conserved / conserved[0] - 1))) if law.conserves else None
    return {
        "conserved_drift": drift,
        "lyapunov_violations": int(np.count_nonzero(rises > bound)),
        "lyapunov_largest_rise": float(rises.max(initial=0.0) / (V[0] or np.inf)),
        "lyapunov_bound": float(np.max(bound, initial=0.0) / (V[0] or np.inf)),
    }


def energy(run: Run) -> Array:
    """(N,) V of the scenario's own identifier, under the true θ of each row's time."""
    system, law, record = run.plant.system, run.identifiers[""], run.record
    V, struck = lyapunov(system, law, record, run.plant.truth), run.plant.struck(record["t"])
    if not struck.any():
        return V
    return np.where(struck, lyapunov(system, law, record, true_theta(run)), V)


def lyapunov(system: SecondOrderSystem, law: Identifier, record: Record, truth: Array) -> Array:
    """(N,) V = ½ Δvᵀ M(x, θ) Δv + ½ Δθᵀ Γ⁻¹ Δθ (66), with the true θ.

    Parameters that an identifier holds do not count: they have no Γ⁻¹.
    """
    dv = record["v_hat"] - record["v"]
    x = np.hstack([record["q"], record["v"]])
    rows = max(1, NUMBERS // (system.n * system.p))
    momentum = [system.W_M(x[k : k + rows], dv[k : k + rows]) @ truth
                for k in range(0, len(x), rows)]  # fmt: skip
    kinetic = np.einsum("ki,ki->k", dv, np.concatenate(momentum))
    return 0.5 * kinetic + law.divergence(truth, record["theta_hat"])


def lyapunov_rises(V: Array, law: Identifier, record: Record) -> tuple[Array, Array]:
    """By how much V rose from each row to the next, and what the integrator may be blamed for.

    Returns:
        (N−1,) rises, ≤ 0 where V fell; (N−1,) bounds.

    V̇ = −Δvᵀ M K Δv ≤ 0 (69) holds for the exact flow. RK4 makes an error in each step; the same
    error shows in θ̂ᵀ Γ⁻¹ θ̂, which (30) conserves exactly and which is half of V's second term
    but for Δθ in place of θ̂. The bound is that measured defect over the run, per row, plus the
    rounding of V itself.
    """
    conserved = kept(law, record)
    defect = np.max(np.abs(np.diff(conserved)), initial=0.0)
    sizes = np.maximum(V[1:], conserved[1:]) + law.cancelling
    rounding = 8 * np.finfo(float).eps * sizes
    return np.diff(V), defect + rounding


def kept(law: Identifier, record: Record) -> Array:
    """(N,) the law's conserved quantity along a record, with what implicit steps have taken."""
    return law.conserved(record["theta_hat"]) + record["spent"]


def assumption_46(run: Run) -> tuple[float | None, float]:
    """The margin of (46), negative where it fails, and λ_min(M(x, θ)) over the run.

    (46) asks for √(λ_max(Γ) Δθ(t₀)ᵀ Γ⁻¹ Δθ(t₀)) + ε ≤ λ_min(M(x, θ)), which mixes units: it is
    evaluated as it stands, in SI units. Without it M̂ may lose definiteness; most runs do without.
    """
    law, system = run.identifiers[""], run.plant.system
    _, x, _, _ = states(run.record, max(1, len(run.record) // 200))
    least = float(np.linalg.eigvalsh(system.mass_matrix(x, run.plant.truth)).min())
    constant = not run.scenario.identifier.in_cone
    if not (constant and isinstance(law, NullspaceIdentifier) and law.conserves):
        return None, least  # (46) speaks of a constant Γ of full rank
    error = law.conserved(run.prior - run.plant.truth)
    gain = law.metric.Gamma
    largest = gain.max() if gain.ndim == 1 else np.linalg.eigvalsh(gain)[-1]
    return float(least - np.sqrt(largest * error)), least
