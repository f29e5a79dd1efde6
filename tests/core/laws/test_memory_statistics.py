"""The momentum balance that the truth satisfies, and its means in bounded storage."""

from __future__ import annotations

import pickle
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.memory.statistics import Memory, Recorder
from nsaid_mj.core.laws.settings import MemoryConfig
from nsaid_mj.core.log import EXACT, SensorLevels
from nsaid_mj.core.quotient.cost import Remembered
from nsaid_mj.lab.plants.world.noise import SensorNoise
from tests.support.dense import transport
from tests.support.plants import plant
from tests.support.remembered import (
    Log,
    added,
    blocks,
    driven,
    noisy,
    off,
    regressors,
    remember,
)
from tests.support.vehicles import VEHICLES

FEW = settings(deadline=None, max_examples=5)
ARMS = ["ur5", "kinova", "panda", "double_pendulum", "solo12"]
NAMES = ["scalar_rov", "rover", *ARMS, "kinova pinocchio", *VEHICLES]
EXACTLY = ["bluerov2", "remus100", "f1tenth", "crazyflie", "astrobee", "uvms", "borinot", "rover"]
"""Systems whose Cᵀ v has a closed form."""


def recorder(
    log: Log, config: MemoryConfig | None = None, levels: SensorLevels = EXACT
) -> Recorder:
    return Recorder(log.plant.system, config or MemoryConfig(), log.dt, levels, levels.exact)


# -- the momentum balance ------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@FEW
@given(st.integers(0, 2**32 - 1))
def test_transport_is_the_transposed_coriolis_matrix_times_v(name, seed):
    """For any θ, not for true ones only."""
    system, rng = plant(name).system, np.random.default_rng(seed)
    q, v, _ = system.random_state(rng)
    theta = system.space.scale * rng.standard_normal(system.p)
    C = system.coriolis_matrix(np.r_[q, v], theta)
    expected, own = C.T @ v, transport(system, q, v) @ theta
    size = (np.abs(C.T) @ np.abs(v)).max() + np.abs(system._W_M(q, v) * theta).max()
    assert np.abs(own - expected).max() <= (1e-13 if name in EXACTLY else 1e-8) * size
    assert (transport(system, q, 0 * v) == 0).all()


# From 8, 4 and 2 plant steps to a sample. Drag |v|v has a kink at v = 0, which costs an order.
SMOOTH = ["double_pendulum", "ur5", "crazyflie", "f1tenth", "astrobee", "borinot"]
KINKED = ["scalar_rov", "bluerov2", "remus100", "uvms"]


@pytest.mark.parametrize(
    "name",
    # links that fly are smooth as an arm and as a flying body are
    [pytest.param(x, marks=pytest.mark.slow) if x == "borinot" else x for x in (*SMOOTH, *KINKED)],
)
def test_the_truth_is_in_the_nullspace_to_the_order_of_simpsons_rule(name):
    log = driven(name, 0.5 if name in ("uvms", "borinot") else 1.0, hold=8)
    coarse, middle, fine = (
        off(regressors(recorder(log.every(k)), log.every(k)), log.plant.truth) for k in (8, 4, 2)
    )
    order = np.log2(coarse / fine) / 2
    assert (3.6 if name in SMOOTH else 2.2) < order < 5.5
    assert coarse < 1e-6 and middle < coarse and fine < 3e-9
    wrong = log.plant.truth * (1 + 0.1 * np.cos(np.arange(log.plant.system.p)))
    assert off(regressors(recorder(log.every(4)), log.every(4)), wrong) > 1e-3


@pytest.mark.parametrize("name", ["double_pendulum", "bluerov2"])
def test_the_balance_is_the_regressor_with_the_true_acceleration_behind_the_leak(name):
    """Y = ∫ e^{−a(t−τ)} W(τ, x, v, v̇) dτ, all columns, over one held command."""
    log = driven(name, 0.2, hold=20 if name == "bluerov2" else 200)
    rows = log.rows[: 20 if name == "bluerov2" else 200]
    system, config = log.plant.system, MemoryConfig(window=0.07)
    t, q, v, u = (np.array(part) for part in zip(*rows, strict=True))
    assert (u == u[0]).all()
    x = np.hstack([q, v])
    W = system.regressor(t, x, v, system.acceleration(t, x, v, u, log.plant.truth), u)
    grown = np.exp(t / config.window)[:, None, None]
    expected = cumulative_simpson(W * grown, x=t, axis=0) / grown[1:]
    Y = regressors(recorder(log, config), log._replace(rows=rows))
    scale = system.space.scale
    assert np.abs((Y - expected) * scale).max() < 1e-6 * np.abs(Y * scale).max()


