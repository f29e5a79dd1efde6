"""Free-flyers: nozzles of unknown gain turn and push a body in free fall; Astrobee is included."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from ..bounds import Name, Share, config
from ..errors import InvalidInput
from ..parameters import Array
from ..systems.space import FreeFlyer, FreeFlyerScales
from .world.body import NED, Inertia, Vehicle, guessed, hidden, vehicle_spec
from .world.plant import ParametricPlantConfig, Plant
from .world.sheet import (
    Number,
    Positive,
    Sheet,
    Table,
    check_inertia,
    check_unit_vectors,
    one,
    several,
)

Place = Annotated[list[Number], Field(min_length=3, max_length=3)]


class Guess(Table):
    """What an engineer expects before any measurement."""

    mass: Positive = one("a number > 0 [kg]")
    offset: Positive = one("a distance of the centre of mass from the origin > 0 [m]")
    inertia: list[Positive] = several(3, "three numbers > 0 [kg·m²]")
    speed: list[Positive] = several(6, "six velocities of operation > 0 [m/s, rad/s]")


class Nozzles(Table):
    """The nozzles of one propulsion module; the other module has x and y negated."""

    positions: list[Place] = Field(min_length=1, description="three numbers for each [inch]")
    directions: list[Place] = Field(
        min_length=1, description="a unit vector, three numbers, for each jet"
    )
    force: list[Positive] = several(3, "forces of two nozzles along x, y, z > 0 [N]")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.positions) != len(self.directions):
            raise InvalidInput(
                "nozzles.directions",
                f"one for each of {len(self.positions)} positions",
                len(self.directions),
                "Give every nozzle its position and its direction.",
            )
        check_unit_vectors("nozzles.directions", np.array(self.directions))
        return self


class FreeFlyerSheet(Sheet):
    """A free-flyer's data sheet; axes x forward, y right, z down."""

    family: ClassVar[str] = "free-flyer"

    mass: Positive = one("a number > 0 [kg]")
    centre: list[Number] = several(3, "three numbers [m]")
    inertia: list[Positive] = several(3, "three principal moments > 0 [kg·m²]")
    inch: Positive = one("length of the unit of the nozzles' positions, 0.0254 [m]")
    guess: Guess
    nozzles: Nozzles

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_inertia(self.inertia)
        return self


@config
class AstrobeePlant(ParametricPlantConfig):
    """NASA's Astrobee, or another free-flyer with two propulsion modules.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the nozzles' true thrust from the published value.
    """

    sheet: ClassVar[type[Sheet]] = FreeFlyerSheet
    vehicle: Name = "astrobee"
    spread: Share = 0.2

    @model_validator(mode="after")
    def _check_mismatch(self) -> Self:
        self.mismatch.refuse("a free-flyer in a vacuum", "flow", "fluid")
        return self

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        sheet = FreeFlyerSheet.of(self.vehicle)
        thrust = hidden(nozzles(sheet)[2], self.spread, np.random.default_rng(seed))
        return self._plant(dt, published_body(sheet), thrust)

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (p,), or the published ones."""
        if theta is not None:
            return self._plant(dt, Inertia.of(theta[:10]), theta[10:])
        sheet = FreeFlyerSheet.of(self.vehicle)
        return self._plant(dt, published_body(sheet), nozzles(sheet)[2])

    def _plant(self, dt: float, body: Inertia, true_thrust: Array) -> Plant:
        sheet = FreeFlyerSheet.of(self.vehicle)
        positions, jets, thrust = nozzles(sheet)
        guess = sheet.guess
        scales = FreeFlyerScales(
            mass=guess.mass,
            offset=guess.offset,
            inertia=np.array(guess.inertia),
            thrust=guessed(thrust),
            speed=np.array(guess.speed),
        )
        spec = vehicle_spec(self.vehicle, dt, body.mass, body.lever, body.inertia, sheet.size)
        truth = np.concatenate([body.theta(), true_thrust])
        system = FreeFlyer(scales, positions, -jets)
        acting = np.concatenate([np.zeros(10), true_thrust])
        vehicle = Vehicle(system, truth, spec, acting, self.mismatch)
        return vehicle.failing(self.faults, self)


def published_body(sheet: FreeFlyerSheet) -> Inertia:
    """The body's inertia; z up."""
    return Inertia(sheet.mass, NED * sheet.centre, np.diag(sheet.inertia))


def nozzles(sheet: FreeFlyerSheet) -> tuple[Array, Array, Array]:
    """Positions, jet directions and nominal thrusts of the nozzles of both modules; z up.

    Returns:
        (k, 3) positions [m], (k, 3) unit vectors of the jets, (k,) nominal thrust [N].
    """
    one_module, jets = np.array(sheet.nozzles.positions), np.array(sheet.nozzles.directions)
    other = np.array([-1.0, -1.0, 1.0])
    positions = NED * sheet.inch * np.concatenate([one_module, other * one_module])
    directions = NED * np.concatenate([jets, other * jets])
    return positions, directions, np.abs(directions) @ np.array(sheet.nozzles.force) / 2
