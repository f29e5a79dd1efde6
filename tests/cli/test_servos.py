"""`nsaid identify` with logs of targets and positions."""

import json

import mujoco
import pytest

from nsaid_mj.cli.commands import command
from nsaid_mj.errors import InvalidInput


def test_so101_is_a_demo(tmp_path, capsys):
    out = tmp_path / "found"
    assert command(["identify", "so101", "--out", str(out), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    found = json.loads((out / "identification.json").read_text())
    assert found["law"] == "output error" and found["explains"] == "yes"
    lift = next(servo for servo in found["servos"] if servo["name"] == "shoulder_lift")
    assert 8 < lift["kp"] < 20  # the file has 998
    (replay,) = [f for f in found["findings"] if f["code"] == "replay"]
    assert sum(replay["data"]["exported"]) < 0.2 * sum(replay["data"]["nominal"])
    mujoco.MjModel.from_xml_path(str(out / f"{found['robot']}.xml"))


def test_options_of_the_other_law_are_refused(tmp_path):
    options = ["--cutoff", "5", "--out", str(tmp_path / "found")]
    with pytest.raises(InvalidInput, match="--cutoff"):
        command(["identify", "so101", *options])


def test_the_table_has_a_line_for_every_servo(tmp_path, capsys):
    assert command(["identify", "so101", "--out", str(tmp_path / "found")]) == 0
    said = capsys.readouterr().out
    for joint in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"):
        assert f"\n {joint}" in said
    assert "identification.json" in said
