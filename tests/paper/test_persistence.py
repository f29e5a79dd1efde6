"""(2), (75) and Proposition 1: what persistence of excitation can and cannot mean here."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.nullspace.persistence import PersistenceMonitor
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.parameters import Array
from tests.support.bench import (
    Bench,
    TwoVehicles,
    accelerations,
    bench,
    columns,
    estimates,
    simulate,
)


def window(table: Bench, theta_hat: Array, seconds: float, stride: int) -> tuple[Array, float]:
    """M⁻¹W(t, x, v̂, θ̂)·diag(scale) (k, n, p) along a true motion, at Δv = 0, and its time step."""
    t, x, v, u = (part[::stride] for part in columns(table.drive(seconds)))
    thetas = np.broadcast_to(theta_hat, (len(t), table.system.p))
    a_hat = accelerations(table.system, t, x, v, u, theta=thetas)
    W = table.system.regressor(t, x, v, a_hat, u)
    B = np.linalg.solve(table.system.mass_matrix(x, table.truth), W)
    return B * table.system.space.scale, stride * table.dt


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum"])
def test_proposition_1_at_the_true_set_there_is_no_excitation_along_it(name: str):
    """Proposition 1: with θ̂ = θ* in P(θ) and Δv = 0, M⁻¹W(t, x, v̂, θ̂) is not PE (2): level 0.

    All of P(θ) is unexcited, and nothing else is: within P_⊥ the level is well above rounding.
    """
    table = bench(name)
    B, dt = window(table, 3.0 * table.truth, 6.0, 20)
    strongest = np.linalg.norm(B) * dt**0.5 * (len(B) * dt) ** 0.5
    assert PersistenceMonitor.level_of(B, dt) < 1e-13 * strongest
    assert PersistenceMonitor.level_of(B, dt, table.nullspace.P) < 1e-12 * strongest
    assert PersistenceMonitor.level_of(B, dt, table.nullspace.P_perp) > 1e-6 * strongest
    unexcited = np.linalg.svd(
        B.reshape(-1, table.system.p), compute_uv=False
    ) < 1e-10 * np.linalg.norm(B)
    assert unexcited.sum() == table.nullspace.r


def test_proposition_1_holds_off_the_true_set_too():
    """(30) alone: at any standing θ̂ ≠ θ the regressor is unexcited along θ̂.

    So (2) fails wherever θ̂ settles, not only in P(θ): it is no test of convergence. For the
    vehicle (r = 1), the truth itself is then excited, and (2) fails for θ̂ alone.
    """
    table = bench("scalar_rov")
    theta_hat = table.prior(0.5)
    B, dt = window(table, theta_hat, 20.0, 20)
    s_of_hat = theta_hat / table.system.space.scale
    s_of_truth = table.truth / table.system.space.scale
    strongest = np.linalg.norm(B) * dt**0.5 * (len(B) * dt) ** 0.5
    assert PersistenceMonitor.level_of(B, dt) < 1e-13 * strongest
    assert (
        PersistenceMonitor.level_of(B, dt, (s_of_hat / np.linalg.norm(s_of_hat))[:, None])
        < 1e-13 * strongest
    )
    assert (
        PersistenceMonitor.level_of(B, dt, (s_of_truth / np.linalg.norm(s_of_truth))[:, None])
        > 1e-3 * strongest
    )


def test_proposition_1_the_estimate_need_not_converge_for_it():
    """(30): over a late window (2) fails along θ̂ at its start, although θ̂ is far from P(θ).

    W(τ, x, v̂, θ̂(τ)) θ̂(t) = W(τ, x, v̂, θ̂(τ)) [θ̂(t) − θ̂(τ)] is no larger than what θ̂ moves, and
    by (45, 70) that vanishes: here while the vehicle hovers, and θ̂ stays 40 % off in places.
    """
    system, dt, rows = TwoVehicles(), 0.02, 200
    truth = np.array([2.0, 1.5, 1.0, 3.0, 1.0, 0.8, -1.2, 2.0])
    prior = truth * np.tile([1.4, 0.6], 4)
    samples = simulate(system, truth, lambda t: truth[[2, 6]] / truth[[3, 7]], dt, 3000)
    law = paper_identifier(system, np.full(2, 2.0), np.full(8, 1.0), prior, dt)
    t, x, _, u = columns(samples)
    v_hat, theta_hat = estimates(law, samples)
    levels = []
    for start in range(0, len(t) - rows, rows):
        k = slice(start, start + rows)
        a_hat = accelerations(system, t[k], x[k], v_hat[k], u[k], theta=theta_hat[k])
        W = system.regressor(t[k], x[k], v_hat[k], a_hat, u[k])
        along = theta_hat[start] / np.linalg.norm(theta_hat[start])
        moved = np.linalg.norm(theta_hat[k] - theta_hat[start], axis=1)
        force = np.linalg.norm(W @ theta_hat[start], axis=1)
        assert (force <= np.linalg.norm(W, ord=2, axis=(1, 2)) * moved + 1e-12).all()
        levels.append(PersistenceMonitor.level_of(W, dt, along[:, None]))
    assert levels[0] > 0.01
    assert levels[-1] < 1e-4 * levels[0]
    nullspace = Nullspace.structural(system, truth, np.random.default_rng(0))
    assert nullspace.ratio(theta_hat[-1]) > 0.5 * nullspace.ratio(prior) > 0.1


def test_56_58_the_truth_enters_the_nullspace_of_the_estimates_regressor(converged):
    """(56–58) As θ̂ converges to P(θ), W(t, x, v̂, θ̂) θ → 0, while W(t, x, v̂, θ̂) itself does not."""
    table, samples, v_hat, theta_hat = converged
    t, x, _, u = columns(samples)
    a_hat = accelerations(table.system, t, x, v_hat, u, theta=theta_hat)
    W = table.system.regressor(t, x, v_hat, a_hat, u)
    force, tenth = np.linalg.norm(W @ table.truth, axis=1), len(t) // 10
    assert force[-tenth:].max() < 1e-4 * force[:tenth].max()
    assert np.linalg.norm(W[-tenth:]) > 0.5 * np.linalg.norm(W[:tenth])


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum", "ur5"])
def test_2_75_read_literally_are_never_met(name: str):
    """(2), (75) literally bound ‖∫ B w dτ‖, n numbers linear in w: some unit w makes it 0.

    As P_⊥ has p − r > n dimensions, no motion of these systems meets (75) to the letter, however
    rich; and the w of one window is well excited in the sense of the Gramian all the same.
    """
    table = bench(name)
    B, dt = window(table, table.truth, 5.0, 10)
    B = B @ table.nullspace.P_perp
    integral = B.sum(axis=0) * dt  # (n, p − r)
    assert integral.shape[1] > integral.shape[0]
    w = np.linalg.svd(integral)[2][-1]
    gramian_norm = float(np.sqrt(len(B) * dt * dt * np.sum((B @ w) ** 2)))
    assert np.linalg.norm(integral @ w) < 1e-10 * gramian_norm
    assert gramian_norm >= PersistenceMonitor.level_of(B, dt) > 0


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum"])
def test_75_the_level_bounds_the_literal_norm_over_every_part(name: str):
    """ε₀ ≥ min over w of the largest ‖∫ B w dτ‖ over parts of the window (Cauchy–Schwarz).

    That is Morgan and Narendra's own condition, with the part at liberty, and ‖∫ B w dτ‖ > 0 over
    some part is what Theorem 2's proof needs.
    """
    table = bench(name)
    B, dt = window(table, table.truth, 5.0, 10)
    B = B @ table.nullspace.P_perp
    weakest = np.linalg.svd(B.reshape(-1, B.shape[2]), full_matrices=False)[2][-1]
    running = np.concatenate([np.zeros((1, B.shape[1])), np.cumsum(B @ weakest * dt, axis=0)])
    parts = np.linalg.norm(running[:, None] - running[None], axis=-1)
    assert 0 < parts.max() <= PersistenceMonitor.level_of(B, dt) * (1 + 1e-9)


def test_75_the_level_is_zero_exactly_where_a_direction_stays_unexcited():
    """The level against what it is by hand, and 0 as soon as one direction is never excited."""
    dt, t = 1e-3, np.arange(0, 2, 1e-3)
    waves = np.stack([np.sin(np.pi * t), np.cos(np.pi * t)], axis=1)[:, None, :]  # ∫ = I over 2 s
    assert PersistenceMonitor.level_of(waves, dt) == pytest.approx(
        np.sqrt(2.0), rel=1e-6
    )  # (δ₀ λ)^½
    assert PersistenceMonitor.level_of(3 * waves, dt) == pytest.approx(3 * np.sqrt(2.0), rel=1e-6)
    assert np.linalg.norm(waves.sum(axis=0) * dt) < 1e-12  # while the literal integral is 0
    one = np.stack([waves[:, :, 0], 0.5 * waves[:, :, 0]], axis=-1)
    assert PersistenceMonitor.level_of(one, dt) < 1e-12
    assert PersistenceMonitor.level_of(one, dt, np.array([[1.0], [0.0]])) == pytest.approx(
        np.sqrt(2.0), rel=1e-6
    )


def test_75_the_monitor_bounds_the_level_from_above():
    """The running level, which knows r but not P(θ), is never below that in P_⊥ (75).

    At θ̂ = θ it is equal to it: the r smallest eigenvalues are those of P(θ).
    """
    table = bench("double_pendulum")
    seconds, stride = 4.0, 10
    t, x, v, u = (part[::stride] for part in columns(table.drive(seconds)[:-1]))
    system, nullspace = table.system, table.nullspace
    dt = stride * table.dt
    for theta_hat, equal in ((table.truth, True), (table.prior(0.2), False)):
        thetas = np.broadcast_to(theta_hat, (len(t), system.p))
        a_hat = accelerations(system, t, x, v, u, theta=thetas)
        W = system.regressor(t, x, v, a_hat, u) * system.space.scale
        monitor = PersistenceMonitor(system.p, nullspace.r, seconds)
        for sample in W:
            monitor.add(sample, dt)
        exact = PersistenceMonitor.level_of(W, dt, nullspace.P_perp)
        assert monitor.level_perp >= exact * (1 - 1e-6) > 0
        assert (abs(monitor.level_perp / exact - 1) < 1e-6) == equal
        assert monitor.level < 1e-6 * np.linalg.norm(W)
