"""(44, 45): the laws as integrated, their order, and the quantity they conserve."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.parameters import Array
from tests.support.bench import bench, estimates, followed, order, swing


def positive_definite(diagonal: Array, rng: np.random.Generator) -> Array:
    """A full positive definite matrix near the given diagonal."""
    mixing = np.linalg.qr(np.eye(len(diagonal)) + 0.2 * rng.standard_normal((len(diagonal),) * 2))[
        0
    ]
    root = np.sqrt(diagonal)[:, None] * (mixing @ np.diag(rng.uniform(0.7, 1.4, len(diagonal))))
    return root @ root.T


def test_44_45_converge_with_order_4():
    """(44, 45) with full K and Γ, against the same law written out and solved to 1e-12.

    The reference reads x(t) itself; the identifier has it at its samples only. Its RK4 and its
    interpolation between samples must both be of fourth order.
    """
    table, motion = swing()
    system, rng = table.system, np.random.default_rng(19)
    K = positive_definite(np.full(system.n, 20.0), rng)
    Gamma = positive_definite(10.0 * system.space.scale**2, rng)
    prior, n = table.prior(0.3), system.n

    def law(t: float, z: Array) -> Array:
        x, v_hat, theta_hat = motion.x(t), z[:n], z[n:]
        dv = v_hat - system.split(x)[1]  # (37)
        a_hat = system.acceleration(t, x, v_hat, motion.u, theta_hat)  # (29)
        W = system.regressor(t, x, v_hat, a_hat, motion.u)  # (10), (31)
        return np.concatenate([a_hat - K @ dv, Gamma @ W.T @ dv])  # (44), (45)

    start = np.concatenate([system.split(motion.x(0))[1], prior])
    exact = solve_ivp(law, (0, motion.seconds), start, method="DOP853", rtol=1e-12, atol=1e-14).y[
        :, -1
    ]
    counts, errors = np.array([100, 200, 400, 800]), []
    for count in counts:
        identifier = paper_identifier(system, K, Gamma, prior, motion.seconds / count)
        last, _ = followed(identifier, motion.samples(count))
        end = np.concatenate([last.v_hat, last.theta_hat])
        errors.append(
            np.abs((end - exact) / np.concatenate([np.ones(n), system.space.scale])).max()
        )
    moved = np.abs((exact - start)[n:] / system.space.scale).max()
    assert errors[-1] < 1e-6 * moved
    assert 3.5 < order(1 / counts, np.array(errors)) < 5.0


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum"])
def test_44_45_a_diagonal_gain_is_a_matrix(name: str):
    """K and Γ given by their diagonals or as whole matrices are the same law."""
    table = bench(name)
    system, samples = table.system, table.drive(1.0)
    K, Gamma = np.full(system.n, 5.0), 0.1 * system.space.scale**2
    ends = [
        followed(paper_identifier(system, k, g, table.prior(0.3), table.dt), samples)[0]
        for k, g in ((K, Gamma), (np.diag(K), Gamma), (K, np.diag(Gamma)))
    ]
    for other in ends[1:]:
        assert other.v_hat == pytest.approx(ends[0].v_hat, rel=1e-10, abs=1e-12)
        assert other.theta_hat == pytest.approx(ends[0].theta_hat, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum", "ur5"])
def test_30_45_conserve_the_length_of_the_estimate(name: str):
    """(30) in (45): d/dt ½ θ̂ᵀ Γ⁻¹ θ̂ = (W θ̂)ᵀ Δv = 0, along MuJoCo's plant; Δθᵀ Γ⁻¹ Δθ is not."""
    table = bench(name)
    prior = table.prior(0.3)
    law = table.law.build(table.system, prior, table.dt)
    _, theta_hat = estimates(law, table.drive(2.0, prior=prior))
    length, error = law.conserved(theta_hat), law.conserved(theta_hat - table.truth)
    assert np.abs(length / length[0] - 1).max() < 1e-8
    assert abs(error[-1] / error[0] - 1) > 1e-3


def test_45_conserved_quantity_drifts_with_order_4_or_5():
    """RK4 conserves θ̂ᵀ Γ⁻¹ θ̂ up to its own error: order 4, or 5 as its square may have."""
    table, motion = swing()
    prior = table.prior(0.3)
    counts, drifts = np.array([50, 100, 200, 400]), []
    Gamma = positive_definite(10.0 * table.system.space.scale**2, np.random.default_rng(20))
    for count in counts:
        law = paper_identifier(table.system, np.full(2, 20.0), Gamma, prior, motion.seconds / count)
        _, theta_hat = estimates(law, motion.samples(count))
        length = law.conserved(theta_hat)
        drifts.append(np.abs(length / length[0] - 1).max())
    assert 3.5 < order(1 / counts, np.array(drifts)) < 5.5
