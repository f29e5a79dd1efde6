"""`nsaid live` of a robot that walks."""

import io
import json
import socket
import time
from pathlib import Path

import numpy as np
import pytest

import nsaid_mj
from nsaid_mj.base import InvalidInput
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.session import LiveEstimate
from nsaid_mj.clinic.walking import (
    SAMPLE,
    WalkingSamples,
    first_of,
    identified_along,
    walks,
)

from .walking import GAINS, Walked, walked

JOINTS = ("hip", "knee")


def line(t: float, imu: int = 10, joints: int = 2) -> bytes:
    own = [0.1] * joints
    found = {"t": t, "q": own, "v": own, "u": own, "imu": [1.0] * imu}
    return json.dumps(found).encode() + b"\n"


def read(samples: WalkingSamples) -> WalkingSamples:
    end = time.monotonic() + 5.0
    while not samples.over and time.monotonic() < end:
        time.sleep(0.01)
    return samples


def test_samples_become_a_log(tmp_path: Path) -> None:
    lines = [line(0.1), b"noise\n", line(0.2), line(0.2), line(0.3), line(0.4, joints=3)]
    samples = read(WalkingSamples(JOINTS, io.BytesIO(b"".join([*lines, b'{"end": true}\n']))))
    assert samples.seconds == pytest.approx(0.2) and samples.unreadable == 2
    assert samples.write(tmp_path / "walk.csv") == 3
    names = (tmp_path / "walk.csv").read_text().partition("\n")[0].split(",")
    assert names[:7] == ["time", "q_hip", "q_knee", "dq_hip", "dq_knee", "u_hip", "u_knee"]
    assert names[7] == "imu_qw" and names[-1] == "acc_z"


def test_lines_of_another_robot_are_refused() -> None:
    samples = read(WalkingSamples(JOINTS, io.BytesIO(line(0.1, joints=3) * 12)))
    with pytest.raises(InvalidInput, match="q, v and u of 2 joints"):
        _ = samples.seconds


def test_the_first_sample_says_whether_a_robot_walks(tmp_path: Path) -> None:
    log = walked(tmp_path, seconds=1.0)
    robot = load_robot_model(str(log.model))
    first, rest = first_of(iter([b"\n", line(0.1), line(0.2)]))
    assert not isinstance(rest, socket.socket)
    assert walks(robot, first) and list(rest) == [line(0.1), line(0.2)]
    assert not walks(robot, b'{"t": 0, "q": [], "v": [], "u": []}')
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(line(0.1) + line(0.2), receiver.getsockname())
            assert first_of(receiver)[0] == line(0.1).strip()
            sender.sendto(b'{"end": true}', receiver.getsockname())
            assert read(WalkingSamples(JOINTS, receiver)).seconds == pytest.approx(0.1)


def sampled(log: Walked) -> list[np.ndarray]:
    """Times (N,), positions, velocities, commands and IMU (N, ·) of a log."""
    rows = np.loadtxt(log.log, delimiter=",", skiprows=1)
    k = len(log.joints)
    return [rows[:, 0], *np.split(rows[:, 1:], [k, 2 * k, 3 * k], axis=1)]


@pytest.mark.slow
def test_gains_move_to_the_truth_while_the_robot_walks(tmp_path: Path) -> None:
    log = walked(tmp_path, seconds=14.0)
    t, *parts = sampled(log)

    def sample(k: int) -> bytes:
        row = [float(t[k]), *(part[k].tolist() for part in parts)]
        return json.dumps(dict(zip(SAMPLE, row, strict=True))).encode() + b"\n"

    shown: list[LiveEstimate] = []
    samples = WalkingSamples(tuple(log.joints), io.BytesIO(b"".join(map(sample, range(len(t))))))
    options = {"lock": (), "joints": None}
    identified_along(str(log.model), options, samples, tmp_path / "live", shown.append, print)
    ratio = np.array([gain.value for gain in shown[-1].gains]) / GAINS
    assert np.log(ratio).std() < 0.01
    assert all(np.isfinite([gain.low, gain.high]).all() for gain in shown[-1].gains)


def test_the_readings_of_an_imu_belong_to_every_sample(tmp_path: Path) -> None:
    log = walked(tmp_path, seconds=1.0)
    own = [0.1] * len(log.joints)
    identifier = nsaid_mj.live(str(log.model), rate=100.0, out=tmp_path / "live")
    with pytest.raises(InvalidInput, match="imu of 7 or 10 numbers"):
        identifier.update(0.0, own, own, own, [1.0, 0.0, 0.0])
    with pytest.raises(InvalidInput, match="Write `with"):  # the first sample is kept
        identifier.update(0.0, own, own, own, [1.0] * 10)
    with pytest.raises(InvalidInput, match="all samples with it, or none"):
        identifier.update(0.1, own, own, own)
    arm = nsaid_mj.live("z1", rate=100.0, out=tmp_path / "arm")
    with pytest.raises(InvalidInput, match="a robot that stands and walks, got another robot"):
        arm.update(0.0, own, own, own, [1.0] * 10)


@pytest.mark.slow
def test_python_gets_what_identify_says_of_the_same_samples(tmp_path: Path) -> None:
    log = walked(tmp_path, seconds=9.0)
    t, *parts = sampled(log)
    with nsaid_mj.live(str(log.model), out=tmp_path / "live") as identifier:
        for k, at in enumerate(t.tolist()):
            identifier.update(at, *(part[k] for part in parts))
    last = identifier.estimate
    assert last is not None and last.samples == len(t)
    found = identify_forces(str(log.model), tmp_path / "live" / "walk.csv")
    assert np.array_equal(last.theta_hat, [p.value for p in found.parameters])
    assert [gain.name for gain in last.gains] == [p.name for p in found.gains]
    assert all(gain.low < gain.value < gain.high for gain in last.gains)
    assert identifier.summary["verdict"] == found.verdict
    assert (tmp_path / "live" / "report.html").is_file()
