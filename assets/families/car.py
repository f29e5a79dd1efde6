"""Cars in the plane: exact linear tyres, drive, rolling resistance and air drag in MuJoCo."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from nsaid_mj.lab.plants.conversion import (
    Array,
    Block,
    Blueprint,
    Positive,
    SheetTable,
    VehicleSheet,
    hidden,
    one,
    operation,
    planar_mass,
    several,
    single_track,
)


class Guess(SheetTable):
    """An engineer's guesses before any measurement."""

    off_centre: Positive = one("distance of the centre of mass from the middle, of the wheelbase")
    top_speed: Positive = one("speed at which the drive force drops to zero > 0 [m/s]")
    speed: Positive = one("a cruising speed > 0 [m/s]")
    grip: Positive = one("a lateral acceleration of operation > 0 [m/s²]")


class CarSheet(VehicleSheet):
    """A car's data sheet; axes x forward, y left, z up."""

    family: ClassVar[str] = "car"

    mass: Positive = one("a number > 0 [kg]")
    inertia: Positive = one("a number > 0, about the vertical through the centre of mass [kg·m²]")
    front: Positive = one("distance from the centre of mass to the front axle > 0 [m]")
    rear: Positive = one("distance from the centre of mass to the rear axle > 0 [m]")
    friction: Positive = one("a coefficient > 0 of tyre on ground")
    stiffness: list[Positive] = several(2, "two numbers > 0, front and rear [1/rad]")
    gravity: Positive = one("a number > 0 [m/s²]")
    steering: Positive = one("a largest steering angle > 0 [rad]")
    drive: Positive = one("a force > 0 at full command and standstill [N]")
    loss: Positive = one("a number > 0 [N·s/m]")
    rolling: Positive = one("a force > 0 [N]")
    drag: Positive = one("a number > 0 [N·s²/m²]")
    guess: Guess

    def blueprint(self) -> Blueprint:
        """The car by the single-track model; the axle loads follow from the lever rule."""
        wheelbase, guess = self.front + self.rear, self.guess
        grip = self.friction * self.mass * self.gravity / wheelbase
        stiffness = grip * np.array(self.stiffness) * [self.rear, self.front]
        forces = np.array([*stiffness, self.drive, self.loss, self.rolling, self.drag])
        scale = Block.guessed(np.array([self.mass, 1.0, self.inertia, *forces]))
        scale[1] = guess.off_centre * self.mass * wheelbase
        scale[6] = scale[5] / guess.top_speed
        car = single_track(
            planar_mass(self.mass, wheelbase / 2 - self.front, self.inertia),
            forces,
            scale,
            wheelbase,
            operation(guess.speed, guess.grip, self.steering, wheelbase),
        )
        return replace(car, size=self.size, hidden_body=self._hidden_body)

    def _hidden_body(self, spread: float, rng: np.random.Generator) -> Array:
        centre = (self.rear - self.front) / 2
        return planar_mass(*hidden(np.array([self.mass, centre, self.inertia]), spread, rng))
