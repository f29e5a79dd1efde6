"""The example of a robot and an identifier in two processes, and the measuring script."""

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.support.faulty import CHECKOUT


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_a_robot_learns_its_gains_over_udp(tmp_path: Path):
    more = {"NSAID_EXAMPLE_SECONDS": "3", "NSAID_EXAMPLE_PORT": str(free_port())}
    done = subprocess.run(
        [sys.executable, str(CHECKOUT / "examples" / "live" / "robot.py")],
        cwd=tmp_path,
        env={**os.environ, **more, "PYTHONPATH": str(CHECKOUT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = re.search(r"gains over their mean: \[(.*?)\], true: \[(.*?)\]", done.stdout)
    assert found, done.stdout
    gains, true = (np.array([float(x) for x in part.split()]) for part in found.groups())
    assert np.abs(gains - true).max() < 0.01  # they begin 0.3 off
    assert (tmp_path / "runs" / "example-live" / "report.html").is_file()
