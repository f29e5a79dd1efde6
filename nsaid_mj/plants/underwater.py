"""Underwater vehicles with thrusters of unknown gain; a BlueROV2 Heavy is included."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from ..bounds import Name, Share, config
from ..errors import InvalidInput
from ..parameters import Array
from ..systems.underwater import UnderwaterScales, UnderwaterVehicle
from .world.body import (
    BODY,
    NED,
    Vehicle,
    guessed,
    hidden,
    vehicle_spec,
)
from .world.hydrodynamics import POWERS, Hydrodynamics, split_mass
from .world.mismatch import Mismatch
from .world.plant import ParametricPlantConfig, Plant
from .world.sheet import (
    NotNegative,
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

    linear_drag: list[Positive] = several(6, "six numbers > 0 [N·s/m, N·m·s/rad]")
    speed: list[Positive] = several(6, "six velocities of operation > 0 [m/s, rad/s]")


class Ring(Table):
    """Copies of one thruster, each turned about z: Rz(angle)·position, Rz(turn)·direction."""

    position: list[Number] = several(3, "three numbers [m]")
    direction: list[Number] = several(3, "a unit vector, three numbers")
    angles: list[Number] = Field(min_length=1, description="one angle for each thruster [rad]")
    turns: list[Number] = Field(min_length=1, description="one angle for each thruster [rad]")


class Thrusters(Table):
    """Thrusters listed one by one, in rings, or both; all have the same command curve."""

    curve: list[Number] = Field(
        min_length=1,
        max_length=POWERS,
        description=f"1 to {POWERS} coefficients of u, u³, u⁵, u⁷, u⁹, of command u in [−1, 1] [N]",
    )
    positions: list[Place] = Field(default=[], description="three numbers for each thruster [m]")
    directions: list[Place] = Field(
        default=[], description="a unit vector, three numbers, for each thruster"
    )
    rings: list[Ring] = Field(default=[], description="tables [[thrusters.rings]]")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.positions) != len(self.directions):
            raise InvalidInput(
                "thrusters.directions",
                f"one for each of {len(self.positions)} positions",
                len(self.directions),
                "Give every thruster its position and its direction.",
            )
        for ring in self.rings:
            if len(ring.angles) != len(ring.turns):
                raise InvalidInput(
                    "thrusters.rings.turns",
                    f"one for each of {len(ring.angles)} angles",
                    len(ring.turns),
                    "Give every thruster of the ring both.",
                )
        count = len(self.positions) + sum(len(ring.angles) for ring in self.rings)
        if not count:
            raise InvalidInput(
                "thrusters", "at least one thruster", count, "Give `positions`, or `rings`."
            )
        check_unit_vectors("thrusters.directions", self.placed("direction"))
        if not sum(self.curve) > 1e-9:
            raise InvalidInput(
                "thrusters.curve",
                "a thrust > 0 N at full command, the sum of all coefficients",
                sum(self.curve),
                "If thrusters push backwards, reverse their directions.",
            )
        return self

    def placed(self, what: str) -> Array:
        """(k, 3) position or direction of every thruster: single thrusters first, then the rings'.

        Args:
            what: `position` or `direction`.
        """
        alone = np.array(getattr(self, f"{what}s"), dtype=np.float64).reshape(-1, 3)
        angles = {"position": "angles", "direction": "turns"}[what]
        rings = [_turned(getattr(ring, what), getattr(ring, angles)) for ring in self.rings]
        return np.concatenate([alone, *rings])


class UnderwaterSheet(Sheet):
    """An underwater vehicle's data sheet; x forward, y right, z down from the centre of mass."""

    family: ClassVar[str] = "underwater"

    mass: Positive = one("a number > 0 [kg]")
    volume: Positive = one("a number > 0 [m³]")
    inertia: list[Positive] = several(3, "three principal moments > 0 [kg·m²]")
    buoyancy_centre: list[Number] = several(3, "three numbers [m], z < 0 if self-righting")
    water_density: Positive = one("a number > 0 [kg/m³], 1000 in fresh water")
    gravity: Positive = one("a number > 0 [m/s²]")
    ballast: Number = Field(default=0.0, description="a weight [N]")
    added_mass: list[NotNegative] = several(6, "six numbers ≥ 0 [kg, kg·m²]")
    linear_drag: list[NotNegative] = several(6, "six numbers ≥ 0 [N·s/m, N·m·s/rad]")
    quadratic_drag: list[Positive] = several(6, "six numbers > 0 [N·s²/m², N·m·s²/rad²]")
    guess: Guess
    thrusters: Thrusters

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_inertia(self.inertia)
        if abs(self.net_weight) < 1e-9:
            raise InvalidInput(
                "ballast",
                "a net weight that is not 0 N",
                self.net_weight,
                "A neutral vehicle has none to identify: add some ballast, such as 1 N.",
            )
        if abs(self.buoyancy_centre[2]) < 1e-9:
            raise InvalidInput(
                "buoyancy_centre",
                "a z that is not 0 m",
                self.buoyancy_centre,
                "Without it there is no righting moment: −0.01 is 1 cm above the centre of mass.",
            )
        return self

    @property
    def buoyancy(self) -> float:
        """Buoyancy of the displaced water [N]."""
        return self.volume * self.water_density * self.gravity

    @property
    def net_weight(self) -> float:
        """Weight plus ballast minus buoyancy [N]."""
        return self.mass * self.gravity - self.buoyancy + self.ballast


