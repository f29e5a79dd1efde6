"""Experiments with robots of one's own: files in, limits of the model as defaults."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.lab.control.multisine import MultisineCommand
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.plans.excite.experiment import Experiment, own_limits, scenario_of_model
from nsaid_mj.plans.excite.limits import COMMAND, RANDOM, Limit, Limits
from nsaid_mj.plans.excite.motions import DrivenMotions
from nsaid_mj.robots.assets import VehicleFiles
from nsaid_mj.robots.errors import BadRobot

XML = """
<mujoco model="two"><compiler angle="radian"/>
  <default><joint damping="0.4" armature="0.02"/></default><worldbody>
  <body><joint name="a" axis="0 1 0" range="-2 1"/><geom size="0.1" pos="0.2 0 0" mass="2"/>
    <body pos="0.4 0 0"><joint name="b" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0" mass="1"/>
  </body></body></worldbody>
  <actuator><motor joint="a" gear="30" ctrlrange="-2 2"/><motor joint="b"/></actuator></mujoco>"""


def random_limits(n: int) -> Limits:
    units = {"position": "rad", "speed": "rad/s", "acceleration": "rad/s²", "torque": "N·m"}
    limits = {name: Limit(-np.full(n, 7.0), np.full(n, 7.0), unit) for name, unit in units.items()}
    return Limits(limits, sources=dict.fromkeys(limits, RANDOM))


def test_an_mjcf_becomes_an_arm_with_the_limits_of_its_file(tmp_path):
    path = tmp_path / "two.xml"
    path.write_text(XML)
    scenario = scenario_of_model(str(path))
    plant = scenario.plant
    assert isinstance(plant, ArmPlant)
    assert plant.robot == str(path)
    system = Experiment.of(scenario).system
    assert isinstance(system, JointTree) and system.scales.rotor is not None
    assert system.scales.viscous.tolist() == [0.4, 0.4]
    assert system.scales.rotor.tolist() == [0.02, 0.02]
    limits = own_limits(system, random_limits(2))
    high = {name: limit.high.tolist() for name, limit in limits.limits.items()}
    assert high == {
        "position": [1, np.pi],
        "speed": [7, 7],
        "acceleration": [7, 7],
        "torque": [60, 7],
    }
    assert limits.sources == {
        "position": "model; ±π for b",
        "speed": "random motions, as the model has none",
        "acceleration": "random motions",
        "torque": "model; random motions for b",
    }


def test_a_urdf_brings_its_own_speed_and_effort():
    scenario = scenario_of_model("ur5")
    system = Experiment.of(scenario).system
    limits = own_limits(system, random_limits(6))
    assert limits.limits["torque"].high.tolist() == system.model.effortLimit.tolist()
    assert limits.limits["speed"].high.tolist() == system.model.velocityLimit.tolist()
    assert limits.sources["torque"] == "model"


def test_a_vehicles_file_gets_the_excitation_of_its_family(tmp_path):
    sheet = tmp_path / "mine.toml"
    files = VehicleFiles.of("bluerov2")
    sheet.write_bytes(files.sheet.read_bytes())
    (tmp_path / "model.xml").write_bytes(files.model.read_bytes())
    scenario = scenario_of_model(str(sheet))
    known = load("bluerov2")
    assert scenario.excitation == known.excitation
    assert type(scenario.plant) is type(known.plant)
    assert scenario.plant.vehicle == str(sheet)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(BadRobot, match="no such file"):
        Experiment.of(scenario_of_model(str(tmp_path / "none.urdf")))
    with pytest.raises(BadRobot, match="no such file"):
        Experiment.of(scenario_of_model(str(tmp_path / "none.xml")))


def test_the_amplitude_of_a_vehicle_keeps_a_given_limit_of_commands():
    scenario = replace(load("bluerov2"), duration=2.0)
    experiment = Experiment.of(scenario)
    half = np.full(experiment.system.n_u, 0.5)
    limits = Limits({COMMAND: Limit(-half, half, "")})
    motions = DrivenMotions(experiment, limits, scenario.excitation)
    driver = motions.driver(motions.random(np.random.default_rng(0)))
    assert isinstance(driver.driver, MultisineCommand)
    assert driver.driver.amplitude == 0.5
    log = experiment.simulate(driver, 0, 2.0)
    assert log is not None
    assert 0.3 < np.abs(log.u).max() <= 0.5
