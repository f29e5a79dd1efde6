"""Squats, a trot, and waving one leg after another, in open loop under PD control of the joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...base import NonNegative, Number, Positive, config
from ..fields import Share
from .driver import Driver, DriverConfig

if TYPE_CHECKING:
    from ...core import Array, SecondOrderSystem


@config
class Walk(DriverConfig):
    """Squats, an open-loop trot and waving of one leg, over and over, under PD control.

    Torques are stiffness · (target − q) − damping · q̇, divided by the prior's gain of each motor.
    Lengths and speeds are shares of the standing height h, and of h per second.

    Attributes:
        stance: joint positions of standing [rad], of all joints, or of one leg for all legs.
        squat: duration of the squats [s]; the base also sways and tilts.
        trot: duration of the trot [s].
        wave: duration of the waving of one leg, another one in each round [s].
        ramp: time in which each of these movements grows to its size, and fades [s].
        period: time of a step of the trot and of the next one [s].
        clearance: height to which feet are lifted [h].
        speed: largest speed of the trot [h/s].
        depth: largest vertical displacement of the base in squats [h].
        sway: largest horizontal one [h].
        tilt: largest angle of the base in squats [rad].
        reach: largest displacement of a foot that waves [h].
        lean: displacement of the base away from a foot that waves [distance to that foot].
        stiffness: of the joints, over weight · h [1/rad].
        damping: of the joints, over stiffness [s].
    """

    stance: tuple[Number, ...] = ()
    squat: NonNegative = 3.5
    trot: NonNegative = 5.5
    wave: Positive = 6.0
    ramp: Positive = 0.8
    period: Positive = 0.5
    clearance: Share = 0.18
    speed: Positive = 0.5
    depth: Share = 0.13
    sway: Share = 0.1
    tilt: Share = 0.15
    reach: Share = 0.2
    lean: NonNegative = 0.3
    stiffness: Positive = 3.0
    damping: Positive = 0.03

    @property
    def cycle(self) -> float:
        """Duration of a round [s]."""
        return self.squat + self.trot + self.wave

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the system is no floating tree of joints with feet, or the stance does not
                suit its joints.
        """
        from .gait import WalkingDriver, on_feet

        return WalkingDriver(self, on_feet(system), prior, int(rng.integers(2**62)))
