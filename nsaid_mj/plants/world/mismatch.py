"""What a real plant does and the identifier's structure does not know, by switches."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import mujoco
from pydantic import Field

from ...bounds import Config, NonNegative, Number, config
from ...errors import InvalidInput

Fluid = Literal["exact", "ellipsoid"]
LONGEST_DELAY = 60.0
"""Of a command [s]: what is under way is kept."""


@config
class Mismatch(Config):
    """Deviations of a plant from what its structure can represent; all are off by default.

    Attributes:
        lag: time constant of every actuator's first-order lag [s].
        delay: from a command to the actuator [s], rounded to steps.
        flow: velocity of the water or the air in the world's axes, z up [m/s].
        fluid: `exact` is what the structure says; `ellipsoid` MuJoCo's own fluid forces on
            ellipsoids instead of the vehicle's drag, lift and added mass.
    """

    _path = "plant.mismatch"

    lag: NonNegative = 0.0
    delay: Annotated[float, Field(strict=True, ge=0, le=LONGEST_DELAY)] = 0.0
    flow: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    fluid: Fluid = "exact"

    def steps(self, dt: float) -> int:
        """The delay in steps of dt [s]."""
        return round(self.delay / dt)

    def in_words(self, dt: float) -> list[str]:
        """What is on at steps of dt [s], in words; empty where the structure fits."""
        words = []
        if self.lag:
            words.append(f"actuators lag by {self.lag:g} s")
        if self.steps(dt):
            words.append(f"commands arrive {self.steps(dt) * dt:g} s late")
        if any(self.flow):
            words.append("flow of {:g}, {:g}, {:g} m/s".format(*self.flow))
        if self.fluid != "exact":
            words.append("MuJoCo's ellipsoid fluid instead of the structure's")
        return words

    def refuse(self, plant: str, *fields: str) -> None:
        """Refuses the switches that a kind of plant does not have.

        Raises:
            InvalidInput: one of `fields` is on.
        """
        for name in fields:
            if getattr(self, name) != getattr(Mismatch(), name):
                raise InvalidInput(
                    f"mismatch.{name}",
                    f"the default, for {plant}",
                    getattr(self, name),
                    "Leave it out: this plant has nothing it could act on.",
                )

    def apply(self, spec: Any) -> None:
        """Gives every actuator of a MuJoCo specification the lag, as a state that RK4 integrates.

        MuJoCo's `filterexact` is exact under Euler only: it integrates RK4's mean rate once more.

        Raises:
            InvalidInput: the lag is too short for RK4 at the specification's step.
        """
        dt = spec.option.timestep
        if self.lag and dt > 2.5 * self.lag:  # RK4 is unstable beyond 2.785
            raise InvalidInput(
                "mismatch.lag",
                f"0, or at least {dt / 2.5:g} s at steps of {dt:g} s",
                self.lag,
                "Leave it out, or take a smaller dt.",
            )
        if self.lag:
            for actuator in spec.actuators:
                actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTER
                actuator.dynprm[0] = self.lag
