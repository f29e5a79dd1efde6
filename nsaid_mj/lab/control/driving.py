"""Cars drive around a test ground with continuously varying speed and steering."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from ...base import Positive, config
from ...core import Array
from ..fields import Tones
from .driver import Driver, DriverConfig, Feedback

if TYPE_CHECKING:
    from ...core import SecondOrderSystem

_LOOP = 3.0  # bandwidth of the speed loop [rad/s]
_WIDEST = 0.55  # of the cruising speed: even with the loop's tracking error, the speed stays above
# 0.4 of it, so that slip angles are well defined


@config
class Driving(DriverConfig):
    """Multisines of speed and lateral acceleration; at the edge of the ground, the car turns back.

    Drive loss, rolling resistance and air drag differ only in how they depend on speed, so the
    speed must vary widely. Only fast steering separates the centre of mass from the tyres.

    Attributes:
        speed: cruising speed [m/s].
        variation: largest deviation of the desired speed, as a share of the cruising speed.
        pace_low: lowest frequency of the desired speed [Hz].
        pace_high: highest frequency of the desired speed [Hz].
        grip: bound on the commanded lateral acceleration [m/s²].
        steer_low: lowest frequency of the steering [Hz].
        steer_high: highest frequency of the steering [Hz].
        tones: number of sines in each multisine.
        ground: radius of the test ground [m].
    """

    speed: Positive = 8.0
    variation: Annotated[float, Field(strict=True, gt=0, le=_WIDEST)] = 0.5
    pace_low: Positive = 0.2
    pace_high: Positive = 0.8
    grip: Positive = 4.0
    steer_low: Positive = 0.5
    steer_high: Positive = 5.0
    tones: Tones = 8
    ground: Positive = 100.0

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the system is not a ground vehicle, or a frequency band is empty.
        """
        from ...core import SingleBody
        from .signals import Multisine

        wanted = ("cornering stiffness", "drive gain", "drive loss", "rolling resistance")
        car = SingleBody.of(system, wanted, "a ground vehicle to drive")
        front, rear = car.constants("tyre", "arm").tolist()
        wheelbase = front - rear
        steering = car.operation.command[1][1]
        m, k_d, k_v, c_0, c_D = (
            float(prior[car.space.index(name)]) for name in ("m", "k_d", "k_v", "c_0", "c_D")
        )
        bend = Multisine(1, self.steer_low, self.steer_high, self.tones, 1.0, rng)
        pace = Multisine(1, self.pace_low, self.pace_high, self.tones, self.variation, rng)

        def desired(t: float) -> float:
            """Desired speed at time t [m/s]."""
            return self.speed * (1 + float(pace(t)[0]))

        def drive(t: float, speed: float) -> float:
            """Drive command in [−1, 1] that, under the prior, closes the speed error."""
            force = m * _LOOP * (desired(t) - speed)
            force += c_0 + c_D * abs(speed) * speed
            share = force / max(k_d - k_v * speed, 0.1 * k_d)
            return min(max(share, -1.0), 1.0)  # np.clip of one number takes 10 times as long

        def command(t: float, q: Array, v: Array) -> Array:
            curvature = self._curvature(float(bend(t)[0]), q, v)
            speed = max(float(v[0]), 0.1)
            angle = float(np.arctan(wheelbase * (2 * curvature - v[2] / speed)))
            return np.array([drive(t, float(v[0])), min(max(angle, -steering), steering)])

        return Feedback(lambda: (np.zeros(3), np.array([desired(0.0), 0.0, 0.0])), command)

    def _curvature(self, share: float, q: Array, v: Array) -> float:
        """Desired curvature κ [1/m], for a share in [−1, 1] of the grip.

        Steering is arctan(L (2κ − r/u)): feedforward L κ plus yaw-rate feedback, without which a
        car with softer rear tyres is unstable at high speed.
        """
        away = min(2 * float(np.hypot(q[0], q[1])) / self.ground - 1, 1.0)
        if away > 0:  # more than half-way to the edge: turn back towards the centre, the short way
            bearing = np.arctan2(-q[1], -q[0]) - q[2]
            side = np.sin(bearing)
            share += 4 * away * (side if np.cos(bearing) > 0 else np.sign(side))
        return self.grip * min(max(share, -1.0), 1.0) / max(float(v[0]), 0.1) ** 2
