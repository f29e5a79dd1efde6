"""Theorem 1: V falls along every run at the rate (69) and Δv → 0; and where it does not hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.log import Measurement
from tests.support.bench import (
    Bench,
    TwoVehicles,
    bench,
    columns,
    estimates,
    lyapunov,
    order,
    simulate,
    swing,
)


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("scalar_rov", 60.0),
        ("double_pendulum", 4.0),
        ("ur5", 2.0),
        ("bluerov2", 20.0),
        ("astrobee", 20.0),
    ],
)
def test_69_V_never_rises(name: str, seconds: float):
    """(66, 69) along MuJoCo's plant: V falls in every step, but for RK4's own error.

    That error is seen in θ̂ᵀ Γ⁻¹ θ̂, which the exact flow would hold (30, 45). V itself falls by
    far more than the error could explain.
    """
    table = bench(name)
    system, prior = table.system, table.prior(0.3)
    samples = table.drive(seconds, prior=prior)
    law = table.law.build(system, prior, table.dt)
    found = estimates(law, samples)
    V = lyapunov(system, table.truth, law.metric.Gamma, samples, found)
    conserved = law.conserved(found[1])
    bound = np.abs(np.diff(conserved)).max() + 8 * np.finfo(float).eps * conserved[0]
    assert np.diff(V).max() <= bound
    assert V[0] - V[-1] > 1e3 * bound
    assert V[-1] < 0.99 * V[0]


def test_67_68_the_rate_of_V_term_by_term(arm: Bench):
    """(67) = (68) = (69) at random states, for any v̂, θ̂, K and Γ; not with M − 2C, as printed.

    Δv̇ and θ̂̇ are those of (44, 45); Ṁ is a fourth-order difference along q̇ = J v.
    """
    system, truth, rng, h = arm.system, arm.truth, np.random.default_rng(26), 1e-3
    n, p, scale = system.n, system.p, system.space.scale
    for t, x, v, u in zip(*arm.states(5), strict=True):
        q, _ = system.split(x)
        theta_hat = truth + 0.1 * np.abs(truth) * rng.uniform(-1, 1, p)
        v_hat = v + rng.standard_normal(n)
        K, mixing = 5 * np.eye(n) + rng.standard_normal((n, n)), rng.standard_normal((p, p))
        Gamma = np.outer(scale, scale) * (np.eye(p) + 0.1 * mixing @ mixing.T)
        dv, dtheta = v_hat - v, theta_hat - truth
        a_hat = system.acceleration(t, x, v_hat, u, theta_hat)
        dv_rate = a_hat - K @ dv - system.acceleration(t, x, v, u, truth)  # (48)
        W = system.regressor(t, x, v_hat, a_hat, u)

        def M(s: float, q=q, v=v) -> np.ndarray:
            moved = np.concatenate([system.integrate(q, s * v), v])
            return system.mass_matrix(moved, truth)

        M_dot = (8 * (M(h) - M(-h)) - (M(2 * h) - M(-2 * h))) / (12 * h)
        C = system.coriolis_matrix(x, truth)
        theta_rate = Gamma @ W.T @ dv  # (45)
        flow = dtheta @ np.linalg.solve(Gamma, theta_rate)
        whole = 0.5 * dv @ M_dot @ dv + dv @ M(0) @ dv_rate + flow  # (67)
        loss = dv @ M(0) @ K @ dv
        size = abs(loss) + abs(flow) + abs(dv @ C @ dv)
        assert abs(whole - (0.5 * dv @ (M_dot - 2 * C) @ dv - loss)) < 1e-9 * size  # (68)
        assert abs(whole + loss) < 1e-9 * size  # (69)
        assert abs(whole - (0.5 * dv @ (M(0) - 2 * C) @ dv - loss)) > 1e-6 * size


def test_69_rate_of_V():
    """(69) V̇ = −Δvᵀ M K Δv: what V loses over a motion is the integral of that, order 4 in dt."""
    table, motion = swing()
    system, prior = table.system, table.prior(0.3)
    counts, errors = np.array([100, 200, 400, 800]), []
    for count in counts:
        dt, samples = motion.seconds / count, motion.samples(count)
        law = table.law.build(system, prior, dt)
        found = estimates(law, samples)
        V = lyapunov(system, table.truth, law.metric.Gamma, samples, found)
        t, x, v, _ = columns(samples)
        dv = found[0] - v
        loss = np.einsum("ki,kij,kj->k", dv, system.mass_matrix(x, table.truth) * 20.0, dv)
        lost = cumulative_simpson(loss, x=t, initial=0.0)
        errors.append(np.abs(V - V[0] + lost)[:: count // 50].max() / lost[-1])
    assert errors[-1] < 1e-6
    assert 3.5 < order(1 / counts, np.array(errors)) < 5.5


def test_69_holds_for_every_member_of_P_s():
    """(66, 69) need no M(x, θ*) ≻ 0: V changes by −∫ Δvᵀ M(x, θ*) K Δv for every θ* of P_s(θ).

    Among them are 0, one with a vehicle of mass 0 and one with a negative mass. As ∫ |Δv|² dt is
    finite, V converges for all of them, and with Δv → 0 so does ‖θ̂ − θ*‖ in the metric of Γ. A
    limit point of θ̂ in P_s(θ) is then the only one: (43) makes θ̂ come to rest, as (42) says.
    """
    system, dt = TwoVehicles(), 0.01
    truth = np.array([2.0, 1.5, 1.0, 3.0, 1.0, 0.8, -1.2, 2.0])
    Gamma, K = np.linspace(0.5, 1.5, 8), 2.0
    samples = simulate(system, truth, lambda t: np.array([0.9, -0.2]), dt, 400)
    law = paper_identifier(system, np.full(2, K), Gamma, truth * np.tile([1.4, 0.6], 4), dt)
    found = estimates(law, samples)
    t, x, v, _ = columns(samples)
    dv = found[0] - v

    def defect(theta: np.ndarray) -> float:
        V = lyapunov(system, theta, Gamma, samples, found)
        loss = K * np.einsum("ki,kij,kj->k", dv, system.mass_matrix(x, theta), dv)
        lost = cumulative_simpson(loss, x=t, initial=0.0)
        return np.abs(V - V[0] + lost).max() / (K * np.sum(dv**2) * dt)

    for scales in ([1.0, 1.0], [1.0, 0.0], [1.0, -1.0], [0.0, 0.0], [-0.4, 2.0]):
        assert defect(truth * np.repeat(scales, 4)) < 1e-6
    assert defect(truth * np.repeat([1.0, 0.5], 4) + 0.1) > 1e-2  # not in P_s(θ)


def rise(K: np.ndarray, dv: np.ndarray, dt: float) -> tuple[float, float]:
    """V(dt) − V(0) of a step from θ̂ = θ and the given Δv, simulated and by (69)."""
    table, motion = swing()
    system = table.system
    samples = [Measurement(t, *system.split(motion.x(t)), motion.u) for t in (0.0, dt)]
    law = paper_identifier(system, K, 1e-6 * system.space.scale**2, table.truth, dt)
    found = estimates(law, samples, lambda s: s._replace(v_hat=s.v_hat + dv))
    V = lyapunov(system, table.truth, law.metric.Gamma, samples, found)
    M = system.mass_matrix(motion.x(0), table.truth)
    return (V[1] - V[0]) / dt, float(-dv @ M @ K @ dv)


def bad_gain() -> tuple[np.ndarray, np.ndarray]:
    """A diagonal K, positive definite, and a Δv with Δvᵀ M K Δv < 0 at the swing's start."""
    table, motion = swing()
    M = table.system.mass_matrix(motion.x(0), table.truth)
    K = np.diag([1.0, 400.0])
    eigenvalues, vectors = np.linalg.eigh(M @ K + K @ M)
    assert eigenvalues[0] < 0 < eigenvalues[1]
    return K, vectors[:, 0]


