"""(32–36, 39–43): the split of parameter space, and its dimension by other ways of counting."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.lab.plants.arm import true_model
from tests.support.bench import Bench, TwoVehicles, bench


def test_36_Q_is_orthogonal(table: Bench):
    """(33, 35, 36) Q = [P̄ P̄_⊥] is square and orthogonal, and holds a basis of all of θ."""
    nullspace, p = table.nullspace, table.system.p
    assert nullspace.P.shape == (p, nullspace.r)
    assert nullspace.P_perp.shape == (p, p - nullspace.r)
    assert np.abs(nullspace.Q.T @ nullspace.Q - np.eye(p)).max() < 1e-13


def test_34_P_is_in_the_nullspace_at_fresh_states(table: Bench):
    """(34) W(t, x, v, θ) P̄ = 0 at states P̄ was not computed from; no column of P̄_⊥ has that."""
    system, nullspace = table.system, table.nullspace
    t, x, v, u = table.states(50, seed=16)
    a = system.acceleration(t, x, v, u, table.truth)
    W = system.regressor(t, x, v, a, u) * system.space.scale
    W = (W / np.linalg.norm(W, axis=-1, keepdims=True)).reshape(-1, system.p)
    assert np.abs(W @ nullspace.P).max() < 1e-11  # ≤ 6e-13 · √rows on the stack it came from
    assert (np.abs(W @ nullspace.P_perp).max(axis=0) > 1e-6).all()


def test_32_the_truth_is_in_P(table: Bench):
    """(32) θ itself is in P_s(θ)."""
    assert table.nullspace.ratio(table.truth / table.system.space.scale) < 1e-9


def test_40_decomposition_round_trip(table: Bench):
    """(39, 40) θ̂ = P̄_⊥ θ̄_P⊥ + P̄ θ̄_P, with the lengths of a right-angled triangle."""
    nullspace = table.nullspace
    theta_s = np.random.default_rng(17).standard_normal((3, table.system.p))
    along, across = nullspace.coordinates(theta_s)
    again = along @ nullspace.P.T + across @ nullspace.P_perp.T
    assert np.abs(again - theta_s).max() < 1e-13
    lengths = np.linalg.norm(along, axis=1) ** 2 + np.linalg.norm(across, axis=1) ** 2
    assert lengths == pytest.approx(np.sum(theta_s**2, axis=1), rel=1e-13)
    sine = np.linalg.norm(across, axis=1) / np.linalg.norm(theta_s, axis=1)
    assert nullspace.ratio(theta_s) == pytest.approx(sine, rel=1e-13)


def test_42_43_theta_perp_is_the_distance_to_P(table: Bench):
    """(42) ⇔ (43): ‖θ̄_P⊥‖ is the distance of θ̂ to P_s(θ), so that both vanish together.

    The nearest member is found by least squares over a skew basis of P_s(θ); the basis of the
    complement has no part in it.
    """
    nullspace, rng = table.nullspace, np.random.default_rng(25)
    theta_s = table.truth / table.system.space.scale
    mixing = 0.1 * rng.standard_normal((nullspace.r, nullspace.r)) / np.sqrt(nullspace.r)
    members = theta_s[:, None] / np.linalg.norm(theta_s) + nullspace.P @ mixing
    for error in (1.0, 1e-3, 1e-6):
        estimate = members @ rng.standard_normal(nullspace.r)
        estimate = estimate / np.linalg.norm(estimate) + error * rng.standard_normal(len(theta_s))
        nearest = members @ np.linalg.lstsq(members, estimate, rcond=None)[0]
        distance = np.linalg.norm(estimate - nearest)
        _, across = nullspace.coordinates(estimate)
        assert distance > 0.1 * error
        assert np.linalg.norm(across) == pytest.approx(distance, rel=1e-6)


def test_r_of_an_arm_by_inverse_dynamics(arm: Bench):
    """r = dim P_s(θ), counted without v̇(θ), `structural` or our regressors.

    Motors free us to choose v̇ at will, and u_j = τ_j/k_j. So θ* is in P_s(θ) exactly where, for
    every joint, Y_j φ* = (k*_j/k_j) τ_j over random (q, v, v̇), with Y and τ Pinocchio's inverse
    dynamics and φ all parameters but the gains: r is the nullity of [Y, −diag(τ)].
    """
    system = arm.system
    model = true_model(system.model, arm.truth)  # pyright: ignore
    data = model.createData()
    n, rng, rows = system.n, np.random.default_rng(18), []
    friction = arm.truth[10 * n : -n].reshape(-1, n)  # rotor inertia, viscous, Coulomb
    for _ in range(10 * system.p // n):
        q, v, _ = system.random_state(rng)
        a = rng.uniform(-5, 5, n)
        by_joint = [np.diag(x) for x in (a, v, np.tanh(v / 0.05))]
        Y = np.hstack([pin.computeJointTorqueRegressor(model, data, q, v, a), *by_joint])
        tau = pin.rnea(model, data, q, v, a) + friction[0] * a + friction[1] * v
        tau += friction[2] * np.tanh(v / 0.05)
        rows.append(np.hstack([Y * system.space.scale[:-n], -np.diag(tau)]))
    stack = np.vstack(rows)
    stack /= np.linalg.norm(stack, axis=1, keepdims=True)
    assert system.p - np.linalg.matrix_rank(stack, tol=1e-8) == arm.nullspace.r


def test_r_of_two_vehicles_is_2():
    """r from textbooks: parameters less base parameters, and one for the common scale.

    Double pendulum, 28 parameters: 6 inertial base parameters of a planar 2R in gravity (a moment
    and two first moments for each link), rotor 2 (rotor 1 turns with link 1), 2·3 of friction and
    gain, so 28 − 13 + 1 = 16. UR5, 84: 36 inertial base parameters, rotors 3 to 6 (axis 1 is
    vertical and axis 2 horizontal, so that rotor 1 adds to Izz₁ and rotor 2 to Izz₂), 6·3, so
    84 − 58 + 1 = 27. The vehicle (16), and bodies in water and in space: their scale. Two of them:
    two scales.
    """
    for name in ("scalar_rov", "bluerov2", "astrobee"):
        assert bench(name).nullspace.r == 1
    assert bench("double_pendulum").nullspace.r == 28 - (6 + 1 + 6) + 1
    assert bench("ur5").nullspace.r == 84 - (36 + 4 + 18) + 1
    truth = np.array([2.0, 1.5, 0.3, 3.0, 1.0, 0.8, -0.2, 2.0])
    assert Nullspace.structural(TwoVehicles(), truth, np.random.default_rng(0)).r == 2
