"""Real processes that are killed, interrupted, short of disk, or two in one folder."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import time
from pathlib import Path

from nsaid_mj import Record
from nsaid_mj.errors import NsaidError
from nsaid_mj.recording import postprocessing
from tests.support.faulty import start

from .tries import Draw, Kind

PATIENCE = 300.0  # of a busy machine [s]
SHORT = ("run", "scalar_rov", "--duration", "5", "--held-out", "0.5", "--pe-window", "0.5")
LONG = ("run", "scalar_rov", "--duration", "3000", "--held-out", "0.5", "--pe-window", "0.5")


def ended(process: subprocess.Popen[str], *codes: int) -> str:
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


def running(process: subprocess.Popen[str], out: Path) -> str:
    """Waits until a run has written some rows; returns why it does not."""
    record, end = out / "record.arrow", time.monotonic() + PATIENCE
    while not (record.is_file() and record.stat().st_size > 20_000):
        if process.poll() is not None or time.monotonic() > end:
            return f"it does not run: {ended(process)}"
        time.sleep(0.02)
    return ""


def killed(rng: random.Random, here: Path) -> Kind:
    """kill -9 at any time: what is there can be read and finished, or is refused typed."""
    delay = rng.uniform(0.0, 8.0)

    def check() -> str:
        process = start(*LONG, "--out", "out", "--quiet", cwd=here)
        time.sleep(delay)
        process.kill()
        process.communicate()
        try:
            record = Record.read(here / "out")
            if len(record) > 1 and postprocessing.rebuild(here / "out")["status"] not in (
                "interrupted",
                "completed",
            ):
                return "a wrong status"
        except NsaidError:
            pass
        return ended(start(*SHORT, "--out", "out", "--force", cwd=here), 0)

    return Kind("kill -9 at random", check)


def interrupted(rng: random.Random, here: Path) -> Kind:
    """A signal ends a run with all its files."""
    how = rng.choice((signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    delay = rng.uniform(0.0, 3.0)

    def check() -> str:
        process = start(*LONG, "--out", "out", cwd=here)
        if wrong := running(process, here / "out"):
            return wrong
        time.sleep(delay)
        os.kill(process.pid, how)
        if wrong := ended(process, 0, 130):
            return wrong
        finished = (here / "out" / "summary.json").is_file() or process.returncode == 130
        return "" if finished else "no summary"

    return Kind(f"{how.name} while running", check)


def full_disk(rng: random.Random, here: Path) -> Kind:
    """A limit on the size of files: completed, or typed, with a readable record."""
    blocks = round(10 ** rng.uniform(0.3, 3.6))  # of 512 bytes, or of 1024 in some shells

    def check() -> str:
        process = start(*SHORT, "--out", "out", cwd=here, before=f"ulimit -f {blocks}; ")
        if wrong := ended(process, 0, 2):
            return wrong
        if blocks > 100:
            Record.read(here / "out")  # raises if it is unreadable
        return ""

    return Kind(f"files of at most {blocks} blocks", check)


def streams(rng: random.Random, here: Path) -> Kind:
    """Full and closed standard streams."""
    redirect = rng.choice((">/dev/full", "2>/dev/full", "<&-", ">&-", "2>&-", "<&- >&- 2>&-"))
    words = rng.choice(((*SHORT, "--out", "out"), ("list",), ("--version",)))
    code = 2 if redirect == ">/dev/full" else 0
    return Kind(
        f"streams {redirect}", lambda: ended(start(*words, cwd=here, redirect=redirect), code)
    )


def together(rng: random.Random, here: Path) -> Kind:
    """Several runs in one folder: one is completed, the others are refused."""
    count, gap = rng.choice((2, 3)), rng.uniform(0.0, 0.5)

    def check() -> str:
        flags = ("--duration", "30", "--held-out", "0.5", "--out", "out", "--quiet", "--force")
        found = []
        for seed in range(count):
            found.append(start("run", "scalar_rov", *flags, "--seed", str(seed), cwd=here))
            time.sleep(gap)
        wrong = [words for process in found if (words := ended(process, 0, 2))]
        if wrong:
            return wrong[0]
        record = Record.read(here / "out")
        steady = (record["t"][1:] > record["t"][:-1]).all()
        if not (record.complete and steady and len(record) == 3001):
            return "the record is mixed"
        return "" if any(process.returncode == 0 for process in found) else "none completed"

    return Kind(f"{count} runs in one folder", check)


def removed(rng: random.Random, here: Path) -> Kind:
    """The folder is removed while the run writes into it."""
    delay = rng.uniform(0.0, 1.0)

    def check() -> str:
        process = start("run", "scalar_rov", "--duration", "600", "--out", "out", cwd=here)
        if wrong := running(process, here / "out"):
            return wrong
        time.sleep(delay)
        (here / "out").rename(here / "away")
        return ended(process, 0, 2)

    return Kind("folder removed while running", check)


FAMILIES: dict[str, Draw] = {
    "kill -9": killed,
    "signals": interrupted,
    "full disks": full_disk,
    "streams": streams,
    "one folder": together,
    "removed folders": removed,
}
