"""Arms with a joint that no motor drives: an acrobot, and a cart with a pole."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from nsaid_mj import ArmPlant, FourierTracking, NullspaceAID, Scenario
from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.cli.commands import command
from nsaid_mj.clinic.identify.export import write_models
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.measured import LiveRobot
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.result import Identification
from nsaid_mj.clinic.logs.layout import layout
from nsaid_mj.clinic.logs.mapping import ColumnMap, Joint, Map
from nsaid_mj.clinic.logs.matching import match
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.clinic.logs.unusable import UnmatchedChannels
from nsaid_mj.lab.setup import Setup
from tests.support.robot_logs import write_csv

HEAD = (
    '<mujoco model="{}"><compiler angle="radian"/><default><joint damping="0.02" armature="0.01" '
    'frictionloss="0.01"/></default><worldbody>'
)
ACROBOT = HEAD.format("acrobot") + (
    '<body name="upper"><joint name="shoulder" axis="0 1 0"/>'
    '<geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.4" mass="0.6"/>'
    '<body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="0 1 0"/>'
    '<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.4" mass="0.4"/></body></body>'
    '</worldbody><actuator><motor joint="elbow"/></actuator></mujoco>'
)
CARTPOLE = HEAD.format("cartpole") + (
    '<body name="cart"><joint name="rail" type="slide" axis="1 0 0" range="-1 1" limited="true"/>'
    '<geom type="box" size="0.1 0.05 0.05" mass="1"/>'
    '<body name="pole"><joint name="pole" axis="0 1 0"/>'
    '<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.5" mass="0.3"/></body></body>'
    '</worldbody><actuator><motor joint="rail"/></actuator></mujoco>'
)
ROBOTS = {"acrobot": (ACROBOT, 1), "cartpole": (CARTPOLE, 0)}  # and the number of the driven joint


def logged(name: str, folder: Path) -> tuple[Path, Path, dict[str, float]]:
    """A robot's model file and a log of its motion, and true parameters by name."""
    text, driven = ROBOTS[name]
    (model := folder / f"{name}.xml").write_text(text, encoding="utf-8")
    scenario = Scenario(
        ArmPlant(robot=str(model)),
        FourierTracking(fundamental=0.2, harmonics=10),
        NullspaceAID(),
        duration=12.0,
        dt=2e-3,
        sensors="noisy",
        seed=5,
    )
    setup = Setup.of(scenario)
    with setup.plant.running():
        log = setup.simulate()
    angles, joints = setup.system.angles(log.q), setup.system.joint_names  # type: ignore[attr-defined]
    values = {"t": log.t}
    for k, joint in enumerate(joints):
        values |= {f"{joint}_position": angles[:, k], f"{joint}_velocity": log.v[:, k]}
    values[f"{joints[driven]}_torque"] = log.u[:, 0]
    truth = dict(zip(setup.system.space.names, setup.plant.truth.tolist(), strict=True))
    return model, write_csv(folder / f"{name}.csv", values), truth


@pytest.fixture(scope="module", params=list(ROBOTS))
def identified(request, tmp_path_factory) -> tuple[Identification, dict[str, float], int]:
    model, log, truth = logged(request.param, tmp_path_factory.mktemp("passive"))
    return identify_forces(str(model), [log]), truth, ROBOTS[request.param][1]


def test_parameters_are_covered(identified):
    result, truth, _ = identified
    assert result.explains in ("yes", "partly")
    found = [p for p in result.parameters if p.name in truth]
    assert len(found) == len(truth)
    assert [p.name for p in found if not p.low <= truth[p.name] <= p.high] == []
    (friction,) = (p for p in found if p.name == "coulomb_1")
    assert abs(friction.value / truth["coulomb_1"] - 1) < 0.3


def test_a_passive_joint_has_no_gain_and_the_exported_file_no_motor_for_it(identified, tmp_path):
    result, _, driven = identified
    assert [p.name for p in result.parameters if p.block == "motor gain"] == [f"gain_{driven + 1}"]
    files, (followed,) = write_models(result, tmp_path)
    (path,) = (str(file) for file in files if file.suffix == ".xml")
    exported = mujoco.MjModel.from_xml_path(path)
    assert exported.nu == 1 and exported.actuator_trnid[0, 0] == driven
    assert followed.level == "note" and "was not simulated" not in followed.text


