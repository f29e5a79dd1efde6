"""The Lyapunov function V (66) along a run, bounds on integration error, and assumption (46)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Array, ConstantMetric, Identifier, NullspaceIdentifier, SecondOrderSystem
from ..loop import Run
from ..record import Record
from .figures import states
from .truth import Truth

_CHUNK = 1_000_000  # entries of temporary arrays in memory at once; the record itself may be large
_UNSOLVED = 1e-5  # tolerance of an implicit step's solution, over V(0)


def conserved_drift(run: Run) -> float | None:
    """Largest relative drift of the law's conserved quantity; None if it conserves nothing."""
    identifier = run.identifiers[""]
    if not identifier.conserves:
        return None
    conserved = kept(identifier, run.record)
    return float(np.max(np.abs(conserved / conserved[0] - 1)))


class Rises(NamedTuple):
    """Rises of V between the rows of a record."""

    violations: int  # time steps in which V rose beyond the error bound
    largest: float  # the largest rise, over V(0)
    bound: float  # the largest rise that integrator and memory explain, over V(0)


def rises_of(run: Run, truth: Truth) -> Rises | None:
    """Number and size of the steps in which V, under the true θ, rose beyond the error bound.

    None for a law without a proof. Steps in which V is undefined, as for a law in the cone after an
    actuator was reversed, do not count.
    """
    record = run.record
    identifier = run.identifiers[""]
    if not isinstance(identifier, NullspaceIdentifier):
        return None
    V = energy(run, truth)
    rises, bound = lyapunov_rises(V, identifier, record)
    rises[np.diff(truth.epoch(record["t"])) > 0] = 0.0  # a fault changes the truth, and V with it
    undefined = ~np.isfinite(rises)
    rises[undefined] = 0.0
    stepped = identifier.implicit(record["t"])
    if run.scenario.record_every == 1 and stepped.any():
        bound += identifier.slacks(record.log, truth.theta)
        bound[stepped] += _UNSOLVED * V[0]
    else:
        rises[stepped] = 0.0  # the slack of an implicit step needs every measurement
    bound = np.where(undefined | ~np.isfinite(bound), 0.0, bound)
    return Rises(
        violations=int(np.count_nonzero(rises > bound)),
        largest=float(rises.max(initial=0.0) / (V[0] or np.inf)),
        bound=float(np.max(bound, initial=0.0) / (V[0] or np.inf)),
    )


def energy(run: Run, truth: Truth, rows: NDArray[np.intp] | None = None) -> Array:
    """(k,) V of the scenario's own identifier, under the true θ at each row's time [J]."""
    system = run.system
    identifier = run.identifiers[""]
    record = run.record
    if rows is not None:
        columns = {key: record.rows(key, rows) for key in ("t", "q", "v", "v_hat", "theta_hat")}
        record = Record(columns, record.metadata, record.complete)
    epochs = truth.epoch(record["t"])
    V = np.empty(len(record))
    for epoch in np.unique(epochs):
        within = epochs == epoch
        theta = truth.theta_at(float(record["t"][within][-1]))
        V[within] = lyapunov(system, identifier, record, theta)[within]
    return V


def lyapunov(
    system: SecondOrderSystem, identifier: Identifier, record: Record, truth: Array
) -> Array:
    """(N,) V = ½ Δvᵀ M(x, θ) Δv + ½ Δθᵀ Γ⁻¹ Δθ (66), under the true θ [J].

    Parameters that the identifier holds constant are left out of the second term.
    """

    def of(part: slice) -> Array:
        v = record["v"][part]
        theta_hat = record.rows("theta_hat", part)
        dv = record["v_hat"][part] - v
        momentum = system.W_M(np.hstack([record["q"][part], v]), dv) @ truth
        kinetic = np.einsum("ki,ki->k", dv, momentum)
        return 0.5 * kinetic + identifier.divergence(truth, theta_hat)

    return _by_parts(of, len(record), system.n * system.p)


def _by_parts(function: Callable[[slice], Array], length: int, width: int) -> Array:
    """(length,) values of a function of a stretch of rows, with `width` entries in memory each."""
    rows = max(1, _CHUNK // width)
    parts = [function(slice(k, k + rows)) for k in range(0, length, rows)]
    return np.concatenate(parts) if parts else np.zeros(0)


def lyapunov_rises(V: Array, identifier: Identifier, record: Record) -> tuple[Array, Array]:
    """Increments of V between rows (N−1,), and bounds on the part that integration error explains.

    V̇ = −Δvᵀ M K Δv ≤ 0 (69) holds for the exact flow. The error of RK4 also appears in θ̂ᵀ Γ⁻¹ θ̂,
    which (30) conserves exactly and which has the form of V's second term with θ̂ for Δθ. The bound
    (N−1,) is the largest defect of θ̂ᵀ Γ⁻¹ θ̂ in any step of the run, plus the rounding error of V.
    """
    conserved = kept(identifier, record)
    defect = np.max(np.abs(np.diff(conserved)), initial=0.0)
    bound = np.maximum(V[1:], conserved[1:])  # in place: there may be millions of rows
    assert identifier.metric is not None  # as it conserves something
    bound += identifier.metric.cancelling
    bound *= 8 * np.finfo(float).eps
    bound += defect
    return np.diff(V), bound


def kept(identifier: Identifier, record: Record) -> Array:
    """(N,) the law's conserved quantity along a record, corrected for implicit steps."""
    conserved = _by_parts(
        lambda part: identifier.conserved(record.rows("theta_hat", part)),
        len(record),
        record.rows("theta_hat", slice(1)).size,
    )
    return conserved + record["spent"]


def assumption_46(run: Run, truth: Truth) -> tuple[float | None, float]:
    """The margin of assumption (46), and the smallest λ_min(M(x, θ)) over the run.

    (46) requires √(λ_max(Γ) Δθ(t₀)ᵀ Γ⁻¹ Δθ(t₀)) + ε ≤ λ_min(M(x, θ)). It mixes units and is
    evaluated in SI units as it stands. If it is violated, M̂ may lose definiteness; it is
    sufficient, not necessary, and most runs violate it. The margin is negative if (46) is violated,
    None if the law has no constant Γ.
    """
    identifier = run.identifiers[""]
    theta = truth.initial
    _, x, _, _ = states(run.record.log, max(1, len(run.record) // 200))
    least = float(np.linalg.eigvalsh(run.system.mass_matrix(x, theta)).min())
    constant = not run.scenario.identifier.in_cone
    if not (constant and isinstance(identifier, NullspaceIdentifier) and identifier.conserves):
        return None, least  # (46) speaks of a constant Γ of full rank
    error = identifier.conserved(run.prior - theta)
    assert isinstance(identifier.metric, ConstantMetric)
    gain = identifier.metric.Gamma
    largest = gain.max() if gain.ndim == 1 else np.linalg.eigvalsh(gain)[-1]
    return float(least - np.sqrt(largest * error)), least
