"""Torpedo-shaped underwater vehicles with four fins and a propeller; a REMUS 100 is included."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from ..bounds import Name, Share, config
from ..errors import InvalidInput
from ..parameters import Array
from ..systems.torpedo import TorpedoScales, TorpedoVehicle, mass_tensor
from .underwater import use_mujoco_fluid
from .world.body import BODY, Vehicle, guessed, hidden, vehicle_spec
from .world.hydrodynamics import split_mass
from .world.mismatch import Mismatch
from .world.plant import ParametricPlantConfig, Plant
from .world.sheet import (
    Negative,
    Number,
    Positive,
    Sheet,
    Table,
    check_inertia,
    one,
    several,
)


class AddedMass(Table):
    """Added-mass derivatives, with their published signs."""

    X_udot: Negative = one("a number < 0 [kg]")
    Y_vdot: Negative = one("a number < 0 [kg]")
    K_pdot: Negative = one("a number < 0 [kg·m²]")
    M_qdot: Negative = one("a number < 0 [kg·m²]")
    Y_rdot: Number = one("a number that is not 0 [kg·m]")


class Drag(Table):
    """Quadratic drag derivatives, with their published signs."""

    coefficient: Positive = one("a coefficient > 0 on the frontal area")
    diameter: Positive = one("a number > 0 [m]")
    Y_vv: Negative = one("a number < 0 [N·s²/m²]")
    K_pp: Negative = one("a number < 0 [N·m·s²]")
    M_qq: Negative = one("a number < 0 [N·m·s²]")


class Lift(Table):
    """Lift derivatives of body and fins together."""

    Y_uv: Number = one("a number [N·s²/m²]")
    M_uw: Number = one("a number [N·s²/m]")


class Fins(Table):
    """Four fins, with coefficients published per pair."""

    Y_uudr: Positive = one("a number > 0 [N·s²/m² for each rad]")
    N_uudr: Negative = one("a number < 0 [N·s²/m for each rad]")
    drag_by_lift: Positive = one("a share > 0")
    radius: Positive = one("a number > 0 [m]")
    limit: float = Field(gt=0, lt=1.5, description="a deflection in (0, 1.5) [rad]")


class Propeller(Table):
    """The propeller and its thrust coefficients."""

    diameter: Positive = one("a number > 0 [m]")
    shaft_speed: Positive = one("a number > 0 at full command [1/s]")
    K_T: list[Positive] = several(2, "two numbers > 0, at advance ratios 0 and `advance`")
    advance: Positive = one("an advance ratio > 0")
    wake: Positive = one("a share > 0")
    deduction: Share = one("a share in [0, 1)")
    torque: Positive = one("a number > 0 [N·m·s²/rad²]")
    position: Number = one("x of the propeller [m]")


class Guess(Table):
    """What an engineer expects before any measurement."""

    speed: list[Positive] = several(6, "six velocities of operation > 0 [m/s, rad/s]")


class TorpedoSheet(Sheet):
    """A torpedo's data sheet; axes x forward, y right, z down, origin at the centre of buoyancy."""

    family: ClassVar[str] = "torpedo"

    mass: Positive = one("a number > 0 [kg]")
    inertia: list[Positive] = several(3, "three moments about the origin > 0 [kg·m²]")
    gravity_centre: list[Number] = several(3, "three numbers [m], z > 0 if self-righting")
    gravity: Positive = one("a number > 0 [m/s²]")
    water_density: Positive = one("a number > 0 [kg/m³], 1026 in the sea")
    net_weight: Number = one("weight less buoyancy, not 0 [N]")
    added_mass: AddedMass
    drag: Drag
    lift: Lift
    fins: Fins
    propeller: Propeller
    guess: Guess

    @model_validator(mode="after")
    def _fits(self) -> Self:
        height = self.gravity_centre[2]
        for key, value in (
            ("net_weight", self.net_weight),
            ("gravity_centre", height),
            ("added_mass.Y_rdot", self.added_mass.Y_rdot),
        ):
            if abs(value) < 1e-9:
                raise InvalidInput(
                    key,
                    "a number that is not 0 (of the centre of gravity, its z)",
                    value,
                    "It is a parameter to be identified, and needs a scale.",
                )
        shift = self.mass * height**2
        check_inertia([self.inertia[0] - shift, self.inertia[1] - shift, self.inertia[2]])
        if not self.propeller.K_T[0] > self.propeller.K_T[1]:
            raise InvalidInput(
                "propeller.K_T",
                "a coefficient that falls with the advance ratio",
                self.propeller.K_T,
                "Give first the one at standstill.",
            )
        return self


