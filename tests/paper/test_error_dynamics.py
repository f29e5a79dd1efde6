"""(47–55), (59–65): the error dynamics, written both ways, against the identifier."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from nsaid_mj.core.parameters import Array
from tests.support.bench import accelerations, bench, columns, estimates, order, swing


class Errors(NamedTuple):
    """All that (54) and (64) speak of, along N samples of a real run."""

    K: Array
    dv: Array
    dv_dot: Array  # (48), from the law and the true v̇
    theta_hat: Array
    M: Array  # under θ
    C: Array
    W: Array  # W(t, x, v, θ)
    M_hat: Array  # under θ̂
    C_hat: Array
    W_hat: Array  # W(t, x, v̂, θ̂)


@pytest.fixture(scope="module", params=["scalar_rov", "double_pendulum", "ur5", "bluerov2"])
def case(request: pytest.FixtureRequest):
    """A table with the errors along a run of its identifier, from the tenth sample on."""
    table = bench(request.param)
    system, truth, prior = table.system, table.truth, table.prior(0.3)
    samples = table.drive(0.5, prior=prior)
    found = estimates(table.law.build(system, prior, table.dt), samples)
    pick = slice(10, None, len(samples) // 20)
    t, x, v, u = (part[pick] for part in columns(samples))
    v_hat, theta_hat = (part[pick] for part in found)
    K = np.eye(system.n) * table.law.K
    dv = v_hat - v
    a = system.acceleration(t, x, v, u, truth)
    a_hat = accelerations(system, t, x, v_hat, u, theta=theta_hat)
    several = list(zip(x, theta_hat, strict=True))
    return table, Errors(
        K,
        dv,
        a_hat - dv @ K - a,
        theta_hat,
        system.mass_matrix(x, truth),
        system.coriolis_matrix(x, truth),
        system.regressor(t, x, v, a, u),
        np.array([system.mass_matrix(*s) for s in several]),
        np.array([system.coriolis_matrix(*s) for s in several]),
        system.regressor(t, x, v_hat, a_hat, u),
    )


def product(matrix: Array, vector: Array) -> Array:
    """Matrices (N, i, j) times vectors (N, j)."""
    return np.einsum("kij,kj->ki", matrix, vector)


def agree(right: Array, left: Array) -> bool:
    """Whether two sides agree to 1e-9 of their size."""
    assert np.abs(left).max() > 1e-3  # there is an error to have dynamics
    return bool(np.abs(right - left).max() <= 1e-9 * np.abs(left).max())


def test_52_54_errors_factored_by_M(case):
    """(52) and (54) equal (48): â − KΔv − v̇, at states of a real run."""
    table, e = case
    through_theta = product(e.W_hat, np.broadcast_to(table.truth, e.theta_hat.shape))
    right_52 = (
        -e.dv @ e.K + np.linalg.solve(e.M, (through_theta - product(e.C, e.dv))[..., None])[..., 0]
    )
    assert agree(right_52, e.dv_dot)
    damping = e.K + np.linalg.solve(e.M, e.C)
    push = np.linalg.solve(e.M, product(e.W_hat, e.theta_hat - table.truth)[..., None])[..., 0]
    assert agree(-product(damping, e.dv) - push, e.dv_dot)


def test_62_64_errors_factored_by_M_hat(case):
    """(62) and (64) equal (48) once the sign of Ĉ Δv is set right.

    v̂ = v + Δv gives W_C(x, v̂) = W_C(x, v) + W_C(x, Δv); the paper's step from (60) to (61) has
    a minus, and (61–65) and (72) carry it on. With W(t, x, v, θ) θ̂ alone in P̄_⊥, by (34):

        Δv̇ = −(K + M̂⁻¹Ĉ) Δv − M̂⁻¹ W(t, x, v, θ) P̄_⊥ θ̄_P⊥.
    """
    table, e = case
    scale, nullspace = table.system.space.scale, table.nullspace
    _, across = nullspace.coordinates(e.theta_hat / scale)
    in_P_perp = scale * (across @ nullspace.P_perp.T)
    damping = e.K + np.linalg.solve(e.M_hat, e.C_hat)
    for theta in (e.theta_hat, in_P_perp):  # (62), (64)
        push = np.linalg.solve(e.M_hat, product(e.W, theta)[..., None])[..., 0]
        assert agree(-product(damping, e.dv) - push, e.dv_dot)


def test_62_64_not_with_the_printed_sign(case):
    """(62, 64) as printed, with K − M̂⁻¹Ĉ, miss Δv̇ by 2M̂⁻¹ĈΔv: only C = 0 hides it."""
    _, e = case
    printed = e.K - np.linalg.solve(e.M_hat, e.C_hat)
    push = np.linalg.solve(e.M_hat, product(e.W, e.theta_hat)[..., None])[..., 0]
    assert agree(-product(printed, e.dv) - push, e.dv_dot) == (not e.C.any())


def test_55_65_error_system_by_differences():
    """(55, 65): central differences of the simulated Δv, Δθ and (θ̄_P, θ̄_P⊥) meet the right sides.

    They do so with the differences' own order, 2, as dt is halved.
    """
    table, motion = swing()
    system, truth, prior = table.system, table.truth, table.prior(0.3)
    scale, nullspace = system.space.scale, table.nullspace
    gains = 20.0 * np.eye(system.n), 10.0 * scale**2  # K, Γ of the table's law
    counts, errors = np.array([80, 160, 320, 640]), []
    for count in counts:
        dt, samples = motion.seconds / count, motion.samples(count)
        k = np.arange(5, 40, 5) * count // 40  # the same times for every dt
        t, x, v, u = columns(samples)
        v_hat, theta_hat = estimates(table.law.build(system, prior, dt), samples)
        dv, dtheta = v_hat - v, theta_hat - truth
        rate_v = (dv[k + 1] - dv[k - 1]) / (2 * dt)
        rate_theta = (dtheta[k + 1] - dtheta[k - 1]) / (2 * dt)
        t, x, u, v_hat, theta_hat, dv, dtheta = (
            part[k] for part in (t, x, u, v_hat, theta_hat, dv, dtheta)
        )
        a_hat = accelerations(system, t, x, v_hat, u, theta=theta_hat)
        W_hat = system.regressor(t, x, v_hat, a_hat, u)
        M, C = system.mass_matrix(x, truth), system.coriolis_matrix(x, truth)
        right_v = (
            -dv @ gains[0]
            - np.linalg.solve(M, (product(C, dv) + product(W_hat, dtheta))[..., None])[..., 0]
        )
        right_theta = gains[1] * np.einsum("kip,ki->kp", W_hat, dv)
        by_coordinates = nullspace.coordinates(rate_theta / scale)  # lower rows of (65)
        in_scale = np.einsum("kip,ki->kp", W_hat * scale, dv) * gains[1] / scale**2
        errors.append(
            [
                np.abs(rate_v - right_v).max() / np.abs(right_v).max(),
                np.abs(rate_theta - right_theta).max() / np.abs(right_theta).max(),
                *(
                    np.abs(rate - in_scale @ basis).max() / np.abs(in_scale @ basis).max()
                    for rate, basis in zip(
                        by_coordinates, (nullspace.P, nullspace.P_perp), strict=True
                    )
                ),
            ]
        )
    for column in np.array(errors).T:
        assert column[-1] < 1e-2
        assert 1.7 < order(1 / counts, column) < 2.3
