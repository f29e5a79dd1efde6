"""(76–96): the steps of Theorem 2's proof, on a run and on random regressors.

All of it in θ/scale coordinates: W·diag(scale), and Γ_s = diag(scale)⁻¹ Γ diag(scale)⁻¹. The
proof uses (75) at one w in each window. `persistence.level` in place of the printed norm gives
the same constants (82, 95), by Minkowski's inequality in L² instead of the triangle's in ℝⁿ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier
from nsaid_mj.core.nullspace.persistence import PersistenceMonitor
from nsaid_mj.core.parameters import Array
from tests.support.bench import accelerations, columns


class Path(NamedTuple):
    """What the proof speaks of, at the N samples of a run."""

    dt: float
    dv: Array  # (N, n)
    W_hat: Array  # (N, n, p) W(t, x, v̂, θ̂), with the command held from the sample on
    W_hat_end: Array  # (N−1, n, p) the same at the following sample, with the command still held
    B: Array  # (N, n, p−r) W(t, x, v, θ) P̄_⊥
    across: Array  # (N, p−r) θ̄_P⊥
    Gamma: Array  # (p,) diagonal of Γ_s
    P_perp: Array


@pytest.fixture(scope="module")
def path(converged) -> Path:
    """The first 60 s of the run: its transient, and what is left when that is over."""
    table, samples, v_hat, theta_hat = converged
    system, nullspace, scale = table.system, table.nullspace, table.system.space.scale
    t, x, v, u = (part[:6000] for part in columns(samples))
    v_hat, theta_hat = v_hat[:6000], theta_hat[:6000]

    def W_hat(k: slice, command: Array) -> Array:
        a_hat = accelerations(system, t[k], x[k], v_hat[k], command, theta=theta_hat[k])
        return system.regressor(t[k], x[k], v_hat[k], a_hat, command) * scale

    a = system.acceleration(t, x, v, u, table.truth)
    law = table.law.build(system, table.prior(0.5), table.dt)
    assert isinstance(law, NullspaceIdentifier)
    return Path(
        table.dt,
        v_hat - v,
        W_hat(slice(None), u),
        W_hat(slice(1, None), u[:-1]),
        system.regressor(t, x, v, a, u) * scale @ nullspace.P_perp,
        nullspace.coordinates(theta_hat / scale)[1],
        law.metric.Gamma / scale**2,
        nullspace.P_perp,
    )


def largest(matrices: Array) -> float:
    """The largest spectral norm of matrices (N, n, k), as in (76) and (77)."""
    return float(np.linalg.norm(matrices, ord=2, axis=(1, 2)).max())


def test_79_theta_perp_moves_by_the_integral_of_its_rate(path: Path):
    """(79) θ̄_P⊥(t) − θ̄_P⊥(t_i) = ∫ P̄_⊥ᵀ Γ W(t, x, v̂, θ̂)ᵀ Δv, by the trapezoidal rule."""

    def rate(W: Array, dv: Array) -> Array:
        return (np.einsum("kip,ki->kp", W, dv) * path.Gamma) @ path.P_perp

    steps = rate(path.W_hat[:-1], path.dv[:-1]) + rate(path.W_hat_end, path.dv[1:])
    moved = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * path.dt * steps, axis=0)])
    wandered = np.abs(path.across - path.across[0]).max()
    assert wandered > 0.05
    assert np.abs(path.across - path.across[0] - moved).max() < 1e-3 * wandered


@pytest.mark.parametrize("rows", [10, 100, 1000])
def test_81_theta_perp_is_flat_where_the_velocity_error_is_small(path: Path, rows: int):
    """(77–81) ‖Δv‖ ≤ ε′ = φ/(T′ λ_max(Γ) b_θ̂) keeps θ̄_P⊥ within φ, in windows of any length T′."""
    b = max(largest(path.W_hat), largest(path.W_hat_end))  # (77)
    shares = []
    for start in range(0, 2000, rows):  # later Δv is down to RK4's own error
        k = slice(start, start + rows + 1)
        phi = rows * path.dt * path.Gamma.max() * b * np.linalg.norm(path.dv[k], axis=1).max()
        flat = np.linalg.norm(path.across[k] - path.across[start], axis=1).max()
        assert flat <= phi
        shares.append(flat / phi)
    assert max(shares) > {10: 0.5, 100: 0.2, 1000: 0.02}[rows]  # the bound is not idle


def test_81_the_bound_is_met_by_the_worst_regressor():
    """(80, 81) with equality: Wᵀ Δv along the first eigenvector of Γ, which lies in P_⊥."""
    rng = np.random.default_rng(24)
    basis, _ = np.linalg.qr(rng.standard_normal((5, 5)))
    P_perp, values = basis[:, :3], np.array([4.0, 1.0, 0.5, 2.0, 0.1])
    Gamma, T, b, phi = basis @ np.diag(values) @ basis.T, 0.7, 3.0, 0.2
    error = phi / (T * values.max() * b)  # ε′ of the proof
    W, dv = b * np.outer([0.6, 0.8], basis[:, 0]), error * np.array([0.6, 0.8])
    assert largest(W[None]) == pytest.approx(b)
    assert T * np.linalg.norm(P_perp.T @ Gamma @ W.T @ dv) == pytest.approx(phi, rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_82_95_a_flat_error_shows_in_the_window(seed: int):
    """(82–95) as printed, for regressors that meet (75) to the letter: n = 4 ≥ p − r = 3.

    W P̄_⊥ is nearly an isometry and θ̄_P⊥ goes straight back by φ, which leaves little to spare.
    """
    rng, dt, count = np.random.default_rng(seed), 0.01, 200
    delta, tau = dt * count, np.linspace(0, 2 * np.pi, count)[:, None, None]
    isometry = np.linalg.qr(rng.standard_normal((4, 3)))[0]
    B = 3 * isometry + 0.2 * np.sin(tau * rng.uniform(1, 5, (4, 3)))
    least = np.linalg.svd(B.sum(axis=0) * dt)[1][-1]  # ε₀ of (75)
    b, start = largest(B), rng.standard_normal(3)
    size = np.linalg.norm(start)
    phi = least * size / (2 * delta * b)  # (82)
    across = start * (1 - phi / size * np.minimum(np.arange(count) / 3, 1))[:, None]
    force = np.einsum("kij,kj->ki", B, across)
    held = np.einsum("kij,j->ki", B, start)
    integral, still = (np.linalg.norm(part.sum(axis=0) * dt) for part in (force, held))
    assert 0 < still - integral <= delta * b * phi  # (84–87), with θ̄_P⊥(t_i) in the first integral
    assert still >= size * least * (1 - 1e-12)  # (88, 89)
    assert integral >= least * size / 2  # (91)
    norms = np.linalg.norm(force, axis=1)
    assert norms.sum() * dt >= integral * (1 - 1e-12)  # (92, 93)
    assert norms.max() >= least * size / (2 * delta) > 0  # (95, 96)


@pytest.mark.parametrize("seed", range(5))
def test_82_95_hold_with_the_level_where_the_literal_condition_cannot(seed: int):
    """(82, 95) with ε₀ = `level`, for n = 1 < p − r = 3 and ∫ W P̄_⊥ dτ = 0.

    At every time θ̄_P⊥ is where within φ of its start it shows least.
    """
    rng, dt, count = np.random.default_rng(seed), 0.01, 200
    delta, tau = dt * count, np.arange(count) * 2 * np.pi / count
    tones = zip(rng.permutation(6)[:3] + 1, rng.uniform(0, 6, 3), strict=True)
    B = np.stack([np.sin(k * tau + phase) for k, phase in tones], axis=1)
    assert np.abs(B.sum(axis=0)).max() < 1e-12 * count  # (75) is met for no w at all
    start = rng.standard_normal(3)
    size = np.linalg.norm(start)
    least, b = PersistenceMonitor.level_of(B[:, None], dt), largest(B[:, None])
    phi = least * size / (2 * delta * b)  # (82)
    lengths = np.linalg.norm(B, axis=1)
    step = np.clip(B @ start / lengths, -phi, phi)
    across = start - (step / lengths)[:, None] * B
    assert np.linalg.norm(across - start, axis=1).max() == pytest.approx(phi, rel=1e-12)
    force = np.einsum("kj,kj->k", B, across)
    assert np.abs(force).max() >= least * size / (2 * delta) > 0  # (95)


def test_82_no_larger_step_will_do():
    """(82) is sharp: with W P̄_⊥ = b·(isometry) (91) is an equality at φ, and 2φ leaves nothing."""
    delta, b = 2.0, 3.0
    B = b * np.eye(4)[:, :3]
    start = np.array([0.3, -0.4, 1.2])  # of length 1.3
    least = delta * b
    phi = least * 1.3 / (2 * delta * b)
    for share, left in ((1.0, 0.5), (2.0, 0.0)):
        integral = delta * B @ (start * (1 - share * phi / 1.3))
        assert np.linalg.norm(integral) == pytest.approx(left * least * 1.3, abs=1e-12)


@pytest.mark.parametrize("rows", [500, 1000])
def test_90_a_run_hides_no_error_larger_than_its_force(path: Path, rows: int):
    """(90, 95) on a run, in every window: ε₀ ‖θ̄_P⊥(t_i)‖ ≤ δ₀ (max ‖W P̄_⊥ θ̄_P⊥‖ + b_θ φ).

    ε₀ is that of the window, and φ what θ̄_P⊥ does move in it. Both terms on the right vanish by
    Lemma 1 and (81), so the left does: that is the theorem.
    """
    b, delta, bounds = largest(path.B), rows * path.dt, []  # (76)
    for start in range(0, len(path.B) - rows, rows // 2):
        k = slice(start, start + rows)
        force = np.linalg.norm(np.einsum("kij,kj->ki", path.B[k], path.across[k]), axis=1).max()
        phi = np.linalg.norm(path.across[k] - path.across[start], axis=1).max()
        error = np.linalg.norm(path.across[start])
        bounds.append(delta * (force + b * phi) / PersistenceMonitor.level_of(path.B[k], path.dt))
        assert error <= bounds[-1]
    assert bounds[-1] < 1e-3 * np.linalg.norm(path.across[0])
