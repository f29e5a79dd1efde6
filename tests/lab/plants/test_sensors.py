"""Sensor noise: of the stated size, seeded, off when 0."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.lab.plants.world.noise import SensorNoise
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=50)
levels = st.floats(1e-6, 10)


def corrupt(noise: SensorNoise, position, velocity, seed=0):
    return noise.corrupt(position, velocity, np.random.default_rng(seed))


@FEW
@given(seeds)
def test_zero_noise_returns_the_true_values(seed):
    q, v = np.random.default_rng(seed).standard_normal((2, 4))
    for given_, said in zip((q, v), corrupt(SensorNoise(0.0, 0.0, 0.0), q, v), strict=True):
        assert (given_ == said).all()


@FEW
@given(seeds, st.floats(1e-6, 1.0))
def test_an_encoder_rounds_to_its_nearest_step(seed, step):
    q = np.random.default_rng(seed).standard_normal(50)
    said, _ = corrupt(SensorNoise(0.0, 0.0, step), q, q)
    ticks = said / step
    assert np.abs(ticks - np.round(ticks)).max() <= 1e-9 * (1 + np.abs(ticks).max())
    assert np.abs(said - q).max() <= step / 2 * (1 + 1e-9)


@FEW
@given(seeds, levels, levels)
def test_noise_has_the_stated_size_no_mean_and_no_correlation(seed, position, velocity):
    zero = np.zeros(20_000)
    q, v = corrupt(SensorNoise(position, velocity), zero, zero, seed)
    for said, sigma in ((q, position), (v, velocity)):
        assert np.std(said) == pytest.approx(sigma, rel=0.04)
        assert abs(np.mean(said)) < 0.04 * sigma
    assert abs(np.corrcoef(q, v)[0, 1]) < 0.04
    assert abs(np.corrcoef(q[1:], q[:-1])[0, 1]) < 0.04


def test_noise_is_seeded_and_leaves_its_inputs_alone():
    q, v = np.arange(3.0), np.arange(3.0)
    one, same, other = (corrupt(SensorNoise(), q, v, seed) for seed in (1, 1, 2))
    assert (np.array(one) == np.array(same)).all()
    assert (np.array(one) != np.array(other)).all()
    assert q.tolist() == v.tolist() == [0.0, 1.0, 2.0]


def test_a_coarse_encoder_hides_small_noise():
    q = np.full(100, 0.3)
    said, _ = corrupt(SensorNoise(position=1e-4, encoder_step=0.1), q, q)
    assert np.unique(said).size == 1


@pytest.mark.parametrize("noise", [0.0, 2e-3])
@pytest.mark.parametrize("step", [0.0, 1e-2])
def test_the_stated_level_is_the_measured_one_of_noise_and_encoder_together(noise, step):
    """An encoder's error is uniform within ± half a step: its variance is a twelfth of step²."""
    sensor = SensorNoise(position=noise, velocity=3e-3, encoder_step=step)
    true = np.random.default_rng(1).uniform(-1, 1, 200_000)
    said, v = corrupt(sensor, true, np.zeros_like(true))
    assert sensor.levels.position == pytest.approx(np.std(said - true), rel=0.01, abs=1e-12)
    assert sensor.levels.velocity == pytest.approx(np.std(v), rel=0.01)


@pytest.mark.parametrize("field", ["position", "velocity", "encoder_step"])
@pytest.mark.parametrize("bad", [-1e-9, np.nan, np.inf])
def test_a_bad_level_is_refused(field, bad):
    with pytest.raises(InvalidInput) as caught:
        SensorNoise(**{field: bad})
    assert caught.value.name == f"noise.{field}"