def test_filters_of_two_windows_are_related_by_their_leaks():
    """Ẏ = −a Y + W for every a, so Y_a − Y_b = (b − a) ∫ e^{−a(t−τ)} Y_b dτ."""
    log = driven("ur5", 0.5)
    slow, fast = (regressors(recorder(log, MemoryConfig(window=w)), log) for w in (0.5, 0.1))
    t = np.array([row.t for row in log.rows[1:]])
    grown = np.exp(t / 0.5)[:, None, None]
    first = log.dt * np.exp(t[0] / 0.5) * fast[0] / 2
    lag = (cumulative_simpson(fast * grown, x=t, axis=0, initial=0) + first) / grown
    scale = log.plant.system.space.scale
    difference = (slow - fast - (10 - 2) * lag) * scale
    assert np.abs(difference).max() < 1e-4 * np.abs(slow * scale).max()


@pytest.mark.parametrize("name", ["double_pendulum", "f1tenth"])
def test_samples_need_not_be_regular(name):
    log, rng = driven(name, 1.0, hold=8), np.random.default_rng(1)
    inner = [k for k in range(len(log.rows)) if k % 8 == 0 or rng.uniform() < 0.3]
    rows = [log.rows[k] for k in inner]
    assert len({round((b.t - a.t) / log.dt) for a, b in pairwise(rows)}) > 4
    assert off(regressors(recorder(log), log._replace(rows=rows)), log.plant.truth) < 1e-6


# -- the means -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["double_pendulum", "bluerov2"])
def test_recursive_means_equal_those_of_all_blocks(name):
    log = driven(name, 2.03)
    own = recorder(log)
    kept, listed = list(remember(own, log))[-1], blocks(own, log)
    assert len(listed) == 20 and own.block == round(0.1 / log.dt)
    weight = np.ones(len(listed))
    assert kept.means.blocks == pytest.approx(weight.sum())
    pairs = list(zip([np.zeros_like(listed[0]), *listed], listed, weight, strict=False))
    gramian = sum(w * np.einsum("ip,iq->ipq", Y, Y) for _, Y, w in pairs) / weight.sum()
    lagged = sum(w * np.einsum("ip,iq->ipq", Y, Z) for Z, Y, w in pairs) / weight.sum()
    assert isinstance(gramian, np.ndarray) and isinstance(lagged, np.ndarray)
    size = np.abs(gramian).max()
    np.testing.assert_allclose(kept.means.gramian, gramian, rtol=1e-10, atol=1e-14 * size)
    symmetric = 0.5 * (lagged + lagged.transpose(0, 2, 1))
    np.testing.assert_allclose(kept.means.lagged, symmetric, rtol=1e-10, atol=1e-14 * size)
    np.testing.assert_allclose(kept.means.last, listed[-1], rtol=1e-9)
    assert (kept.means.noise == 0).all()


def test_the_innovation_gramian_equals_that_of_all_differences():
    """Mean of (Y − ρ Y′)(Y − ρ Y′)ᵀ, ρ the correlation of neighbouring residuals at θ."""
    log = driven("bluerov2", 4.0)
    own, space = recorder(log), log.plant.system.space
    theta = log.plant.truth * (1 + 0.2 * np.cos(np.arange(len(space))))
    kept, listed = list(remember(own, log))[-1], blocks(own, log)
    found = Remembered.of(kept.means, space)
    assert found is not None
    cost = found.weighted(theta)
    own_rho, _ = found.residuals(theta)
    before = np.concatenate([np.zeros_like(listed[:1]), listed[:-1]])
    weight = np.ones(len(listed))
    weight /= weight.sum()
    old, new = before @ theta, listed @ theta
    rho = np.sum(weight[:, None] * old * new, axis=0) / np.sum(weight[:, None] * new**2, axis=0)
    np.testing.assert_allclose(own_rho, np.clip(rho, 0, 0.95), rtol=1e-8)
    assert (own_rho > 0.1).any()  # else nothing is taken away
    fresh = listed - own_rho[:, None] * before
    expected = np.einsum("k,kip,kiq->ipq", weight, fresh, fresh)
    np.testing.assert_allclose(
        cost.gramian, expected, rtol=1e-8, atol=1e-12 * np.abs(expected).max()
    )
    assert np.linalg.eigvalsh(cost.gramian).min() > -1e-12 * np.abs(expected).max()
    level = np.einsum("k,ki->i", weight, (fresh @ theta) ** 2) / (found.effort @ theta**2)
    np.testing.assert_allclose(cost.weights, kept.means.blocks / level, rtol=1e-8)


