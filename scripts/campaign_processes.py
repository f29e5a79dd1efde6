"""Real processes that are killed, interrupted, short of disk, or two in one folder."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from nsaid_mj import Record
from nsaid_mj.errors import NsaidError
from nsaid_mj.recording import postprocessing
from scripts.campaign_tries import Draw, Kind, Try, carried_out

ROOT = Path(__file__).resolve().parents[1]
CODE = "from nsaid_mj.cli import run_from_shell; run_from_shell()"
LIMIT = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0})); "
PATIENCE = 300.0  # of a busy machine [s]
SHORT = ("--duration", "5", "--held-out", "0.5", "--pe-window", "0.5")
LONG = ("--duration", "3000", "--held-out", "0.5", "--pe-window", "0.5")


def start(*words: str, cwd: Path, before: str = "", redirect: str = "") -> subprocess.Popen[str]:
    """`nsaid …` in a process of its own."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # never inherit SIG_IGN
    line = f'exec "$0" "$@" {redirect}'
    try:
        return subprocess.Popen(
            ["sh", "-c", line, sys.executable, "-c", before + CODE, *words],
            cwd=cwd,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUTF8": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
    finally:
        signal.signal(signal.SIGINT, handler)


def ended(process: subprocess.Popen[str], codes: tuple[int, ...]) -> str:
    """What is wrong with how a process ended."""
    try:
        _, err = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return "it hangs"
    if "Traceback" in err:
        return f"a traceback: {err.strip().splitlines()[-1]}"
    return "" if process.returncode in codes else f"exit code {process.returncode}: {err[-300:]}"


def killed(rng: random.Random, folder: Path) -> Kind:
    """kill -9 at any time: what is there can be read and finished, or is refused typed."""
    delay = rng.uniform(0.0, 8.0)

    def check() -> str:
        process = start("run", "scalar_rov", *LONG, "--out", "out", "--quiet", cwd=folder)
        time.sleep(delay)
        process.kill()
        process.communicate()
        try:
            record = Record.read(folder / "out")
            if len(record) > 1 and postprocessing.rebuild(folder / "out")["status"] not in (
                "interrupted",
                "completed",
            ):
                return "a wrong status"
        except NsaidError:
            pass
        return ended(
            start("run", "scalar_rov", *SHORT, "--out", "out", "--force", cwd=folder), (0,)
        )

    return Kind("kill -9 at random", check)


def interrupted(rng: random.Random, folder: Path) -> Kind:
    """A signal ends a run with all its files."""
    how = rng.choice((signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    delay = rng.uniform(0.0, 3.0)

    def check() -> str:
        process = start("run", "scalar_rov", *LONG, "--out", "out", cwd=folder)
        record, end = folder / "out" / "record.arrow", time.monotonic() + PATIENCE
        while not (record.is_file() and record.stat().st_size > 50_000):
            if process.poll() is not None or time.monotonic() > end:
                return f"it does not run: {ended(process, ())}"
            time.sleep(0.02)
        time.sleep(delay)
        os.kill(process.pid, how)
        if wrong := ended(process, (0, 130)):
            return wrong
        finished = (folder / "out" / "summary.json").is_file() or process.returncode == 130
        return "" if finished else "no summary"

    return Kind(f"{how.name} while running", check)


def full_disk(rng: random.Random, folder: Path) -> Kind:
    """A limit on the size of files: completed, or typed within 30 s, with a readable record."""
    limit = round(10 ** rng.uniform(3.0, 6.3))

    def check() -> str:
        before = LIMIT.format(limit)
        process = start("run", "scalar_rov", *SHORT, "--out", "out", cwd=folder, before=before)
        if wrong := ended(process, (0, 2)):
            return wrong
        if limit > 50_000:
            Record.read(folder / "out")  # raises if it is unreadable
        return ""

    return Kind("disk full", check)


def streams(rng: random.Random, folder: Path) -> Kind:
    """Full and closed standard streams."""
    redirect = rng.choice((">/dev/full", "2>/dev/full", "<&-", ">&-", "2>&-", "<&- >&- 2>&-"))
    words = rng.choice((("run", "scalar_rov", *SHORT, "--out", "out"), ("list",), ("--version",)))
    codes = (2,) if redirect == ">/dev/full" else (0,)

    def check() -> str:
        return ended(start(*words, cwd=folder, redirect=redirect), codes)

    return Kind(f"streams {redirect}", check)


def together(rng: random.Random, folder: Path) -> Kind:
    """Several runs in one folder: one is completed, the others are refused."""
    count, gap = rng.choice((2, 3)), rng.uniform(0.0, 0.5)

    def check() -> str:
        flags = ("--duration", "30", "--held-out", "0.5", "--out", "out", "--quiet", "--force")
        found = []
        for seed in range(count):
            found.append(start("run", "scalar_rov", *flags, "--seed", str(seed), cwd=folder))
            time.sleep(gap)
        wrong = [words for process in found if (words := ended(process, (0, 2)))]
        if wrong:
            return wrong[0]
        record = Record.read(folder / "out")
        steady = all(
            later > earlier for earlier, later in zip(record["t"], record["t"][1:], strict=False)
        )
        if not (record.complete and steady and len(record) == 3001):
            return "the record is mixed"
        return "" if any(process.returncode == 0 for process in found) else "none completed"

    return Kind("several runs in one folder", check)


def removed(rng: random.Random, folder: Path) -> Kind:
    """The folder is removed while the run writes into it."""
    delay = rng.uniform(0.0, 1.0)

    def check() -> str:
        process = start("run", "scalar_rov", "--duration", "600", "--out", "out", cwd=folder)
        record, end = folder / "out" / "record.arrow", time.monotonic() + PATIENCE
        while not (record.is_file() and record.stat().st_size > 20_000):
            if process.poll() is not None or time.monotonic() > end:
                return f"it does not run: {ended(process, ())}"
            time.sleep(0.02)
        time.sleep(delay)
        (folder / "out").rename(folder / "away")
        return ended(process, (0, 2))

    return Kind("folder removed while running", check)


FAMILIES: dict[str, Draw] = {
    "kill -9": killed,
    "signals": interrupted,
    "full disks": full_disk,
    "streams": streams,
    "one folder": together,
    "removed folders": removed,
}


def carry_out(family: str, tries: int, seed: int) -> Iterator[Try]:
    """The first tries of a family."""
    return carried_out(family, FAMILIES[family], tries, seed)
