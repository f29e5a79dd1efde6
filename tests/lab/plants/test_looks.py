"""The shapes in model.xml show actuators and wheels where the vehicle's sheet has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from nsaid_mj.lab.plants.jointed import RoverPlant, UvmsPlant
from nsaid_mj.lab.plants.vehicles import (
    AstrobeePlant,
    BlueROV2Plant,
    CarPlant,
    QuadrotorPlant,
    REMUS100Plant,
)
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.robots.assets import published_numbers
from tests.support.fossen import published

NEAR = 0.005  # m
FINS = ("upper_rudder", "lower_rudder", "left_plane", "right_plane")
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


def geom(plant: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and z axis (3,) of a geom in its body's axes."""
    found = plant.model.geom(name)
    w, x, y, z = found.quat
    return found.pos, np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)])


@pytest.mark.parametrize("config", [BlueROV2Plant(), UvmsPlant()], ids=["bluerov2", "uvms"])
def test_a_thruster_is_drawn_where_it_pushes_and_along_its_thrust(config: Any) -> None:
    plant, sheet = config.build(1e-2, 1), published()
    for i, (place, direction) in enumerate(zip(sheet.positions, sheet.directions, strict=True), 1):
        for part in ("", "_propeller", "_hub"):
            at, axis = geom(plant, f"thruster_{i}{part}")
            assert at == pytest.approx(place, abs=NEAR)
            assert axis == pytest.approx(direction, abs=1e-3)


def test_a_nozzle_is_drawn_where_its_jet_leaves() -> None:
    plant = AstrobeePlant().build(1e-2, 1)
    nozzles = plant.system.columns("nozzle")
    assert len(nozzles) == 12
    for i, nozzle in enumerate(nozzles, 1):
        at, axis = geom(plant, f"nozzle_{i}")
        assert at == pytest.approx(nozzle.constants["point"], abs=NEAR)
        assert axis == pytest.approx(-nozzle.constants["direction"], abs=1e-3)


@pytest.mark.parametrize("vehicle", ["hummingbird", "crazyflie"])
def test_a_rotor_is_drawn_above_the_place_of_its_thrust(vehicle: str) -> None:
    plant, sheet = (
        QuadrotorPlant(vehicle=vehicle).build(1e-2, 1),
        published_numbers(vehicle)["rotors"],
    )
    for i, place in enumerate(sheet["places"], 1):
        at, axis = geom(plant, f"rotor_{i}")
        assert at[:2] == pytest.approx(sheet["arm"] / np.sqrt(2) * np.array(place), abs=1e-3)
        assert axis == pytest.approx([0, 0, 1])


def test_fins_and_propeller_are_drawn_where_their_forces_act() -> None:
    plant = REMUS100Plant().build(1e-2, 1)
    mounts = plant.system.mounts
    assert geom(plant, "propeller")[0] == pytest.approx(mounts[0], abs=NEAR)
    for name, mount in zip(FINS, mounts[2:6], strict=True):
        assert geom(plant, name)[0] == pytest.approx(mount, abs=NEAR)


@pytest.mark.parametrize("vehicle", ["f1tenth", "bmw320i"])
def test_wheels_are_drawn_at_the_axles_and_on_the_ground(vehicle: str) -> None:
    plant, sheet = CarPlant(vehicle=vehicle).build(1e-2, 1), published_numbers(vehicle)
    half = (sheet["front"] + sheet["rear"]) / 2
    for name in WHEELS:
        at, _ = geom(plant, f"wheel_{name}")
        assert at[0] == pytest.approx(half if name.startswith("front") else -half, abs=NEAR)
        assert at[2] == pytest.approx(plant.model.geom(f"wheel_{name}").size[0])


def test_the_rovers_wheels_are_at_its_axles() -> None:
    plant, sheet = RoverPlant().build(1e-3, 1), published_numbers("rover")
    for name in WHEELS:
        x = sheet["wheelbase"] / 2 * (1 if name.startswith("front") else -1)
        y = sheet["track"] / 2 * (1 if name.endswith("left") else -1)
        assert plant.model.body(name).pos == pytest.approx([x, y, 0], abs=NEAR)


def test_thrusters_that_are_drawn_change_no_force_of_mujocos_water() -> None:
    plant = BlueROV2Plant(mismatch=Mismatch(fluid="ellipsoid")).build(1e-2, 1)
    model = plant.model
    wet = {model.geom(i).name for i in range(model.ngeom) if model.geom_fluid[i, 0] > 0}
    assert "float_left" in wet and not any(name.startswith("thruster") for name in wet)
