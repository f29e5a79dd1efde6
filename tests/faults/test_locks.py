"""A folder belongs to one run at a time, and files are written without following links."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from nsaid_mj.base.errors import BadRun, FolderInUse, NotWritten
from nsaid_mj.base.files import OutputFile, OutputFolder
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.loop import Observer, run
from nsaid_mj.lab.record import RECORD_FILE, Record
from nsaid_mj.plans.studies.engine import Engine
from nsaid_mj.plans.studies.folder import ROWS
from nsaid_mj.plans.studies.sweep import run_sweep as sweep
from nsaid_mj.plans.studies.sweep import sweep_plan as plan_of
from tests.support.faulty import CHECKOUT, FILES, ROV, script, shell, strict

SHORT = replace(ROV, duration=0.5, held_out=0.2, pe_window=0.2)
HOLD = """
import sys, time
from pathlib import Path
from nsaid_mj.base import OutputFolder
with OutputFolder(Path(sys.argv[1])).locked():
    print("held", flush=True)
    time.sleep(600)
"""


@contextmanager
def holder(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process, which is writing into a folder."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)],
        env={**os.environ, "PYTHONPATH": str(CHECKOUT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def test_a_second_run_in_a_folder_is_refused_until_the_first_has_died(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with holder(out) as first:
        code, said = script(SHORT, "--out", out, "--quiet")
        assert code == 2
        assert said.err.splitlines() == [
            f"nsaid: {out}: another run is writing into it. Wait until that has ended, or give "
            "another folder with --out"
        ]
        assert not list(out.iterdir())
        for action in (lambda: run(SHORT, out), lambda: sweep_in(out)):
            with pytest.raises(FolderInUse):
                action()
        os.kill(first.pid, signal.SIGKILL)
        first.wait()
        code, said = script(SHORT, "--out", out, "--quiet")
    assert (code, said.err) == (0, "")
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)


def sweep_in(folder: Path) -> object:
    plan = plan_of("scalar_rov", SHORT, {"identifier.gain": (0.1,)}, seeds=1)
    return sweep(plan, folder, Engine(jobs=1), quiet=True)


def test_a_default_folder_in_use_is_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    flags = ("--duration", 0.5, "--held-out", 0.2, "--pe-window", 0.2, "--quiet")
    with holder(tmp_path / "runs/scalar_rov-paper"):
        code, said = shell("run", "scalar_rov", *flags)
    assert (code, said.err) == (0, "")
    assert (tmp_path / "runs/scalar_rov-paper-2" / postprocessing.SUMMARY).is_file()


def test_a_second_design_in_a_folder_is_refused_and_a_default_folder_in_use_is_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ("excite", "double_pendulum", "--duration", 2, "--effort", 0.004, "--quiet")
    first = tmp_path / "runs/double_pendulum-excite"
    with holder(first):
        code, said = shell(*words, "--out", first)
        assert code == 2
        assert "another run is writing into it" in said.err
        assert not list(first.iterdir())
        code, said = shell(*words)
    assert (code, said.err) == (0, "")
    assert (tmp_path / "runs/double_pendulum-excite-2/design.json").is_file()


def test_two_threads_cannot_run_in_one_folder(tmp_path: Path) -> None:
    found: list[type[BaseException]] = []

    def second() -> None:
        try:
            run(SHORT, tmp_path)
        except FolderInUse as error:
            found.append(type(error))

    with OutputFolder(tmp_path).locked(), OutputFolder(tmp_path).locked():  # the same thread may
        thread = threading.Thread(target=second)
        thread.start()
        thread.join()
    assert found == [FolderInUse]
    run(SHORT, tmp_path)


def test_a_lock_leaves_no_folder_that_nobody_has_used(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), OutputFolder(tmp_path / "a" / "b").locked():
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())
    with OutputFolder(tmp_path / "a" / "b").locked():
        (tmp_path / "a" / "file").touch()
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["file"]


def test_results_are_not_written_beside_another_runs_record(tmp_path: Path) -> None:
    first = run(replace(SHORT, seed=1), tmp_path)
    run(replace(SHORT, seed=2), tmp_path, force=True)
    with pytest.raises(BadRun, match="another run's record"):
        postprocessing.finish(first)
    assert [path.name for path in tmp_path.iterdir()] == [RECORD_FILE]


class Saboteur(Observer):
    """Does something to the run's folder while it runs."""

    period = 0.1

    def __init__(self, action) -> None:
        self.action = action

    def start(self, scenario, robot, first) -> None:
        pass

    def see(self, log, states, levels) -> None:
        if log.t[-1] > 0.25:
            self.action()
            self.action = lambda: None

    def stop(self) -> None:
        pass


def test_a_folder_removed_during_the_run_ends_typed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(BadRun, match="removed or replaced while the run was writing it"):
        run(SHORT, out, Saboteur(lambda: shutil.rmtree(out)))
    result = run(SHORT, out)
    shutil.rmtree(out)
    with pytest.raises(BadRun):
        postprocessing.finish(result)


def test_a_record_replaced_during_the_run_ends_typed(tmp_path: Path) -> None:
    def replace_it() -> None:
        (tmp_path / RECORD_FILE).unlink()
        (tmp_path / RECORD_FILE).write_bytes(b"foreign")

    with pytest.raises(BadRun, match="removed or replaced"):
        run(SHORT, tmp_path, Saboteur(replace_it))


# -- planted links -------------------------------------------------------------------------------


def plant(folder: Path, victim: Path, *names: str) -> None:
    folder.mkdir()
    victim.write_text("dear")
    for name in names:
        (folder / name).symlink_to(victim)


def test_links_planted_in_a_runs_folder_are_not_followed(tmp_path: Path) -> None:
    out, victim = tmp_path / "out", tmp_path / "victim"
    partial = [f".{name}.part" for name in FILES if name != RECORD_FILE]
    plant(out, victim, *partial, *FILES)
    postprocessing.finish(run(SHORT, out))
    assert victim.read_text() == "dear"
    assert sorted(path.name for path in out.iterdir()) == sorted([*FILES, *partial])
    assert not any((out / name).is_symlink() for name in FILES)
    assert strict((out / postprocessing.SUMMARY).read_text())["status"] == "completed"
    assert Record.read(out).complete


def test_links_planted_in_a_sweeps_folder_are_not_followed(tmp_path: Path) -> None:
    out, victim = tmp_path / "out", tmp_path / "victim"
    names = ("manifest.json", "results.parquet", ROWS)
    plant(out, victim, *(f".{name}.part" for name in names))
    sweep_in(out)
    assert victim.read_text() == "dear"
    (out / "results.parquet").unlink()
    (out / "results.parquet").symlink_to(victim)
    (out / ROWS).unlink()
    (out / ROWS).symlink_to(victim)  # as if it held the rows of the sweep
    found = sweep_in(out)
    assert victim.read_text() == "dear" and len(found.rows) == 1


def test_what_cannot_be_written_is_a_typed_error_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").mkdir()
    with pytest.raises(NotWritten, match=r"not written by nsaid-mj.*--out"):
        OutputFile(tmp_path / "file").write_text("words")
    with pytest.raises(NotWritten), OutputFile(tmp_path / "gone" / "file").atomically():
        pass
    with pytest.raises(ZeroDivisionError), OutputFile(tmp_path / "other").atomically():
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
