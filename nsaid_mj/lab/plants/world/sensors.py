"""Sensor models: seeded noise and quantisation."""

from typing import NamedTuple

import numpy as np
from numba import f8, i8, types, void

from ....core import Array, kernel
from .noise import SensorNoise


class Errors(NamedTuple):
    """Sensor errors of k consecutive measurements, for compiled code."""

    position: float  # standard deviation of the position [rad or m]
    velocity: float  # standard deviation of the velocity [rad/s or m/s]
    encoder_step: float  # resolution of the encoder [rad or m]; 0 for no quantisation
    # (k, 2, n) standard normal draws for position and velocity; (0, 2, n) if the sensors are exact
    normal: Array


ERRORS = types.NamedTuple((f8, f8, f8, f8[:, :, ::1]), Errors)


@kernel(void(ERRORS, i8, f8[::1], f8[::1]), inner=True)
def add_errors(errors, k, position, velocity):
    """Adds the k-th errors to a true position (n,) and velocity (n,) in place.

    Equal to `SensorNoise.corrupt` to the bit.
    """
    if not errors.normal.shape[0]:
        return
    step = errors.encoder_step
    for i in range(position.shape[0]):
        position[i] += errors.position * errors.normal[k, 0, i]
        if step:
            position[i] = step * np.rint(position[i] / step)
        velocity[i] += errors.velocity * errors.normal[k, 1, i]


class Sensors:
    """Sensors with their own stream of random errors; without noise they are exact."""

    def __init__(self, noise: SensorNoise | None, rng: np.random.Generator):
        self.noise = noise
        self.rng = rng

    def __call__(self, position: Array, velocity: Array) -> tuple[Array, Array]:
        """Measurements of a true position (n,) and velocity (n,)."""
        if self.noise is None:
            return position, velocity
        return self.noise.corrupt(position, velocity, self.rng)

    def errors(self, k: int, n: int) -> Errors:
        """Draws the errors of the next k measurements of n position numbers each."""
        if self.noise is None:
            return Errors(0.0, 0.0, 0.0, np.empty((0, 2, n)))
        noise = self.noise
        normal = self.rng.standard_normal((k, 2, n))
        return Errors(
            float(noise.position), float(noise.velocity), float(noise.encoder_step), normal
        )


EXACT_SENSORS = Sensors(None, np.random.default_rng(0))
