"""`nsaid live` of a robot that walks."""

import io
import json
import socket
import time
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base import InvalidInput
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.session import LiveEstimate
from nsaid_mj.clinic.walking import WalkingSamples, first_of, identified_along, walks

from .walking import GAINS, walked

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


@pytest.mark.slow
def test_gains_move_to_the_truth_while_the_robot_walks(tmp_path: Path) -> None:
    log = walked(tmp_path, seconds=14.0)
    rows = np.loadtxt(log.log, delimiter=",", skiprows=1)
    names = log.log.read_text().partition("\n")[0].split(",")
    k = len(log.joints)
    kinds = ("pos", "vel", "cur")
    header = [name for name in names if name != names[0]]
    columns = [[names.index(n) for n in header[j * k : (j + 1) * k]] for j in range(len(kinds))]
    imu = [names.index(name) for name in header[3 * k :]]

    def sample(row: np.ndarray) -> bytes:
        parts = dict(zip("qvu", (row[own].tolist() for own in columns), strict=True))
        return json.dumps({"t": row[0], **parts, "imu": row[imu].tolist()}).encode() + b"\n"

    shown: list[LiveEstimate] = []
    samples = WalkingSamples(tuple(log.joints), io.BytesIO(b"".join(map(sample, rows))))
    options = {"lock": (), "joints": None}
    identified_along(str(log.model), options, samples, tmp_path / "live", shown.append, print)
    ratio = np.array([gain.value for gain in shown[-1].gains]) / GAINS
    assert np.log(ratio).std() < 0.01
    assert all(np.isfinite([gain.low, gain.high]).all() for gain in shown[-1].gains)
