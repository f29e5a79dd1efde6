"""The parts of adaptive tracking one by one: reference, actuators, gains, laws, estimate."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.cone.law import ConeMetric
from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.laws.metric import ConstantMetric
from nsaid_mj.core.numerics.spatial import product
from nsaid_mj.core.parameters import Array, Block, ParameterSpace
from nsaid_mj.core.structure.parts import Column
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab.control.adaptive.actuation import Actuation, unit_forces
from nsaid_mj.lab.control.adaptive.laws import ControllerEstimate
from nsaid_mj.lab.control.adaptive.reference import (
    loop_frequency,
    mean_inertia,
    prior_motion,
    stiffness,
)
from nsaid_mj.lab.control.adaptive.tracker import AdaptiveTracking, Tracker, command_range
from tests.support.plants import plant

RATE = 1.5
SLOW = AdaptiveTracking(
    rate=RATE, damping=4.0, adaptation=8.0, fundamental=0.04, travel=0.3, floor=0.01, barrier=2.0
)
ROBOTS = ["double_pendulum", "ur5", "bluerov2", "astrobee"]
BODIES = ["bluerov2", "astrobee"]


def tracker(name: str, law: Any = "nullspace") -> tuple[Any, Array, Tracker]:
    """System, prior and controller."""
    made, rng = plant(name), np.random.default_rng(0)
    prior = Prior(made.system.space, made.truth, 0.3).draw(rng)
    return made.system, prior, replace(SLOW, law=law).build(made.system, prior, rng)


def away(system: Any, control: Tracker, t: float, size: float, seed: int) -> tuple[Array, Array]:
    """A state about `size` off the reference in every coordinate."""
    rng = np.random.default_rng(seed)
    numbers, v = control.reference.desired(t)
    q = system.integrate(system.position(numbers), size * rng.standard_normal(system.n))
    return q, v + size * rng.standard_normal(system.n)


# -- the reference ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("seed", range(3))
def test_a_r_is_the_derivative_of_v_r_along_any_motion(name: str, seed: int):
    system, _, control = tracker(name)
    t, h = 2.0 + seed, 1e-5
    q, v = away(system, control, t, 0.4, seed)
    a = np.random.default_rng(seed).standard_normal(system.n)
    ends = [control.reference(t + e, system.integrate(q, e * v), v + e * a)[0] for e in (-h, h)]
    assert control.reference(t, q, v)[1] == pytest.approx((ends[1] - ends[0]) / (2 * h), abs=1e-5)


@pytest.mark.parametrize("name", ROBOTS)
def test_where_s_vanishes_the_error_decays_at_its_rate(name: str):
    """ė = −Λ e of positions and joints, and η̇ = Λ |q_e|² of attitudes."""
    system, _, control = tracker(name)
    t, h = 3.0, 1e-5
    q, v = away(system, control, t, 0.4, 1)
    v_r, _ = control.reference(t, q, v)
    aims = [system.position(control.reference.desired(t + e)[0]) for e in (-h, 0.0, h)]
    states = [system.integrate(q, e * v_r) for e in (-h, 0.0, h)]
    if system.group:
        errors = [aim[:3] - x[:3] for aim, x in zip(aims, states, strict=True)]
        assert (errors[2] - errors[0]) / (2 * h) == pytest.approx(-RATE * errors[1], abs=1e-6)
        turns = [turn_of(x, aim) for aim, x in zip(aims, states, strict=True)]
        slope = (turns[2][3] - turns[0][3]) / (2 * h)
        assert slope == pytest.approx(RATE * turns[1][:3] @ turns[1][:3], abs=1e-6)
    errors = [system.difference(x, aim) for aim, x in zip(aims, states, strict=True)]
    errors = [error[system.group :] for error in errors]
    assert (errors[2] - errors[0]) / (2 * h) == pytest.approx(-RATE * errors[1], abs=1e-6)


def turn_of(q: Array, aim: Array) -> Array:
    """(4,) the quaternion of Rᵀ R_d with η ≥ 0, of two poses."""
    found = product(q[3:7] * [-1.0, -1.0, -1.0, 1.0], aim[3:7])
    return found if found[3] >= 0 else -found


@pytest.mark.parametrize("name", BODIES)
def test_v_jumps_at_an_attitude_error_of_pi(name: str):
    """v_r turns back the shorter way: s jumps by 4Λ where the error passes π."""
    system, _, control = tracker(name)
    numbers, v = control.reference.desired(0.0)
    aim, axis = system.position(numbers), np.array([0.6, 0.0, 0.8])
    sides = []
    for angle in (np.pi - 1e-6, np.pi + 1e-6):
        turn = np.zeros(system.n)
        turn[3:6] = angle * axis
        sides.append(control.reference(0.0, system.integrate(aim, turn), v)[0])
    jump = sides[1] - sides[0]
    assert jump[3:6] == pytest.approx(4 * RATE * axis, abs=1e-4)
    assert jump[:3] == pytest.approx(np.zeros(3), abs=1e-4)


@pytest.mark.parametrize("share", [0.99, 1.3])
def test_a_small_s_keeps_the_attitude_error_away_from_pi(share: float):
    """(T0) under the worst s: η stays above η₀ if |s| < 2Λ (1 − η₀²)^½, and else need not."""
    system, _, control = tracker("bluerov2")
    least, h = 0.3, 2e-3
    start, axis = np.zeros(system.n), np.array([0.0, 0.6, 0.8])
    numbers, _ = control.reference.desired(0.0)
    start[3:6] = 2 * np.arccos(least + 1e-3) * axis
    q, lowest = system.integrate(system.position(numbers), start), 1.0
    for k in range(1500):
        t = k * h
        turn = turn_of(q, system.position(control.reference.desired(t)[0]))
        lowest = min(lowest, turn[3])
        if turn[3] < 0.05:
            break
        v_r, _ = control.reference(t, q, np.zeros(system.n))
        s = np.zeros(system.n)
        s[3:6] = -share * 2 * RATE * np.sqrt(1 - least**2) * turn[:3] / np.linalg.norm(turn[:3])
        q = system.integrate(q, h * (v_r + s))
    assert (lowest > least - 1e-3) if share < 1 else (lowest < 0.1)


# -- the bound of composite ------------------------------------------------------------------------


@pytest.mark.slow
def test_the_bound_of_composite_needs_the_condition_of_the_mass_matrix():
    """(T4), M = diag(1, 100), K_d = 1, |e| = 1: 1 is exceeded; and the bound on a tree's own M."""
    M = np.array([1.0, 100.0])
    heavy = 1 - np.exp(-2000 / M[1])
    t = np.linspace(0, 10, 2001)
    length = np.hypot(1 - np.exp(-t / M[0]), heavy * np.exp(-t / M[1]))
    assert length.max() == pytest.approx(1.38, abs=0.01)
    system, prior, _ = tracker("double_pendulum")
    sizes, rng = [], np.random.default_rng(0)

    def motion(t: float) -> tuple[Array, Array]:
        return np.array([0.3, 1.5]) * np.sin(t * np.array([1.0, 1.7])), np.array(
            [0.3, 1.5 * 1.7]
        ) * np.cos(t * np.array([1.0, 1.7]))

    bumps = rng.standard_normal((2, 40))

    def rate(t: float, s: Array) -> Array:
        q, v = motion(t)
        x = np.r_[system.position(q), v]
        M = system.mass_matrix(x, prior)
        C = np.column_stack([system.coriolis_matrix(x, prior) @ e for e in np.eye(2)])
        sizes.append(np.linalg.eigvalsh(M)[[0, -1]])
        e = bumps[:, int(2 * t) % 40]
        return np.linalg.solve(M, -0.1 * s - C @ s + 0.05 * e / np.linalg.norm(e))

    found = solve_ivp(rate, (0, 40), np.zeros(2), max_step=0.05)
    low, high = np.min(sizes, axis=0)[0], np.max(sizes, axis=0)[1]
    assert np.linalg.norm(found.y, axis=0).max() <= np.sqrt(high / low) * 0.05 / 0.1
    assert np.linalg.norm(found.y, axis=0).max() > 0.1 * 0.05 / 0.1


