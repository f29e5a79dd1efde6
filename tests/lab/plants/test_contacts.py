"""Contacts of an arm with itself and with the ground."""

import numpy as np
import pytest

from nsaid_mj.lab.plants.world.contacts import Contacts
from nsaid_mj.robots.loading import load_robot


@pytest.fixture(scope="module")
def contacts() -> Contacts:
    robot = load_robot("ur5")
    return Contacts(robot, (np.full(6, -3.0), np.full(6, 3.0)))


def test_an_upright_arm_touches_nothing(contacts):
    assert contacts.known
    assert contacts.touching(np.array([[0, -np.pi / 2, 0, 0, 0, 0]])) == [""]


def test_an_arm_that_points_down_touches_the_ground(contacts):
    (words,) = contacts.touching(np.array([[0, 1.0, 0, 0, 0, 0]]))
    assert "ground" in words


def test_a_folded_arm_touches_itself(contacts):
    (words,) = contacts.touching(np.array([[0, -np.pi / 2, 3.0, 0, 0, 0]]))
    assert words
    assert "ground" not in words or "and" in words


def test_a_robot_without_meshes_has_no_known_shape():
    robot = load_robot("double_pendulum")
    found = Contacts(robot, (-np.ones(2), np.ones(2)))
    assert found.touching(np.zeros((2, 2))) == ["", ""] or found.known
