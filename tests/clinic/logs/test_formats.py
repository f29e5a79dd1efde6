"""Every binary format gives the channels that its own library wrote."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest

from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import LogTable, read
from nsaid_mj.clinic.logs.unusable import MissingExtra, UnreadableLog
from nsaid_mj.lab.record import RecordWriter
from tests.support.bags import write_bag, write_sensors
from tests.support.flight_logs import write_dataflash, write_ulog
from tests.support.robot_logs import JOINTS, columns, motion, two_joints

CLEAN = columns(2.0)


@pytest.fixture
def closed(tmp_path: Path) -> Iterator[None]:
    yield
    handles = Path("/proc/self/fd")
    if handles.exists():
        still = [handle.readlink() for handle in handles.iterdir() if handle.is_symlink()]
        assert [path for path in still if path.is_relative_to(tmp_path)] == []


def assert_clean(table: LogTable, tolerance: float = 1e-12) -> None:
    """Whether a table holds the columns of CLEAN at its times."""
    assert set(CLEAN) - {"t"} <= set(table.channels)
    for name in CLEAN:
        if name != "t":
            t, values = table.channels[name]
            np.testing.assert_allclose(t, CLEAN["t"], atol=1e-6)
            np.testing.assert_allclose(values, CLEAN[name], atol=tolerance)


def test_parquet(tmp_path):
    pa.parquet.write_table(pa.table(CLEAN), tmp_path / "log.parquet")
    assert_clean(read(tmp_path / "log.parquet"))


@pytest.mark.parametrize("compression", ["lz4", "uncompressed"])
def test_feather(tmp_path, compression):
    pa.feather.write_feather(pa.table(CLEAN), tmp_path / "log.feather", compression=compression)
    assert_clean(read(tmp_path / "log.feather"))


def test_an_arrow_stream_with_lists_and_dates(tmp_path):
    whole = (CLEAN["t"] * 1e9).round().astype("datetime64[ns]")
    rows = np.column_stack([CLEAN["q1"], CLEAN["q2"]])
    table = pa.table({"time": whole, "q": pa.array(rows.tolist(), pa.list_(pa.float64(), 2))})
    with pa.ipc.new_stream(tmp_path / "log.arrow", table.schema) as stream:
        stream.write_table(table)
    found = read(tmp_path / "log.arrow")
    np.testing.assert_allclose(found.channels["q_1"].values, CLEAN["q2"])
    np.testing.assert_allclose(found.channels["q_1"].t, CLEAN["t"], atol=1e-8)


def test_npz(tmp_path, closed):
    q, v, u = motion(CLEAN["t"])
    np.savez(tmp_path / "log.npz", t=CLEAN["t"], q=q, dq=v, tau=u, names=np.array(JOINTS))
    found = read(tmp_path / "log.npz")
    assert list(found.channels) == ["q_0", "q_1", "dq_0", "dq_1", "tau_0", "tau_1"]
    np.testing.assert_allclose(found.channels["tau_1"].values, CLEAN["tau2"])


def test_matlab(tmp_path, closed):
    import scipy.io

    q, v, u = motion(CLEAN["t"])
    log = {"t": CLEAN["t"], "arm": {"q": q, "dq": v.T, "tau": u}, "name": "arm"}
    scipy.io.savemat(tmp_path / "log.mat", log)
    found = read(tmp_path / "log.mat")
    assert list(found.channels) == [f"arm/{x}_{k}" for x in ("q", "dq", "tau") for k in (0, 1)]
    np.testing.assert_allclose(found.channels["arm/tau_1"].values, CLEAN["tau2"])
    np.testing.assert_allclose(found.channels["arm/dq_0"].t, CLEAN["t"], atol=1e-9)
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64\0\0HDF")
    with pytest.raises(UnreadableLog, match="-v7"):
        read(tmp_path / "new.mat")


def _records():
    return [
        dict(zip(CLEAN, row, strict=True)) for row in zip(*map(list, CLEAN.values()), strict=True)
    ]


@pytest.mark.parametrize("kind", ["records", "lines", "columns", "nested"])
def test_json(tmp_path, closed, kind):
    columns = {name: column.tolist() for name, column in CLEAN.items()}
    whole = {
        "records": _records(),
        "columns": columns,
        "nested": {"robot": "arm", "log": _records()},
    }
    text = "\n".join(map(json.dumps, _records())) if kind == "lines" else json.dumps(whole[kind])
    (tmp_path / "log.json").write_text(text, encoding="utf-8")
    assert_clean(read(tmp_path / "log.json"))


def test_json_of_lists_and_objects_in_records(tmp_path):
    rows = [{"t": t, "state": {"q": [t, 2 * t]}, "mode": "x"} for t in CLEAN["t"].tolist()]
    rows[5]["state"] = {}
    (tmp_path / "log.json").write_text(json.dumps(rows), encoding="utf-8")
    found = read(tmp_path / "log.json")
    assert list(found.channels) == ["state/q_0", "state/q_1"]
    assert np.flatnonzero(np.isnan(found.channels["state/q_1"].values)).tolist() == [5]


@pytest.mark.parametrize("text", ['{"t": [0, 1', "[1, 2]", '{"a": "b"}', "[{}]"])
def test_json_without_a_log_is_told(tmp_path, text):
    (tmp_path / "log.json").write_text(text, encoding="utf-8")
    with pytest.raises(UnreadableLog):
        read(tmp_path / "log.json")


def test_messages_of_a_bag_are_read_by_their_structure(tmp_path, closed):
    found = read(write_sensors(tmp_path / "log", CLEAN["t"]))
    last = {name: channel.values[-1] for name, channel in found.channels.items()}
    end = CLEAN["t"][-1]
    assert last["imu/angular_velocity/z"] == pytest.approx(end)
    assert last["imu/linear_acceleration/z"] == 9.8 and last["imu/orientation/w"] == 0.8
    assert last["pose/position/x"] == pytest.approx(end) and last["pose/orientation/z"] == 0.6
    assert last["twist/linear/x"] == pytest.approx(end) and last["twist/angular/z"] == 0.5
    assert last["pwm/data_1"] == 1600
    assert last["thrust/force_2"] == pytest.approx(end)
    assert not [name for name in last if "covariance" in name or "image" in name]
    (left,) = [f for f in found.findings if f.code == "left_out"]
    assert "image" in left.text


def test_a_run_of_ours_without_its_estimates(tmp_path, closed):
    q, v, u = motion(CLEAN["t"])
    widths = {"t": 0, "q": 2, "v": 2, "u": 2, "theta_hat": 3}
    writer = RecordWriter(tmp_path / "record.arrow", widths, {"names": []}, 100)
    writer.extend(CLEAN["t"], q, v, u, np.ones((len(q), 3)))
    writer.close()
    for path in (tmp_path, tmp_path / "record.arrow"):
        found = read(path)
        assert list(found.channels) == ["q_0", "q_1", "v_0", "v_1", "u_0", "u_1"]
        np.testing.assert_allclose(found.channels["u_1"].values, CLEAN["tau2"])


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap", "single mcap"])
def test_bags_match_their_joints_by_name(tmp_path, closed, kind):
    path = write_bag(
        tmp_path / ("log.bag" if kind == "ros1" else "log"), kind.split()[-1], CLEAN["t"]
    )
    if kind == "single mcap":
        (path,) = path.glob("*.mcap")
    found = read(path)
    np.testing.assert_allclose(found.channels["odom/position/x"].values, CLEAN["t"][::4])
    assert found.channels["odom/orientation/w"].values[0] == 1
    recordings = prepare([found], None, two_joints())
    (segment,) = recordings.segments
    for part, wanted in zip(segment.log[1:], motion(segment.log.t), strict=True):
        np.testing.assert_allclose(part, wanted, atol=1e-5)


def test_empty_efforts_are_no_channels(tmp_path):
    found = read(write_bag(tmp_path / "log", "ros2", CLEAN["t"], effort=False))
    assert not [name for name in found.channels if "effort" in name]


def test_ulog(tmp_path, closed):
    values = {name: column for name, column in CLEAN.items() if name != "t"}
    found = read(write_ulog(tmp_path / "log.ulg", {"arm_state": (values, CLEAN["t"] + 5)}))
    assert found.origin == 5_000_000_000
    renamed = {name.removeprefix("arm_state/"): c for name, c in found.channels.items()}
    assert_clean(LogTable(found.source, renamed, found.origin))


def test_dataflash(tmp_path, closed):
    values = {name: column for name, column in CLEAN.items() if name != "t"}
    found = read(write_dataflash(tmp_path / "log.bin", {"ARM": (values, CLEAN["t"] + 5)}))
    renamed = {name.removeprefix("ARM/"): c for name, c in found.channels.items()}
    assert_clean(LogTable(found.source, renamed, found.origin), tolerance=1e-5)


def test_old_dataflash_logs_have_milliseconds(tmp_path):
    values = {name: column for name, column in CLEAN.items() if name != "t"}
    found = read(write_dataflash(tmp_path / "log.bin", {"ARM": (values, CLEAN["t"] + 5)}, "TimeMS"))
    np.testing.assert_allclose(found.channels["ARM/q1"].t, CLEAN["t"], atol=1e-3)


def test_dataflash_messages_with_a_damaged_time_are_told(tmp_path):
    times = np.arange(100) * 0.01
    path = write_dataflash(tmp_path / "log.bin", {"ARM": ({"q": np.sin(times)}, times)})
    message = 3 + 8 + 4
    path.write_bytes(damage_time(path.read_bytes(), -40 * message + 3))
    found = read(path)
    assert len(found.channels["ARM/q"].t) == 99
    (finding,) = [f for f in found.findings if f.code == "left_out"]
    assert "1 of 100 messages, whose time is damaged" in str(finding)


def damage_time(content: bytes, at: int) -> bytes:
    """A log whose eight bytes of a time are all set."""
    return content[:at] + b"\xff" * 8 + content[at + 8 :]


@pytest.mark.parametrize(
    "head,library,extra",
    [
        (b"#ROSBAG V2.0\n", "rosbags.highlevel", "ros"),
        (b"ULog\x01\x12\x35\x01", "pyulog", "ulog"),
        (b"\xa3\x95\x80\x80", "pymavlink.DFReader", "dataflash"),
    ],
)
def test_a_missing_library_is_named_by_its_extra(tmp_path, monkeypatch, head, library, extra):
    monkeypatch.setitem(sys.modules, library, None)
    (tmp_path / "log").write_bytes(head)
    with pytest.raises(MissingExtra, match=rf"pip install nsaid-mj\[{extra}\]"):
        read(tmp_path / "log")


@pytest.mark.parametrize(
    "head",
    [
        b"PAR1",
        b"ARROW1\x00\x00",
        b"PK\x03\x04",
        b"#ROSBAG V2.0\n",
        b"\x89MCAP0\r\n",
        b"SQLite format 3\x00",
        b"ULog\x01\x12\x35\x01",
        b"\xa3\x95\x80",
        b"\x00\x01\x02",
    ],
)
@pytest.mark.parametrize("rest", [b"", b"\x07" * 200])
def test_damaged_files_are_refused_by_a_typed_error(tmp_path, head, rest):
    (tmp_path / "log").write_bytes(head + rest)
    with pytest.raises(UnreadableLog):
        read(tmp_path / "log")
