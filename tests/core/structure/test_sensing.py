"""What sensors measure: their names, and constant errors."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from tests.support.poses import pose_difference


@cache
def made(name: str) -> SecondOrderSystem:
    """Not at import: both workers would wait for one compilation."""
    return Setup.of(load(name)).system


def test_an_error_of_a_place_is_along_a_world_axis_whatever_the_attitude() -> None:
    rov = made("bluerov2")
    q = rov.random_state(np.random.default_rng(1))[0]
    read = rov.displaced(q, np.array([0, 0.2, 0, 0, 0, 0.0]))
    np.testing.assert_allclose(read - q, [0, 0.2, 0, 0, 0, 0, 0], atol=1e-15)


def test_an_error_of_an_attitude_is_a_turn_about_an_axis_of_the_body() -> None:
    rov = made("bluerov2")
    q = rov.random_state(np.random.default_rng(2))[0]
    read = rov.displaced(q, np.array([0, 0, 0, 0.1, 0, 0.0]))
    np.testing.assert_allclose(read[:3], q[:3], atol=1e-15)
    np.testing.assert_allclose(pose_difference(q, read), [0, 0, 0, 0.1, 0, 0], atol=1e-14)


@pytest.mark.parametrize("name", ["bluerov2", "ur5"])
def test_the_opposite_error_undoes_one_of_a_single_sensor(name) -> None:
    system, rng = made(name), np.random.default_rng(3)
    for error in 0.3 * np.eye(system.n):
        q = system.random_state(rng)[0]
        back = system.displaced(system.displaced(q, error), -error)
        np.testing.assert_allclose(back, q, atol=1e-14)


def test_every_sensor_has_a_name_and_a_unit() -> None:
    rov, arm = made("bluerov2"), made("ur5")
    assert rov.sensors[2] == ("position of z", "m")
    assert rov.sensors[6] == ("velocity of surge", "m/s")
    assert arm.sensors[8] == ("velocity of elbow_joint", "rad/s")
    assert arm.sensors[2] == ("position of elbow_joint", "rad")
