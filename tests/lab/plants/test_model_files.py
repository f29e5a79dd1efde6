"""Plants of users' own files: a Furuta pendulum, whose swing has no motor, as URDF and as MJCF."""

import numpy as np
import pytest

from nsaid_mj.lab.control.multisine import MultisineCommand
from nsaid_mj.lab.control.tracking import FourierTracking
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.world.simulated import SimulatedRobot
from nsaid_mj.robots.errors import RobotChanged
from tests.support.plants import assert_engines_agree

LINK = (
    '<link name="{}"><inertial><origin xyz="0.1 0.02 -0.1"/><mass value="{}"/><inertia ixx="0.02" '
    'iyy="0.03" izz="0.025" ixy="0.001" ixz="0" iyz="-0.002"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/>'
    '<origin xyz="0.2 0 0.1"/><axis xyz="{3}"/><limit effort="{4}" velocity="9"/></joint>'
)
URDF = (
    '<robot name="furuta"><link name="base"/>'
    + LINK.format("arm", 0.4)
    + LINK.format("pendulum", 0.2)
    + JOINT.format("drive", "base", "arm", "0 0 1", 5)
    + JOINT.format("swing", "arm", "pendulum", "1 0 0", 0)
    + "</robot>"
)
MJCF = """<mujoco model="furuta"><compiler angle="radian"/>
  <default><joint damping="0.01" armature="0.002"/></default><worldbody>
  <body name="drive"><joint name="drive" axis="0 0 1"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0" mass="0.4"/>
    <body name="swing" pos="0.2 0 0"><joint name="swing" axis="1 0 0"{spring}/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.2"/></body></body>
  </worldbody><actuator><motor joint="drive" gear="2"/></actuator></mujoco>"""


@pytest.fixture(params=["urdf", "xml"])
def file(request, tmp_path):
    path = tmp_path / f"furuta.{request.param}"
    path.write_text(URDF if request.param == "urdf" else MJCF.format(spring=""))
    return str(path)


def built(file: str, **options) -> SimulatedRobot:
    return ArmPlant(robot=file, **options).build(1e-3, 0)


@pytest.mark.parametrize("backend", ["compiled", "pinocchio"])
@pytest.mark.parametrize("actuator", ["motor", "servo"])
def test_a_passive_joint_has_no_motor_in_either_engine(file, backend, actuator):
    plant = built(file, backend=backend, actuator=actuator)
    assert (plant.system.n, plant.system.n_u, plant.model.nu) == (2, 1, 1)
    assert [plant.system.space.labels[i] for i in plant.system.space.actuators] in (
        ["gain of drive"],
        ["servo gain of drive"],
    )
    for seed in range(3):
        assert_engines_agree(plant, seed)


def test_theta_makes_the_same_plant_again(file):
    plant = built(file)
    again = ArmPlant(robot=file).simulating(1e-3, plant.truth)
    assert np.allclose(again.truth, plant.truth, rtol=1e-12, atol=1e-12)


def test_motors_are_driven_and_a_passive_joint_swings(file):
    plant, rng = built(file), np.random.default_rng(0)
    driver = FourierTracking(speed=1.0).build(plant.system, plant.truth, rng)
    log = plant.trajectory(driver, 3000)
    errors = plant.system.angles(log.q) - np.array([driver.desired(t)[0] for t in log.t])
    assert log.u.shape == (3001, 1)
    assert np.abs(errors[:, 0]).max() < 0.1 < np.ptp(plant.system.angles(log.q), axis=0).min()
    driver = MultisineCommand().build(plant.system, plant.truth, rng)
    assert driver.command(0.1, plant.position(np.zeros(2)), np.zeros(2)).shape == (1,)


def test_an_mjcf_brings_frictions_rotors_and_shapes(tmp_path):
    path = tmp_path / "furuta.xml"
    path.write_text(MJCF.format(spring=""))
    plant = ArmPlant(robot=str(path), spread=0.0).build(1e-3, 0)
    space, truth = plant.system.space, plant.truth
    assert np.allclose(truth[space["viscous friction"]], 0.01)
    assert np.allclose(truth[space["rotor inertia"]], 0.002)
    assert len(plant.visuals()) == 2
    places, _ = plant.poses(np.zeros((1, 2)))
    assert np.allclose(places[0], [[0.1, 0, 0], [0.2, 0, -0.15]])


def test_what_a_simulation_of_an_mjcf_lacks_is_told(tmp_path, recwarn):
    path = tmp_path / "furuta.xml"
    path.write_text(MJCF.format(spring=""))
    built(str(path))
    assert not [w for w in recwarn if issubclass(w.category, RobotChanged)]
    path.write_text(MJCF.format(spring=' stiffness="3"'))
    with pytest.warns(RobotChanged, match="springs of swing"):
        built(str(path))