# -- the actuators ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BODIES)
def test_redundant_actuators_are_as_near_to_their_efforts_at_rest_as_the_force_allows(name: str):
    system, prior, _ = tracker(name)
    low, high, rest = command_range(system)
    unequal = np.linspace(0.6, 1.0, system.n_u)
    actuation = Actuation(system, prior, unequal * low, unequal * high, rest)
    B, rng = actuation.matrix(prior), np.random.default_rng(2)
    group = actuation.groups[0]
    k = group.columns
    least, most = actuation._least[k], actuation._most[k]
    own = B[np.ix_(group.rows, k)]
    force = np.zeros(system.n)
    force[group.rows] = 0.02 * own @ ((most - least) * rng.uniform(-1, 1, len(k)))
    effort = actuation._share(B, force, group)
    assert own @ effort == pytest.approx(force[group.rows], abs=1e-9 * np.abs(own).max())
    assert (effort > least).all() and (effort < most).all()
    strong = actuation._share(B, 1e4 * force, group)
    assert (strong >= least - 1e-12).all() and (strong <= most + 1e-12).all()
    direction = own @ strong / np.linalg.norm(own @ strong)
    assert direction == pytest.approx(force[group.rows] / np.linalg.norm(force), abs=1e-6)

    def distance(x: Array) -> float:
        return float(np.sum(((x - rest[k]) / (most - least)) ** 2))

    null = np.linalg.svd(own)[2][len(group.rows) :]
    best = minimize(lambda z: distance(effort + null.T @ z), np.zeros(len(null)), tol=1e-14)
    assert distance(effort) <= best.fun * (1 + 1e-9) + 1e-12