@config
class REMUS100Plant(ParametricPlantConfig):
    """A REMUS 100, or another torpedo-shaped vehicle.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true drag, lift, weight, righting moment,
            propeller and fins from the published values.
    """

    sheet: ClassVar[type[Sheet]] = TorpedoSheet
    vehicle: Name = "remus100"
    spread: Share = 0.2

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        nominal = nominal_numbers(TorpedoSheet.of(self.vehicle))
        rng = np.random.default_rng(seed)
        true = replace(
            nominal,
            drag=hidden(nominal.drag, self.spread, rng),
            lift=hidden(nominal.lift, self.spread, rng),
            net_weight=float(hidden(nominal.net_weight, self.spread, rng)),
            righting=float(hidden(nominal.righting, self.spread, rng)),
            propeller=hidden(nominal.propeller, self.spread, rng),
            fin_lift=hidden(nominal.fin_lift, self.spread, rng),
            fin_drag=hidden(nominal.fin_drag, self.spread, rng),
        )
        return self._plant(dt, true)

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (p,), or the published ones.

        See `split_mass` for how M is divided into rigid-body and added mass.
        """
        nominal = nominal_numbers(TorpedoSheet.of(self.vehicle))
        return self._plant(dt, nominal if theta is None else with_theta(nominal, theta))

    def _plant(self, dt: float, true: Torpedo) -> Plant:
        sheet = TorpedoSheet.of(self.vehicle)
        nominal = nominal_numbers(sheet)
        system = TorpedoVehicle(
            TorpedoScales(
                inertia=guessed(theta_of(nominal)[:4]),
                coupling=guessed(theta_of(nominal)[4:6]),
                drag=guessed(nominal.drag),
                lift=guessed(nominal.lift),
                net_weight=float(guessed(nominal.net_weight)),
                righting=float(guessed(nominal.righting)),
                propeller=guessed(nominal.propeller),
                fin_lift=guessed(nominal.fin_lift),
                fin_drag=guessed(nominal.fin_drag),
                speed=np.array(sheet.guess.speed),
                limit=sheet.fins.limit,
            ),
            nominal.positions,
            nominal.lifts,
            np.array([sheet.propeller.position, 0.0, 0.0]),
            nominal.slip,
        )
        vehicle = _in_water(self.vehicle, system, true, dt, self.mismatch, sheet.size)
        return vehicle.failing(self.faults, self)


@dataclass(frozen=True)
class Torpedo:
    """Parameters of a torpedo-shaped vehicle; axes x forward, y left, z up.

    Attributes:
        rigid: (6, 6) M_RB about the body's origin, the centre of buoyancy [kg, kg·m, kg·m²].
        added: (6, 6) M_A, symmetric [kg, kg·m, kg·m²].
        drag: (4,) quadratic: along, across [N·s²/m²], rolling, turning [N·m·s²/rad²].
        lift: (2,) of the body: force [N·s²/m²], moment [N·s²/m].
        net_weight: weight less buoyancy [N].
        righting: z of r_B B − r_G W [N·m].
        propeller: (2,) thrust [N] and torque [N·m] at full command at rest.
        slip: share of full thrust that the propeller loses per unit of forward speed [s/m].
        positions: (k, 3) of the fins [m].
        lifts: (k, 3) unit vectors of the lift at positive deflection.
        fin_lift: (k,) [N·s²/m² for each rad].
        fin_drag: (k,) [N·s²/m² for each rad²].
    """

    rigid: Array
    added: Array
    drag: Array
    lift: Array
    net_weight: float
    righting: float
    propeller: Array
    slip: float
    positions: Array
    lifts: Array
    fin_lift: Array
    fin_drag: Array


def theta_of(true: Torpedo) -> Array:
    """(p,) θ of a `TorpedoVehicle` with these parameters."""
    M = true.rigid + true.added
    return np.concatenate(
        [
            [M[0, 0], M[1, 1], M[3, 3], M[5, 5], M[1, 5], M[0, 4]],
            true.drag,
            true.lift,
            [true.net_weight, true.righting],
            true.propeller,
            true.fin_lift,
            true.fin_drag,
        ]
    )


def with_theta(nominal: Torpedo, theta: Array) -> Torpedo:
    """The nominal geometry with the parameters θ (p,) of a `TorpedoVehicle`."""
    M = mass_tensor() @ theta[:6]
    rigid, added = split_mass(M, nominal.rigid, nominal.added)
    k = len(nominal.fin_lift)
    drag, lift, weight, righting, propeller, fin_lift, fin_drag = np.split(
        theta[6:], [4, 6, 7, 8, 10, 10 + k]
    )
    return replace(
        nominal,
        rigid=rigid,
        added=added,
        drag=drag,
        lift=lift,
        net_weight=float(weight[0]),
        righting=float(righting[0]),
        propeller=propeller,
        fin_lift=fin_lift,
        fin_drag=fin_drag,
    )


def nominal_numbers(sheet: TorpedoSheet) -> Torpedo:
    """Nominal parameters of a data sheet, x forward, y left, z up; a fin has half its pair's lift.

    From z down to z up, the y and z components of vectors change sign. Coefficients that relate two
    such components, as Y_uv and N_vdot, keep theirs; m z_g, the righting moment and Y_uuδr do not.
    """
    a, drag, lift, fins, p = sheet.added_mass, sheet.drag, sheet.lift, sheet.fins, sheet.propeller
    mass, height = sheet.mass, -sheet.gravity_centre[2]
    rigid = np.diag([mass] * 3 + sheet.inertia)
    rigid[0, 4] = rigid[4, 0] = mass * height
    rigid[1, 3] = rigid[3, 1] = -mass * height
    added = -np.diag([a.X_udot, *[a.Y_vdot] * 2, a.K_pdot, *[a.M_qdot] * 2])
    added[1, 5] = added[5, 1] = -a.Y_rdot
    added[2, 4] = added[4, 2] = a.Y_rdot
    munk = a.X_udot - a.Y_vdot
    x, r = fins.N_uudr / fins.Y_uudr, fins.radius
    rho, n, wide = sheet.water_density, p.shaft_speed, p.diameter
    slope = (p.K_T[0] - p.K_T[1]) / p.advance
    thrust = (1 - p.deduction) * rho * n**2 * wide**4 * p.K_T[0]
    fin_lift = np.full(4, fins.Y_uudr / 2)
    front = np.pi / 4 * drag.diameter**2
    return Torpedo(
        rigid=rigid,
        added=added,
        drag=np.array([rho / 2 * drag.coefficient * front, -drag.Y_vv, -drag.K_pp, -drag.M_qq]),
        lift=np.array([-lift.Y_uv - fins.Y_uudr, munk + fins.N_uudr - lift.M_uw]),
        net_weight=sheet.net_weight,
        righting=-height * mass * sheet.gravity,
        propeller=np.array([thrust, p.torque * (2 * np.pi * n) ** 2]),
        slip=slope * p.wake / (n * wide) / p.K_T[0],
        positions=np.array([[x, 0, r], [x, 0, -r], [x, r, 0], [x, -r, 0]]),
        lifts=np.array([[0.0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]]),
        fin_lift=fin_lift,
        fin_drag=fins.drag_by_lift * fin_lift,
    )


def _in_water(
    vehicle: str,
    system: TorpedoVehicle,
    true: Torpedo,
    dt: float,
    mismatch: Mismatch,
    size: list[float] | None,
) -> Vehicle:
    """The vehicle with the given true parameters and Prestero's or MuJoCo's fluid forces.

    Args:
        vehicle: whose model.xml is drawn.
        system: the structure that an identifier may know.
        true: the true parameters.
        dt: time step [s].
        mismatch: the effects outside the structure; its `fluid` selects the fluid forces.
        size: (3,) of the box that is drawn if there is no model.xml [m].
    """
    mass = true.rigid[0, 0]
    centre = np.array([0.0, 0.0, true.rigid[0, 4] / mass])
    about_centre = true.rigid[3:, 3:] - mass * (
        centre @ centre * np.eye(3) - np.outer(centre, centre)
    )
    spec = vehicle_spec(vehicle, dt, mass, centre, about_centre, size)
    acting = theta_of(replace(true, rigid=np.zeros((6, 6))))
    if mismatch.fluid == "ellipsoid":
        use_mujoco_fluid(spec, mismatch)
        for geom in spec.body(BODY).geoms:
            geom.fluid_ellipsoid = int(geom.name == "hull")  # the fins keep their own lift
        acting[:12] = 0.0
    return Vehicle(system, theta_of(true), spec, acting, mismatch)
