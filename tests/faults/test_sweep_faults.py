"""Sweeps whose processes are killed, whose files are damaged, or that two processes want."""

from __future__ import annotations

import itertools
import json
import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pebble.pool.process
import pytest

from nsaid_mj.base.errors import BadRun, InvalidInput
from nsaid_mj.plans.studies import engine, sweep_report
from nsaid_mj.plans.studies.engine import Engine
from nsaid_mj.plans.studies.folder import MANIFEST, ROWS, TABLE, read
from nsaid_mj.plans.studies.runs import Runs
from nsaid_mj.plans.studies.study import Row
from nsaid_mj.plans.studies.sweep import run_sweep, sweep_plan
from nsaid_mj.report import ExitCode
from nsaid_mj.report.page import render_html
from tests.support.faulty import ROV, shell

PLAN = sweep_plan("scalar_rov", ROV, {"identifier.gain": (0.1, 1.0)}, seeds=2)


def row(number: int) -> Row:
    """A row as a run would give it."""
    found = {"run": number, "failure": None, "status": "completed", "theta_perp_ratio": 0.1}
    return PLAN.what(number) | found | {"time_to_converge": None}


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers of the runs that are made, by an engine that takes no time."""
    numbers: list[int] = []

    def make(self, todo, job):
        for number in todo:
            numbers.append(number)
            yield {key: value for key, value in row(number).items() if key not in PLAN.what(0)} | {
                "run": number
            }

    monkeypatch.setattr(Engine, "make", make)
    return numbers


def sweep(folder: Path, **more: bool) -> Runs:
    return run_sweep(PLAN, folder, Engine(jobs=1), quiet=True, **more)


# -- processes that die ----------------------------------------------------------------------------


def kill_at_once(monkeypatch: pytest.MonkeyPatch, first: int) -> None:
    """Kills the first processes of a pool before they have imported anything."""
    launch, count = pebble.pool.process.launch_process, itertools.count()

    def launched(*arguments):
        process = launch(*arguments)
        if next(count) < first:
            os.kill(process.pid, signal.SIGKILL)
        return process

    monkeypatch.setattr(pebble.pool.process, "launch_process", launched)


def test_a_process_killed_while_it_starts_is_started_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kill_at_once(monkeypatch, 2)
    found = sweep(tmp_path)
    assert len(found.rows) == len(PLAN) and not found.lost


def test_processes_killed_at_every_start_end_the_sweep(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kill_at_once(monkeypatch, 10**6)
    before = dict(os.environ)
    with pytest.raises(InvalidInput, match="processes that start"):
        sweep(tmp_path)
    assert read(tmp_path).rows == [] and os.environ == before


class Broken:
    """What Dask gives for a run that no worker could begin."""

    def add_done_callback(self, callback: Callable[[Broken], object]) -> None:
        callback(self)

    def result(self) -> None:
        raise ModuleNotFoundError("No module named 'nsaid_mj'")


def test_workers_that_cannot_import_the_package_end_the_sweep(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch, pytest.raises(InvalidInput, match="can import"):
        patch.setattr(engine._Cluster, "__init__", cluster_of(Broken))
        patch.setattr(engine._Cluster, "close", lambda _: None)
        run_sweep(PLAN, tmp_path, Engine("dask", "tcp://nowhere:1"), quiet=True)
    assert read(tmp_path).rows == []


def test_a_lost_scheduler_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine._Cluster, "__init__", cluster_of(Future, "connecting"))
    monkeypatch.setattr(engine._Cluster, "close", lambda _: None)
    monkeypatch.setattr(engine, "_SILENCE", 0.1)
    with pytest.raises(InvalidInput, match="scheduler that keeps running"):
        run_sweep(PLAN, tmp_path, Engine("dask", "tcp://nowhere:1"), quiet=True)
    assert read(tmp_path).rows == []


def cluster_of(task: Callable[[], Any], status: str = "running"):
    """The constructor of a cluster in memory, whose runs all become such tasks."""

    def made(self, distributed, address, jobs) -> None:
        self._killed, self._address, self._jobs = distributed.KilledWorker, address, jobs
        self._client = SimpleNamespace(
            status=status, nthreads=lambda: {"worker": 2}, submit=lambda *_, **__: task()
        )
        self._tasks, self._seen, self._threads = {}, time.monotonic(), 1

    return made


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
    assert sweep_report.write_sweep_page(found)
    code, said = shell("report", tmp_path)
    assert code == 0 and "line 2 is damaged" in said.err
    made.clear()
    for retry in (True, False):
        found = sweep(tmp_path, retry=retry)
        assert made == [1] and found.damaged == ""
        assert [row["run"] for row in found.rows] == [0, 1, 2, 3]


WRONG = (None, True, -1, 0.5, 1e308, 10**400, "", "x", [], {}, [1.0], {"a": 1})
KEYS = [*row(1)]


@pytest.mark.parametrize("key", KEYS)
def test_a_changed_value_of_a_row_ends_in_a_page_or_in_words(
    key: str, made: list[int], tmp_path: Path
) -> None:
    """Every kind of value in every place: the row counts, or is called damaged."""
    sweep(tmp_path)
    lines = (tmp_path / ROWS).read_bytes().splitlines()
    before = json.loads(lines[1])
    for value in WRONG:
        lines[1] = json.dumps(before | {key: value}).encode()
        (tmp_path / ROWS).write_bytes(b"\n".join(lines) + b"\n")
        found = read(tmp_path)
        kept = [each["run"] for each in found.rows]
        assert kept == [0, 1, 2, 3] or found.damaged == "rows.jsonl: line 2 is damaged", value
        assert sum(len(group.rows) for group in found.groups) == len(kept), value
        assert render_html(sweep_report.sweep_page(found)), value


def test_the_console_says_which_row_is_damaged(
    made: list[int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    sweep(tmp_path)
    (tmp_path / ROWS).write_bytes((tmp_path / ROWS).read_bytes() + b"damaged\n")
    run_sweep(PLAN, tmp_path, Engine(jobs=1))
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
    assert code == ExitCode.NOT_EXPLAINED and time.process_time() - begin < 60
    code, _ = shell(*words, "--held-out", "0.5", "--quiet", "--out", tmp_path / "other")
    assert code == 0