def test_a_motor_alone_is_clipped_at_its_own_limit():
    system, prior, _ = tracker("ur5")
    low, high, rest = command_range(system)
    actuation = Actuation(system, prior, 0.5 * low, high, rest)
    gains = prior[system.space.actuators]
    wanted = np.array([0.5, 2.0, -0.25, -2.0, 0.0, 0.9]) * high
    found = actuation.command(prior, gains * wanted)
    assert found == pytest.approx(np.clip(wanted, 0.5 * low, high), rel=1e-6, abs=1e-9)


def test_a_command_exerts_its_force_under_the_estimate_not_the_prior():
    system, prior, _ = tracker("bluerov2")
    actuation = Actuation(system, prior, *command_range(system))
    other = prior.copy()
    other[system.space.actuators] *= np.linspace(0.6, 1.6, len(system.space.actuators))
    q, v, _ = system.random_state(np.random.default_rng(0))
    force = 0.05 * actuation.matrix(other) @ np.linspace(-1, 1, system.n_u)
    u = actuation.command(other, force)
    zero = system._F(0.0, q, v, np.zeros(system.n_u)) @ other
    found = system._F(0.0, q, v, u) @ other - zero
    assert found == pytest.approx(force, abs=1e-5 * np.abs(force).max())


# -- the gains -------------------------------------------------------------------------------------


def known(name: str) -> tuple[Any, Array, Tracker, Any]:
    system, prior, control = tracker(name)
    actuation = Actuation(system, prior, *command_range(system))
    return system, prior, control, prior_motion(system, prior, control.reference, actuation, 25.0)


@pytest.mark.parametrize("law", ["nullspace", "conventional"])
@pytest.mark.parametrize("name", ["double_pendulum", "bluerov2"])
def test_the_adaptations_loop_has_the_stated_frequency_at_the_prior(name: str, law: str):
    system, prior, _, rehearsal = known(name)
    _, _, control = tracker(name, law)
    metric = control.metric
    if isinstance(metric, ConeMetric):
        mobility = np.asarray(np.linalg.inv(metric.mu * metric.mirror(prior)[1]), dtype=np.float64)
    else:
        assert isinstance(metric, ConstantMetric)
        mobility = np.diag(metric.Gamma)
        assert (mobility[:, system.space.actuators] == 0).all()
    squares = [
        np.linalg.eigvals(np.linalg.solve(M, W @ mobility @ W.T)).real.max()
        for W, M in zip(rehearsal.W, rehearsal.M, strict=True)
    ]
    assert np.sqrt(max(squares)) == pytest.approx(SLOW.adaptation, rel=1e-6)
    assert loop_frequency(rehearsal, mobility) == pytest.approx(SLOW.adaptation, rel=1e-6)


