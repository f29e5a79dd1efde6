"""BlueROV2 Heavy: eight thrusters of unknown gain move a body in water."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..bounds import Share, config
from ..parameters import Array
from ..resources import numbers
from ..systems.underwater import UnderwaterScales, UnderwaterVehicle
from .world.body import (
    BODY,
    NED,
    Vehicle,
    command_inputs,
    guessed,
    hidden,
    vehicle_spec,
)
from .world.hydrodynamics import SIZE, Hydrodynamics, fossen
from .world.mismatch import Mismatch
from .world.plant import Plant, PlantConfig


@config
class BlueROV2Plant(PlantConfig):
    """A BlueROV2 Heavy; numbers and sources in assets/bluerov2.

    Attributes:
        spread: largest relative deviation of the true drag, weight, righting moment and thrust
            from the published numbers.
    """

    spread: Share = 0.2

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden numbers and makes the plant."""
        nominal = published()
        true = drawn(nominal, self.spread, np.random.default_rng(seed))
        true = replace(true, flow=np.array(self.mismatch.flow))
        system = UnderwaterVehicle(
            scales_of(nominal), nominal.positions, nominal.directions, nominal.curve
        )
        return body_in_water("bluerov2", system, true, dt, self.mismatch).failing(self.fault)


def drawn(nominal: Hydrodynamics, spread: float, rng: np.random.Generator) -> Hydrodynamics:
    """True numbers that deviate from nominal ones in all but the inertias."""
    return replace(
        nominal,
        linear=hidden(nominal.linear, spread, rng),
        quadratic=hidden(nominal.quadratic, spread, rng),
        net_weight=float(hidden(nominal.net_weight, spread, rng)),
        righting=hidden(nominal.righting, spread, rng),
        thrust=hidden(nominal.thrust, spread, rng),
    )


def scales_of(nominal: Hydrodynamics) -> UnderwaterScales:
    """What an engineer would guess of a BlueROV2 Heavy."""
    guess = numbers("bluerov2")["guess"]
    return UnderwaterScales(
        mass=guessed(np.diag(nominal.rigid + nominal.added)),
        linear=np.array(guess["linear_drag"]),
        quadratic=guessed(nominal.quadratic),
        net_weight=float(guessed(nominal.net_weight)),
        righting=float(guessed(nominal.righting[2])),
        thrust=guessed(nominal.thrust),
        speed=np.array(guess["speed"]),
    )


def body_in_water(
    name: str, system: UnderwaterVehicle, true: Hydrodynamics, dt: float, mismatch: Mismatch
) -> Vehicle:
    """A vehicle with the given true numbers, in Fossen's water or in MuJoCo's."""
    mass, inertia = true.rigid[0, 0], true.rigid[3:, 3:]
    spec = vehicle_spec(name, dt, mass, np.zeros(3), inertia)
    command_inputs(spec, system.n_u)
    spec.nuserdata = SIZE
    acting = true
    if mismatch.fluid == "ellipsoid":
        into_mujocos_water(spec, mismatch)
        still = np.zeros(6)
        acting = replace(true, added=np.zeros((6, 6)), linear=still, quadratic=still)
    return Vehicle(
        system,
        theta_of(true),
        spec,
        acting.numbers(mismatch.lag > 0),
        fossen(),
        mismatch,
        acting.gain_places,
    )


def theta_of(true: Hydrodynamics) -> Array:
    """(p,) θ of an `UnderwaterVehicle` with these numbers."""
    M = (true.rigid + true.added)[np.triu_indices(6)]
    return np.concatenate(
        [M, true.linear, true.quadratic, [true.net_weight], true.righting, true.thrust]
    )


def into_mujocos_water(spec: Any, mismatch: Mismatch) -> None:
    """Gives a specification MuJoCo's own fluid forces, on every geom as an ellipsoid."""
    spec.option.density, spec.option.viscosity = 1000.0, 1e-3
    spec.option.wind = mismatch.flow
    for geom in spec.body(BODY).geoms:
        geom.fluid_ellipsoid = 1


def published() -> Hydrodynamics:
    """The published BlueROV2 Heavy, x forward, y left, z up."""
    d = numbers("bluerov2")
    turn6 = np.r_[NED, NED]
    weight, buoyancy = d["mass"] * d["gravity"], d["volume"] * d["water_density"] * d["gravity"]
    t = d["thrusters"]
    positions, directions = (
        NED * np.concatenate([_placed(t[kind], what) for kind in ("horizontal", "vertical")])
        for what in (("position", "angles"), ("direction", "turns"))
    )
    curve = np.array(t["curve"])
    return Hydrodynamics(
        rigid=np.diag([d["mass"]] * 3 + d["inertia"]),
        added=turn6[:, None] * np.diag(d["added_mass"]) * turn6,
        linear=np.array(d["linear_drag"]),
        quadratic=np.array(d["quadratic_drag"]),
        net_weight=weight - buoyancy + d["ballast"],
        righting=NED * d["buoyancy_centre"] * buoyancy,
        positions=positions,
        directions=directions,
        thrust=np.full(len(positions), curve.sum()),
        curve=curve / curve.sum(),
        flow=np.zeros(3),
    )


def _placed(group: dict[str, Any], what: tuple[str, str]) -> Array:
    """(k, 3) copies of a vector, each turned about z by its angle."""
    vector, angles = np.array(group[what[0]]), np.array(group[what[1]])
    c, s = np.cos(angles), np.sin(angles)
    x, y, z = vector
    return np.stack([c * x - s * y, s * x + c * y, np.full(len(angles), z)], axis=1)
