"""Quadrotors fly epicycles by geometric control based on the prior; the flight is in `flight`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from ...base import Positive, config
from ...core import Array
from .driver import Driver, DriverConfig

if TYPE_CHECKING:
    from ...core import SecondOrderSystem


@config
class QuadrotorFlight(DriverConfig):
    """Position and heading follow smooth paths; dither is added to every rotor's speed.

    The horizontal path is an epicycle, flown at varying speed while climbing and descending. Body
    drag is identified from its growth with speed, the drag of each body axis from the heading's
    rotation relative to the path, and the rotors' torques from the yaw response to dither in roll
    and pitch.

    Attributes:
        radius: radius of the larger circle [m].
        speed: largest horizontal speed; the smallest is a third of it [m/s].
        climb: largest vertical speed [m/s].
        yaw_rate: largest yaw rate [rad/s].
        tilt: largest commanded tilt [rad].
        bandwidth: bandwidth of the position loop [Hz].
        attitude_bandwidth: bandwidth of the attitude loop [Hz].
        dither: bound on each rotor's dither, relative to its speed.
        low: lowest frequency of the dither [Hz].
        high: highest frequency of the dither [Hz].
    """

    radius: Positive = 6.0
    speed: Positive = 8.0
    climb: Positive = 5.0
    yaw_rate: Positive = 5.0
    tilt: Annotated[float, Field(strict=True, gt=0, lt=1.4)] = 0.95
    bandwidth: Positive = 0.3
    attitude_bandwidth: Positive = 2.0
    dither: Annotated[float, Field(strict=True, gt=0, lt=1)] = 0.5
    low: Positive = 3.0
    high: Positive = 9.0

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver; raises `InvalidInput` unless the system is a quadrotor."""
        from ...core import SingleBody
        from .flight import Flight

        wanted = ("body", "rotor thrust gain", "rotor torque gain")
        quadrotor = SingleBody.of(system, wanted, "a quadrotor to fly")
        return Flight(self, quadrotor, prior, rng)
