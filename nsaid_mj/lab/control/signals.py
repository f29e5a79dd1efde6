"""Seeded excitation signals: random Fourier series and multisines."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import f8, types, void
from numpy.typing import ArrayLike

from ...base import InvalidInput
from ...core import Array, JointTree, SecondOrderSystem, kernel


class Series(NamedTuple):
    """A finite Fourier series for every joint."""

    omega: Array  # (h,) angular frequencies of the harmonics [rad/s]
    coefficients: Array  # (n, 2 h) coefficients of the sines, then of the cosines [rad or m]
    centre: Array  # (n,) centre of the motion [rad or m]


SERIES = types.NamedTuple((f8[::1], f8[:, ::1], f8[::1]), Series)


@kernel(void(SERIES, f8, f8[:, ::1]))
def fourier(series, t, motion):
    """Writes position, velocity and acceleration at time t [s] into motion (n, 3)."""
    omega, coefficients, centre = series
    count = omega.shape[0]
    for i in range(motion.shape[0]):
        motion[i, 0] = motion[i, 1] = motion[i, 2] = 0.0
    for k in range(count):
        rate = omega[k]
        s = np.sin(rate * t)
        c = np.cos(rate * t)
        for i in range(motion.shape[0]):
            a = coefficients[i, k]
            b = coefficients[i, count + k]
            swing = a * s + b * c
            motion[i, 0] += swing
            motion[i, 1] += rate * (a * c - b * s)
            motion[i, 2] -= rate * rate * swing
    for i in range(motion.shape[0]):
        motion[i, 0] += centre[i]


class FourierTrajectory:
    """A random finite Fourier series for every joint, within position and speed limits.

    Each joint follows centre + Σ_k (a_k sin(k ω t) + b_k cos(k ω t)), with period 1/fundamental
    [s], between low and high (n,) [rad or m], and no faster than speed (n,) [rad/s or m/s].

    Raises:
        InvalidInput: a frequency or count is not positive.
    """

    def __init__(
        self,
        low: Array,
        high: Array,
        speed: Array,
        fundamental: float,
        harmonics: int,
        rng: np.random.Generator,
    ):
        if not (np.isfinite(fundamental) and fundamental > 0):
            raise InvalidInput("fundamental", "a frequency > 0 Hz", fundamental, "0.1 suits arms.")
        if harmonics < 1:
            raise InvalidInput("harmonics", "a whole number ≥ 1", harmonics, "5 suits arms.")
        omega = 2 * np.pi * fundamental * np.arange(1, harmonics + 1, dtype=np.float64)
        coefficients = rng.standard_normal((len(low), 2 * harmonics)) / np.tile(
            np.arange(1, harmonics + 1), 2
        )
        self.series = Series(omega, coefficients, np.zeros(len(low)))
        period = np.linspace(0, 1 / fundamental, 40 * harmonics, endpoint=False)
        position, velocity, _ = np.array([self(t) for t in period]).transpose(1, 2, 0)
        reach = np.maximum(
            np.abs(position).max(axis=1) / (0.5 * (high - low)),
            np.abs(velocity).max(axis=1) / speed,
        )
        reach /= np.cos(np.pi / 40)  # a peak between samples is higher by at most this factor
        self.series = Series(omega, coefficients / reach[:, None], 0.5 * (low + high))

    @staticmethod
    def within(
        config: Any, system: SecondOrderSystem, rng: np.random.Generator, base: ArrayLike = ()
    ) -> FourierTrajectory:
        """A trajectory about the middle of a tree's joint ranges, after a base's about 0.

        It has the fields of `config`: `reach`, a share of the joints' ranges, up to the largest
        `speed` [rad/s or m/s], None for that share of the nominal ones; `fundamental` [Hz] and the
        number of `harmonics`. `base` (b,) are the base's largest displacements [m or rad].
        """
        bounds = system.limits if isinstance(system, JointTree) else np.zeros((2, system.group))
        low, high = (bound[system.group :] for bound in bounds)
        centre = 0.5 * (low + high)
        half = 0.5 * config.reach * (high - low)
        speed = np.full(len(low), config.speed)
        if config.speed is None and isinstance(system, JointTree):
            speed = config.reach * system.scales.speed
        fastest = 2 * np.pi * config.fundamental * config.harmonics * np.maximum(base, 1e-9)
        ends = np.r_[np.negative(base), centre - half], np.r_[base, centre + half]
        tones = config.fundamental, config.harmonics
        return FourierTrajectory(*ends, np.r_[fastest, speed], *tones, rng)

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """(n,) position, velocity and acceleration at time t [s]."""
        motion = np.empty((len(self.series.centre), 3))
        fourier(self.series, t, motion)
        position, velocity, acceleration = motion.T
        return position, velocity, acceleration


class Multisine:
    """Random-phase sines of equal amplitude, one set for each channel, within ±amplitude.

    The band is from `low` to `high` [Hz], with so many tones in every channel.

    Raises:
        InvalidInput: the band is empty or there is no tone.
    """

    def __init__(
        self,
        channels: int,
        low: float,
        high: float,
        tones: int,
        amplitude: float,
        rng: np.random.Generator,
    ):
        if not (0 < low < high and np.isfinite(high)):
            raise InvalidInput(
                "band", "0 < low < high [Hz]", f"{low} … {high}", "Try 0.05 … 0.5 Hz."
            )
        if not (np.isfinite(amplitude) and amplitude > 0):
            raise InvalidInput("amplitude", "a finite number > 0", amplitude, "Try 0.4.")
        if tones < 1:
            raise InvalidInput("tones", "a whole number ≥ 1", tones, "Use about two per parameter.")
        steps = (np.arange(tones) + rng.uniform(0, 1, (channels, tones))) / tones
        self._omega = 2 * np.pi * low * (high / low) ** steps
        self._phase = rng.uniform(0, 2 * np.pi, (channels, tones))
        self._amplitude = amplitude / tones**0.5
        self._bound = amplitude

    def __call__(self, t: ArrayLike) -> Array:
        """(..., channels) signals at times t (...) [s], clipped to ±amplitude."""
        times = np.asarray(t, dtype=np.float64)
        signal = np.empty((times.size, len(self._omega)))
        _sines(times.flatten(), self._omega, self._phase, self._amplitude, self._bound, signal)
        return signal.reshape(*times.shape, -1)


@kernel(void(f8[::1], f8[:, ::1], f8[:, ::1], f8, f8, f8[:, ::1]))
def _sines(t, omega, phase, amplitude, bound, signal):
    """Writes sums of sines at times t (k,), clipped, into signal (k, channels)."""
    channels, tones = omega.shape
    for k in range(t.shape[0]):
        for i in range(channels):
            total = 0.0
            for j in range(tones):
                total += np.sin(omega[i, j] * t[k] + phase[i, j])
            signal[k, i] = min(max(amplitude * total, -bound), bound)
