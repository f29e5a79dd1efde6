"""A rigid body's compiled step equals the generic step and is of fourth order."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.log import Log
from nsaid_mj.core.numerics import spatial
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.parts import Body, Inertia
from nsaid_mj.core.structure.structure import Structure
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from tests.support import poses
from tests.support.bench import Motion, estimates, identify, lyapunov, order
from tests.support.dense import half_way, rk4_step
from tests.support.evaluation import Evaluation
from tests.support.matrices import coupled
from tests.support.plants import drive
from tests.support.vehicles import VEHICLES

BODIES = ["bluerov2", "astrobee", "remus100", "hummingbird", "f1tenth", "scalar_rov"]
bodies = pytest.mark.parametrize("name", BODIES)


@cache
def driven(name: str):
    """(system, prior, law's config, dt, 201 measurements) of a packed scenario."""
    scenario = load(name)
    setup = Setup.of(scenario)
    plant, prior = setup.plant, setup.prior
    driver = scenario.excitation.build(plant.system, prior, np.random.default_rng(0))
    seen = drive(plant, driver, 200 * scenario.dt).rows
    return plant.system, prior, scenario.identifier, scenario.dt, seen


@bodies
@pytest.mark.parametrize("gains", ["diagonal", "full"])
@pytest.mark.parametrize("hermite", [True, False])
def test_the_compiled_step_equals_the_generic_one(name, gains, hermite):
    """200 steps; what differs is the order of sums."""
    system, prior, law, dt, seen = driven(name)
    K, Gamma = np.full(system.n, law.K), law.gain * system.space.scale**2
    if gains == "full":
        rng = np.random.default_rng(1)
        K, Gamma = coupled(K, rng), coupled(Gamma, rng)
    identifier = paper_identifier(system, K, Gamma, prior, dt, hermite)
    states, scale = identify(identifier, seen), system.space.scale
    v_hat, theta_hat = states[0].v_hat, prior
    for one, pair in zip(states[1:], pairwise(seen), strict=True):
        v_hat, theta_hat, pivot = rk4_step(identifier, v_hat, theta_hat, *pair)
        assert np.abs((one.theta_hat - theta_hat) / scale).max() <= 1e-12
        size = 1 + np.abs(v_hat).max()
        assert np.abs(one.v_hat - v_hat).max() <= 1e-12 * size
        assert one.pivot == pytest.approx(pivot, rel=1e-10)
    assert np.abs((states[-1].theta_hat - prior) / scale).max() > 1e-6  # it has moved


@bodies
def test_the_compiled_step_ends_as_the_generic_one_does(name):
    system, prior, law, dt, seen = driven(name)
    gains = np.full(system.n, law.K), law.gain * system.space.scale**2
    lost = seen[1]._replace(v=seen[1].v * np.nan)
    for start, status in (
        (prior, Status.completed),
        (-prior, Status.estimate_not_positive_definite),
    ):
        identifier = paper_identifier(system, *gains, start, dt)
        first = identifier.init(seen[0])
        state = identifier.step(first, *seen[:2])
        assert state.status is status
        broken = identifier.step(first, seen[0], lost)
        assert broken.status is Status.measurement_not_finite
        pivot = rk4_step(identifier, first.v_hat, start, *seen[:2])[2]
        assert state.pivot == pytest.approx(pivot, rel=1e-10)


# -- the state between two samples ---------------------------------------------------------------


def twist(t: float, n: int) -> Array:
    """A smooth velocity (n,) of operation, none of it constant."""
    k = np.arange(n)
    return np.cos((0.9 + 0.35 * k) * t + k) + 0.3 * np.sin(1.7 * t - k)


@cache
def smooth(n: int):
    """The pose along that velocity, to 1e-13."""
    start = np.array([1.0, -2.0, 0.5, 0.1, -0.3, 0.2, np.sqrt(1 - 0.14)]) if n == 6 else np.ones(3)

    def rate(t: float, q: Array) -> Array:
        v = twist(t, n)
        if n == 6:
            return spatial.pose_jacobian(q) @ v
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])

    return solve_ivp(
        rate,
        (0, 4),
        start,
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
        max_step=0.01,
        dense_output=True,
    ).sol


def pose(n: int, t: float) -> Array:
    q = smooth(n)(t)
    if n == 6:
        q[3:] /= np.linalg.norm(q[3:])
    return q


def middles(n: int, dt: float, hermite: bool) -> tuple[float, float]:
    """Largest error of pose and velocity half-way between samples dt apart."""
    errors = []
    difference = poses.pose_difference if n == 6 else poses.planar_difference
    body = Body("free" if n == 6 else "planar")
    alone = Evaluation(Structure([body], [Inertia(0, 0)], [], 10, 0))

    for t in np.linspace(0.2, 3.4, 9):
        q, v = np.array([pose(n, t), pose(n, t + dt)]), np.array([twist(t, n), twist(t + dt, n)])
        log = Log(np.array([0.0, dt]), q, v, np.zeros((2, 0)))
        (q,), (v,) = alone.system.midpoints(log, hermite)[:2]
        half = t + dt / 2
        errors.append(
            [np.abs(difference(pose(n, half), q)).max(), np.abs(v - twist(half, n)).max()]
        )
    return tuple(np.max(errors, axis=0))


