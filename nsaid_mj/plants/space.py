"""Astrobee: twelve nozzles of unknown gain turn and push a cube in free fall."""

from __future__ import annotations

from typing import Any, Self

import mujoco
import numpy as np
import pinocchio as pin
from pydantic import model_validator

from ..bounds import Share, config
from ..parameters import Array
from ..resources import numbers
from ..systems.space import FreeFlyer, FreeFlyerScales
from .world.body import BODY, NED, Vehicle, guessed, hidden, vehicle_spec
from .world.plant import Plant, PlantConfig


@config
class AstrobeePlant(PlantConfig):
    """NASA's Astrobee; numbers and sources in assets/astrobee.

    Attributes:
        spread: largest relative deviation of the nozzles' true thrust from the published one.
    """

    spread: Share = 0.2

    @model_validator(mode="after")
    def _check_mismatch(self) -> Self:
        self.mismatch.refuse("a free-flyer in a vacuum", "flow", "fluid")
        return self

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden numbers and makes the plant."""
        d = numbers("astrobee")
        positions, jets, thrust = nozzles(d)
        guess = d["guess"]
        scales = FreeFlyerScales(
            mass=guess["mass"],
            offset=guess["offset"],
            inertia=np.array(guess["inertia"]),
            thrust=guessed(thrust),
            speed=np.array(guess["speed"]),
        )
        true_thrust = hidden(thrust, self.spread, np.random.default_rng(seed))
        mass, centre, inertia = d["mass"], NED * d["centre"], np.diag(d["inertia"])
        spec = vehicle_spec("astrobee", dt, mass, centre, inertia)
        for i, (position, jet, gain) in enumerate(zip(positions, jets, true_thrust, strict=True)):
            _add_nozzle(spec, f"nozzle {i + 1}", position, -jet, gain)
        body = pin.Inertia(mass, centre, inertia).toDynamicParameters()
        truth = np.concatenate([body, true_thrust])
        system = FreeFlyer(scales, positions, -jets)
        vehicle = Vehicle(system, truth, spec, np.zeros(0), None, self.mismatch)
        return vehicle.failing(self.fault)


def nozzles(d: dict[str, Any]) -> tuple[Array, Array, Array]:
    """(12, 3) positions [m], (12, 3) directions of the jets, (12,) nominal thrust [N]; z up."""
    one, jets = np.array(d["nozzles"]["positions"]), np.array(d["nozzles"]["directions"])
    other = np.array([-1.0, -1.0, 1.0])
    positions = NED * d["inch"] * np.concatenate([one, other * one])
    directions = NED * np.concatenate([jets, other * jets])
    return positions, directions, np.abs(directions) @ np.array(d["nozzles"]["force"]) / 2


def _add_nozzle(spec: Any, name: str, position: Array, push: Array, thrust: float) -> None:
    """An actuator that pushes at a site of the body, in the body's axes."""
    spec.body(BODY).add_site(name=name, pos=position)
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_SITE)
    actuator.gear = [*push, 0, 0, 0]
    actuator.gainprm[0] = thrust
