"""Kernels against `nsaid_mj.core.paper`, the equations in plain numpy, at random states."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.core import paper
from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.log import Log
from nsaid_mj.core.nullspace.persistence import PersistenceMonitor
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.paper import Bases, Moment
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.evaluation.lyapunov import lyapunov
from nsaid_mj.lab.record import Record
from tests.support.bench import Bench, bench

from .test_update_laws import positive_definite


def moment(table: Bench, seed: int) -> tuple[Moment, Array, Array]:
    """A random measurement, with velocities v̂ ≠ v and parameters θ̂ ≠ θ of a random estimate."""
    rng = np.random.default_rng(seed)
    q, v, u = table.system.random_state(rng)
    v_hat = v + 0.5 * np.abs(v).max() * rng.standard_normal(len(v))
    return Moment(rng.uniform(), np.hstack([q, v]), u), v_hat, table.prior(0.1, seed)


def near(found: Array, wanted: Array, relative: float = 1e-12) -> None:
    """Asserts that the largest difference is within a share of the largest value."""
    assert np.shape(found) == np.shape(wanted)
    largest = np.abs(wanted).max()
    assert np.abs(found - wanted).max() <= relative * largest, np.abs(found - wanted).max()


def test_8_9_10_29_31_the_kernels_of_a_stage_are_the_papers(table: Bench):
    system = table.system
    q_to = system.m
    for seed in range(10):
        at, v_hat, theta_hat = moment(table, seed)
        q, v = at.x[:q_to], at.x[q_to:]
        stage = system.evaluate_at(at.t, q, v, at.u, v_hat, theta_hat)
        near(stage.a, paper.acceleration(system, at, v_hat, theta_hat), 1e-10)
        near(stage.W, paper.regressor(system, at, v_hat, stage.a))
        near(system.mass_matrix(at.x, theta_hat), paper.mass_matrix(system, at.x, theta_hat))
        C = paper.coriolis_matrix(system, at.x, theta_hat)
        near(system.coriolis_matrix(at.x, theta_hat), C)
        near(C @ v_hat, system.W_C(at.x, v_hat) @ theta_hat)


def test_4_the_residual_is_the_regressor_times_theta(table: Bench):
    for seed in range(5):
        at, _, theta = moment(table, seed)
        a = np.random.default_rng(seed).standard_normal(table.system.n)
        W = paper.regressor(table.system, at, at.v(table.system.n), a)
        sizes = np.abs(W) @ np.abs(theta)
        off = paper.residual(table.system, at, a, theta) - W @ theta
        assert np.abs(off).max() <= 1e-13 * sizes.max()


def test_6_16_the_forces_of_the_vehicle_of_one_direction():
    """(16) is (6) with D = d|v|: −d v|v| − g + a u."""
    table = bench("scalar_rov")
    system, theta = table.system, table.truth
    _, d, g, a = theta  # m, d, g, a
    for seed in range(5):
        at, _, _ = moment(table, seed)
        v = at.v(1)
        own = system.F(at.t, at.x, at.u) @ theta
        near(paper.forces(v, tau=a * at.u, D=d * np.abs(v), g=g), own, 1e-14)


def test_44_45_a_step_of_the_law_is_that_of_the_paper(table: Bench):
    """One RK4 step from v̂ ≠ v with full K and Γ, x interpolated as the identifier does."""
    system, dt = table.system, table.dt
    for seed in range(3):
        rng = np.random.default_rng(100 + seed)
        at, v_hat, theta_hat = moment(table, seed)
        q, v = at.x[: system.m], at.x[system.m :]
        K = positive_definite(np.full(system.n, 5.0), rng)
        Gamma = positive_definite(0.1 * system.space.scale**2, rng)
        after = (
            system.displaced(q, dt * v),
            v + 0.01 * np.abs(v).max() * rng.standard_normal(len(v)),
        )
        log = Log(
            np.array([0.0, dt]),
            np.array([q, after[0]]),
            np.array([v, after[1]]),
            np.array([at.u, at.u]),
        )
        half = system.midpoints(log, True)
        x = [at.x, np.hstack([half.q[0], half.v[0]]), np.hstack(after)]
        moments = [Moment(t, each, at.u) for t, each in zip((0.0, 0.5 * dt, dt), x, strict=True)]
        wanted = paper.step(system, K, Gamma, moments, v_hat, theta_hat)

        law = paper_identifier(system, K, Gamma, theta_hat, dt)
        start = law.init(log.at(0))._replace(v_hat=v_hat, theta_hat=theta_hat)
        end, _ = law.follow(start, log)
        near(end.v_hat, wanted[0])
        near(end.theta_hat / system.space.scale, wanted[1] / system.space.scale)


def test_15_33_35_the_nullspace_is_what_every_regressor_maps_to_0(table: Bench):
    system, scale, theta = table.system, table.system.space.scale, table.truth
    stack = []
    for seed in range(10 * system.p // system.n + 20):
        at, _, _ = moment(table, seed)
        W = paper.regressor_under(system, at, at.v(system.n), theta) * scale
        stack.append(W / np.linalg.norm(W, axis=1, keepdims=True))
    found = paper.persistent_nullspace(np.array(stack))
    kernels = Nullspace.structural(system, theta, np.random.default_rng(1))
    assert found.P.shape == kernels.P.shape and found.P_perp.shape == kernels.P_perp.shape
    off = found.P @ found.P.T - kernels.P @ kernels.P.T
    assert np.abs(off).max() < 1e-7
    inside = theta / scale
    assert np.linalg.norm(found.P_perp.T @ inside) < 1e-9 * np.linalg.norm(inside)


def test_75_the_level_of_excitation_is_that_of_the_monitored_one():
    """By singular values in the package, by eigenvalues in the paper: half of the digits."""
    table = bench("double_pendulum")
    system, scale = table.system, table.system.space.scale
    W = []
    for seed in range(60):
        at, _, _ = moment(table, seed)
        W.append(paper.regressor_under(system, at, at.v(system.n), table.truth) * scale)
    window, basis = np.array(W), table.nullspace.P_perp
    found = paper.excitation_level(window, 0.01, basis)
    assert found == pytest.approx(PersistenceMonitor.level_of(window, 0.01, basis), rel=1e-9)
    rng = np.random.default_rng(3)
    for _ in range(20):
        w = rng.standard_normal(basis.shape[1])
        w /= np.linalg.norm(w)
        literal = paper.excitation(window, 0.01, basis, w)
        squares = np.sum((window @ basis @ w) ** 2) * 0.01
        assert literal <= np.sqrt(0.6 * squares) * (1 + 1e-12)  # δ₀ = 0.6 s
        assert found <= np.sqrt(0.6 * squares) * (1 + 1e-12)


def test_66_v_is_that_of_the_evaluation(table: Bench):
    system = table.system
    Gamma = positive_definite(0.1 * system.space.scale**2, np.random.default_rng(5))
    law = paper_identifier(system, np.full(system.n, 5.0), Gamma, table.prior(0.1), table.dt)
    for seed in range(3):
        at, v_hat, theta_hat = moment(table, seed)
        q, v = at.x[: system.m], at.x[system.m :]
        row = {"t": np.zeros(()), "q": q, "v": v, "v_hat": v_hat, "theta_hat": theta_hat}
        record = Record({name: part[None] for name, part in row.items()}, {}, True)
        wanted = paper.lyapunov(system, Gamma, at, v_hat, theta_hat, table.truth)
        assert lyapunov(system, law, record, table.truth)[0] == pytest.approx(wanted, rel=1e-11)


def test_65_the_error_system_moves_as_the_laws_and_the_robot_do(table: Bench):
    """ż of (65), against (44, 45) less the robot's own acceleration (20), at v̂ ≠ v and θ̂ ≠ θ."""
    system, scale, theta = table.system, table.system.space.scale, table.truth
    stack = table.nullspace
    root = np.linalg.qr(stack.P * scale[:, None])[0]  # the basis in θ itself, not over its scale
    left = np.linalg.svd(root)[0]
    bases = Bases(root, left[:, root.shape[1] :])
    rng = np.random.default_rng(6)
    K = positive_definite(np.full(system.n, 5.0), rng)
    Gamma = positive_definite(0.1 * scale**2, rng)
    for seed in range(3):
        at, v_hat, theta_hat = moment(table, seed)
        v = at.v(system.n)
        z = np.concatenate([v_hat - v, bases.P_perp.T @ theta_hat, bases.P.T @ theta_hat])
        found = paper.error_system(system, K, Gamma, at, v_hat, theta_hat, theta, bases) @ z
        rates = paper.rates(system, K, Gamma, at, v_hat, theta_hat)
        dv_rate = rates.v_hat - paper.acceleration(system, at, v, theta)
        near(found[: system.n], dv_rate, 1e-8)
        bars = np.hstack([bases.P_perp, bases.P]).T @ rates.theta_hat
        near(found[system.n :], bars, 1e-10)


