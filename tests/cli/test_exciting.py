"""`nsaid excite` and `nsaid run --excitation designed:FOLDER`."""

import json

import pytest

from nsaid_mj.cli.commands import command
from nsaid_mj.cli.exciting import without_excitation
from nsaid_mj.errors import BadRun, InvalidInput
from nsaid_mj.experiment.library import load


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("excite") / "design"
    words = ["excite", "double_pendulum", "--duration", "3", "--effort", "0.004", "--quiet"]
    assert command([*words, "--for", "gains", "--out", str(out)]) == 0
    return out


def test_excite_writes_a_motion_a_scenario_a_page_and_a_recording(folder):
    names = {path.name for path in folder.iterdir()}
    assert names == {
        "design.json", "design.rrd", "motion.csv", "report.html", "scenario.json", "scenario.py",
    }  # fmt: skip
    document = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    assert max(document["uses"].values()) <= 1
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
