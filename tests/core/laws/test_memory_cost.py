"""The memory's cost: its gradient, its curvature, and its invariance to scale."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.core.laws.memory.statistics import Memory, Recorder
from nsaid_mj.core.laws.settings import MemoryConfig
from nsaid_mj.core.log import EXACT
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.quotient.cost import Quotient, Remembered
from nsaid_mj.lab.plants.world.noise import SensorNoise
from tests.support.remembered import Log, driven, noisy, remember
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=25)
NAMES = ["scalar_rov", "bluerov2", "double_pendulum", "crazyflie"]
NOISE = SensorNoise()


@cache
def remembered(name: str, sensors: str) -> tuple[Log, Memory]:
    """A memory of a few seconds of a driven plant."""
    log = driven(name, 3.0)
    exact = sensors == "ideal"
    levels = EXACT if exact else NOISE.levels
    seen = log if exact else noisy(log, NOISE, 1)
    own = Recorder(log.plant.system, MemoryConfig(), log.dt, levels, exact)
    *_, memory = remember(own, seen)
    return log, memory


def near(log: Log, rng: np.random.Generator, error: float = 0.3) -> Array:
    """θ within ±error of the truth, those near 0 of their scale."""
    size = np.abs(log.plant.truth) + 0.1 * log.plant.system.space.scale
    return log.plant.truth + error * size * rng.uniform(-1, 1, len(size))


def weighted(name: str, sensors: str, theta: Array) -> Quotient:
    log, memory = remembered(name, sensors)
    found = Remembered.of(memory.means, log.plant.system.space)
    assert found is not None
    return found.weighted(theta)


def drawn(rng: np.random.Generator, n: int = 3, p: int = 7) -> tuple[Quotient, Array]:
    """A quotient of random data with a θ* > 0 in the nullspace of all, its first 3 actuators."""
    truth = np.exp(rng.uniform(-1, 1, p))
    rows = rng.standard_normal((n, 5, p))
    rows -= (rows @ truth)[..., None] * truth / (truth @ truth)
    effort = np.zeros((n, p))
    effort[:, :3] = rng.uniform(0, 2, (n, 3))
    G = np.einsum("ikp,ikq->ipq", rows, rows)
    return Quotient(G, effort, rng.uniform(0.1, 9, n)), truth


each = pytest.mark.parametrize("name", NAMES)
both = pytest.mark.parametrize("sensors", ["ideal", "noisy"])


@each
@both
@FEW
@given(seeds)
def test_the_gradient_is_the_slope(name, sensors, seed):
    log, _ = remembered(name, sensors)
    rng, scale = np.random.default_rng(seed), log.plant.system.space.scale
    theta = near(log, rng)
    cost = weighted(name, sensors, theta)
    step = 1e-5 * (np.abs(theta) + 0.1 * scale) * rng.standard_normal(len(theta))
    slope = cost.gradient(theta) @ step
    whole, half = ((cost.value(theta + x) - cost.value(theta - x)) / 2 for x in (step, step / 2))
    rise = (8 * half - whole) / 3  # Richardson's extrapolation
    terms = np.abs(cost.gradient(theta) * step).sum()
    assert rise == pytest.approx(slope, abs=1e-7 * terms + 1e-11 * cost.weights.sum())


@each
@both
@FEW
@given(seeds, st.floats(1e-6, 1e6))
def test_a_change_of_scale_changes_nothing(name, sensors, seed, factor):
    """R(sθ) = R(θ), so θᵀ ∇R = 0; and the weights have no scale either."""
    log, _ = remembered(name, sensors)
    theta = near(log, np.random.default_rng(seed))
    cost = weighted(name, sensors, theta)
    assert cost.value(factor * theta) == pytest.approx(cost.value(theta), rel=1e-9)
    pull = theta * cost.gradient(theta)
    assert abs(pull.sum()) < 1e-9 * np.abs(pull).sum()
    again = weighted(name, sensors, factor * theta)
    np.testing.assert_allclose(again.weights, cost.weights, rtol=1e-7)
    pulls = np.outer(theta, theta) * cost.curvature(theta)  # Π θ = 0
    assert np.abs(pulls.sum(axis=1)).max() <= 1e-9 * np.abs(pulls).max()


@FEW
@given(seeds)
def test_every_true_theta_sees_the_cost_fall(seed):
    """θ*ᵀ ∇R ≤ −2 R min θ*/θ̂ over the actuators, wherever G_i θ* = 0: no other stationary point."""
    rng = np.random.default_rng(seed)
    cost, truth = drawn(rng)
    theta = truth * np.exp(rng.uniform(-2, 2, len(truth)))
    share = (truth / theta)[:3].min()
    fall, size = truth @ cost.gradient(theta), np.abs(truth * cost.gradient(theta)).sum()
    assert fall <= -2 * share * cost.value(theta) + 1e-12 * size
    assert cost.value(truth) == pytest.approx(0, abs=1e-12 * cost.weights.sum())
    assert np.abs(truth * cost.gradient(truth)).max() < 1e-10 * cost.weights.sum()


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum", "crazyflie"])
@FEW
@given(seeds)
def test_every_plants_truth_sees_the_cost_fall(name, seed):
    log, _ = remembered(name, "ideal")
    rng, truth = np.random.default_rng(seed), log.plant.truth
    theta = truth * np.exp(rng.uniform(-1, 1, len(truth)))
    cost = weighted(name, "ideal", theta)
    measures = cost.effort.any(axis=0)  # of the actuators, and of what stands in for them in a row
    share = (truth[measures] / theta[measures]).min()
    assert truth @ cost.gradient(theta) <= -2 * share * cost.value(theta) * (1 - 1e-3)


@FEW
@given(seeds)
def test_the_curvature_is_that_of_gauss_and_newton(seed):
    """Jᵀ J of the residuals r_ik = (w_i/θᵀΣ_iθ)^½ y_ik θ, s_i held or not: here by differences."""
    rng = np.random.default_rng(seed)
    n, count, p = 2, 6, 5
    rows, effort = rng.standard_normal((n, count, p)), np.zeros((n, p))
    effort[:, :2] = rng.uniform(0.1, 2, (n, 2))
    theta, weights = rng.uniform(0.5, 2, p), rng.uniform(0.1, 9, n)
    cost = Quotient(np.einsum("ikp,ikq->ipq", rows, rows), effort, weights)

    def residuals(theta: Array) -> Array:
        return ((rows @ theta) * np.sqrt(weights / (effort @ theta**2))[:, None]).ravel()

    steps = 1e-6 * np.eye(p)
    J = np.stack([residuals(theta + s) - residuals(theta - s) for s in steps], axis=1) / 2e-6
    own, size = cost.curvature(theta), np.abs(J.T @ J).max()
    np.testing.assert_allclose(own, J.T @ J, atol=1e-6 * size)
    np.testing.assert_allclose(own, own.T, atol=1e-12 * size)
    assert cost.value(theta) == pytest.approx(0.5 * residuals(theta) @ residuals(theta))
    slope = J.T @ residuals(theta)
    np.testing.assert_allclose(cost.gradient(theta), slope, atol=1e-6 * np.abs(J).max() ** 2)


@each
@both
@FEW
@given(seeds)
def test_curvature_is_positive_semidefinite(name, sensors, seed):
    log, _ = remembered(name, sensors)
    theta = near(log, np.random.default_rng(seed))
    hessian = weighted(name, sensors, theta).curvature(theta)
    balanced = hessian * np.outer(theta, theta)
    assert np.linalg.eigvalsh(balanced)[0] > -1e-9 * np.abs(balanced).max()


# -- what the data are measured in ---------------------------------------------------------------


@each
def test_the_quotient_is_normalised_by_positive_parameters_only(name):
    """On a row's actuators, and where it has none on its other positive parameters."""
    log, memory = remembered(name, "ideal")
    space = log.plant.system.space
    found = Remembered.of(memory.means, space)
    assert (
        found is not None
        and (found.effort >= 0).all()
        and (found.effort @ space.scale**2 > 0).all()
    )
    own = memory.means.gramian[:, space.actuators][:, :, space.actuators].any(axis=(1, 2))
    rest = np.setdiff1d(np.arange(len(space)), space.actuators)
    assert own.any() and (found.effort[np.ix_(own, rest)] == 0).all()
    assert (found.effort[:, space.geometries != "positive"] == 0).all()


