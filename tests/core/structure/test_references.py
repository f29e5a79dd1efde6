"""Structures of whole families against their sources' own equations in plain numpy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.robots.assets import published_numbers
from tests.support.evaluation import Evaluation
from tests.support.fossen import Fossen, true_numbers, vehicle
from tests.support.plants import draw_state, plant
from tests.support.servo_arm import ServoArm
from tests.support.single_bodies import REFERENCES
from tests.support.vehicle_arms import acceleration as arm_acceleration
from tests.support.vehicles import acceleration


@pytest.mark.parametrize("seed", range(10))
def test_an_arm_of_position_servos_moves_by_lagranges_equations(seed):
    rng = np.random.default_rng(seed)
    arm = ServoArm(
        *rng.uniform(
            [[0.2], [0.1], [0.05], [1e-3], [1e-3], [0.1], [0.05], [5.0]],
            [[0.6], [0.3], [0.15], [5e-3], [1e-2], [0.5], [0.2], [15.0]],
            (8, 3),
        )
    )
    q, v, u = rng.uniform(-2, 2, 3), rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3)
    expected = arm.acceleration(q, v, u)
    a = Evaluation(arm.structure()).stage(q, v, v, u, arm.theta).a
    assert np.abs(a - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("seed", range(5))
def test_a_bluerov2_with_couplings_moves_by_fossens_equations(seed):
    plant, true = vehicle(true_numbers("full"), 1e-3), true_numbers("full")
    rng, system = np.random.default_rng(seed), Evaluation(plant.system.structure)
    q, v, u = plant.system.random_state(rng)
    x = np.concatenate([q[:3], q[[6, 3, 4, 5]], v])
    expected = Fossen(true, u, Mismatch())(0.0, x)[7:13]
    a = system.stage(q, v, v, u, np.ascontiguousarray(plant.truth)).a
    assert np.abs(a - expected).max() <= 1e-9 * np.abs(expected).max()


PLANTS = {
    "bluerov2": "underwater",
    "remus100": "torpedo",
    "hummingbird": "quadrotor",
    "crazyflie": "quadrotor",
    "astrobee": "free flyer",
    "f1tenth": "car",
    "bmw320i": "car",
    "scalar_rov": "scalar",
}


def geometry(system: Any, family: str) -> SimpleNamespace:
    """What a family's reference has to know of a vehicle's shape."""
    found = SimpleNamespace()
    if family in ("underwater", "free flyer"):
        kind = "thruster" if family == "underwater" else "nozzle"
        found.positions, found.directions = (
            system.constants(kind, what) for what in ("point", "direction")
        )
        curve = np.array(published_numbers("bluerov2")["thrusters"]["curve"])
        found.curve = curve / curve.sum()
    elif family == "torpedo":
        found.positions, found.lifts = (system.constants("fin", x) for x in ("point", "direction"))
        found.slip = float(system.constants("propeller", "slip")[0])
    elif family == "quadrotor":
        found.rotors = system.constants("rotor", "point")
        found.spin = system.constants("rotor_torque", "direction")[:, 2]
    elif family == "car":
        front, rear = system.constants("tyre", "arm")
        found.wheelbase = front - rear
    return found


@pytest.mark.parametrize("name,family", PLANTS.items())
@pytest.mark.parametrize("seed", range(3))
def test_mujoco_moves_a_vehicle_by_its_sources_equations(name, family, seed):
    p = plant(name)
    system, theta, shape = p.system, p.truth, geometry(p.system, family)
    x, _, _, u, at = draw_state(system, seed)
    q, v = system.split(x)

    def residual(a):
        return REFERENCES[family](shape, q, v, a, u, theta)

    still = residual(np.zeros(system.n))
    M = np.stack([residual(e) - still for e in np.eye(system.n)], axis=1)
    expected = np.linalg.solve(M, -still)
    assert np.abs(acceleration(p, at, v, u) - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("name", ["uvms", "borinot", "iris"])
@pytest.mark.parametrize("seed", range(3))
def test_mujoco_moves_a_vehicle_with_an_arm_by_kanes_equations(name, seed):
    p = plant(name)
    x, _, _, u, at = draw_state(p.system, seed)
    q, v = p.system.split(x)
    expected = arm_acceleration(name, p.system, q, v, u, p.truth)
    assert np.abs(acceleration(p, at, v, u) - expected).max() <= 1e-9 * np.abs(expected).max()
