"""What noise explains is left out, what new data do not renew is kept."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from nsaid_mj.core.laws.memory.feedback import FedBack
from nsaid_mj.core.log import Log
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.quotient.cost import without_noise
from nsaid_mj.core.quotient.gramians import forgetting
from nsaid_mj.lab.library import load
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=25)
P = 6


def gramian(rng: np.random.Generator, rank: int) -> Array:
    rows = rng.standard_normal((rank, P))
    return rows.T @ rows


# -- forgetting ----------------------------------------------------------------------------------


@given(seeds)
@FEW
def test_what_is_not_excited_keeps_its_information_exactly(seed):
    """vᵀ G v stands for every v that new data do not see, however often they come."""
    rng = np.random.default_rng(seed)
    new = 1e3 * gramian(rng, 2)
    unseen = np.linalg.svd(new)[2][2:].T
    old = whole = gramian(rng, 10)
    for _ in range(20):
        whole = whole + new
        (T,), share = forgetting(whole[None], new[None], 0 * new[None], 0.3)
        assert 0.7 < share < 1
        whole = T @ whole @ T.T
    np.testing.assert_allclose(
        unseen.T @ whole @ unseen, unseen.T @ old @ unseen, rtol=1e-6, atol=1e-7
    )


@given(seeds)
@FEW
def test_what_is_excited_is_forgotten_at_the_stated_rate(seed):
    """What is known of z = y θ, whatever the rest of θ, is 1/(yᵀ G⁻¹ y)."""
    rng = np.random.default_rng(seed)
    y = rng.standard_normal(P)
    whole = gramian(rng, 10) + 100 * np.outer(y, y)
    (T,), _ = forgetting(whole[None], 100 * np.outer(y, y)[None], 0 * whole[None], 0.3)
    kept = T @ whole @ T.T
    before, after = (1 / (y @ np.linalg.solve(G, y)) for G in (whole, kept))
    assert after == pytest.approx(0.7 * before, rel=1e-6)
    everything, _ = forgetting(whole[None], whole[None], 0 * whole[None], 0.3)
    np.testing.assert_allclose(everything[0], 0.7**0.5 * np.eye(P), atol=1e-6)


@given(seeds)
@FEW
def test_no_direction_loses_more_than_it_has_gained(seed):
    rng = np.random.default_rng(seed)
    old, new = gramian(rng, 10), rng.uniform(0, 1) * gramian(rng, 3)
    (T,), _ = forgetting((old + new)[None], new[None], 0 * new[None], 0.3)
    left = T @ (old + new) @ T.T
    assert np.linalg.eigvalsh(left - old).min() > -1e-6 * np.trace(old)
    assert np.linalg.eigvalsh(old + new - left).min() > -1e-6 * np.trace(old)


def test_noise_renews_nothing():
    rng = np.random.default_rng(0)
    noise = gramian(rng, 10)
    old, new = 1e3 * gramian(rng, 10), 1.3 * noise
    (T,), share = forgetting((old + new)[None], new[None], noise[None], 0.3)
    assert share == 1 and (np.eye(P) == T).all()


# -- noise in a Gramian --------------------------------------------------------------------------


@pytest.mark.parametrize("blocks", [100, 1000, 100_000])
def test_of_noise_alone_nothing_is_left_and_a_signal_keeps_its_size(blocks):
    """Without bias: what is left of y + noise is that of y alone, and along θ* nothing."""
    rng = np.random.default_rng(blocks)
    root = rng.standard_normal((P, P))
    noise = root @ root.T
    rows = rng.standard_normal((blocks, P)) @ root.T
    alone = without_noise(rows.T @ rows / blocks, noise, blocks)
    assert np.linalg.norm(alone) < 0.03 * np.linalg.norm(noise)
    y = 3 * root @ rng.standard_normal(P)
    both = rows + rng.standard_normal((blocks, 1)) * y
    found = without_noise(both.T @ both / blocks, noise, blocks)
    assert np.linalg.eigvalsh(found).min() > -1e-9 * np.trace(found)
    along = np.linalg.solve(noise, y)
    kept = (along @ found @ along) / (along @ y) ** 2
    assert kept == pytest.approx(1.0, abs=4 / np.sqrt(blocks) + 0.02)


def test_a_row_without_any_signal_has_none_and_says_nothing(capfd):
    assert not without_noise(np.zeros((P, P)), np.eye(P), 10).any()
    assert capfd.readouterr().out == ""


# -- noise that is fed back ----------------------------------------------------------------------


def fed_log(gain: float, seed: int, count: int = 1500) -> tuple[Log, Array]:
    """A car at rest whose commands follow the noise of its measured velocity, and a smooth one."""
    rng, t = np.random.default_rng(seed), 0.004 * np.arange(count)
    q, v = 1e-4 * rng.standard_normal((count, 3)), 5e-3 * rng.standard_normal((count, 3))
    u = np.stack([np.sin(t) - gain * v[:, 0], 0.1 * np.cos(2 * t)], axis=1)
    return Log(t, q, v, u), 5e-3 * gain * np.array([1.0, 0.0])


@pytest.mark.parametrize("gain", [0.0, 2.0])
def test_noise_that_is_fed_back_is_found_in_the_data(gain):
    system = load("f1tenth").plant.build(0.004, 0).system
    log, expected = fed_log(gain, 1)
    fed = FedBack.unknown(3, 2).along(system.moves(log.q), log)
    found = np.linalg.norm(fed.deviations(), axis=0)
    np.testing.assert_allclose(found, expected, rtol=0.1, atol=1e-6)
    stepwise = FedBack.unknown(3, 2)
    for k in range(len(log.t) - 1):
        part = log.part(k, k + 2)
        stepwise = stepwise.along(system.moves(part.q), part)
    assert all(np.array_equal(a, b) for a, b in zip(fed, stepwise, strict=True))
