"""Plants by name, each built once, and the ways in which tests make them move."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from nsaid_mj.core.log import Log
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.plants.jointed import ArmPlant, FloatingBasePlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.setup import draw_prior
from tests.support.vehicles import INEXACT, VEHICLES, acceleration, draw_numbers


def config_of(name: str) -> PlantConfig:
    """A vehicle by name, or a robot: `ur5`, `solo12 free` (floating), `ur5 pinocchio` (backend)."""
    known = {"scalar_rov": ScalarRovPlant()} | VEHICLES | INEXACT
    if name in known:
        return known[name]
    robot, _, kind = name.partition(" ")
    if kind == "pinocchio":
        return ArmPlant(robot, backend="pinocchio")
    return FloatingBasePlant(robot) if kind == "free" else ArmPlant(robot)


@cache
def built(config: PlantConfig, seed: int = 1, dt: float = 1e-3) -> Any:
    """The plant of a configuration, shared by all tests: none may change it for good."""
    return config.build(dt, seed)


def plant(name: str, seed: int = 1, dt: float = 1e-3, **options: Any) -> Any:
    """The plant of a name, its configuration changed by `options`; built once."""
    return built(replace(config_of(name), **options), seed, dt)


# -- states and priors -----------------------------------------------------------------------------


def draw_state(
    system: Any, rng: np.random.Generator | int
) -> tuple[Array, Array, Array, Array, Array]:
    """(x, w, a, u) of the size seen in operation, and (n,) the position numbers of x.

    `rng` may be a seed.
    """
    rng = np.random.default_rng(rng)
    numbers = draw_numbers(system, rng)
    _, v, u = system.random_state(rng)
    w, a = rng.standard_normal((2, system.n))
    return np.r_[system.position(numbers), v], w, a, u, numbers


def start_of(plant: Plant, seed: int = 1) -> tuple[Array, Array]:
    """(n,) position numbers and (n,) velocity to start from."""
    rng = np.random.default_rng(seed)
    _, v, _ = plant.system.random_state(rng)
    return 0.3 * draw_numbers(plant.system, rng), v


def random_commands(plant: Plant, steps: int = 60, seed: int = 0) -> Array:
    """(steps, n_u) commands of the size seen in operation."""
    rng = np.random.default_rng(seed)
    return np.array([plant.system.random_state(rng)[2] for _ in range(steps)])


def wrong_prior(plant: Plant, seed: int = 0) -> Array:
    """(p,) θ̂(0), off by up to 30 % in every parameter."""
    return draw_prior(plant.truth, plant.system.space, 0.3, None, np.random.default_rng(seed))


# -- motions ---------------------------------------------------------------------------------------


def path(plant: Plant, commands: Iterable[Array], numbers: Array, v: Array) -> Array:
    """(steps + 1, 2 n) position numbers and velocities, one command to each step."""
    with plant.running():
        plant.reset(numbers, v)
        rows = [np.concatenate(plant.coordinates())]
        for u in commands:
            plant.step(u)
            rows.append(np.concatenate(plant.coordinates()))
    return np.array(rows)


def hold(plant: Plant, start: tuple[Array, Array], u: Array, seconds: float) -> Array:
    """(2 n,) position numbers and velocity after some seconds of a held command."""
    with plant.running():
        plant.reset(*start)
        for _ in range(round(seconds / plant.dt)):
            plant.step(u)
        return np.concatenate(plant.coordinates())


def drive(plant: Plant, driver: Driver, seconds: float) -> Log:
    """The exact log of some seconds under a driver."""
    with plant.running():
        return plant.trajectory(driver, round(seconds / plant.dt))


def assert_engines_agree(
    plant: Plant, seed: int, tolerance: float = 1e-12, acceleration_tolerance: float = 1e-9
) -> None:
    """MuJoCo's v̇ is (29), and W(t, x, v, v̇) θ = 0 (10), at the truth and a random state."""
    system, theta = plant.system, plant.truth
    x, _, _, u, numbers = draw_state(system, seed)
    v = x[system.m :]
    a = acceleration(plant, numbers, v, u)
    expected = system.acceleration(0.0, x, v, u, theta)
    assert np.abs(a - expected).max() <= acceleration_tolerance * np.abs(expected).max()
    W = system.regressor(0.0, x, v, a, u)
    assert np.abs(W @ theta).max() <= tolerance * (np.abs(W) @ np.abs(theta)).max()


def name_of(config: PlantConfig) -> str:
    """A configuration's name in a test's id."""
    return type(config).__name__ + getattr(config, "robot", "") + getattr(config, "model", "")
