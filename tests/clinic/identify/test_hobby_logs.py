"""LeRobot datasets, recordings of Rerun and folders of logs are read; units are asked for."""

import mujoco
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.inspection import inspect
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.first_map import first_map
from nsaid_mj.clinic.logs.mapping import ColumnMap, map_of, read_map
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.clinic.logs.unusable import UnreadableLog, UnusableLog
from nsaid_mj.clinic.servos.identify import servo_logs
from tests.clinic.servos.simulated import JOINTS, MODEL, write
from tests.support.lerobot import write_dataset

NAMES = [f"{joint}.pos" for joint in JOINTS]


@pytest.fixture
def episodes():
    """Two episodes of targets within the limits, followed 60 ms late; states and actions."""
    found = []
    for seconds, shift in ((8, 0.0), (6, 0.4)):
        t = np.arange(0, seconds, 0.02)[:, None]
        u = 0.8 * np.sin(t * np.arange(1, 7) / 2 + shift) + 0.7 * (np.arange(6) == 5)
        found.append((np.vstack([u[:1]] * 3 + [u[:-3]]), u))
    return found


def in_degrees(episodes):
    """As LeRobot writes them: degrees, the gripper from 0 to 100 of its range."""
    low, high = -0.174533, 1.74533

    def converted(x):
        return np.column_stack([np.rad2deg(x[:, :5]), 100 * (x[:, 5] - low) / (high - low)])

    return [(converted(q), converted(u)) for q, u in episodes]


def assert_read(given, episodes, atol):
    assert given is not None and len(given.logs) == len(episodes)
    for log, (q, u) in zip(given.logs, episodes, strict=True):
        np.testing.assert_allclose(np.diff(log.t), 0.02, atol=1e-6)
        np.testing.assert_allclose(log.position, q, atol=atol)
        np.testing.assert_allclose(log.target, u, atol=atol)


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
@pytest.mark.parametrize("wrap", [list, lambda names: {"motors": names}])
def test_episodes_of_a_dataset_are_separate_stretches(tmp_path, episodes, version, wrap):
    folder = write_dataset(tmp_path / "set", version, episodes, wrap(NAMES))
    assert_read(servo_logs(MODEL, [folder]), episodes, 1e-6)


def test_names_without_a_quantity_are_of_positions(tmp_path, episodes):
    names = [f"main_{joint}" for joint in JOINTS]
    folder = write_dataset(tmp_path / "set", "v2.1", episodes, names)
    assert_read(servo_logs(MODEL, [folder]), episodes, 1e-6)
    numbered = write_dataset(tmp_path / "other", "v3.0", episodes, None)
    assert_read(servo_logs(MODEL, [numbered]), episodes, 1e-6)


def test_degrees_are_refused_until_the_first_map_is_given(tmp_path, episodes):
    far = np.array([1, 1, 1, 1, 2.5, 1])  # the roll turns by 115°
    episodes = [(far * q, far * u) for q, u in episodes]
    folder = write_dataset(tmp_path / "set", "v3.0", in_degrees(episodes), NAMES)
    with pytest.raises(UnusableLog) as refused:
        servo_logs(MODEL, [folder])
    assert {f.code for f in refused.value.findings} >= {"degrees"}
    robot, tables = load_robot_model(str(MODEL)), read_tables([folder])
    assert any(f.level == "refusal" for f in inspect(tables, None, robot).findings)
    path = tmp_path / "map.toml"
    path.write_text(first_map(tables, robot))
    assert read_map(path).joints["wrist_roll"].position.unit == "deg"
    given = servo_logs(MODEL, [folder], path)
    assert given is not None
    for log, (q, _) in zip(given.logs, episodes, strict=True):
        np.testing.assert_allclose(log.position, q, atol=1e-5)
    found = inspect(tables, read_map(path), robot).findings
    assert not [f for f in found if f.level == "refusal"]
    assert "targets" in {f.code for f in found}


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_ticks_are_read_by_the_first_map(tmp_path, episodes, version):
    raw = [[np.round((x / np.pi + 1) * 2048) for x in pair] for pair in episodes]
    folder = write_dataset(tmp_path / "set", version, raw, {"motors": list(JOINTS)})
    with pytest.raises(UnusableLog):
        servo_logs(MODEL, [folder])
    path = tmp_path / "map.toml"
    path.write_text(first_map(read_tables([folder]), load_robot_model(str(MODEL))))
    assert_read(servo_logs(MODEL, [folder], path), episodes, 1.01 * np.pi / 4096)


