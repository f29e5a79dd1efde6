"""Sweeps whose children are killed, whose files are damaged, or that two processes want."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from pathlib import Path

import pytest

from nsaid_mj.cli.process import NOT_EXPLAINED
from nsaid_mj.errors import BadRun, InvalidInput
from nsaid_mj.experiment.library import digest_of
from nsaid_mj.studies import sweep_report, sweep_worker
from nsaid_mj.studies.sweep import Plan, run
from nsaid_mj.studies.sweep_engine import Engine
from nsaid_mj.studies.sweep_results import MANIFEST, ROWS, TABLE, Row, Sweep, read
from nsaid_mj.studies.sweep_worker import Job, supervised
from tests.support.faulty import CHECKOUT, ROV, shell

PLAN = Plan("scalar_rov", ROV, {"identifier.gain": (0.1, 1.0)}, seeds=2)


def row(number: int) -> Row:
    """A row as a run would give it."""
    found = {"run": number, "failure": None, "status": "completed", "theta_perp_ratio": 0.1}
    return PLAN.what(number) | found | {"time_to_converge": None}


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers of the runs that are made, by an engine that takes no time."""
    numbers: list[int] = []

    def make(self, todo, job, longest):
        for number in todo:
            numbers.append(number)
            yield {key: value for key, value in row(number).items() if key not in PLAN.what(0)} | {
                "run": number
            }

    monkeypatch.setattr(Engine, "make", make)
    return numbers


def sweep(folder: Path, **more: bool) -> Sweep:
    return run(PLAN, folder, Engine(jobs=1), quiet=True, **more)


# -- children that die -----------------------------------------------------------------------------


def job() -> Job:
    scenario = PLAN.run(0).to_json()
    return Job(0, "scalar_rov", digest_of("scalar_rov"), scenario, 300.0)


def kill_at_once(monkeypatch: pytest.MonkeyPatch, first: int) -> None:
    """Kills the first children before they have imported anything."""
    started, count = sweep_worker.subprocess.Popen, itertools.count()

    def popen(*arguments, **more):
        process = started(*arguments, **more)
        if next(count) < first:
            os.kill(process.pid, signal.SIGKILL)
        return process

    monkeypatch.setattr(sweep_worker.subprocess, "Popen", popen)
    monkeypatch.setattr(sweep_worker, "_mine", sweep_worker.threading.local())


def test_a_child_killed_while_it_starts_is_started_again(monkeypatch: pytest.MonkeyPatch) -> None:
    kill_at_once(monkeypatch, 2)
    found = supervised(job())
    sweep_worker._mine.child.stop()
    assert found["failure"] is None and found["status"] == "completed"


def test_a_child_killed_at_every_start_loses_only_its_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kill_at_once(monkeypatch, 10**6)
    assert supervised(job()) == {"run": 0, "failure": "its process died: Killed"}


def test_a_worker_whose_engine_is_gone_before_it_starts_ends_at_once() -> None:
    code = "import time; from nsaid_mj.studies import sweep_worker as worker; worker._end_with(1)"
    words = [sys.executable, "-c", f"{code}; time.sleep(60); raise SystemExit(0)"]
    done = subprocess.run(words, cwd=CHECKOUT, check=False, timeout=120)
    assert done.returncode == 1


def test_workers_that_cannot_import_the_package_end_the_sweep(tmp_path: Path) -> None:
    unfit = {"run": 0, "failure": "its process died: exit code 1", "unfit": True}
    with pytest.MonkeyPatch.context() as patch, pytest.raises(InvalidInput, match="can import"):
        patch.setattr("nsaid_mj.studies.sweep_engine.supervised", lambda *_: unfit)
        run(PLAN, tmp_path, Engine(jobs=1), quiet=True)
    assert read(tmp_path).rows == []


