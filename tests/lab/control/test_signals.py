"""Excitation signals: seeded, bounded, within their band, with consistent derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.lab.control.signals import FourierTrajectory, Multisine
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=30)


def fourier(seed, *, low=(-1.0, 0.0, 2.0), high=(1.0, 3.0, 2.5), speed=(1.0, 9.0, 0.3), f=0.2, h=5):
    rng = np.random.default_rng(seed)
    return FourierTrajectory(np.array(low), np.array(high), np.array(speed), f, h, rng)


def sampled(trajectory, period: float, count: int = 2000):
    parts = zip(*(trajectory(t) for t in np.linspace(0, period, count)), strict=True)
    return [np.array(part) for part in parts]


def test_fourier_stays_within_range_and_speed_and_uses_one_of_them():
    low, high, speed = np.array([-1.0, 0.0]), np.array([1.0, 3.0]), np.array([1.0, 20.0])
    uses = []
    for seed in range(16):
        q, v, _ = sampled(fourier(seed, low=low, high=high, speed=speed, h=1 + seed % 8), 5.0)
        part = np.abs(q - (low + high) / 2).max(0) / ((high - low) / 2)
        uses.append(np.maximum(part, np.abs(v).max(0) / speed))
    assert np.min(uses) >= 0.99, "it does not use its limits"
    assert np.max(uses) <= 1 + 1e-9, "it leaves its limits"


@FEW
@given(seeds, st.floats(0, 20))
def test_fourier_velocity_and_acceleration_are_derivatives(seed, t):
    trajectory, h = fourier(seed), 1e-4
    (q0, v0, _), (_, v, a), (q1, v1, _) = (trajectory(t + s) for s in (-h, 0, h))
    np.testing.assert_allclose((q1 - q0) / (2 * h), v, atol=1e-5)
    np.testing.assert_allclose((v1 - v0) / (2 * h), a, atol=1e-4)


@FEW
@given(seeds, st.floats(0, 5), st.floats(0.05, 2.0))
def test_fourier_is_periodic(seed, t, f):
    trajectory = fourier(seed, f=f)
    for now, later in zip(trajectory(t), trajectory(t + 1 / f), strict=True):
        np.testing.assert_allclose(now, later, atol=1e-9 * (1 + np.abs(now).max()))


def test_fourier_joints_move_independently():
    q, _, _ = sampled(fourier(0), 5.0)
    assert np.linalg.matrix_rank(q - q.mean(0)) == 3


@pytest.mark.parametrize("change", [{"f": 0.0}, {"f": -1.0}, {"f": np.nan}, {"f": np.inf}])
def test_fourier_refuses_a_bad_frequency(change):
    with pytest.raises(InvalidInput) as caught:
        fourier(0, **change)
    assert caught.value.name == "fundamental"


@pytest.mark.parametrize("harmonics", [0, -1])
def test_fourier_refuses_no_harmonic(harmonics):
    with pytest.raises(InvalidInput) as caught:
        fourier(0, h=harmonics)
    assert caught.value.name == "harmonics"


def multisine(seed, *, channels=3, low=0.1, high=1.0, tones=6, amplitude=0.8):
    return Multisine(channels, low, high, tones, amplitude, np.random.default_rng(seed))


@FEW
@given(seeds, st.integers(1, 12), st.floats(1e-3, 1e3), st.floats(0, 1e4))
def test_multisine_is_bounded(seed, tones, amplitude, t):
    signal = multisine(seed, tones=tones, amplitude=amplitude)(t)
    assert signal.shape == (3,) and (np.abs(signal) <= amplitude).all()


@FEW
@given(seeds, st.floats(0.05, 0.5), st.floats(1.1, 20))
def test_a_single_tone_lies_within_the_band(seed, low, ratio):
    """s̈ = −ω² s, so ω² shows in three samples."""
    signal, h = multisine(seed, low=low, high=low * ratio, tones=1), 1e-2
    t = np.linspace(0, 30, 50)
    s = np.array([[signal(x - h), signal(x), signal(x + h)] for x in t])
    middle = s[:, 1]
    cosine = np.sum((s[:, 0] + s[:, 2]) * middle, 0) / np.sum(2 * middle**2, 0)
    f = np.arccos(np.clip(cosine, -1, 1)) / (2 * np.pi * h)
    assert (f >= low * (1 - 1e-6)).all() and (f <= low * ratio * (1 + 1e-6)).all()


def test_multisine_power_does_not_depend_on_the_number_of_tones():
    t = np.linspace(0, 400, 8000)
    for tones in (1, 4, 16):
        power = np.mean([multisine(5, tones=tones)(x) ** 2 for x in t])
        assert 0.65 < power / (0.8**2 / 2) < 1.05  # many tones are clipped: 0.74 for a Gaussian


@pytest.mark.parametrize(
    "low,high",
    [(0.0, 1.0), (-1.0, 1.0), (np.nan, 1.0), (0.1, 0.1), (0.1, 0.05), (0.1, np.nan), (0.1, np.inf)],
)
def test_multisine_refuses_an_empty_band(low, high):
    with pytest.raises(InvalidInput) as caught:
        multisine(0, low=low, high=high)
    assert caught.value.name == "band"


@pytest.mark.parametrize("change", [{"tones": 0}, {"tones": -3}])
def test_multisine_refuses_no_tone(change):
    with pytest.raises(InvalidInput) as caught:
        multisine(0, **change)
    assert caught.value.name == "tones"


@pytest.mark.parametrize("amplitude", [np.nan, np.inf, -0.5])
def test_multisine_refuses_a_bad_amplitude(amplitude):
    with pytest.raises(InvalidInput) as caught:
        multisine(0, amplitude=amplitude)
    assert caught.value.name == "amplitude"


@pytest.mark.parametrize("make", [lambda s: fourier(s)(1.3)[0], lambda s: multisine(s)(1.3)])
def test_a_signal_is_determined_by_its_seed(make):
    assert (make(3) == make(3)).all()
    assert (make(3) != make(4)).any()