def test_an_unused_actuator_does_not_enter_the_quotient():
    """Nothing pulls at it, and no residual is excused by it."""
    log = driven("bluerov2", 3.0)
    space, still = log.plant.system.space, 2
    rows = [row._replace(u=row.u * (np.arange(len(row.u)) != still)) for row in log.rows]
    own = Recorder(log.plant.system, MemoryConfig(), log.dt, EXACT)
    *_, memory = remember(own, log._replace(rows=rows))
    found = Remembered.of(memory.means, space)
    assert found is not None
    k = space.actuators[still]
    assert (found.effort[:, k] == 0).all() and (memory.means.gramian[:, k] == 0).all()
    theta = near(log, np.random.default_rng(0))
    cost = found.weighted(theta)
    assert cost.gradient(theta)[k] == 0 and (cost.curvature(theta)[k] == 0).all()


@pytest.mark.parametrize("name", ["scalar_rov", "bluerov2"])
def test_without_any_command_there_is_no_quotient(name):
    log = driven(name, 1.0)
    own = Recorder(log.plant.system, MemoryConfig(), log.dt, EXACT)
    *_, memory = remember(own, log._replace(rows=[row._replace(u=0 * row.u) for row in log.rows]))
    assert np.abs(memory.means.gramian).max() > 0
    assert Remembered.of(memory.means, log.plant.system.space) is None


