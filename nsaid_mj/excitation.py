"""Seeded signals that keep a system moving in all its directions."""

from __future__ import annotations

import numpy as np

from .errors import InvalidInput
from .parameters import Array


class FourierTrajectory:
    """A random finite Fourier series for every joint, within position and speed limits.

    Each joint follows centre + Σ_k (a_k sin(k ω t) + b_k cos(k ω t)), periodic with 1/fundamental.

    Args:
        low: (n,) lower end of the range [rad or m].
        high: (n,) upper end of the range.
        speed: (n,) largest speed [rad/s or m/s].
        fundamental: frequency of the first harmonic [Hz].
        harmonics: number of harmonics.
        rng: source of the coefficients.

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
        self._omega = 2 * np.pi * fundamental * np.arange(1, harmonics + 1)
        self._rates = np.concatenate([self._omega, -self._omega])  # of sines, of cosines
        self._coefficients = rng.standard_normal((len(low), 2 * harmonics)) / np.tile(
            np.arange(1, harmonics + 1), 2
        )
        self._centre = 0.5 * (low + high)
        period = np.linspace(0, 1 / fundamental, 40 * harmonics, endpoint=False)
        position, velocity, _ = np.array([self._series(t) for t in period]).transpose(2, 1, 0)
        reach = np.maximum(
            np.abs(position).max(axis=1) / (0.5 * (high - low)),
            np.abs(velocity).max(axis=1) / speed,
        )
        reach /= np.cos(np.pi / 40)  # a peak between samples is higher by at most this
        self._coefficients /= reach[:, None]

    def _series(self, t: float) -> Array:
        """(n, 3) position, velocity and acceleration about the centre."""
        phase = self._omega * t
        s, c = np.sin(phase), np.cos(phase)
        basis = np.empty((len(self._rates), 3))
        basis[:, 0] = np.concatenate([s, c])
        basis[:, 1] = self._rates * np.concatenate([c, s])
        basis[:, 2] = -(self._rates**2) * basis[:, 0]
        return self._coefficients @ basis

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """(n,) position, velocity and acceleration at time t [s]."""
        position, velocity, acceleration = self._series(t).T
        return self._centre + position, velocity, acceleration


class Multisine:
    """Random-phase sines of equal amplitude, one set for each channel, within ±amplitude.

    Args:
        channels: number of signals.
        low: lowest frequency [Hz].
        high: highest frequency [Hz].
        tones: number of sines in a channel.
        amplitude: bound of every signal.
        rng: source of frequencies and phases.

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
            raise InvalidInput("band", "0 < low < high [Hz]", f"{low} … {high}", "0.05 … 0.5 Hz?")
        if not (np.isfinite(amplitude) and amplitude > 0):
            raise InvalidInput("amplitude", "a finite number > 0", amplitude, "0.4 will do.")
        if tones < 1:
            raise InvalidInput("tones", "a whole number ≥ 1", tones, "Two for each parameter.")
        steps = (np.arange(tones) + rng.uniform(0, 1, (channels, tones))) / tones
        self._omega = 2 * np.pi * low * (high / low) ** steps
        self._phase = rng.uniform(0, 2 * np.pi, (channels, tones))
        self._amplitude = amplitude / tones**0.5
        self._bound = amplitude

    def __call__(self, t: float) -> Array:
        """(channels,) the signals at time t [s], clipped to ±amplitude."""
        signal = self._amplitude * np.sin(self._omega * t + self._phase).sum(axis=1)
        return np.clip(signal, -self._bound, self._bound)
