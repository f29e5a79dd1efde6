"""What stands between the plant and a measurement: seeded noise and quantisation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...bounds import Config, NonNegative, config
from ...log import SensorLevels
from ...parameters import Array


@config
class SensorNoise(Config):
    """Levels of a joint encoder and of a velocity signal. MuJoCo's own `noise` adds nothing.

    Attributes:
        position: standard deviation of the position [rad or m].
        velocity: standard deviation of the velocity [rad/s or m/s].
        encoder_step: the encoder's resolution [rad or m]; 0 is none.
    """

    _path = "noise"

    position: NonNegative = 1e-4
    velocity: NonNegative = 5e-3
    encoder_step: NonNegative = 0.0

    @property
    def levels(self) -> SensorLevels:
        """What a data sheet would say: quantisation adds its step/√12 to the position's level."""
        return SensorLevels(
            float(np.hypot(self.position, self.encoder_step / 12**0.5)), self.velocity
        )

    def corrupt(
        self, position: Array, velocity: Array, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """What the sensors say of a true position and velocity."""
        position = position + self.position * rng.standard_normal(position.shape)
        if self.encoder_step:
            position = self.encoder_step * np.round(position / self.encoder_step)
        return position, velocity + self.velocity * rng.standard_normal(velocity.shape)


class Errors(NamedTuple):
    """What sensors will add to a stretch of measurements, for compiled code.

    Attributes:
        position: standard deviation of the position [rad or m].
        velocity: standard deviation of the velocity [rad/s or m/s].
        encoder_step: the encoder's resolution [rad or m]; 0 is none.
        normal: (k, 2, n) drawn for position and velocity; (0, 2, n) where sensors are exact.
    """

    position: float
    velocity: float
    encoder_step: float
    normal: Array


@njit(cache=True)
def add_errors(errors, k, position, velocity):
    """Adds the k-th errors to a true position (n,) and velocity (n,), as `SensorNoise` does."""
    if not errors.normal.shape[0]:
        return
    step = errors.encoder_step
    for i in range(position.shape[0]):
        position[i] += errors.position * errors.normal[k, 0, i]
        if step:
            position[i] = step * np.rint(position[i] / step)
        velocity[i] += errors.velocity * errors.normal[k, 1, i]


class Sensors:
    """What measures a run: the noise's levels, and its stream of errors.

    Args:
        noise: the levels; None is exact.
        rng: source of the errors.
    """

    def __init__(self, noise: SensorNoise | None, rng: np.random.Generator):
        self.noise, self.rng = noise, rng

    def __call__(self, position: Array, velocity: Array) -> tuple[Array, Array]:
        """What they say of a true position and velocity."""
        if self.noise is None:
            return position, velocity
        return self.noise.corrupt(position, velocity, self.rng)

    def errors(self, k: int, n: int) -> Errors:
        """What they would add to the next k measurements of n position numbers each."""
        if self.noise is None:
            return Errors(0.0, 0.0, 0.0, np.empty((0, 2, n)))
        noise, normal = self.noise, self.rng.standard_normal((k, 2, n))
        return Errors(
            float(noise.position), float(noise.velocity), float(noise.encoder_step), normal
        )


EXACT_SENSORS = Sensors(None, np.random.default_rng(0))