def test_a_range_that_may_be_degrees_is_left_to_the_user(tmp_path, episodes):
    folder = write_dataset(tmp_path / "set", "v3.0", in_degrees(episodes), NAMES)
    text = first_map(read_tables([folder]), load_robot_model(str(MODEL)))
    assert "points = [[0, -0.174533], [100, 1.745329]]" in text
    path = tmp_path / "map.toml"
    path.write_text(text)
    for mapping in (None, path):  # one question for all joints
        with pytest.raises(
            UnusableLog, match='`position = "deg"` or `position = "range"`'
        ) as asked:
            servo_logs(MODEL, [folder], mapping)
        assert [f.code for f in asked.value.findings if f.level == "refusal"] == ["degrees"]
        assert "shoulder" in str(asked.value) and "\n" not in str(asked.value)
    path.write_text(text.replace('# position = "deg"', 'position = "deg"'))
    assert_read(servo_logs(MODEL, [folder], path), episodes, 1e-5)
    path.write_text('[factors]\nposition = "deg"\n')  # one line is enough
    assert_read(servo_logs(MODEL, [folder], path), episodes, 1e-5)


def test_a_range_is_that_of_each_joint_in_the_model_file(tmp_path, episodes):
    low, high = (np.array(ends) for ends in zip(*limits_of_joints(), strict=True))

    def parts(x):  # 0 to 100 of the gripper, -100 to 100 of all others
        share = (x - low) / (high - low)
        return np.column_stack([200 * share[:, :5] - 100, 100 * share[:, 5]])

    dataset = [(parts(q), parts(u)) for q, u in episodes]
    folder = write_dataset(tmp_path / "set", "v3.0", dataset, NAMES)
    path = tmp_path / "map.toml"
    path.write_text('[factors]\nposition = "range"\n')
    assert_read(servo_logs(MODEL, [folder], path), episodes, 1e-5)


def limits_of_joints():
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    return model.jnt_range.tolist()


def test_a_unit_for_all_leaves_a_joints_own_line_alone():
    column = ColumnMap(column="q", unit="turns")
    factors = map_of({"factors": {"position": "deg", "velocity": -2}}).factors
    assert factors.with_unit("position", "elbow", column) is column
    assert factors.with_unit("position", "elbow", ColumnMap(column="q")).unit == "deg"
    assert (factors.of("position", "elbow"), factors.of("velocity", "elbow")) == (1.0, -2.0)
    parts = map_of({"factors": {"position": "range", "velocity": "range"}}).factors
    for quantity in ("position", "velocity"):  # without limits a joint has no range
        with pytest.raises(InvalidInput, match=f"factors.{quantity}"):
            parts.with_unit(quantity, "elbow", ColumnMap(column="q"))


def test_two_points_are_a_line_from_values_to_positions(tmp_path, episodes):
    (q, u), *_ = episodes
    low, high = -1.9, 1.7
    path = write(
        tmp_path / "log.csv",
        np.arange(len(q)) / 50,
        *(200 * (x - low) / (high - low) - 100 for x in (u, q)),
    )
    line = [[-100, low], [100, high]]
    joints = {
        joint: {
            "position": {"column": f"position_{joint}", "points": line},
            "command": {"column": f"target_{joint}", "points": line},
        }
        for joint in JOINTS
    }
    given = servo_logs(MODEL, [path], map_of({"joints": joints}))
    assert given is not None
    np.testing.assert_allclose(given.logs[0].position, q, atol=1e-5)
    joints["gripper"]["position"]["points"] = [[5, 1], [5, 2]]
    with pytest.raises(InvalidInput, match="two different values"):
        map_of({"joints": joints})


