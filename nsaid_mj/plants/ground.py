"""Cars in the plane: exact linear tyres, drive, rolling resistance and air drag in MuJoCo."""

from __future__ import annotations

from typing import ClassVar, NamedTuple, Self

import numpy as np
from pydantic import model_validator

from ..bounds import Name, Share, config
from ..errors import InvalidInput
from ..parameters import Array
from ..systems.ground import GroundScales, GroundVehicle
from .world.body import Vehicle, guessed, hidden, vehicle_spec
from .world.mismatch import Mismatch
from .world.plant import ParametricPlantConfig, Plant
from .world.sheet import Positive, Sheet, Table, one, several


class Guess(Table):
    """What an engineer expects before any measurement."""

    off_centre: Positive = one("distance of the centre of mass from the middle, of the wheelbase")
    top_speed: Positive = one("speed at which the drive force drops to zero > 0 [m/s]")
    speed: Positive = one("a cruising speed > 0 [m/s]")
    grip: Positive = one("a lateral acceleration of operation > 0 [m/s²]")


class CarSheet(Sheet):
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


@config
class CarPlant(ParametricPlantConfig):
    """A car that drives forwards on level ground.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true load, tyres, drive and resistances from the
            nominal values.
    """

    sheet: ClassVar[type[Sheet]] = CarSheet
    vehicle: Name = "f1tenth"
    spread: Share = 0.2

    @model_validator(mode="after")
    def _check_mismatch(self) -> Self:
        check_wind(self.mismatch, "a car in the plane")
        return self

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        nominal, rng = nominal_car(CarSheet.of(self.vehicle)), np.random.default_rng(seed)
        return self._plant(dt, Car(*hidden(np.array(nominal), self.spread, rng).tolist()))

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (9,), or the published ones."""
        if theta is None:
            return self._plant(dt, nominal_car(CarSheet.of(self.vehicle)))
        mass, moment, inertia, *others = theta.tolist()
        centre = moment / mass
        return self._plant(dt, Car(mass, centre, inertia - moment * centre, *others))

    def _plant(self, dt: float, true: Car) -> Plant:
        sheet = CarSheet.of(self.vehicle)
        nominal, wheelbase = nominal_car(sheet), sheet.front + sheet.rear
        system = GroundVehicle(scales(nominal, wheelbase, sheet.guess), wheelbase, sheet.steering)
        centre, inertia = np.array([true.centre, 0.0, 0.0]), true.inertia * np.eye(3)
        spec = vehicle_spec(self.vehicle, dt, true.mass, centre, inertia, sheet.size, planar=True)
        acting = np.array([0.0, 0.0, 0.0, *true[3:]])
        vehicle = Vehicle(system, true.theta, spec, acting, self.mismatch)
        return vehicle.failing(self.faults, self)


@config
class F1TenthPlant(CarPlant):
    """An F1TENTH, a race car at one tenth scale; parameters and sources in assets/f1tenth.

    Its attributes are those of `CarPlant`.
    """


@config
class BMW320iPlant(CarPlant):
    """A BMW 320i; parameters and sources in assets/bmw320i.

    Its attributes are those of `CarPlant`.
    """

    vehicle: Name = "bmw320i"


class Car(NamedTuple):
    """Parameters of a car; x forward, y left, origin half-way between the axles.

    Attributes:
        mass: [kg].
        centre: x of the centre of mass [m].
        inertia: about the vertical through the centre of mass [kg·m²].
        front: cornering stiffness of the front axle [N/rad].
        rear: cornering stiffness of the rear axle [N/rad].
        drive: drive force at full command and standstill [N].
        loss: decrease of the drive force per unit of speed [N·s/m].
        rolling: rolling resistance [N].
        drag: aerodynamic drag [N·s²/m²].
    """

    mass: float
    centre: float
    inertia: float
    front: float
    rear: float
    drive: float
    loss: float
    rolling: float
    drag: float

    @property
    def theta(self) -> Array:
        """(9,) θ of a `GroundVehicle` with these parameters."""
        moment = self.mass * self.centre
        return np.array([self.mass, moment, self.inertia + moment * self.centre, *self[3:]])


def nominal_car(sheet: CarSheet) -> Car:
    """Nominal parameters of a data sheet; the axle loads follow from the lever rule."""
    wheelbase = sheet.front + sheet.rear
    grip = sheet.friction * sheet.mass * sheet.gravity / wheelbase
    return Car(
        mass=sheet.mass,
        centre=wheelbase / 2 - sheet.front,
        inertia=sheet.inertia,
        front=sheet.stiffness[0] * grip * sheet.rear,
        rear=sheet.stiffness[1] * grip * sheet.front,
        drive=sheet.drive,
        loss=sheet.loss,
        rolling=sheet.rolling,
        drag=sheet.drag,
    )


def scales(nominal: Car, wheelbase: float, guess: Guess) -> GroundScales:
    """An engineer's guess of a car's scales: nominal values rounded to powers of two."""
    return GroundScales(
        mass=float(guessed(nominal.mass)),
        moment=guess.off_centre * nominal.mass * wheelbase,
        inertia=float(guessed(nominal.inertia)),
        stiffness=guessed(np.array([nominal.front, nominal.rear])),
        drive=float(guessed(nominal.drive)),
        loss=float(guessed(nominal.drive)) / guess.top_speed,
        rolling=float(guessed(nominal.rolling)),
        drag=float(guessed(nominal.drag)),
        speed=guess.speed,
        grip=guess.grip,
    )


def check_wind(mismatch: Mismatch, plant: str) -> None:
    """Checks that a mismatch has no fluid model and no vertical wind.

    Raises:
        InvalidInput: it has one; the message names `plant`.
    """
    mismatch.refuse(plant, "fluid")
    if mismatch.flow[2]:
        raise InvalidInput(
            "mismatch.flow", f"a level wind, for {plant}", mismatch.flow, "Make the third one 0."
        )