def test_the_barriers_weight_is_in_units_of_gamma_at_the_scale():
    system, prior, control, rehearsal = known("double_pendulum")
    metric, scale = control.metric, system.space.scale
    assert isinstance(metric, ConeMetric)
    damping = SLOW.damping * mean_inertia(system, prior)
    shape = stiffness(rehearsal, scale, damping, SLOW.floor)
    ratio = 1 / metric.Gamma / shape
    assert ratio == pytest.approx(np.full(system.p, ratio[0]))
    assert metric.mu == pytest.approx(2.0 * np.median(scale**2 / metric.Gamma))


def test_stiffness_is_the_mean_effect_on_the_forces_and_a_floor():
    system, _, _, rehearsal = known("double_pendulum")
    scale, damping = system.space.scale, np.array([2.0, 0.5])
    effect = np.zeros(system.p)
    for W in rehearsal.W:
        for j in range(system.p):
            column = W[:, j] * scale[j]
            effect[j] += column @ (column / damping) / len(rehearsal.W)
    expected = effect / effect.max() + 0.01
    assert stiffness(rehearsal, scale, damping, 0.01) * scale**2 == pytest.approx(expected)


def test_a_rehearsal_is_the_priors_own_motion_along_the_reference():
    system, prior, control, rehearsal = known("double_pendulum")
    for k in (0, 37, 99):
        t = 25.0 * k / 100
        numbers, v = control.reference.desired(t)
        q = system.position(numbers)
        assert rehearsal.W[k] @ prior == pytest.approx(np.zeros(system.n), abs=1e-9)
        assert rehearsal.M[k] == pytest.approx(system.mass_matrix(np.r_[q, v], prior))
    assert mean_inertia(system, prior) == pytest.approx(mean_inertia(system, 2 * prior) / 2)


# -- the laws --------------------------------------------------------------------------------------


def balance(name: str, law: str) -> tuple[Any, ...]:
    """A law's first command off the reference, with limits far away: all parts of its balance."""
    system, prior, control = tracker(name, law)
    control.start()
    q, v = away(system, control, 0.0, 0.02, 3)
    u = control.command(0.0, q, v)
    assert (u > control.limits[0]).all() and (u < control.limits[1]).all()
    v_r, a_r = control.reference(0.0, q, v)
    return system, prior, q, v, u, v_r, a_r


@pytest.mark.parametrize("law", ["nullspace", "conventional", "composite"])
def test_a_command_solves_the_balance_with_k_d_s(law: str):
    system, prior, q, v, u, v_r, a_r = balance("double_pendulum", law)
    pull = system._W(0.0, q, v, v_r, a_r, u) @ prior
    assert pull == pytest.approx(SLOW.damping * mean_inertia(system, prior) * (v - v_r), rel=1e-6)


def test_computed_torque_makes_s_decay_under_its_model():
    system, prior, q, v, u, v_r, a_r = balance("double_pendulum", "computed_torque")
    a = system.acceleration(0.0, np.r_[q, v], v, u, prior)
    assert a - a_r == pytest.approx(-SLOW.damping * (v - v_r), rel=1e-6)


@pytest.mark.parametrize("law", ["nullspace", "conventional", "composite"])
def test_a_held_command_is_that_of_the_state_half_way_under_the_newest_estimate(law: str):
    system, prior, control = tracker("double_pendulum", law)
    control.start()
    q, v = away(system, control, 0.0, 0.02, 3)
    control.command(0.0, q, v)
    step = 0.02
    q, v = away(system, control, step, 0.02, 4)
    u = control.command(step, q, v)
    t, half = 1.5 * step, 0.5 * step
    q_m, v_m = system.integrate(q, half * v), v + half * control.reference(step, q, v)[1]
    v_r, a_r = control.reference(t, q_m, v_m)
    pull = system._W(t, q_m, v_m, v_r, a_r, u) @ control.theta_hat
    assert pull == pytest.approx(SLOW.damping * mean_inertia(system, prior) * (v_m - v_r), rel=1e-6)
    assert (control.theta_hat != prior).any() == (law != "composite")


