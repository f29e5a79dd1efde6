"""Levels of sensor noise, as part of a scenario."""

import numpy as np

from ....base import Config, NonNegative, config
from ....core import Array, SensorLevels


@config
class SensorNoise(Config):
    """Noise levels of a position encoder and of a velocity sensor.

    MuJoCo's own `noise` attribute is not used: MuJoCo adds no noise.

    Attributes:
        position: standard deviation of the position [rad or m].
        velocity: standard deviation of the velocity [rad/s or m/s].
        encoder_step: resolution of the encoder [rad or m]; 0 for no quantisation.
    """

    _path = "noise"

    position: NonNegative = 1e-4
    velocity: NonNegative = 5e-3
    encoder_step: NonNegative = 0.0

    @property
    def levels(self) -> SensorLevels:
        """Standard deviations, with the encoder's quantisation counted as encoder_step/√12."""
        return SensorLevels(
            float(np.hypot(self.position, self.encoder_step / 12**0.5)), self.velocity
        )

    def corrupt(
        self, position: Array, velocity: Array, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Measurements of a true position and velocity, both of any shape."""
        position = position + self.position * rng.standard_normal(position.shape)
        if self.encoder_step:
            position = self.encoder_step * np.round(position / self.encoder_step)
        return position, velocity + self.velocity * rng.standard_normal(velocity.shape)
