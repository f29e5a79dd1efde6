"""Flags, samples, lines and summaries are bounded where they enter."""

from __future__ import annotations

import errno
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj import NsaidError
from nsaid_mj.base.inputs import read_bytes
from nsaid_mj.clinic.logs.stream import Cleaner
from nsaid_mj.clinic.logs.tables import read
from nsaid_mj.clinic.logs.unusable import UnreadableLog
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.loop import run
from nsaid_mj.robots.assets import folder
from nsaid_mj.robots.loading import load_tree
from tests.support.faulty import ROV, shell

URDF = folder("assets") / "robots" / "double_pendulum" / "double_pendulum.urdf"
ROWS = "\n".join(f"{0.01 * i},{i % 7},{i % 5}" for i in range(50))
LOG = f"time,joint1_pos,joint1_tau\n{ROWS}\n"


@pytest.mark.parametrize(
    "flag", ["--every", "--position-noise", "--velocity-noise", "--prior-error", "--gain"]
)
@pytest.mark.parametrize("value", ["-1", "1e-300", "5e-324", "1e308", "nan", "inf"])
def test_flags_of_live_are_bounded(flag: str, value: str) -> None:
    code, said = shell("live", "--model", URDF, f"{flag}={value}")
    assert code == 2 and flag in said.err and "expected a number from" in said.err


def test_two_values_of_a_known_parameter_are_refused(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text(LOG, encoding="utf-8")
    words = ("identify", "--model", URDF, "--log", log, "--known", "gain_1=1", "--known")
    code, said = shell(*words, "gain_1=2")
    assert code == 2 and "one value of gain_1" in said.err


@pytest.mark.parametrize("part", [0, 1, 2], ids=["q", "v", "u"])
@pytest.mark.parametrize("value", [1e300, -1e9, np.inf, np.nan])
def test_a_sample_beyond_physics_is_dropped_and_counted(part: int, value: float) -> None:
    system = load_tree("double_pendulum").system
    cleaner = Cleaner(system, 100.0)
    sample = [np.zeros(system.m), np.zeros(system.n), np.zeros(system.n_u)]
    sample[part][0] = value
    assert cleaner.accept(0.0, *sample) is None
    assert cleaner.counts.not_finite == 1 and cleaner.counts.used == 0


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_table_is_read_in_the_encodings_of_spreadsheets(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(LOG.encode(encoding))
    table = read(tmp_path / "log.csv")
    assert set(table.channels) == {"joint1_pos", "joint1_tau"}
    assert len(table.channels["joint1_pos"].t) == 50


@pytest.mark.parametrize("line", [0, 1, 20, -1])
def test_a_line_of_megabytes_is_refused_by_its_size(line: int, tmp_path: Path) -> None:
    lines = LOG.splitlines()
    lines[line] += ",1.5" * 400_000
    (tmp_path / "log.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(UnreadableLog, match=r"1\.6 MB"):
        read(tmp_path / "log.csv")


WAITING = """
import threading, time
from nsaid_mj.clinic.logs.stream import standard_input
threading.Thread(target=list, args=(standard_input(),), daemon=True).start()
time.sleep(0.3)
"""


def test_a_file_beyond_its_limit_is_refused_with_its_name_and_both_sizes(tmp_path: Path) -> None:
    path = tmp_path / "large"
    path.write_bytes(bytes(3_000_000))
    assert len(read_bytes(path, 3_000_000)) == 3_000_000
    with pytest.raises(OSError, match="it has 3 MB, more than 2 MB") as refused:
        read_bytes(path, 2_000_000)
    assert refused.value.errno == errno.EFBIG
    assert refused.value.filename == str(path)


def test_python_ends_while_the_sender_of_live_is_silent() -> None:
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", WAITING], stdin=pipe, stderr=pipe) as process:
        assert process.wait(60) == 0
        assert process.stderr is not None and process.stderr.read() == b""


@pytest.mark.parametrize("key", ["sim_s", "wall_s", "seed", "theta_perp_ratio", "rivals"])
def test_a_changed_summary_is_no_part_of_a_rebuilt_run(key: str, tmp_path: Path) -> None:
    postprocessing.finish(run(replace(ROV, duration=0.2, held_out=0.1, pe_window=0.1), tmp_path))
    file = tmp_path / "summary.json"
    summary = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(summary | {key: 1e300}), encoding="utf-8")
    with pytest.raises(NsaidError, match=r"summary\.json"):
        postprocessing.rebuild(tmp_path)
    assert json.loads(file.read_text(encoding="utf-8"))[key] == 1e300
