"""Quadrotors: four rotors of unknown gain; Hummingbird and Crazyflie are included."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from ..bounds import Name, Share, config
from ..errors import InvalidInput
from ..parameters import Array
from ..systems.aerial import GRAVITY, AerialScales, Quadrotor
from .world.body import BODY, Inertia, Vehicle, guessed, hidden, vehicle_spec
from .world.plant import ParametricPlantConfig, Plant
from .world.sheet import (
    NotNegative,
    Number,
    Positive,
    Sheet,
    Table,
    check_inertia,
    one,
    several,
)

AIR_DENSITY, AIR_VISCOSITY = 1.225, 1.81e-5
"""Standard atmosphere at sea level [kg/m³, Pa·s], for MuJoCo's own fluid model."""


Place = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Rotors(Table):
    """Four equal rotors with thrust along z."""

    arm: Positive = one("distance of a rotor from the origin, a number > 0 [m]")
    places: list[Place] = several(4, "two numbers for each of four rotors, times arm/√2")
    spin: list[Number] = several(4, "1 or −1 for each of four rotors, the sign of its torque")
    top_speed: Positive = one("a number > 0 [rad/s]")
    thrust: Positive = one("a number > 0 [N·s²/rad²]")
    torque: Positive = one("a number > 0 [N·m·s²/rad²]")
    drag: list[Positive] = several(2, "two numbers > 0 [N·s²/(m·rad)], in and across its plane")
    lift: NotNegative = one("a number ≥ 0 [N·s²/m²]")


class Guess(Table):
    """What an engineer expects before any measurement."""

    offset: Positive = one("a distance of the centre of mass from the origin > 0 [m]")
    lift: Positive = one("a number > 0 [N·s²/m²]")
    speed: list[Positive] = several(6, "six velocities of operation > 0 [m/s, rad/s]")


class QuadrotorSheet(Sheet):
    """A quadrotor's data sheet; axes x forward, y left, z up, origin at the rotors' centre."""

    family: ClassVar[str] = "quadrotor"

    mass: Positive = one("a number > 0 [kg]")
    inertia: list[Positive] = several(3, "three principal moments > 0 [kg·m²]")
    centre_of_mass: list[NotNegative] = several(
        3, "three numbers ≥ 0, how far off the origin it may be [m]"
    )
    body_drag: list[Positive] = several(3, "three numbers > 0 [N·s²/m²]")
    rotors: Rotors
    guess: Guess

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_inertia(self.inertia)
        if strange := [s for s in self.rotors.spin if abs(s) != 1]:
            raise InvalidInput(
                "rotors.spin", "1 or −1", strange[0], "1 is a torque that turns the body left."
            )
        return self