@pytest.mark.parametrize("n", [6, 3])
def test_the_interpolated_midpoint_is_of_fourth_order(n):
    steps = np.array([0.2, 0.1, 0.05, 0.025])
    place, speed = np.array([middles(n, dt, True) for dt in steps]).T
    assert 3.7 < order(steps, place) < 4.5, place
    assert 3.7 < order(steps, speed) < 4.5, speed
    assert place[0] < 1e-4 and speed[0] < 3e-3


@pytest.mark.parametrize("n", [6, 3])
def test_the_linear_midpoint_is_of_second_order_in_the_velocity(n):
    steps = np.array([0.2, 0.1, 0.05, 0.025])
    place, speed = np.array([middles(n, dt, False) for dt in steps]).T
    assert 3.7 < order(steps, place) < 4.5
    assert 1.9 < order(steps, speed) < 2.1


def test_without_the_bracket_the_midpoint_is_of_second_order(monkeypatch):
    """The test above can fail: steps added as if they commuted lose two orders."""
    steps, errors = np.array([0.2, 0.1, 0.05, 0.025]), []
    for dt in steps:
        dq = poses.pose_difference(pose(6, 1.0), pose(6, 1.0 + dt))
        _, v = half_way(dq, twist(1.0, 6), twist(1.0 + dt, 6), dt, True, 0)
        errors.append(np.abs(v - twist(1.0 + dt / 2, 6)).max())
    assert order(steps, np.array(errors)) < 2.5


# -- order, conserved quantity and V of the whole law --------------------------------------------


STARTS = {  # velocity, seconds, γ; no velocity passes 0 on the way: |v| v has a kink there
    "bluerov2": ([0.9, 0.5, -0.6, 0.7, -0.8, 0.9], 0.3, 3.0),
    "astrobee": ([0.3, -0.2, 0.1, 0.4, 0.5, -0.6], 1.0, 500.0),
    "f1tenth": ([5.0, 0.2, 0.5], 0.2, 0.2),
}


@cache
def motion(name: str) -> tuple[SecondOrderSystem, Array, Motion]:
    """A vehicle's motion from a given velocity under a constant command."""
    plant, (v, seconds, _) = VEHICLES[name].build(1e-3, 1), STARTS[name]
    system = plant.system
    numbers = 0.3 * np.cos(1 + np.arange(system.n))
    u = 0.3 + 0.1 * np.sin(1 + np.arange(system.n_u))
    start = system.position(numbers), np.array(v)
    return system, plant.truth, Motion(system, plant.truth, *start, u, seconds=seconds)


def exact(system, K: float, Gamma: Array, prior: Array, m: Motion) -> Array:
    """θ̂ at the motion's end by (44, 45) written out, integrated to 1e-12."""

    def rate(t: float, z: Array) -> Array:
        x, v_hat, theta_hat = m.x(t), z[: system.n], z[system.n :]
        dv = v_hat - x[system.m :]
        a_hat = system.acceleration(t, x, v_hat, m.u, theta_hat)
        W = system.regressor(t, x, v_hat, a_hat, m.u)
        return np.r_[a_hat - K * dv, Gamma * (W.T @ dv)]

    start = np.r_[m.x(0)[system.m :], prior]
    end = solve_ivp(rate, (0, m.seconds), start, method="DOP853", rtol=1e-11, atol=1e-13)
    return end.y[system.n :, -1]


@pytest.mark.parametrize("name", STARTS)
def test_the_law_converges_to_44_and_45_with_fourth_order(name):
    system, truth, m = motion(name)
    rng, scale = np.random.default_rng(2), system.space.scale
    prior = truth * (1 + 0.3 * rng.uniform(-1, 1, system.p))
    K, Gamma = 20.0, STARTS[name][2] * scale**2
    end, counts, errors = exact(system, K, Gamma, prior, m), np.array([10, 20, 40, 80]), []
    for count in counts:
        law = paper_identifier(system, np.full(system.n, K), Gamma, prior, m.seconds / count)
        states = identify(law, m.samples(count))
        errors.append(np.abs((states[-1].theta_hat - end) / scale).max())
    moved = np.abs((end - prior) / scale).max()
    assert moved > 1e-3 and errors[-1] < 1e-4 * moved
    assert 3.5 < order(1 / counts, np.array(errors)) < 4.6, errors


@bodies
def test_the_estimate_stays_on_its_sphere_and_V_falls(name):
    """(30, 45): θ̂ᵀ Γ⁻¹ θ̂ stays, full Γ or diagonal; (69): V falls by more than that error."""
    system, prior, law, dt, seen = driven(name)
    truth = Setup.of(load(name)).plant.truth
    Gamma = law.gain * system.space.scale**2
    for gain in (Gamma, coupled(Gamma, np.random.default_rng(3))):
        identifier = paper_identifier(system, np.full(system.n, law.K), gain, prior, dt)
        found = estimates(identifier, seen)
        conserved = identifier.conserved(found[1])
        drift = np.abs(conserved / conserved[0] - 1).max()
        assert drift < 1e-6
        if gain.ndim == 1:
            V = lyapunov(system, truth, Gamma, seen, found)
            error = np.abs(np.diff(conserved)).max() + 1e-15 * conserved[0]
            assert np.diff(V).max() <= error
            assert V[0] - V[-1] > 10 * error
