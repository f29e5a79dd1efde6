"""`nsaid identify` with logs of targets and positions."""

import json

import mujoco
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.base.files import OutputFolder
from nsaid_mj.cli.commands import command
from tests.clinic.servos import simulated
from tests.support.lerobot import write_dataset


def test_so101_is_a_demo_with_a_line_for_every_servo(tmp_path, capsys):
    out = tmp_path / "found"
    assert command(["identify", "so101", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    for joint in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"):
        assert f"\n  {joint} " in said
    assert "identification.json" in said
    assert (out / OutputFolder.RECORDING).is_file()  # which `nsaid view` opens
    found = json.loads((out / "identification.json").read_text())
    assert found["law"] == "output error" and found["explains"] == "yes"
    lift = next(servo for servo in found["servos"] if servo["name"] == "shoulder_lift")
    assert 8 < lift["kp"] < 20  # the file has 998
    (replay,) = [f for f in found["findings"] if f["code"] == "replay"]
    assert sum(replay["data"]["exported"]) < 0.2 * sum(replay["data"]["nominal"])
    mujoco.MjModel.from_xml_path(str(out / f"{found['robot']}.xml"))


@pytest.mark.parametrize(
    "option,value", [("--cutoff", "5"), ("--law", "memory"), ("--law", "efficient")]
)
def test_options_of_the_other_laws_are_refused(tmp_path, option, value):
    with pytest.raises(InvalidInput, match=option):
        command(["identify", "so101", option, value, "--out", str(tmp_path / "found")])


@pytest.mark.parametrize(
    "load,said",
    [
        ("0.2kg", "FILE:MASSkg"),
        ("other.csv:0.2kg", "name of a log"),
        ("log.csv.gz:200g", "no load"),
    ],
)
def test_a_load_that_cannot_tell_anything_is_refused(tmp_path, load, said):
    with pytest.raises(InvalidInput, match=said):
        command(["identify", "so101", "--load", load, "--out", str(tmp_path / "found")])


@pytest.mark.parametrize("version", [pytest.param("v2.1", marks=pytest.mark.slow), "v3.0"])
def test_three_commands_lead_from_a_lerobot_dataset_to_a_calibrated_file(tmp_path, version, capsys):
    episodes = []
    for seed in range(2):
        _, u, q = simulated.log(seed, 20.0)
        episodes.append((degrees(q), degrees(u)))
    names = [f"{joint}.pos" for joint in simulated.JOINTS]
    data, out = write_dataset(tmp_path / "set", version, episodes, names), tmp_path / "out"
    model = ["--model", str(simulated.MODEL)]
    assert command(["inspect", str(data), *model, "--out", str(out)]) == 2  # degrees, as rad
    mapped = [*model, "--map", str(out / "map.toml")]
    assert command(["inspect", str(data), *mapped, "--out", str(out / "again")]) == 0
    found = ["--log", str(data), "--out", str(out / "found"), "--quiet"]
    capsys.readouterr()
    assert command(["identify", *mapped, *found]) == 0
    assert capsys.readouterr().out == ""
    (file,) = (out / "found").glob("*.xml")
    mj = mujoco.MjModel.from_xml_path(str(file))
    for joint in (1, 2, 3):  # those that lift the arm
        assert mj.actuator_gainprm[joint, 0] == pytest.approx(simulated.KP[joint], rel=0.15)


def degrees(x):
    """As LeRobot writes them; the wrist's roll is seen from a horn that is turned by 80°."""
    low, high = -0.174533, 1.745329
    gripper = 100 * (x[:, 5] - low) / (high - low)
    return np.column_stack([np.rad2deg(x[:, :4]), np.rad2deg(x[:, 4]) + 80, gripper])