@config
class QuadrotorPlant(ParametricPlantConfig):
    """A quadrotor in the air.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true mass, second moments of mass, drag, lift and
            thrust from the published values; half of it for the rotors' torque, because yaw
            authority is small.
    """

    sheet: ClassVar[type[Sheet]] = QuadrotorSheet
    vehicle: Name = "hummingbird"
    spread: Share = 0.1

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        sheet = QuadrotorSheet.of(self.vehicle)
        nominal, rng = nominal_airframe(sheet), np.random.default_rng(seed)
        moments = np.diag(nominal.inertia)
        true = replace(
            nominal,
            mass=float(hidden(nominal.mass, self.spread, rng)),
            centre=np.array(sheet.centre_of_mass) * rng.uniform(-1, 1, 3),
            inertia=_inertia(hidden(moments.sum() / 2 - moments, self.spread, rng)),
            lift=float(hidden(nominal.lift, self.spread, rng)),
            rotor_drag=hidden(nominal.rotor_drag, self.spread, rng),
            body_drag=hidden(nominal.body_drag, self.spread, rng),
            thrust=hidden(nominal.thrust, self.spread, rng),
            torque=hidden(nominal.torque, self.spread / 2, rng),
        )
        return self._plant(dt, true)

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (24,), or the published ones.

        The centre of mass is published as that of the rotors.
        """
        nominal = nominal_airframe(QuadrotorSheet.of(self.vehicle))
        return self._plant(dt, nominal if theta is None else with_theta(nominal, theta))

    def _plant(self, dt: float, true: Airframe) -> Plant:
        sheet = QuadrotorSheet.of(self.vehicle)
        nominal, guess = nominal_airframe(sheet), sheet.guess
        system = Quadrotor(
            AerialScales(
                mass=float(guessed(nominal.mass)),
                offset=guess.offset,
                inertia=guessed(np.diag(nominal.inertia)),
                lift=guess.lift,
                rotor_drag=guessed(nominal.rotor_drag),
                body_drag=guessed(nominal.body_drag),
                thrust=guessed(nominal.thrust),
                torque=guessed(nominal.torque),
                speed=np.array(guess.speed),
            ),
            nominal.positions,
            nominal.spin,
        )
        spec = vehicle_spec(self.vehicle, dt, true.mass, true.centre, true.inertia, sheet.size)
        spec.option.gravity = [0, 0, -GRAVITY]
        acting = true.theta()
        acting[:10] = 0.0  # MuJoCo's body has them, and their weight
        if self.mismatch.fluid == "ellipsoid":
            spec.option.density, spec.option.viscosity = AIR_DENSITY, AIR_VISCOSITY
            spec.option.wind = self.mismatch.flow
            for geom in spec.body(BODY).geoms:
                geom.fluid_ellipsoid = int(
                    not geom.name.startswith("rotor")
                )  # rotor disks are not solid
            acting[13:16] = 0.0  # body drag
        vehicle = Vehicle(system, true.theta(), spec, acting, self.mismatch)
        return vehicle.failing(self.faults, self)


@dataclass(frozen=True)
class Airframe:
    """Parameters of a quadrotor; axes x forward, y left, z up, origin at the rotors' centre.

    Attributes:
        mass: [kg].
        centre: (3,) centre of mass [m].
        inertia: (3, 3) about the centre of mass [kg·m²].
        lift: translational lift of a rotor [N·s²/m²].
        rotor_drag: (2,) of a rotor at full speed, in and across its plane [N·s/m].
        body_drag: (3,) [N·s²/m²].
        positions: (4, 3) of the rotors [m].
        spin: (4,) ±1, sign of each rotor's torque about z.
        thrust: (4,) at full speed [N].
        torque: (4,) at full speed [N·m].
    """

    mass: float
    centre: Array
    inertia: Array
    lift: float
    rotor_drag: Array
    body_drag: Array
    positions: Array
    spin: Array
    thrust: Array
    torque: Array

    def theta(self) -> Array:
        """(24,) θ of a `Quadrotor`."""
        body = Inertia(self.mass, self.centre, self.inertia).theta()
        return np.concatenate(
            [body, [self.lift], self.rotor_drag, self.body_drag, self.thrust, self.torque]
        )


def nominal_airframe(sheet: QuadrotorSheet) -> Airframe:
    """Nominal parameters of a data sheet, the centre of mass at the rotors' centre."""
    rotors, top = sheet.rotors, sheet.rotors.top_speed
    return Airframe(
        mass=sheet.mass,
        centre=np.zeros(3),
        inertia=np.diag(sheet.inertia),
        lift=rotors.lift,
        rotor_drag=top * np.array(rotors.drag),
        body_drag=np.array(sheet.body_drag),
        positions=np.c_[rotors.arm / np.sqrt(2) * np.array(rotors.places), np.zeros(4)],
        spin=np.array(rotors.spin, dtype=float),
        thrust=np.full(4, rotors.thrust * top**2),
        torque=np.full(4, rotors.torque * top**2),
    )


def with_theta(nominal: Airframe, theta: Array) -> Airframe:
    """The nominal geometry with the parameters θ (24,) of a `Quadrotor`."""
    body = Inertia.of(theta[:10])
    lift, rotor_drag, body_drag, thrust, torque = np.split(theta[10:], [1, 3, 6, 10])
    return replace(
        nominal,
        mass=body.mass,
        centre=body.lever,
        inertia=body.inertia,
        lift=float(lift[0]),
        rotor_drag=rotor_drag,
        body_drag=body_drag,
        thrust=thrust,
        torque=torque,
    )


def _inertia(second_moments: Array) -> Array:
    """(3, 3) inertia of a body with the second moments ∫x² dm, ∫y² dm, ∫z² dm (3,) [kg·m²].

    Any three positive ones give principal moments that satisfy the triangle inequality.
    """
    return np.diag(second_moments.sum() - second_moments)
