"""Logs of attitude and rates alone: the rotation is identified, the rest left out by name."""

from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.identify import identify
from nsaid_mj.clinic.identify.inspection import inspect
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.mapping import map_of, read_map
from nsaid_mj.clinic.logs.tables import Channel, LogTable, read
from nsaid_mj.clinic.logs.unusable import UnusableLog
from tests.court.field_commands import draw_constant

TURNS = '[vehicle]\nquaternion = ["q_3", "q_4", "q_5", "q_6"]\n'
RATES = 'angular = ["v_3", "v_4", "v_5"]\n'
INERTIA = "effective yaw inertia"


def _map(folder: Path, vehicle: str, name: str = "bluerov2", **actuators: str) -> Path:
    joints = load_robot_model(name).joints
    columns = {joint: f"u_{k}" for k, joint in enumerate(joints)} | actuators
    lines = [f'"{joint}" = {{ column = "{column}" }}' for joint, column in columns.items()]
    path = folder / "map.toml"
    path.write_text(vehicle + "[actuators]\n" + "\n".join(lines), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def dive(tmp_path_factory):
    return draw_constant(3, tmp_path_factory.mktemp("dive"), 12.0, "bluerov2")


@pytest.fixture(scope="module")
def rotation(dive):
    folder = dive.logs[0].parent
    mapping = _map(folder, TURNS + RATES)
    known = {INERTIA: dive.truth[INERTIA]}
    return identify("bluerov2", dive.logs, mapping=mapping, known=known, delay=0.005, cutoff=4.0)


def test_the_rotation_of_a_rov_is_identified_from_attitude_and_rates(dive, rotation):
    held = {joint.name: joint.held_out for joint in rotation.joints}
    assert all(np.isnan(held[name]) for name in ("surge", "sway", "heave"))
    assert max(held[f"{axis} rate"] for axis in ("roll", "pitch", "yaw")) < 0.1
    told = [p for p in rotation.parameters if p.status == "identified"]
    assert len(told) >= 9  # thrusters that move, inertias
    missed = [p.label for p in told if not p.low <= dive.truth[p.label] <= p.high]
    assert len(missed) <= 1


def test_what_is_left_out_is_named_and_not_identified(rotation):
    (finding,) = [f for f in rotation.findings if f.code == "rotation_alone"]
    assert finding.data["left_out"] == ["surge", "sway", "heave"]
    assert "surge, sway, heave are not measured and cannot be judged" in rotation.verdict
    own = {p.label: p for p in rotation.parameters}
    for label in ("linear drag in surge", "quadratic drag in heave", "net weight"):
        assert own[label].status == "not excited"


def test_a_weighed_mass_does_not_fix_the_scale_of_a_rotation(dive, tmp_path):
    found = identify(
        "bluerov2", dive.logs, mapping=_map(tmp_path, TURNS + RATES), known={"m": 13.5}
    )
    assert found.explains == "partly"
    assert "does not fix its scale" in str(found.findings)
    assert not any(p.status == "identified" for p in found.gains)


def test_rates_along_other_axes_than_the_attitude_are_refused(dive, tmp_path):
    mapping = _map(tmp_path, TURNS + 'angular = ["v_3", "-v_4", "-v_5"]\n')
    with pytest.raises(UnusableLog, match="angular"):
        identify("bluerov2", dive.logs, mapping=mapping)


def _table(dive) -> LogTable:
    table = read(dive.logs[0])
    time = table.channels["q_2"].t
    rng = np.random.default_rng(0)
    felt = {f"a_{k}": Channel(time, 0.1 * rng.standard_normal(len(time))) for k in range(3)}
    felt["depth"] = Channel(time, -table.channels["q_2"].values)
    return LogTable(table.source, table.channels | felt, table.origin)


def test_a_depth_is_a_vertical_velocity(dive, tmp_path):
    text = TURNS + RATES + 'depth = "depth"\nacceleration = ["a_0", "a_1", "a_2"]\n'
    robot = load_robot_model("bluerov2")
    mapping = read_map(_map(tmp_path, text))
    recordings = inspect([_table(dive)], mapping, robot).recordings
    assert recordings is not None and recordings.turns_only
    segment = max(recordings.segments, key=lambda one: len(one.log.t))
    np.testing.assert_allclose(segment.log.q[:, 0], 0.0)
    rise = np.gradient(segment.log.q[:, 2], 1 / recordings.rate)
    speed = np.linalg.norm(segment.log.v[:, :3], axis=1)
    assert np.corrcoef(np.abs(rise)[5:-5], speed[5:-5])[0, 1] > 0.98
    assert segment.specific is not None and segment.specific.shape == (len(segment.log.t), 3)


def test_all_that_is_missing_is_said_at_once(dive):
    table = read(dive.logs[0])
    names = {"q_3": "qx", "q_4": "qy", "q_5": "qz", "q_6": "qw"}
    some = {new: table.channels[old] for old, new in names.items()}
    found = inspect([LogTable("a.csv", some, 0)], None, load_robot_model("bluerov2"))
    (text,) = [f.text for f in found.findings if f.code == "unmatched"]
    assert "commands of thruster 1" in text.partition("Names tell")[0]
    for word in ("Position or linear velocity", "angular velocity", "depth or acceleration"):
        assert word in text
    assert "the rotation alone is identified" in text


@pytest.mark.parametrize(
    ("vehicle", "word"),
    [
        ({"angular": ["p", "q", "r"]}, "no quaternion or euler"),
        ({"quaternion": ["a", "b", "c", "d"], "euler": ["e", "f", "g"]}, "quaternion and euler"),
        (
            {
                "quaternion": ["a", "b", "c", "d"],
                "position": ["x", "y", "z"],
                "depth": "h",
            },
            "depth",
        ),
    ],
)
def test_parts_of_a_motion_that_do_not_fit_are_named(vehicle, word):
    robot = load_robot_model("bluerov2")
    actuators = {joint: {"column": f"u{k}"} for k, joint in enumerate(robot.joints)}
    mapping = map_of({"vehicle": vehicle, "actuators": actuators})
    table = LogTable("a.csv", {"u0": Channel(np.arange(9.0), np.zeros(9))}, 0)
    with pytest.raises(InvalidInput, match=word):
        inspect([table], mapping, robot)


def test_a_log_without_commands_names_all_of_them():
    robot = load_robot_model("bluerov2")
    mapping = map_of({"vehicle": {"quaternion": ["a", "b", "c", "d"]}})
    with pytest.raises(InvalidInput, match=r"thruster 1, .*thruster 8"):
        inspect([LogTable("a.csv", {}, 0)], mapping, robot)


def test_a_law_along_a_log_of_a_rotation_is_refused(dive, tmp_path):
    with pytest.raises(InvalidInput, match="translation is not measured"):
        identify("bluerov2", dive.logs, mapping=_map(tmp_path, TURNS + RATES), law="memory")