def test_a_row_without_an_actuator_is_normalised_by_the_others():
    """A rotor pushes along one axis: the others' balances are drag's, or have none of their own."""
    log, memory = remembered("crazyflie", "ideal")
    space, gramian = log.plant.system.space, memory.means.gramian.copy()
    dragged = Remembered.of(memory.means, space)
    assert dragged is not None and (dragged.effort[:2, space.actuators] == 0).all()
    gramian[:2, space.geometries == "positive"] = 0.0
    gramian[:2, :, space.geometries == "positive"] = 0.0
    found = Remembered.of(memory.means._replace(gramian=gramian), space)
    assert found is not None
    own = found.effort[:, space.actuators]
    shares = own / np.einsum("ipp,p->i", gramian, space.scale**2)[:, None]
    np.testing.assert_allclose(shares[:2], np.tile(shares[2:].mean(axis=0), (2, 1)), rtol=1e-9)
    assert (own[:2] > 0).any(axis=1).all()


def test_a_row_without_excitation_has_no_cost():
    log, memory = remembered("bluerov2", "ideal")
    moving = (np.arange(log.plant.system.n) != 1)[:, None, None]
    theta = near(log, np.random.default_rng(1))
    means = memory.means
    still = memory._replace(
        means=means._replace(
            gramian=moving * means.gramian,
            lagged=moving * means.lagged,
            last=moving[:, 0] * means.last,
            noise=moving * means.noise,
        )
    )
    found = Remembered.of(still.means, log.plant.system.space)
    assert found is not None
    cost = found.weighted(theta)
    assert np.isfinite(cost.weights).all()
    alone = Quotient(cost.gramian[[1]], cost.effort[[1]], cost.weights[[1]])
    assert alone.value(theta) == 0 and (alone.gradient(theta) == 0).all()
    assert np.isfinite(cost.gradient(theta)).all()


@both
def test_weights_are_one_over_the_residuals(sensors):
    """½ w λ = ½ blocks for every row whose residuals are above the floor; noise counts in w."""
    log, memory = remembered("bluerov2", sensors)
    theta = near(log, np.random.default_rng(2))
    found = Remembered.of(memory.means, log.plant.system.space)
    assert found is not None
    cost = found.weighted(theta)
    expected = 0.5 * memory.means.blocks * log.plant.system.n
    rho, _ = found.residuals(theta)
    whole = replace(cost, gramian=memory.means.innovations(rho))
    assert whole.value(theta) == pytest.approx(expected, rel=1e-9)
    assert cost.value(theta) <= expected * (1 + 1e-9)
    truth = log.plant.truth
    floor = weighted("bluerov2", sensors, truth)
    assert np.isfinite(floor.weights).all() and (floor.weights > 0).all()