@config
class BlueROV2Plant(ParametricPlantConfig):
    """A BlueROV2 Heavy, or another underwater vehicle with fixed thrusters.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true drag, weight, righting moment and thrust
            from the published values.
    """

    sheet: ClassVar[type[Sheet]] = UnderwaterSheet
    vehicle: Name = "bluerov2"
    spread: Share = 0.2

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        nominal = nominal_numbers(UnderwaterSheet.of(self.vehicle))
        return self._plant(dt, drawn(nominal, self.spread, np.random.default_rng(seed)))

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (p,), or the published ones.

        See `split_mass` for how M is divided into rigid-body and added mass.
        """
        nominal = nominal_numbers(UnderwaterSheet.of(self.vehicle))
        return self._plant(dt, nominal if theta is None else with_theta(nominal, theta))

    def _plant(self, dt: float, true: Hydrodynamics) -> Plant:
        sheet = UnderwaterSheet.of(self.vehicle)
        nominal = nominal_numbers(sheet)
        system = UnderwaterVehicle(
            scales_of(nominal, sheet.guess), nominal.positions, nominal.directions, nominal.curve
        )
        vehicle = body_in_water(self.vehicle, system, true, dt, self.mismatch, sheet.size)
        return vehicle.failing(self.faults, self)


def drawn(nominal: Hydrodynamics, spread: float, rng: np.random.Generator) -> Hydrodynamics:
    """Random true parameters: all but the inertias deviate from nominal by up to `spread`."""
    return replace(
        nominal,
        linear=hidden(nominal.linear, spread, rng),
        quadratic=hidden(nominal.quadratic, spread, rng),
        net_weight=float(hidden(nominal.net_weight, spread, rng)),
        righting=hidden(nominal.righting, spread, rng),
        thrust=hidden(nominal.thrust, spread, rng),
    )


def scales_of(nominal: Hydrodynamics, guess: Guess) -> UnderwaterScales:
    """An engineer's guess of the scales of a vehicle with these nominal parameters."""
    return UnderwaterScales(
        mass=guessed(np.diag(nominal.rigid + nominal.added)),
        linear=np.array(guess.linear_drag),
        quadratic=guessed(nominal.quadratic),
        net_weight=float(guessed(nominal.net_weight)),
        righting=float(guessed(nominal.righting[2])),
        thrust=guessed(nominal.thrust),
        speed=np.array(guess.speed),
    )


