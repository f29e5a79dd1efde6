"""Which logs are of targets and positions, and what is read from them."""

import re

import numpy as np
import pytest

import nsaid_mj
from nsaid_mj.base.errors import InvalidInput, NsaidError
from nsaid_mj.clinic.identify.inspection import inspect
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.mapping import map_of
from nsaid_mj.clinic.logs.matching import match_targets
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.clinic.servos.logs import settled
from nsaid_mj.robots.assets import asset

from .simulated import JOINTS, MODEL, write


@pytest.fixture
def motion():
    t = np.arange(0, 12, 0.02)
    u = 0.5 * np.sin(t[:, None] * np.arange(1, 7) / 2)
    return t, u, np.vstack([u[:4] * 0, u[:-4]])


@pytest.mark.parametrize(
    "pattern",
    [
        *("target_{}", "{}.goal_position", "action.{}.pos", "{}_cmd_position", "des_{}"),
        "control/position_{}",
    ],
)
def test_targets_are_matched_by_name(pattern):
    channels = [pattern.format(joint) for joint in JOINTS]
    others = [f"position_{joint}" for joint in JOINTS]
    assert match_targets(channels + others, JOINTS) == dict(zip(JOINTS, channels, strict=True))


@pytest.mark.parametrize(
    "pattern", ["target_velocity_{}", "goal_current_{}", "position_{}", "ctrl_{}"]
)
def test_other_channels_are_no_targets(pattern):
    assert match_targets([pattern.format(joint) for joint in JOINTS], JOINTS) == {}


def test_a_log_of_torques_is_left_to_the_other_law(motion, tmp_path):
    path = write(tmp_path / "log.csv", *motion)
    assert servo_logs(MODEL, [path]) is not None
    path.write_text(path.read_text().replace("target_", "torque_"))
    assert servo_logs(MODEL, [path]) is None
    assert servo_logs(asset("tx40", "tx40.urdf"), [path]) is None


def test_targets_in_a_file_of_their_own_beside_measurements(motion, tmp_path):
    """Columns of lists, equal names, and sizes of currents instead of torques."""

    def rows(path, names, *parts):
        lines = zip(t, *(part.tolist() for part in parts), strict=True)
        text = "".join(f"{k:.3f}," + ",".join(f'"{x}"' for x in each) + "\n" for k, *each in lines)
        path.write_text(f"t,{names}\n{text}")
        return path

    t, u, q = motion
    torque = np.round(u - q, 1)
    wanted = rows(tmp_path / "control.csv", "positions", u)
    measured = rows(tmp_path / "state.csv", "positions,torques", q, np.abs(torque))
    found = servo_logs(MODEL, [wanted, measured])
    assert found is not None
    np.testing.assert_allclose(found.logs[0].issued[:, 0], u[:, 0], atol=1e-6)
    np.testing.assert_allclose(found.logs[0].position, q, atol=1e-6)
    signed = rows(tmp_path / "state.csv", "positions,torques", q, torque)
    assert servo_logs(MODEL, [wanted, signed]) is None


def test_targets_are_clipped_and_gaps_cut(motion, tmp_path):
    t, u, q = motion
    u[:, 0] = 3.0
    late = t + np.where(t > 6, 5.0, 0.0)
    found = servo_logs(MODEL, [write(tmp_path / "log.csv", late, u, q)])
    assert found is not None
    assert found.logs[0].target[:, 0] == pytest.approx(1.91986)
    assert [round(log.t[-1] - log.t[0]) for log in found.logs] == [6, 6]


def test_a_map_s_command_is_a_target_if_its_unit_is_that_of_a_position(motion, tmp_path):
    t, u, q = motion
    path = write(tmp_path / "log.csv", t, np.rad2deg(u), np.rad2deg(q))

    def mapped(unit):
        return map_of(
            {
                "joints": {
                    joint: {
                        "position": {"column": f"position_{joint}", "unit": "deg"},
                        "command": {"column": f"target_{joint}", "unit": unit},
                    }
                    for joint in JOINTS
                }
            }
        )

    found = servo_logs(MODEL, [path], mapped("deg"))
    assert found is not None
    np.testing.assert_allclose(found.logs[0].position, q, atol=1e-6)
    np.testing.assert_allclose(found.logs[0].target[:, 1], u[:, 1], atol=1e-6)
    assert servo_logs(MODEL, [path], mapped("N·m")) is None