def test_69_V_may_rise_for_a_general_K():
    """(69) says "negative definite in Δv" of −Δvᵀ M K Δv, for any positive definite K: not so.

    M K is no symmetric matrix, and MK + KM may be indefinite: even a diagonal K makes V rise, at
    the rate (69) gives. Theorem 1 needs K = k I, or MK + KM ≻ 0 for all x.
    """
    K, dv = bad_gain()
    assert (np.linalg.eigvalsh(K) > 0).all()
    simulated, predicted = rise(K, dv, 1e-5)
    assert predicted > 0
    assert simulated == pytest.approx(predicted, rel=0.05)


def test_69_V_falls_for_a_multiple_of_the_identity():
    """K = k I is safe: −k Δvᵀ M Δv < 0 for every Δv, the one above and the axes among them."""
    _, bad = bad_gain()
    rng = np.random.default_rng(21)
    for dv in (bad, [1.0, 0.0], [0.0, 1.0], *rng.standard_normal((5, 2))):
        simulated, predicted = rise(20.0 * np.eye(2), np.asarray(dv), 1e-5)
        assert predicted < 0
        assert simulated == pytest.approx(predicted, rel=0.05)


def test_70_velocity_error_vanishes_and_estimates_settle():
    """(70) Δv → 0, and with it θ̂'s rate, by (45)."""
    table = bench("scalar_rov")
    prior = table.prior(0.5)
    samples = table.drive(100.0)
    v_hat, theta_hat = estimates(table.law.build(table.system, prior, table.dt), samples)
    dv = np.abs(v_hat - columns(samples)[2]).max(axis=1)
    rate = np.abs(np.diff(theta_hat, axis=0) / table.system.space.scale).max(axis=1) / table.dt
    tenth = len(dv) // 10
    assert dv[-tenth:].max() < 1e-3 * dv[:tenth].max()
    assert rate[-tenth:].max() < 1e-3 * rate[:tenth].max()
