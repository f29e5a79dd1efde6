"""An MJCF's tree as a URDF: the same dynamics, limits and shapes."""

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.calibration.models import load_robot_model
from nsaid_mj.errors import BadRobot, InvalidInput
from nsaid_mj.robot.robots import load_robot
from nsaid_mj.robot.tree import RobotVisuals
from nsaid_mj.robot.urdf_tree import write_tree_urdf

ARM = """
<mujoco model="arm"><option gravity="0 0 {gravity}"/><compiler angle="radian"/>
  <worldbody><body pos="0 0 0.6"><geom type="cylinder" size="0.06 0.05"/>
    <body name="upper" pos="0 0 0.1" euler="0.1 0.2 0.3">
      <joint name="pan" axis="0 0 1" range="-2.8 2.8" damping="0.5"/>
      <geom type="cylinder" size="0.05 0.08" mass="2.5"/>
      <body name="fore" pos="0 0.06 0.1" euler="0.3 0 0">
        <joint name="lift" axis="1 1 0" range="-1.5 1.5" actuatorfrcrange="-60 60" pos="0 0.02 0"/>
        <geom type="capsule" size="0.04" fromto="0 0 0 0 0 0.35" mass="2"/>
        <body name="hand" pos="0 0.05 0.4"><joint name="reach" type="slide" axis="0 1 0"/>
          <geom type="box" size="0.03 0.05 0.1" pos="0.02 0.03 0.08" mass="0.9"/>
  </body></body></body></body></worldbody>
  <actuator><motor joint="pan" gear="50" ctrlrange="-1 1"/><motor joint="lift"/></actuator>
</mujoco>"""


@pytest.fixture
def both(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(gravity=-9.81))
    own = load_robot_model(str(path))
    write_tree_urdf(own, tmp_path / "robot.urdf")
    return own, load_robot(str(tmp_path / "robot.urdf"))


def test_the_urdf_has_the_forces_of_the_mjcf(both):
    own, read = both
    rng = np.random.default_rng(0)
    for _ in range(3):
        q, v, a = rng.uniform(-1, 1, (3, 3))
        forces = [pin.rnea(m, m.createData(), q, v, a) for m in (own.model, read.model)]
        np.testing.assert_allclose(forces[1], forces[0], atol=1e-12)


def test_the_urdf_has_the_limits_of_joints_and_motors(both):
    model = both[1].model
    assert list(model.names)[1:] == ["pan", "lift", "reach"]
    assert model.effortLimit.tolist() == [50, 60, 0]
    assert model.velocityLimit.tolist() == [0, 0, 0]
    assert model.lowerPositionLimit.tolist() == [-2.8, -1.5, -1.0]
    assert model.damping.tolist() == [0.5, 0, 0]


def test_the_shapes_are_where_they_were(both):
    own, read = both
    q = np.array([[0.3, -0.4, 0.2]])
    expected, found = own.visuals.poses(q), RobotVisuals(read).poses(q)
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_allclose(np.abs(other), np.abs(one), atol=1e-9)
    assert len(RobotVisuals(read).visuals()) == len(own.visuals.visuals()) == 4


def test_another_gravity_is_refused_since_a_urdf_has_none(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(gravity=-1.6))
    with pytest.raises(BadRobot, match="gravity"):
        write_tree_urdf(load_robot_model(str(path)), tmp_path / "robot.urdf")


def test_what_is_a_urdf_already_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="MJCF"):
        write_tree_urdf(load_robot_model("ur5"), tmp_path / "robot.urdf")
