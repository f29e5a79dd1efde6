"""What stands between the plant and a measurement: seeded noise and quantisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InvalidInput
from ..parameters import Array
from ..system import SensorLevels


@dataclass(frozen=True)
class SensorNoise:
    """Levels of a joint encoder and of a velocity signal. MuJoCo's own `noise` adds nothing.

    Attributes:
        position: standard deviation of the position [rad or m].
        velocity: standard deviation of the velocity [rad/s or m/s].
        encoder_step: the encoder's resolution [rad or m]; 0 is none.
    """

    position: float = 1e-4
    velocity: float = 5e-3
    encoder_step: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "encoder_step"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InvalidInput(f"noise.{name}", "a finite number ≥ 0", value, "0 means none.")

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
