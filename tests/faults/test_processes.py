"""Full disks, full or closed streams, and signals: a command ends soon, typed, without orphans."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.record import RECORD_FILE, Record
from tests.support.faulty import CHECKOUT, FILES, shell, start

PATIENCE = 90.0  # with an empty numba cache on a busy machine [s]
SHORT = ("--duration", "5", "--held-out", "0.5", "--pe-window", "0.5")
NSAID = "from nsaid_mj.cli import run_from_shell; run_from_shell()"


def nsaid(*words: object, cwd: Path, redirect: str) -> subprocess.CompletedProcess[str]:
    """`nsaid …` in a shell, with its standard streams redirected."""
    line = f'exec "$0" "$@" {redirect}'
    return subprocess.run(
        ["sh", "-c", line, sys.executable, "-c", NSAID, *map(str, words)],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(CHECKOUT), "PYTHONUTF8": "1"},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )


# -- full disks: a limit on the size of a file fails like one -------------------------------------


def limited(size: int, folder: Path) -> str:
    """The one line that a run says on stderr if no file can be larger than a size [bytes]."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        code, said = shell("run", "scalar_rov", *SHORT, "--out", folder, "--quiet")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert code == 2 and "Traceback" not in said.err
    (line,) = [line for line in said.err.splitlines() if line.startswith("nsaid: ")]
    return line


def test_a_disk_full_during_the_run_ends_typed_with_a_readable_record(tmp_path: Path) -> None:
    line = limited(40_000, tmp_path / "out")
    assert "out/record.arrow: it cannot be written" in line and "nsaid view --rebuild" in line
    record = Record.read(tmp_path / "out")
    assert not record.complete and 1.0 < record["t"][-1] < 5.0
    assert (
        postprocessing.rebuild(tmp_path / "out").ending.status == "interrupted"
    )  # with room again


def test_a_disk_full_while_finishing_ends_within_30_s_and_typed(tmp_path: Path) -> None:
    begin = time.monotonic()
    line = limited(250_000, tmp_path / "out")
    assert time.monotonic() - begin < 30.0
    assert "out/run.rrd: it cannot be written" in line
    assert f"`nsaid view --rebuild {tmp_path / 'out'}` finishes the run" in line
    assert Record.read(tmp_path / "out").complete
    hidden = {p.name for p in (tmp_path / "out").glob(".*")} - {".nsaid-mj.json"}
    assert not hidden  # no half a file


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
@pytest.mark.parametrize("words", [("list",), ("run", "scalar_rov", *SHORT, "--out", "out")])
def test_a_full_standard_output_is_told_in_one_line(words: tuple[str, ...], tmp_path: Path) -> None:
    done = nsaid(*words, cwd=tmp_path, redirect=">/dev/full")
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert lines == ["nsaid: the output: No space left on device. Give another one."]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
@pytest.mark.parametrize(
    "redirect",
    ["2>/dev/full", pytest.param("<&- 2>&-", marks=pytest.mark.slow), "<&- >&- 2>&-"],
)
def test_a_full_standard_error_or_closed_streams_do_not_matter(
    redirect: str, tmp_path: Path
) -> None:
    words = ("run", "scalar_rov", *SHORT, "--out", "out")
    done = nsaid(*words, cwd=tmp_path, redirect=redirect)
    assert (done.returncode, done.stderr) == (0, "")
    assert ("report" in done.stdout) == (">&- 2" not in redirect)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(FILES)


# -- signals -------------------------------------------------------------------------------------


def test_ctrl_c_while_finishing_names_how_to_finish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("nsaid_mj.lab.postprocessing.evaluate", interrupted)
    code, said = shell("run", "scalar_rov", *SHORT, "--out", tmp_path, "--quiet")
    assert code == 130
    assert said.err == (f"nsaid: interrupted. `nsaid view --rebuild {tmp_path}` finishes the run\n")
    assert [path.name for path in tmp_path.iterdir()] == [RECORD_FILE]


def test_ctrl_c_ends_a_monte_carlo_study_soon(tmp_path: Path) -> None:
    words = ("montecarlo", "scalar_rov", "--runs", "100000", "--jobs", "2", "--duration", "1")
    rows = tmp_path / "out" / "rows.jsonl"
    process = start(*words, "--out", tmp_path / "out", cwd=tmp_path)
    try:
        end = time.monotonic() + 2 * PATIENCE
        while not (rows.is_file() and rows.stat().st_size):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end, "no run is done"
            time.sleep(0.02)
        begin = time.monotonic()
        os.kill(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE)
        assert time.monotonic() - begin < 10.0  # 3 s on an idle machine
    finally:
        process.kill()
    assert process.returncode == 130
    assert err.splitlines()[-1] == "nsaid: interrupted"


def descendants(pid: int) -> set[int]:
    """The processes that a process has started, and theirs."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(entry.parent.name)] = int(entry.read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError):
            continue
    found, fresh = set[int](), {pid}
    while fresh:
        fresh = {child for child, parent in parents.items() if parent in fresh}
        found |= fresh
    return found


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds processes in /proc")
@pytest.mark.parametrize(
    "how",
    [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.slow), signal.SIGKILL],
)
def test_a_sweep_that_is_ended_leaves_no_process(how: signal.Signals, tmp_path: Path) -> None:
    words = ("sweep", "scalar_rov", "--seeds", "4", "--jobs", "2", "--duration", "30000")
    process = start(*words, "--out", tmp_path / "out", "--quiet", cwd=tmp_path)
    try:
        end, begun = time.monotonic() + PATIENCE, set[int]()
        while len(begun) < 3:  # two processes, and that of multiprocessing for its semaphores
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end, "no run has begun"
            time.sleep(0.1)
            begun = descendants(process.pid)
        time.sleep(1.0)
        begun = descendants(process.pid)
        os.kill(process.pid, how)
        process.wait(timeout=30)
        end = time.monotonic() + PATIENCE  # some may still be importing
        while left := {pid for pid in begun if alive(pid)}:
            assert time.monotonic() < end, f"{len(left)} processes are left"
            time.sleep(0.1)
    finally:
        process.kill()
        process.communicate()
        for pid in filter(alive, begun):
            os.kill(pid, signal.SIGKILL)
    assert process.returncode == (-how if how == signal.SIGKILL else 130)