def body_in_water(
    vehicle: str,
    system: UnderwaterVehicle,
    true: Hydrodynamics,
    dt: float,
    mismatch: Mismatch,
    size: list[float] | None = None,
) -> Vehicle:
    """A vehicle with the given true parameters and Fossen's or MuJoCo's fluid forces.

    Args:
        vehicle: whose model.xml is drawn.
        system: the structure that an identifier may know.
        true: the true parameters.
        dt: time step [s].
        mismatch: the effects outside the structure; its `fluid` selects the fluid forces.
        size: (3,) of the box that is drawn if there is no model.xml [m].
    """
    mass, inertia = true.rigid[0, 0], true.rigid[3:, 3:]
    spec = vehicle_spec(vehicle, dt, mass, np.zeros(3), inertia, size)
    acting = theta_of(true)
    acting[:21] = true.added[np.triu_indices(6)]
    if mismatch.fluid == "ellipsoid":
        use_mujoco_fluid(spec, mismatch)
        acting[:33] = 0.0
    return Vehicle(system, theta_of(true), spec, acting, mismatch)


def theta_of(true: Hydrodynamics) -> Array:
    """(p,) θ of an `UnderwaterVehicle` with these parameters."""
    M = (true.rigid + true.added)[np.triu_indices(6)]
    return np.concatenate(
        [M, true.linear, true.quadratic, [true.net_weight], true.righting, true.thrust]
    )


def with_theta(nominal: Hydrodynamics, theta: Array) -> Hydrodynamics:
    """The nominal geometry with the parameters θ (p,) of an `UnderwaterVehicle`."""
    M = np.zeros((6, 6))
    M[np.triu_indices(6)] = theta[:21]
    rigid, added = split_mass(M + np.triu(M, 1).T, nominal.rigid, nominal.added)
    linear, quadratic, weight, righting, thrust = np.split(theta[21:], [6, 12, 13, 16])
    return replace(
        nominal,
        rigid=rigid,
        added=added,
        linear=linear,
        quadratic=quadratic,
        net_weight=float(weight[0]),
        righting=righting,
        thrust=thrust,
    )


def use_mujoco_fluid(spec: Any, mismatch: Mismatch) -> None:
    """Enables MuJoCo's own fluid forces of water in a specification: every geom is an ellipsoid.

    Geoms whose names begin with "thruster" are left out: they only show where the thrust acts.
    """
    spec.option.density, spec.option.viscosity = 1000.0, 1e-3
    spec.option.wind = mismatch.flow
    for geom in spec.body(BODY).geoms:
        geom.fluid_ellipsoid = int(not geom.name.startswith("thruster"))


def nominal_numbers(sheet: UnderwaterSheet) -> Hydrodynamics:
    """Nominal parameters of a data sheet, in axes x forward, y left, z up."""
    turn6 = np.r_[NED, NED]
    curve = np.zeros(POWERS)
    curve[: len(sheet.thrusters.curve)] = sheet.thrusters.curve
    positions, directions = (NED * sheet.thrusters.placed(x) for x in ("position", "direction"))
    return Hydrodynamics(
        rigid=np.diag([sheet.mass] * 3 + sheet.inertia),
        added=turn6[:, None] * np.diag(sheet.added_mass) * turn6,
        linear=np.array(sheet.linear_drag),
        quadratic=np.array(sheet.quadratic_drag),
        net_weight=sheet.net_weight,
        righting=NED * sheet.buoyancy_centre * sheet.buoyancy,
        positions=positions,
        directions=directions,
        thrust=np.full(len(positions), curve.sum()),
        curve=curve / curve.sum(),
    )


def _turned(vector: list[float], angles: list[float]) -> Array:
    """(k, 3) copies of a vector (3,), each rotated about z by its angle [rad]."""
    c, s = np.cos(angles), np.sin(angles)
    x, y, z = vector
    return np.stack([c * x - s * y, s * x + c * y, np.full(len(angles), z)], axis=1)
