"""Terminal output during a command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj import Record
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.progress import COMPILING, Progress, cost_of
from tests.support.faulty import call

ROV = replace(load("scalar_rov"), duration=1.0)


@pytest.mark.slow  # it compiles into an empty cache
def test_a_first_run_says_that_it_compiles_and_the_second_does_not(tmp_path: Path):
    words = ("run", "scalar_rov", "--duration", "0.4", "--law", "memory", "--out")  # no misfit
    cache = str(tmp_path / "cache")
    first, second = (
        call(*words, tmp_path / name, cwd=tmp_path, NUMBA_CACHE_DIR=cache) for name in "ab"
    )
    assert first.returncode == second.returncode == 0
    assert first.stderr.count(COMPILING) >= 1
    assert "s of one-time compilation" in first.stdout
    assert COMPILING not in second.stderr
    assert "compiling" not in second.stdout
    a, b = (Record.read(tmp_path / name) for name in "ab")
    assert all(np.array_equal(a[column], b[column]) for column in a.columns)


def test_without_a_terminal_compiling_is_told_every_10_s(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    now = [100.0]
    monkeypatch.setattr("nsaid_mj.lab.progress.time.monotonic", lambda: now[0])
    told = Progress("ur5")
    for now[0] in (100.0, 101.0, 105.0, 111.0, 112.0):
        told._compiling()
    first, second = capsys.readouterr().err.splitlines()
    assert first == f"ur5: {COMPILING}"
    assert second == f"ur5: {COMPILING}: 4 functions"


@pytest.mark.slow
def test_quiet_says_nothing_of_compiling(tmp_path: Path):
    words = ("run", "scalar_rov", "--duration", "0.5", "--quiet", "--out", tmp_path / "run")
    told = call(*words, cwd=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert (told.returncode, told.stdout, told.stderr) == (0, "", "")


def test_progress_observes_a_whole_run_while_shown(tmp_path: Path):
    with Progress("rov") as progress:
        assert len(run(ROV, tmp_path, progress).record) > 1
        progress.say("evaluating the estimate")


def test_the_cost_of_a_long_run_is_told_beforehand():
    plant = ROV.plant.build(ROV.dt, 0)
    assert cost_of(replace(ROV, duration=60.0), plant.system) == ""
    long = cost_of(replace(ROV, duration=1e7, dt=0.01), plant.system)
    assert long.startswith("1.0e+09 steps, which takes about 28 h and ")
    assert cost_of(replace(ROV, duration=1e6, dt=0.01, record_every=1000), plant.system)