@pytest.mark.parametrize("law", ["nullspace", "conventional"])
def test_adaptation_is_driven_by_the_command_that_was_held_half_way(law: str):
    system, prior, control = tracker("double_pendulum", law)
    control.start()
    q, v = away(system, control, 0.0, 0.8, 3)
    held = control.command(0.0, q, v)
    step = 1e-3
    q2, v2 = away(system, control, step, 0.8, 4)
    control.command(step, q2, v2)
    t_m, v_m = 0.5 * step, 0.5 * (v + v2)
    q_m = system.integrate(q, 0.5 * system.difference(q, q2))
    v_r, a_r = control.reference(t_m, q_m, v_m)
    slope = -system._W(t_m, q_m, v_m, v_r, a_r, held).T @ (v_m - v_r)
    metric = control.metric
    if isinstance(metric, ConeMetric):
        moved = metric.mu * (metric.mirror(control.theta_hat)[0] - metric.mirror(prior)[0])
    else:
        assert isinstance(metric, ConstantMetric)
        learns = metric.Gamma > 0
        slope, moved = slope * learns, (control.theta_hat - prior) * learns
        moved[learns] /= metric.Gamma[learns]
    power = slope * prior  # [W]
    assert moved / step * prior == pytest.approx(power, abs=1e-6 * np.abs(power).max())


def test_a_start_returns_to_the_prior_and_forgets_the_last_sample():
    system, prior, control = tracker("double_pendulum")
    control.start()
    first = [control.command(1e-3 * k, *away(system, control, 0.0, 0.05, k)) for k in range(4)]
    assert (control.theta_hat != prior).any()
    control.start()
    assert (control.theta_hat == prior).all()
    again = [control.command(1e-3 * k, *away(system, control, 0.0, 0.05, k)) for k in range(4)]
    assert np.array_equal(first, again)


# -- the estimate ----------------------------------------------------------------------------------


def two() -> tuple[ParameterSpace, ConeMetric, Array]:
    """Two positive numbers in the metric Γ⁻¹ + μ/θ²."""
    space = ParameterSpace((Block("gain", ("a", "b"), ("1", "1"), np.ones(2), "positive"),))
    prior = np.array([0.5, 2.0])
    return space, ConeMetric(space, np.array([2.0, 0.5]), prior, 0.7), prior


def test_a_step_of_the_adaptation_is_of_second_order():
    _, metric, prior = two()
    slope = np.array([3.0, -1.0])
    exact = solve_ivp(
        lambda _, x: np.linalg.solve(metric.mu * metric.mirror(x)[1], slope),
        (0, 0.4),
        prior,
        rtol=1e-11,
        atol=1e-12,
    ).y[:, -1]
    errors = []
    for steps in (20, 40):
        estimate = ControllerEstimate(prior, metric)
        for _ in range(steps):
            estimate.learn(slope, 0.4 / steps)
        errors.append(np.abs(estimate.theta - exact).max())
    assert errors[1] < 1e-4
    assert 3.3 < errors[0] / errors[1] < 5


def test_an_estimate_that_cannot_move_stays():
    _, metric, prior = two()
    estimate = ControllerEstimate(prior, metric)
    estimate.learn(np.full(2, np.nan), 0.1)
    assert (estimate.theta == prior).all()
    estimate.learn(np.ones(2), 0.1)
    assert np.isfinite(estimate.theta).all() and (estimate.theta > prior).all()


def test_only_an_estimate_that_listens_is_informed():
    constant, prior = ControllerEstimate(np.ones(3)), np.ones(3)
    constant.learn(np.ones(3), 1.0)
    assert (constant.theta == prior).all()
    for law, listens in (("composite", True), ("computed_torque", False), ("nullspace", False)):
        driver = tracker("double_pendulum", law)[2]
        assert driver.period == (SLOW.period if listens else np.inf)
        driver.start()
        before = driver.theta_hat.copy()
        driver.inform(2 * before)
        assert (driver.theta_hat == (2 if listens else 1) * before).all()
        driver.start()
        assert (driver.theta_hat == before).all()


def test_a_thruster_on_a_link_is_refused_as_its_force_depends_on_the_pose():
    """Its kind reads nothing; the arm that carries it makes the difference."""
    system = tracker("uvms")[0]
    unit_forces(system)
    moved = copy(system)
    columns = [
        Column(c.kind, c.parameter, body=3, input=c.input, **c.constants)
        if c.kind == "thruster"
        else c
        for c in system.structure.columns
    ]
    structure = replace(system.structure, columns=columns)
    SecondOrderSystem.__init__(moved, structure, system.space, system.mounts)
    with pytest.raises(InvalidInput, match="their own commands alone"):
        unit_forces(moved)
