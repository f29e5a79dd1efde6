"""Free-flyers: nozzles of unknown gain turn and push a body in free fall; Astrobee is included."""

from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from nsaid_mj.lab.plants.conversion import (
    NED,
    Block,
    Blueprint,
    BodyInertia,
    Guess,
    Number,
    Operation,
    Place,
    Positive,
    SheetTable,
    Term,
    VehicleSheet,
    check_directions,
    check_inertia,
    one,
    several,
)


class FlyerGuess(Guess):
    """An engineer's guesses before any measurement."""

    mass: Positive = one("a number > 0 [kg]")
    offset: Positive = one("a distance of the centre of mass from the origin > 0 [m]")
    inertia: list[Positive] = several(3, "three numbers > 0 [kg·m²]")


class Nozzles(SheetTable):
    """The nozzles of one propulsion module; the other module has x and y negated."""

    positions: list[Place] = Field(min_length=1, description="three numbers for each [inch]")
    directions: list[Place] = Field(
        min_length=1, description="a unit vector, three numbers, for each jet"
    )
    force: list[Positive] = several(3, "forces of two nozzles along x, y, z > 0 [N]")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        places, jets = np.array(self.positions), np.array(self.directions)
        check_directions("nozzles", "nozzle", places, jets)
        return self


class FreeFlyerSheet(VehicleSheet):
    """A free-flyer's data sheet; axes x forward, y right, z down."""

    family: ClassVar[str] = "free-flyer"

    mass: Positive = one("a number > 0 [kg]")
    centre: list[Number] = several(3, "three numbers [m]")
    inertia: list[Positive] = several(3, "three principal moments > 0 [kg·m²]")
    inch: Positive = one("length of the unit of the nozzles' positions, 0.0254 [m]")
    guess: FlyerGuess
    nozzles: Nozzles

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_inertia(self.inertia)
        return self

    def blueprint(self) -> Blueprint:
        """M ν̇ + C(ν) ν = Σ k_i u_i w_i: mass, centre of mass and inertia, and k nozzles.

        θ = [m, m c (3), inertia (6), thrust (k)], about the body's origin. A nozzle opens with
        u_i ∈ [0, 1], and pushes against its jet.
        """
        one_module, jets = np.array(self.nozzles.positions), np.array(self.nozzles.directions)
        other = np.array([-1.0, -1.0, 1.0])
        positions = NED * self.inch * np.concatenate([one_module, other * one_module])
        directions = -NED * np.concatenate([jets, other * jets])
        thrust = np.abs(directions) @ np.array(self.nozzles.force) / 2
        guess, nozzles = self.guess, {"point": positions, "direction": directions}
        return Blueprint(
            Block.of_body(guess.mass, guess.offset, np.array(guess.inertia)),
            BodyInertia(self.mass, NED * self.centre, np.diag(self.inertia)).matrix(),
            [Term.actuators("nozzle", "nozzle", "thrust of nozzle", thrust, **nozzles)],
            Operation.within(guess.speed, np.ones(len(thrust)), 0.0, reach=1.0),
            size=self.size,
        )
