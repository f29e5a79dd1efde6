"""Unmodelled effects of a real plant, each with a switch."""

from typing import Annotated, Any, Literal

from pydantic import Field

from ....base import Config, InvalidInput, NonNegative, Number, config

Fluid = Literal["exact", "ellipsoid"]
LONGEST_DELAY = 60.0
"""Bound on the delay of commands [s]: commands in transit are held in a queue."""


@config
class Mismatch(Config):
    """Deviations of a plant from its structure; all are off by default.

    Attributes:
        lag: time constant of every actuator's first-order lag [s].
        delay: from a command to the actuator [s], rounded to time steps.
        flow: velocity of the water or the air in world axes, z up [m/s].
        fluid: `exact` for the forces of the structure; `ellipsoid` for MuJoCo's own fluid forces
            on ellipsoids in place of the vehicle's drag, lift and added mass.
    """

    _path = "plant.mismatch"

    lag: NonNegative = 0.0
    delay: Annotated[float, Field(strict=True, ge=0, le=LONGEST_DELAY)] = 0.0
    flow: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    fluid: Fluid = "exact"

    def steps(self, dt: float) -> int:
        """The delay as a number of time steps dt [s]."""
        return round(self.delay / dt)

    def in_words(self, dt: float) -> list[str]:
        """The active effects in words, at time steps dt [s]; empty if the structure holds."""
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
        """Raises `InvalidInput` if one of `fields` is on; `level`: if a flow is not level."""
        for name in fields:
            if name == "level" and self.flow[2]:
                expected = f"a level wind, for {plant}"
                raise InvalidInput("mismatch.flow", expected, self.flow, "Make the third one 0.")
            if name != "level" and getattr(self, name) != getattr(Mismatch(), name):
                raise InvalidInput(
                    f"mismatch.{name}",
                    f"the default, for {plant}",
                    getattr(self, name),
                    "Leave it out: it has no effect on this plant.",
                )

    def apply(self, spec: Any) -> None:
        """Adds the lag to every actuator of a MuJoCo specification, as a state that RK4 integrates.

        MuJoCo's `filterexact` is exact only with Euler's method; RK4 would integrate its mean rate
        a second time.

        Raises:
            InvalidInput: the lag is too short for RK4 at the specification's time step.
        """
        dt = spec.option.timestep
        if self.lag and dt > 2.5 * self.lag:  # RK4 is unstable beyond 2.785
            raise InvalidInput(
                "mismatch.lag",
                f"0, or at least {dt / 2.5:g} s at steps of {dt:g} s",
                self.lag,
                "Leave it out, or use a smaller dt.",
            )
        if self.lag:
            import mujoco

            for actuator in spec.actuators:
                actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTER
                actuator.dynprm[0] = self.lag