def test_a_folder_holds_logs(tmp_path, episodes):
    for k, (q, u) in enumerate(episodes):
        write(tmp_path / f"log_{k}.csv", np.arange(len(q)) / 50, u, q)
    (tmp_path / "README.md").write_text("Two motions.")
    given = servo_logs(MODEL, [tmp_path])
    assert_read(given, episodes, 1e-6)
    assert given is not None and [log.source for log in given.logs] == ["log_0.csv", "log_1.csv"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(UnreadableLog, match="holds no logs"):
        read_tables([tmp_path / "empty"])


@pytest.mark.parametrize("damage", ["{", "{}", '{"features": {}}', '{"features": {"a": 3}}'])
def test_a_damaged_dataset_is_refused(tmp_path, episodes, damage):
    folder = write_dataset(tmp_path / "set", "v3.0", episodes, NAMES)
    (folder / "meta" / "info.json").write_text(damage)
    with pytest.raises(UnreadableLog):
        read_tables([folder])


def test_a_dataset_with_a_pointer_in_place_of_its_data_is_refused(tmp_path, episodes):
    folder = write_dataset(tmp_path / "set", "v2.1", episodes, NAMES)
    (folder / "data/chunk-000/episode_000001.parquet").write_text("version https://git-lfs\n")
    with pytest.raises(UnreadableLog, match="whole dataset"):
        read_tables([folder])


def write_rerun(path, t, u, q, own_time=True):
    """A recording in which every joint is an entity of its own, as LeRobot logs them."""
    rr = pytest.importorskip("rerun")
    rec = rr.RecordingStream("arm", recording_id="arm")
    rec.save(path)
    for k, now in enumerate(t):
        if own_time:
            rec.set_time("robot", duration=now)
        for j, joint in enumerate(JOINTS):
            rec.log(f"observation.{joint}.pos", rr.Scalars(q[k, j]))
            rec.log(f"action.{joint}.pos", rr.Scalars(u[k, j]))
    rec.flush()
    del rec
    return path


def test_a_recording_of_rerun_is_read(tmp_path, episodes):
    (q, u), *_ = episodes
    path = write_rerun(tmp_path / "log.rrd", np.arange(len(q)) / 50, u, q)
    assert_read(servo_logs(MODEL, [path]), [(q, u)], 1e-9)


def test_series_of_one_entity_and_rerun_s_own_clock(tmp_path, episodes):
    rr = pytest.importorskip("rerun")
    (q, _), *_ = episodes
    rec = rr.RecordingStream("arm", recording_id="arm")
    rec.save(tmp_path / "log.rrd")
    rec.log("arm/position", rr.SeriesLines(names=list(JOINTS)), static=True)
    times = rr.TimeColumn("log_time", timestamp=1.7e9 + np.arange(len(q)) / 50)
    rec.send_columns("arm/position", [times], rr.Scalars.columns(scalars=q))
    rec.send_columns("arm/other", [times], rr.Scalars.columns(scalars=q))
    rec.flush()
    del rec
    (table,) = read_tables([tmp_path / "log.rrd"])
    assert list(table.channels)[:6] == [f"arm/position/{joint}" for joint in JOINTS] or (
        f"arm/position/{JOINTS[0]}" in table.channels
    )
    channel = table.channels["arm/position/elbow_flex"]
    np.testing.assert_allclose(channel.t, np.arange(len(q)) / 50, atol=1e-6)
    np.testing.assert_array_equal(channel.values, q[:, 2])
    np.testing.assert_array_equal(table.channels["arm/other/1"].values, q[:, 1])


def test_a_recording_without_scalars_is_refused(tmp_path):
    rr = pytest.importorskip("rerun")
    rec = rr.RecordingStream("arm", recording_id="arm")
    rec.save(tmp_path / "log.rrd")
    rec.log("words", rr.TextLog("nothing"))
    rec.flush()
    del rec
    with pytest.raises(UnreadableLog, match="no scalars"):
        read_tables([tmp_path / "log.rrd"])


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
@pytest.mark.parametrize("size", [8, 60, 2000])
def test_a_recording_that_was_cut_is_refused(tmp_path, episodes, size):
    (q, u), *_ = episodes
    path = write_rerun(tmp_path / "log.rrd", np.arange(100) / 50, u, q)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(UnreadableLog):
        read_tables([path])