def test_every_row_of_a_worker_that_died_has_a_failure() -> None:
    def broken(self, job, patience, numbers, begun):
        begun += numbers
        if len(numbers) > 1:
            raise BrokenExecutor
        yield {"run": numbers[0], "failure": "its process died: exit code 1", "unfit": True}

    with pytest.MonkeyPatch.context() as patch, pytest.raises(InvalidInput, match="can import"):
        patch.setattr(Engine, "_parallel", broken)
        list(Engine(jobs=2).make([0, 1], lambda number: job(), 1.0))


# -- files that are damaged --------------------------------------------------------------------

DAMAGE: dict[str, bytes] = {
    "no JSON": b"{half a row",
    "bytes": b"\x00\xff\xfe",
    "no row": b"[]",
    "nothing": b"",
    "no failure": b'{"run": 1, "draw": 0, "seed": 0, "identifier.gain": 1.0}',
    "no figures": b'{"run": 1, "draw": 0, "seed": 0, "identifier.gain": 1.0, "failure": null}',
    "another run": b'{"run": 99, "draw": 0, "seed": 0, "identifier.gain": 1.0, "failure": "x"}',
}


@pytest.mark.parametrize("how", DAMAGE)
def test_a_damaged_row_is_told_and_only_its_run_made_again(
    how: str, made: list[int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    sweep(tmp_path)
    lines = (tmp_path / ROWS).read_bytes().splitlines()
    lines[1] = DAMAGE[how]
    (tmp_path / ROWS).write_bytes(b"\n".join(lines) + b"\n")
    found = read(tmp_path)
    assert found.damaged == "rows.jsonl: line 2 is damaged"
    assert [row["run"] for row in found.rows] == [0, 2, 3]
    assert sweep_report.write(found)
    code, said = shell("report", tmp_path)
    assert code == 0 and "line 2 is damaged" in said.err
    made.clear()
    for retry in (True, False):
        found = sweep(tmp_path, retry=retry)
        assert made == [1] and found.damaged == ""
        assert [row["run"] for row in found.rows] == [0, 1, 2, 3]


def test_the_console_says_which_row_is_damaged(
    made: list[int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    sweep(tmp_path)
    (tmp_path / ROWS).write_bytes((tmp_path / ROWS).read_bytes() + b"damaged\n")
    run(PLAN, tmp_path, Engine(jobs=1))
    assert "rows.jsonl: line 5 is damaged; they are made again" in capfd.readouterr().err


@pytest.mark.parametrize("damage", [lambda path: path.unlink(), lambda path: path.write_text("{")])
def test_a_missing_manifest_is_restored_from_the_table(
    damage: Callable[[Path], object], made: list[int], tmp_path: Path
) -> None:
    before = sweep(tmp_path)
    damage(tmp_path / MANIFEST)
    assert read(tmp_path) == before
    made.clear()
    assert sweep(tmp_path).rows == before.rows and made == []
    assert read(tmp_path).manifest == before.manifest


def test_rows_without_manifest_and_table_are_kept_and_told(made: list[int], tmp_path: Path) -> None:
    sweep(tmp_path)
    rows = (tmp_path / ROWS).read_bytes()
    (tmp_path / MANIFEST).unlink()
    (tmp_path / TABLE).unlink()
    with pytest.raises(BadRun, match="the sweep of its rows is unknown"):
        sweep(tmp_path)
    assert (tmp_path / ROWS).read_bytes() == rows


# -- comparisons -----------------------------------------------------------------------------------


def test_a_comparison_in_which_every_method_failed_exits_with_1(tmp_path: Path) -> None:
    words = ("compare", "scalar_rov", "--methods", "paper", "--seeds", "0", "--durations", "2")
    flags = ("--identifier.gain", "1e8", "--held-out", "0.5", "--quiet")
    begin = time.process_time()
    code, _ = shell(*words, *flags, "--out", tmp_path / "out")
    assert code == NOT_EXPLAINED and time.process_time() - begin < 60
    code, _ = shell(*words, "--held-out", "0.5", "--quiet", "--out", tmp_path / "other")
    assert code == 0