def test_actuators_elsewhere_do_not_disturb_the_replay(tmp_path):
    """A site's number may be a joint's, and comes first here."""
    model, log, _ = logged("acrobot", tmp_path)
    text = ACROBOT.replace("</body></body>", '<site name="a"/><site name="b"/></body></body>')
    pull = '<actuator><general site="b"/><general site="a" gear="1 0 0 0 0 0"/>'
    model.write_text(text.replace("<actuator>", pull), encoding="utf-8")
    (tmp_path / "out").mkdir()
    (followed,) = write_models(identify_forces(str(model), [log]), tmp_path / "out")[1]
    exported = followed.data["exported"]
    assert isinstance(exported, list) and max(exported) < 5e-3


def test_residuals_of_a_passive_joint_have_a_reference_of_their_own(identified):
    """Relative to the other joint's command they would vanish with the link: so did its masses."""
    result, truth, _ = identified
    names = [name for name in truth if name.startswith("coulomb")]
    ratio = {p.name: p.value / truth[p.name] for p in result.parameters if p.name in names}
    assert max(ratio.values()) < 2 * min(ratio.values())


def test_a_gain_that_contradicts_the_masses_of_its_file_has_a_wide_interval(tmp_path):
    model, log, truth = logged("cartpole", tmp_path)
    text = CARTPOLE.replace('joint="rail"/>', 'joint="rail" gear="10"/>')
    model.write_text(text, encoding="utf-8")
    result = identify_forces(str(model), [log])
    (gain,) = (p for p in result.parameters if p.is_gain)
    assert gain.low < truth["gain_1"] < 0.5 * gain.value and gain.status != "identified"
    said = re.search(r"only to a factor of ([\d.]+)\. Next", result.verdict)
    assert said and gain.value / float(said[1]) < truth["gain_1"]


def test_an_inspections_map_is_accepted(tmp_path):
    model, log, _ = logged("cartpole", tmp_path)
    out, words = tmp_path / "inspection", ["--model", str(model), "--log", str(log)]
    command(["inspect", str(log), "--model", str(model), "--out", str(out)])
    words += ["--map", str(out / "map.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    assert command(["identify", *words]) == 0


def test_an_online_law_follows_its_log(tmp_path):
    model, log, _ = logged("acrobot", tmp_path)
    words = ["identify", "--model", str(model), "--log", str(log), "--law", "efficient"]
    assert command([*words, "--out", str(tmp_path / "out"), "--quiet"]) == 0


def test_live_it_takes_the_commands_of_motors_alone(tmp_path):
    (tmp_path / "a.xml").write_text(ACROBOT, encoding="utf-8")
    system = LiveRobot(robot=str(tmp_path / "a.xml")).known().system
    assert (system.n, system.n_u, len(system.space.actuators)) == (2, 1, 1)


def test_a_motor_without_a_command_is_still_a_mistake(tmp_path):
    (tmp_path / "a.xml").write_text(ACROBOT, encoding="utf-8")
    write_csv(tmp_path / "log.csv", {"t": np.arange(9.0), "q_1": np.ones(9), "q_2": np.ones(9)})
    with pytest.raises(UnmatchedChannels, match=r"No channels name a torque .* each of elbow"):
        identify_forces(str(tmp_path / "a.xml"), [tmp_path / "log.csv"])


def test_a_map_must_name_the_command_of_a_motor(tmp_path):
    (tmp_path / "a.xml").write_text(ACROBOT, encoding="utf-8")
    robot = load_robot_model(str(tmp_path / "a.xml"))
    joints = {name: Joint(position=ColumnMap(column=name)) for name in robot.joints}
    write_csv(tmp_path / "log.csv", dict.fromkeys(["t", *robot.joints], np.arange(9.0)))
    with pytest.raises(InvalidInput, match=r"joints\.elbow\.command"):
        layout(Map(joints=joints), robot, read_tables([tmp_path / "log.csv"]))


def test_a_log_with_commands_of_all_joints_keeps_them():
    channels = ["q_1", "q_2", "tau_1", "tau_2"]
    joints = match(channels, ["a", "b"], ["b"]).joints
    assert [joint.command and joint.command.column for joint in joints.values()] == channels[2:]


def test_designing_its_motion_is_refused_with_a_way_out(tmp_path):
    (tmp_path / "a.xml").write_text(ACROBOT, encoding="utf-8")
    words = ["excite", "--model", str(tmp_path / "a.xml"), "--for", "all"]
    with pytest.raises(InvalidInput, match="nsaid run arm --robot"):
        command([*words, "--out", str(tmp_path / "out")])
