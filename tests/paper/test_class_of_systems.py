"""(3, 8, 9): the kinematics, linearity in θ, and C with Ṁ − 2C skew."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from nsaid_mj.lab.plants.arm import true_model
from tests.support.bench import Bench

ROUNDING = 1e-12  # sums of up to 126 products of either sign, relative to the largest


def test_3_positions_move_with_J_v(table: Bench):
    """(3) q̇ = J(q) v: the derivative of q ⊕ εv at ε = 0, with the order of central differences."""
    system = table.system
    _, x, v, _ = table.states(5)
    for q, rate in zip(system.split(x)[0], v, strict=True):
        errors = [
            np.abs(
                (system.integrate(q, h * rate) - system.integrate(q, -h * rate)) / (2 * h)
                - system.J(q) @ rate
            ).max()
            for h in (1e-2, 1e-3)
        ]
        curvature = np.abs(rate).max() ** 3 / 6  # of cos and sin; joints with numbers have none
        assert errors[0] <= 1.01 * curvature * 1e-2**2
        assert errors[1] <= 1.01 * curvature * 1e-3**2 + 1e-12


def test_3_a_motion_of_J_v_ends_where_integrate_says(table: Bench):
    """(3) under constant v: 100 turns of RK4 on q̇ = J(q) v and one q ⊕ v arrive together."""
    system = table.system
    _, x, v, _ = table.states(3)
    for q0, rate in zip(system.split(x)[0], v, strict=True):
        q, h = q0, 0.01
        for _ in range(100):
            k1 = system.J(q) @ rate
            k2 = system.J(q + h / 2 * k1) @ rate
            k3 = system.J(q + h / 2 * k2) @ rate
            k4 = system.J(q + h * k3) @ rate
            q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        assert np.abs(q - system.integrate(q0, rate)).max() < 1e-7  # (2 rad/s)⁵ h⁴/120


def test_8_W_M_theta_is_M_a(table: Bench):
    """(8) W_M(x, a) θ = M(x, θ) a, with M symmetric and positive definite at the truth."""
    system, rng = table.system, np.random.default_rng(5)
    _, x, _, _ = table.states(5)
    for theta in (table.truth, system.space.scale * rng.standard_normal(system.p)):
        a = rng.standard_normal((5, system.n))
        M = system.mass_matrix(x, theta)
        force = system.W_M(x, a) @ theta
        assert np.abs(force - np.einsum("kij,kj->ki", M, a)).max() <= ROUNDING * np.abs(force).max()
        assert np.abs(M - M.swapaxes(1, 2)).max() <= ROUNDING * np.abs(M).max()
    assert (np.linalg.eigvalsh(system.mass_matrix(x, table.truth)) > 0).all()


def test_8_9_regressors_are_linear_in_their_velocity(table: Bench):
    """(8, 9): W_M is linear in a and W_C in w, so that M(x, θ) a and C(x, θ) w are products."""
    system, rng = table.system, np.random.default_rng(6)
    _, x, _, _ = table.states(5)
    a, b = rng.standard_normal((2, 5, system.n))
    for W in (system.W_M, system.W_C):
        both = W(x, 2 * a - 3 * b)
        assert np.abs(both - 2 * W(x, a) + 3 * W(x, b)).max() <= ROUNDING * max(
            np.abs(both).max(), 1
        )


def test_9_C_is_pinocchios(arm: Bench):
    """(9) C(x, θ) is the Coriolis matrix that Pinocchio has for the true inertias."""
    system = arm.system
    model = true_model(system.model, arm.truth)  # pyright: ignore
    data = model.createData()
    _, x, _, _ = arm.states(5)
    for sample, C in zip(x, system.coriolis_matrix(x, arm.truth), strict=True):
        theirs = pin.computeCoriolisMatrix(model, data, *system.split(sample))
        assert np.abs(theirs).max() > 0
        assert np.abs(C - theirs).max() <= ROUNDING * np.abs(theirs).max() + 1e-14


def test_9_M_dot_minus_2C_is_skew(arm: Bench):
    """(9) for every θ, not the true one only; Ṁ by fourth-order differences along q̇ = J v."""
    system, h = arm.system, 1e-3
    theta = system.space.scale * np.random.default_rng(7).standard_normal(system.p)
    _, x, _, _ = arm.states(5)
    for sample in x:
        q, v = system.split(sample)

        def M(s: float, q=q, v=v) -> np.ndarray:
            return system.mass_matrix(np.concatenate([system.integrate(q, s * v), v]), theta)

        M_dot = (8 * (M(h) - M(-h)) - (M(2 * h) - M(-2 * h))) / (12 * h)
        C = system.coriolis_matrix(sample, theta)
        assert np.abs(M_dot).max() > 0  # or there would be nothing to see
        symmetric = M_dot - C - C.T
        assert np.abs(symmetric).max() <= 1e-9 * np.abs(C).max()  # differences: h⁴ and eps/h