def test_logs_of_a_hurried_owner_are_refused_with_a_remedy(motion, tmp_path):
    """Columns of targets and positions swapped; an arm that stands still; one joint missing."""
    t, u, q = motion
    noise = np.random.default_rng(0).integers(-1, 2, u.shape) * 1.5e-3
    refusals = [
        (q, u, "swapped"),
        (u, 0 * u + noise, "no joint moves"),
        (u, q, "target of gripper"),
    ]
    for k, (targets, positions, said) in enumerate(refusals):
        path = write(tmp_path / f"log_{k}.csv", t, targets, positions)
        if "gripper" in said:
            path.write_text(path.read_text().replace("target_gripper", "other"))
        with pytest.raises(NsaidError, match=said) as refused:
            servo_logs(MODEL, [path])
        assert re.search(r"map\.toml|Record motions|--lock", str(refused.value))
    assert servo_logs(MODEL, [write(tmp_path / "sound.csv", t, u, q)]) is not None


def test_a_few_seconds_are_refused(motion, tmp_path):
    part = slice(0, 300)
    found = servo_logs(MODEL, [write(tmp_path / "log.csv", *(x[part] for x in motion))])
    assert found is not None
    with pytest.raises(InvalidInput, match="ten seconds"):
        identify_servos(found)


def test_short_episodes_count_together_and_the_others_are_counted(motion, tmp_path):
    starts = range(0, len(motion[0]) - 60, 60)
    files = []
    for k, first in enumerate(starts):
        rows = slice(first, first + (8 if k == 3 else 50))  # 0.14 s and 1 s
        t, u, q = (part[rows] for part in motion)
        files.append(write(tmp_path / f"episode_{k}.csv", t, u, q))
    given = servo_logs(MODEL, files)
    assert given is not None and len(given.logs) == len(files) - 1
    (finding,) = [f for f in given.findings if f.code == "short_stretch"]
    assert f"1 of {len(files)} stretches" in finding.text
    with pytest.raises(InvalidInput, match=f"1 of {len(files)} stretches"):
        identify_servos(given)


def test_what_a_simulation_cannot_know_at_a_stretch_s_start_is_not_counted(motion, tmp_path):
    t, u, q = motion
    files = [write(tmp_path / "rest.csv", t, u, q)]
    files.append(write(tmp_path / "moving.csv", t[25:], u[25:], q[25:]))
    given = servo_logs(MODEL, files)
    assert given is not None
    counted = settled(given.logs)
    resting, moving = np.split(counted, [len(given.logs[0].t)])
    assert resting.all()
    assert not moving[:15].any() and moving[15:].all()  # 0.3 s


def test_a_servo_arm_s_map_may_leave_parts_out(motion, tmp_path):
    file = write(tmp_path / "log.csv", *motion)
    given = servo_logs(MODEL, [file], map_of({"phases": {"leave_out": [[4.0, 5.0]]}}))
    assert given is not None
    first, second = given.logs
    assert first.t[-1] < 4.0 and second.t[0] > 5.0
    (finding,) = [f for f in given.findings if f.code == "phases"]
    assert "4.0 to 5.0 s left out (map.toml says so)" in finding.text


def test_inspecting_says_that_commands_are_targets(motion, tmp_path):
    path, robot = write(tmp_path / "log.csv", *motion), load_robot_model(str(MODEL))

    def codes():
        return {finding.code for finding in inspect(read_tables([path]), None, robot).findings}

    assert "targets" in codes() and "unmatched" not in codes()
    path.write_text(path.read_text().replace("target_", "nothing_"))
    assert "targets" not in codes() and "unmatched" in codes()


def test_a_packed_servo_arm_is_identified_from_python_too(monkeypatch):
    monkeypatch.setattr("nsaid_mj.clinic.servos.identify.identify_servos", lambda given, _: given)
    given = nsaid_mj.identify("so101")
    assert [log.source for log in given.logs] == ["log.csv.gz"]
    assert given.robot.joints[0] == "shoulder_pan"
    with pytest.raises(InvalidInput, match="cutoff"):
        nsaid_mj.identify("so101", cutoff=5.0)
    with pytest.raises(InvalidInput, match="from forces"):
        nsaid_mj.identify("so101", law="efficient")
