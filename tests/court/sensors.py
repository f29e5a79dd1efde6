"""Sensors that the package's own cannot be: jitter, zero errors, gear ratios, wrong noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from nsaid_mj.core.log import Log
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.plants.world.noise import SensorNoise
from nsaid_mj.lab.plants.world.sensors import Sensors


@dataclass
class Errors:
    """Errors of the sensors that the identifier is not told of.

    Attributes:
        jitter: positions are sampled up to so much before or after their time [time steps].
        zero: (n,) constant error of the positions [rad or m].
        ratio: (n,) measured over true motion.
        noise: true over stated standard deviations.
        held: a logged command is renewed every so many samples only.
        deflection: (n,) of the transmission, position and velocity, which the stepper writes.
    """

    jitter: float = 0.0
    zero: Array | float = 0.0
    ratio: Array | float = 1.0
    noise: float = 1.0
    held: int = 1
    deflection: list[Array | float] = field(default_factory=lambda: [0.0, 0.0])


class WrongSensors(Sensors):
    """Sensors with the stated noise and further errors.

    Args:
        noise: the stated levels.
        rng: source of the errors.
        errors: further errors.
    """

    def __init__(self, noise: SensorNoise, rng: np.random.Generator, errors: Errors):
        factor = errors.noise
        acting = SensorNoise(
            position=factor * noise.position,
            velocity=factor * noise.velocity,
            encoder_step=noise.encoder_step,
        )
        super().__init__(acting, rng)
        self._errors = errors
        self._last: Array | None = None

    def __call__(self, position: Array, velocity: Array) -> tuple[Array, Array]:
        """Measurements of a true position (n,) and velocity (n,)."""
        e, last = self._errors, self._last
        self._last = position.copy()
        if e.jitter and last is not None:  # velocities may be in other axes than positions
            position = position + (position - last) * self.rng.uniform(-e.jitter, e.jitter)
        position = e.ratio * (position + e.deflection[0]) + e.zero
        return super().__call__(position, e.ratio * (velocity + e.deflection[1]))


def stale(log: Log, every: int) -> Log:
    """The log with commands that are renewed every so many samples only."""
    if every <= 1:
        return log
    rows = np.arange(len(log.t)) // every * every
    return Log.unchecked(log.t, log.q, log.v, log.u[rows])


def stated_noise(kind: str, rng: np.random.Generator, length: float, speed: float) -> SensorNoise:
    """The stated levels of the sensors.

    Args:
        kind: `encoder`, of 14 to 19 bit; `noise`; or `stock`, the package's own levels.
        rng: source of the levels.
        length: of a full turn, or of the stroke, in the position's unit.
        speed: typical velocity, for its noise.
    """
    if kind == "stock":
        return SensorNoise()
    velocity = speed * 10.0 ** rng.uniform(-4.0, -2.0)
    if kind == "encoder":
        step = length / 2 ** int(rng.integers(14, 20))
        return SensorNoise(position=0.3 * step, velocity=velocity, encoder_step=step)
    return SensorNoise(position=length * 10.0 ** rng.uniform(-6.0, -4.0), velocity=velocity)