@pytest.mark.parametrize("name", ["bluerov2", "astrobee", "ur5"])
def test_the_noise_gramian_predicts_the_effect_of_noise(name):
    """E[ΔY ΔYᵀ] of blocks with noise less the same without, on the columns of the masses."""
    log, noise = driven(name, 6.0), SensorNoise()
    own, space = recorder(log, levels=noise.levels), log.plant.system.space
    change = blocks(own, noisy(log, noise, 0)) - blocks(own, log)
    found = np.einsum("kip,kip->ip", change, change) / len(change) * space.scale**2
    *_, kept = remember(own, log)
    stated = np.einsum("ipp->ip", kept.means.noise) * space.scale**2
    whole = stated.sum(axis=1)
    share = found.sum(axis=1) / whole
    most = 10 if name == "ur5" else 2  # joints that reverse: friction's tanh is not linear in noise
    assert (share < most).all() and (share > 0.1).all()
    assert 0.4 < np.median(share) < (2.5 if name == "ur5" else 1.6)


LOUD = SensorNoise(position=1e-3, velocity=2e-2)


# -- pure, bounded, robust -----------------------------------------------------------------------


def flat(memory: Memory) -> bytes:
    return pickle.dumps(memory)


@pytest.mark.parametrize("levels", [EXACT, LOUD.levels], ids=["exact", "noisy"])
def test_absorbing_a_step_leaves_its_inputs_unchanged(levels):
    log = driven("f1tenth", 2.0)
    one, other = recorder(log, levels=levels), recorder(log, levels=levels)
    kept = list(remember(one, log))
    frozen = [flat(memory) for memory in kept]
    for k in (300, 7, 300, 24, 25):  # in any order, by any instance, within a block or closing one
        a, b = log.rows[k : k + 2]
        inputs = pickle.dumps((a, b))
        for own in (one, other):
            again = added(own, kept[k], a, b)
            assert flat(again) == frozen[k + 1]
        assert inputs == pickle.dumps((a, b))
    assert [flat(memory) for memory in kept] == frozen


def nbytes(value) -> int:
    if isinstance(value, tuple):
        return sum(map(nbytes, value))
    return np.asarray(value).nbytes if isinstance(value, np.ndarray) else 8 * (value is not None)


@pytest.mark.parametrize("levels", [EXACT, LOUD.levels], ids=["exact", "noisy"])
def test_the_memory_does_not_grow_with_time(levels):
    log = driven("scalar_rov", 60.0)
    for interval in (0.5, 1e6):
        own = recorder(log, MemoryConfig(interval=interval), levels)
        sizes = [nbytes(memory) for memory in remember(own, log)]
        assert max(sizes[-200:]) == max(sizes[:200]) == max(sizes) < 10_000


def test_a_block_has_at_least_one_sample():
    log = driven("double_pendulum", 0.3)
    config = MemoryConfig(block=1e-4, interval=1e-4)
    own = recorder(log, config)
    *_, kept = remember(own, log)
    assert own.block == 1 and kept.means.blocks == len(log.rows) - 1
    assert (kept.balance.total == 0).all()


def test_a_plant_that_nothing_moves_leaves_no_quotient():
    log = driven("scalar_rov", 1.0)
    rest = [row._replace(v=0 * row.v, q=0 * row.q, u=0 * row.u) for row in log.rows]
    *_, kept = remember(recorder(log), log._replace(rows=rest))
    assert Remembered.of(kept.means, log.plant.system.space) is None
    assert Remembered.of(recorder(log).begin(rest[0]).means, log.plant.system.space) is None


@pytest.mark.parametrize("field", [field.name for field in fields(MemoryConfig)])
@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_a_memory_configuration_out_of_range_is_refused(field, bad):
    with pytest.raises(InvalidInput) as caught:
        MemoryConfig(**{field: bad})
    assert caught.value.name == f"identifier.memory.{field}" and caught.value.remedy


def test_the_anchor_defaults_to_0_for_exact_and_1_for_other_rows():
    assert MemoryConfig().weight(True) == 0 and MemoryConfig().weight(False) == 1
    for anchor in (0.0, 0.3):
        for exact in (True, False):
            assert MemoryConfig(anchor=anchor).weight(exact) == anchor