class Pendulum:
    """A user's robot: m l² v̇ = −c v − m g l sin q + k u, θ = (m l², m l, c, k)."""

    n = 1

    def W_M(self, x: Array, a: Array) -> Array:
        return np.array([[a[0], 0.0, 0.0, 0.0]])

    def W_C(self, x: Array, w: Array) -> Array:
        return np.zeros((1, 4))

    def F(self, t: float, x: Array, u: Array) -> Array:
        return np.array([[0.0, -9.81 * np.sin(x[0]), -x[1], u[0]]])


def test_a_robot_is_any_object_with_the_three_regressors():
    """(44, 45) find P(θ) of a pendulum written in a few lines, by the paper's file alone."""
    robot, theta, dt = Pendulum(), np.array([0.5, 0.4, 0.3, 2.0]), 0.01
    K, Gamma = np.eye(1) * 5.0, np.eye(4) * 4.0

    def moved(at: Moment, by: float) -> Moment:
        def slope(x: Array) -> Array:
            own = Moment(at.t, x, at.u)
            return np.hstack([x[1:], paper.acceleration(robot, own, x[1:], theta)])

        k1 = slope(at.x)
        k2 = slope(at.x + 0.5 * by * k1)
        return Moment(at.t + by, at.x + by * slope(at.x + 0.5 * by * k2), at.u)

    at = Moment(0.0, np.zeros(2), np.zeros(1))
    v_hat, theta_hat = np.zeros(1), theta * np.array([1.3, 0.8, 1.2, 0.9])

    def angle(other: Array) -> float:
        unit = theta / np.linalg.norm(theta)
        return float(np.linalg.norm(other - unit * (unit @ other)) / np.linalg.norm(other))

    before, length = angle(theta_hat), np.linalg.norm(theta_hat)
    for k in range(6000):
        at = at._replace(u=np.array([np.sin(0.021 * k) + np.sin(0.047 * k)]))
        moments = [at, moved(at, 0.5 * dt), moved(at, dt)]
        v_hat, theta_hat = paper.step(robot, K, Gamma, moments, v_hat, theta_hat)
        at = moments[-1]
    assert angle(theta_hat) < 0.05 * before
    assert np.linalg.norm(theta_hat) == pytest.approx(length, rel=1e-5)  # (30)
