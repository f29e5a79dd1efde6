"""What sensors measure: their names, and constant errors."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.setup import Setup
from nsaid_mj.structure.sensing import displaced, sensor_labels, sensor_units
from tests.support.poses import pose_difference

ROV, ARM = (Setup.of(load(name)).system for name in ("bluerov2", "ur5"))


def test_an_error_of_a_place_is_along_a_world_axis_whatever_the_attitude() -> None:
    q = ROV.random_state(np.random.default_rng(1))[0]
    read = displaced(ROV, q, np.array([0, 0.2, 0, 0, 0, 0.0]))
    np.testing.assert_allclose(read - q, [0, 0.2, 0, 0, 0, 0, 0], atol=1e-15)


def test_an_error_of_an_attitude_is_a_turn_about_an_axis_of_the_body() -> None:
    q = ROV.random_state(np.random.default_rng(2))[0]
    read = displaced(ROV, q, np.array([0, 0, 0, 0.1, 0, 0.0]))
    np.testing.assert_allclose(read[:3], q[:3], atol=1e-15)
    np.testing.assert_allclose(pose_difference(q, read), [0, 0, 0, 0.1, 0, 0], atol=1e-14)


@pytest.mark.parametrize("system", [ROV, ARM])
def test_the_opposite_error_undoes_one_of_a_single_sensor(system) -> None:
    rng = np.random.default_rng(3)
    for error in 0.3 * np.eye(system.n):
        q = system.random_state(rng)[0]
        back = displaced(system, displaced(system, q, error), -error)
        np.testing.assert_allclose(back, q, atol=1e-14)


def test_every_sensor_has_a_name_and_a_unit() -> None:
    assert sensor_labels(ROV)[2] == "position of z" and sensor_units(ROV)[2] == "m"
    assert sensor_labels(ROV)[6] == "velocity of surge" and sensor_units(ROV)[6] == "m/s"
    assert sensor_labels(ARM)[8] == "velocity of elbow_joint" and sensor_units(ARM)[8] == "rad/s"
    assert sensor_labels(ARM)[2] == "position of elbow_joint" and sensor_units(ARM)[2] == "rad"
