"""Every robot of example-robot-data is built, or refused with a reason."""

import pytest

from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.robots.assets import known_robots
from nsaid_mj.robots.errors import BadRobot


@pytest.mark.slow
def test_61_robots_build_and_the_others_say_why():
    """Building compares MuJoCo's M and bias forces with Pinocchio's."""
    built, refused = [], []
    for name in known_robots():
        try:
            ArmPlant(name).build(1e-3, 0)
            built.append(name)
        except BadRobot as error:
            refused.append(str(error))
    assert len(built) >= 61, refused
