"""Ctrl-C and kill -9 of a real `nsaid run`: its record is readable and can be completed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from nsaid_mj.cli import commands as cli
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.record import RECORD_FILE, Record
from tests.support.faulty import FILES, ROV, shell, start, strict

PATIENCE = 90.0  # with an empty numba cache on a busy machine [s]

# The vehicle, forever; the time of every row that there is goes to a file of its own.
ENDLESS = '''"""The vehicle, as long as it lives."""
import os
from nsaid_mj import MultisineCommand, NullspaceAID, ScalarRovPlant, Scenario
from nsaid_mj.lab.record import RecordWriter

clock = os.open("clock", os.O_CREAT | os.O_WRONLY)
extend = RecordWriter.extend

def watched(self, t, *columns):
    os.pwrite(clock, b"%20.9f" % t[-1], 0)  # first: it may be killed in between
    extend(self, t, *columns)

RecordWriter.extend = watched
scenario = Scenario(
    plant=ScalarRovPlant(), excitation=MultisineCommand(low=0.1, high=1.0, amplitude=0.4),
    identifier=NullspaceAID(K=10.0, gain=0.3), dt=0.01, duration=36000.0, held_out=1.0,
)
'''


@pytest.fixture
def endless(tmp_path: Path) -> Path:
    (tmp_path / "endless.py").write_text(ENDLESS)
    return tmp_path


def wait_until_recorded(process: subprocess.Popen[str], record: Path, size: int) -> None:
    """Waits until a run's record has grown to so many bytes."""
    end = time.monotonic() + PATIENCE
    while not (record.is_file() and record.stat().st_size > size):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "nothing is recorded"
        time.sleep(0.02)


@dataclass(frozen=True)
class Killed:
    """A run that was killed in a folder where another had completed."""

    folder: Path
    clock: float
    code: int


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Killed:
    desk = tmp_path_factory.mktemp("killed")
    (desk / "endless.py").write_text(ENDLESS)
    folder = desk / "out"
    postprocessing.finish(run(ROV, folder))
    before = (folder / RECORD_FILE).stat().st_size
    process = start("run", "endless.py", "--out", folder, "--force", "--quiet", cwd=desk)
    try:
        end = time.monotonic() + PATIENCE
        while not (desk / "clock").exists():
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end, "it does not start"
            time.sleep(0.02)
        wait_until_recorded(process, folder / RECORD_FILE, before)
    finally:
        process.kill()
        process.communicate()
    return Killed(folder, float((desk / "clock").read_text()), process.returncode)


@pytest.fixture
def copy(killed: Killed, tmp_path: Path) -> Path:
    return Path(shutil.copytree(killed.folder, tmp_path / "copy"))


def test_a_kill_loses_at_most_the_last_second(killed: Killed) -> None:
    record = Record.read(killed.folder)
    assert killed.code == -signal.SIGKILL
    assert not record.complete
    assert 1.0 < record["t"][-1] <= killed.clock < record["t"][-1] + 1.0
    assert record["t"] == pytest.approx(0.01 * np.arange(len(record)))
    assert all(np.isfinite(values).all() for values in record.columns.values())


def test_a_killed_run_leaves_no_results_of_an_earlier_one(killed: Killed) -> None:
    assert [path.name for path in killed.folder.glob("[!.]*")] == [RECORD_FILE]


def test_a_killed_run_is_finished_from_its_record(copy: Path) -> None:
    end = float(Record.read(copy)["t"][-1])
    postprocessing.rebuild(copy)
    summary = strict((copy / postprocessing.SUMMARY).read_text(encoding="utf-8"))
    assert summary["status"] == "interrupted"
    assert summary["status_time"] == summary["sim_s"] == end
    assert 0 < summary["theta_perp_ratio"] < summary["theta_perp_ratio_initial"]
    assert sorted(path.name for path in copy.iterdir()) == sorted(FILES)
    assert "interrupted" in (copy / "report.html").read_text(encoding="utf-8")


def test_view_rebuilds_a_killed_run_and_opens_it(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[list[str]] = []

    class Replaced(BaseException):
        """This process has become another one, as after exec."""

    def become(program: str, words: list[str]) -> None:
        assert program == words[0]
        opened.append(words)
        raise Replaced

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(cli.os, "execv", become)
    with pytest.raises(Replaced):
        shell("view", copy, "--rebuild")
    assert str(copy / "run.rrd") in opened[0]
    assert (copy / "run.rrd").stat().st_size > 0
    summary = strict((copy / postprocessing.SUMMARY).read_text(encoding="utf-8"))
    assert summary["status"] == "interrupted"


def test_rebuilding_a_run_killed_before_its_first_batch_is_refused(copy: Path) -> None:
    whole = (copy / RECORD_FILE).read_bytes()
    with pa.memory_map(str(copy / RECORD_FILE)) as source, pa.ipc.open_stream(source) as stream:
        stream.read_next_batch()  # the empty one that carries the schema
        begun = source.tell() + 100
    (copy / RECORD_FILE).write_bytes(whole[:begun])
    assert len(Record.read(copy)) == 0
    code, said = shell("view", copy, "--rebuild")
    assert code == 2
    assert "its record has 0 rows" in said.err and "Run the scenario again" in said.err


@pytest.fixture
def running(endless: Path) -> Iterator[subprocess.Popen[str]]:
    process = start("run", "endless.py", "--out", "out", cwd=endless, COLUMNS="120")
    try:
        wait_until_recorded(process, endless / "out" / RECORD_FILE, 50_000)
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(
    "how",  # of the others, one ends a sweep in test_processes.py
    [
        signal.SIGINT,
        *(pytest.param(s, marks=pytest.mark.slow) for s in (signal.SIGTERM, signal.SIGHUP)),
    ],
)
def test_ctrl_c_ends_a_run_with_all_its_files(
    how: signal.Signals, running: subprocess.Popen[str], endless: Path
) -> None:
    os.kill(running.pid, how)
    out, err = running.communicate(timeout=PATIENCE)
    folder = endless / "out"
    summary = strict((folder / postprocessing.SUMMARY).read_text(encoding="utf-8"))
    record = Record.read(folder)
    assert running.returncode == 130
    assert summary["status"] == "interrupted" and summary["status_signal"] == ""
    assert record.complete
    assert summary["sim_s"] == record["t"][-1]
    assert record["t"][-1] <= summary["status_time"] <= record["t"][-1] + 0.01 + 1e-9
    assert float((endless / "clock").read_text()) == pytest.approx(record["t"][-1])
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    assert "interrupted" in out and "ended early" in out
    assert "Traceback" not in err
    assert not (endless / "MUJOCO_LOG.TXT").exists()
