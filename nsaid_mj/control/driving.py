"""Cars drive about a test ground, their speed and steering always on the move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InvalidInput
from ..excitation import Multisine
from ..parameters import Array
from ..system import SecondOrderSystem
from ..systems.ground import GroundVehicle
from .driver import Driver, DriverConfig

_BANDWIDTH = 3.0  # of the speed loop [rad/s]
_SLOWEST = 0.45  # of cruising speed: below 0.4 the slip angles of the model lose their meaning


@dataclass(frozen=True)
class Driving(DriverConfig):
    """A multisine speed and a multisine lateral acceleration; the car turns back at the edge.

    Attributes:
        speed: cruising speed [m/s].
        variation: of the speed about it, as a share, in (0, 0.55].
        grip: bound of the lateral acceleration asked of the steering [m/s²].
        low: lowest frequency of steering [Hz].
        high: highest frequency of steering [Hz].
        slow: how many times slower the speed varies than the steering.
        tones: number of sines in each.
        ground: radius of the test ground [m].
    """

    speed: float = 6.0
    variation: float = 0.5
    grip: float = 4.0
    low: float = 0.1
    high: float = 1.0
    slow: float = 5.0
    tones: int = 8
    ground: float = 60.0

    def __post_init__(self) -> None:
        for name, remedy in (
            ("speed", "6 m/s suits an F1TENTH."), ("grip", "4 m/s² will do."),
            ("slow", "5 will do."), ("ground", "60 m suits an F1TENTH."),
        ):  # fmt: skip
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"excitation.{name}", "a number > 0", value, remedy)
        if not 0 < self.variation <= 1 - _SLOWEST:
            raise InvalidInput("excitation.variation", f"a share in (0, {1 - _SLOWEST:g}]",
                               self.variation, "0.5 is from half to half as much again.")  # fmt: skip

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the system is no ground vehicle.
        """
        if not isinstance(system, GroundVehicle):
            raise InvalidInput("excitation", "a ground vehicle to drive", type(system).__name__,
                               "Use MultisineCommand.")  # fmt: skip
        return _Driver(self, system, prior, rng)


class _Driver(Driver):
    """Feedforward under the prior and proportional feedback; near the edge, towards the middle."""

    def __init__(
        self, config: Driving, system: GroundVehicle, prior: Array, rng: np.random.Generator
    ):
        self._config, self._system = config, system
        tones, ratio = config.tones, config.slow
        self._bend = Multisine(1, config.low, config.high, tones, 1.0, rng)
        self._pace = Multisine(
            1, config.low / ratio, config.high / ratio, tones, config.variation, rng
        )
        self._prior = {
            name: float(prior[system.space.index(name)]) for name in ("m", "k_d", "k_v", "c_0", "c_D")
        }

    def start(self) -> tuple[Array, Array]:
        return np.zeros(3), np.array([self._speed(0.0), 0.0, 0.0])

    def command(self, t: float, q: Array, v: Array) -> Array:
        return np.array([self._drive(t, v[0]), self._steer(t, q, v[0])])

    def _speed(self, t: float) -> float:
        return self._config.speed * (1 + float(self._pace(t)[0]))

    def _drive(self, t: float, speed: float) -> float:
        """The drive that the prior thinks will close the gap to the wanted speed."""
        p = self._prior
        force = p["m"] * _BANDWIDTH * (self._speed(t) - speed)
        force += p["c_0"] + p["c_D"] * abs(speed) * speed
        return float(np.clip(force / (p["k_d"] - p["k_v"] * speed), -1, 1))

    def _steer(self, t: float, q: Array, speed: float) -> float:
        """The steering angle whose curve, without slip, has the wanted lateral acceleration."""
        config, limit = self._config, self._system.steering
        wanted = float(self._bend(t)[0])
        outside = float(np.clip(2 * np.hypot(q[0], q[1]) / config.ground - 1, 0, 1))
        if outside > 0:
            bearing = np.arctan2(-q[1], -q[0]) - q[2]
            wanted += 2 * outside * np.sin(bearing) if np.cos(bearing) > 0 else 2 * outside
        curvature = config.grip * np.clip(wanted, -1, 1) / max(speed, 0.1) ** 2
        return float(np.clip(np.arctan(self._system.wheelbase * curvature), -limit, limit))
