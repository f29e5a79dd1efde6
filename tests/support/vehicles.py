"""The vehicles that contracts run over, and what they ask of any plant."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.plants.jointed import FlyingArmPlant, RoverPlant, UvmsPlant
from nsaid_mj.lab.plants.listed import ListedPlant
from nsaid_mj.lab.plants.vehicles import (
    AstrobeePlant,
    BlueROV2Plant,
    BMW320iPlant,
    F1TenthPlant,
    QuadrotorPlant,
    REMUS100Plant,
)
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.plant import Plant

VEHICLES: dict[str, PlantConfig] = {
    "bluerov2": BlueROV2Plant(),
    "astrobee": AstrobeePlant(),
    "remus100": REMUS100Plant(),
    "hummingbird": QuadrotorPlant(vehicle="hummingbird"),
    "crazyflie": QuadrotorPlant(vehicle="crazyflie"),
    "f1tenth": F1TenthPlant(),
    "bmw320i": BMW320iPlant(),
    "catamaran": ListedPlant(),
    "uvms": UvmsPlant(),
    "borinot": FlyingArmPlant("borinot"),
    "iris": FlyingArmPlant("iris"),
}
"""Plants whose structure is exact: W θ = 0 at the truth."""

INEXACT: dict[str, PlantConfig] = {"rover": RoverPlant()}
"""Plants that no θ can reproduce; what holds of any plant holds of them."""


def draw_numbers(system: Any, rng: np.random.Generator) -> Array:
    """(n,) position numbers: within the limits where there are any, else of any small motion."""
    low, high = getattr(system, "limits", (-np.ones(system.n), np.ones(system.n)))
    return rng.uniform(low, high)


def coordinate_map(plant: Any) -> Any:
    """The plant's map between MuJoCo's coordinates and the system's; None where they are equal."""
    return getattr(plant, "joints", None) or getattr(plant, "body", None)


def acceleration(
    plant: Plant, numbers: Array, v: Array, u: Array, as_at: float | None = None
) -> Array:
    """(n,) MuJoCo's own v̇ in the system's coordinates, at one state and command."""
    with plant.running():
        plant.reset(numbers, v, as_at)
        plant.data.ctrl[:] = u
        mujoco.mj_forward(plant.model, plant.data)
        at = coordinate_map(plant)
        return plant.data.qacc.copy() if at is None else at.acceleration(plant.data)
