"""`nsaid excite` and `nsaid run --excitation designed:FOLDER`."""

import json

import pytest

from nsaid_mj.base.errors import BadRun, InvalidInput
from nsaid_mj.cli.commands import command
from nsaid_mj.cli.excitation import without_excitation
from nsaid_mj.lab.library import load

XML = """
<mujoco model="two"><compiler angle="radian"/>
  <default><joint damping="0.4" armature="0.02"/></default><worldbody><body pos="0 0 1">
    <joint name="a" axis="0 1 0" range="-2 1"/><geom size="0.08" pos="0.2 0 0" mass="2"/>
    <body pos="0.4 0 0"><joint name="b" axis="0 1 0"/><geom size="0.08" pos="0.2 0.02 0" mass="1"/>
  </body></body></worldbody>
  <actuator><motor joint="a" gear="40" ctrlrange="-1 1"/>
    <motor joint="b" ctrlrange="-20 20"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("excite") / "design"
    words = ["excite", "double_pendulum", "--duration", "3", "--effort", "0.004", "--quiet"]
    assert command([*words, "--for", "gains", "--out", str(out)]) == 0
    return out


def test_excite_writes_a_motion_a_scenario_a_page_and_a_recording(folder):
    names = {path.name for path in folder.iterdir()}
    assert names == {
        ".nsaid-mj.json",
        "design.json",
        "design.rrd",
        "motion.csv",
        "report.html",
        "scenario.json",
        "scenario.py",
    }
    document = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    assert max(document["uses"].values()) <= 1
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert ("best remedy" in page) == bool(document["weak"])
    head, *rows = (folder / "motion.csv").read_text(encoding="utf-8").splitlines()
    assert head == "t,q_joint1,q_joint2,v_joint1,v_joint2,a_joint1,a_joint2"
    assert len(rows) == 1 + round(3 / load("double_pendulum").dt)


def test_the_scenario_of_a_design_is_one_to_run(folder):
    scenario = load(str(folder / "scenario.py"))
    assert scenario.sensors == "noisy"
    assert scenario.duration == 3


def test_a_design_is_not_overwritten_silently(folder):
    with pytest.raises(BadRun, match="--force"):
        command(["excite", "double_pendulum", "--out", str(folder)])


def test_an_mjcf_is_designed_for_within_its_own_limits(tmp_path):
    model = tmp_path / "two.xml"
    model.write_text(XML, encoding="utf-8")
    out = tmp_path / "design"
    words = ["--duration", "2", "--effort", "0.004", "--quiet", "--out", str(out)]
    assert command(["excite", "--model", str(model), *words]) == 0
    document = json.loads((out / "design.json").read_text(encoding="utf-8"))
    assert document["limits"]["torque"]["high"] == [40, 20]
    assert document["limits"]["torque"]["source"] == "model"
    assert max(document["uses"].values()) <= 1
    assert any("payload" in remedy["words"] for remedy in document["remedies"])
    assert load(str(out / "scenario.py")).plant.robot == str(model)


def test_excite_without_a_robot_says_what_to_give():
    with pytest.raises(InvalidInput, match="nsaid excite ur5"):
        command(["excite"])


def test_the_flag_excitation_is_taken_out_of_a_command_line():
    rest = ["--duration", "3"]
    assert without_excitation([*rest, "--excitation", "designed"]) == ("designed", rest)
    assert without_excitation(["--excitation=designed:a", *rest]) == ("designed:a", rest)
    assert without_excitation(rest) == ("", rest)
    with pytest.raises(InvalidInput, match="nothing"):
        without_excitation(["--excitation"])
