"""What `nsaid identify` prints of an arm, an ROV and a robot on its feet: writes docs/output.md.

    python -m scripts.output [--check] [arm] [rov] [legs]

Each log has 60 s and is simulated with noisy sensors; the commands run on a terminal of 80 columns.
With `--check` nothing is written: what is printed now must be what the page shows, apart from
computing times; the exit code is 1 where it is not. The names choose some of the three.
"""

import argparse
import os
import pty
import re
import shlex
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from fcntl import ioctl
from pathlib import Path
from termios import TIOCSWINSZ
from typing import NamedTuple

import numpy as np

from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.assets import asset
from tests.court.walking import drawn_walk

PAGE = Path(__file__).parents[1] / "docs" / "output.md"
COLUMNS = 80
SECONDS = 60.0


def arm(folder: Path) -> list[str]:
    """A UR5's joints and currents, and the known gain of one motor."""
    log, _ = _simulated("ur5", seed=3)
    heads = [f"{kind}{i}" for kind in ("q", "dq", "current") for i in range(1, 7)]
    current = log.u / [11.5, 11.5, 11.5, 8.6, 8.6, 8.6]  # [A], some 11.5 N·m/A at large joints
    _written(folder / "ur5.csv", heads, np.column_stack([log.t, log.q, log.v, current]))
    return ["ur5.csv", "--model", "ur5", "--known", "gain_1=11.5"]


def rov(folder: Path) -> list[str]:
    """A BlueROV2's pose, twist and commands; its sheet is that of the package."""
    log, _ = _simulated("bluerov2", seed=3)
    widths = {"q": log.q, "v": log.v, "u": log.u}
    heads = [f"{name}_{k}" for name, x in widths.items() for k in range(x.shape[1])]
    _written(folder / "dive.csv", heads, np.column_stack([log.t, log.q, log.v, log.u]))
    sheet = asset("bluerov2", "vehicle.toml").read_text(encoding="utf-8")
    (folder / "rov.toml").write_text(sheet, encoding="utf-8")
    return ["dive.csv", "--model", "rov.toml", "--known", "m=13.5"]


def legs(folder: Path) -> list[str]:
    """A walking Go2's joints, torques and IMU, and its weight."""
    walk = drawn_walk(3, folder, robot="go2", seconds=SECONDS)
    mass = sum(walk.truth["mass"])
    return [walk.log.name, "--model", walk.model.name, "--known", f"mass={mass:.4g}"]


class Story(NamedTuple):
    """One of the page's outputs."""

    title: str
    lead: str
    made: Callable[[Path], list[str]]  # writes log and model, returns the words after `identify`


STORIES = {
    "arm": Story(
        "An arm by currents",
        "A UR5 moved for 60 s; its log has positions, velocities and currents. The gain of the "
        "first motor is known from its data sheet.",
        arm,
    ),
    "rov": Story(
        "An underwater vehicle",
        "A BlueROV2 Heavy in a tank; its log has pose, twist and the eight commands. It was "
        "weighed.",
        rov,
    ),
    "legs": Story(
        "Legs on the ground",
        "A Go2 walked for 60 s; its log has joints, torques and the IMU. It was weighed.",
        legs,
    ),
}

_TIMES = re.compile(r"\d+(\.\d+)? s\.$", re.MULTILINE)  # such as "identified in 6.1 s."


def _simulated(name: str, seed: int):
    """The noisy log of a scenario's plant, and its true θ."""
    setup = Setup.of(replace(load(name), duration=SECONDS, sensors="noisy", seed=seed))
    with setup.plant.running():
        return setup.simulate(), setup.plant.truth


def _written(path: Path, heads: list[str], table: np.ndarray) -> None:
    header = ",".join(["t", *heads])
    np.savetxt(path, table, fmt="%.7g", delimiter=",", header=header, comments="")


def printed(words: list[str], folder: Path) -> str:
    """What `nsaid identify` prints on a terminal of 80 columns."""
    ours, theirs = pty.openpty()
    ioctl(theirs, TIOCSWINSZ, struct.pack("HHHH", 50, COLUMNS, 0, 0))
    known = {**os.environ, "NO_COLOR": "1", "TERM": "dumb", "COLUMNS": str(COLUMNS)}
    program = [sys.executable, "-c", "from nsaid_mj.cli import run_from_shell; run_from_shell()"]
    with subprocess.Popen(
        [*program, "identify", *words, "--out", "found"],
        cwd=folder,
        env=known,
        stdout=theirs,
        stderr=subprocess.DEVNULL,
    ):
        os.close(theirs)
        parts = []
        while part := _read(ours):
            parts.append(part)
    os.close(ours)
    lines = b"".join(parts).decode().replace("\r\n", "\n").splitlines()
    return "\n".join(line.rstrip() for line in lines).strip()


def _read(terminal: int) -> bytes:
    """What a terminal has to show; b"" after its end."""
    try:
        return os.read(terminal, 65536)
    except OSError:  # how Linux says that nobody writes any more
        return b""


def section(story: Story) -> str:
    """A section of the page."""
    with tempfile.TemporaryDirectory() as folder:
        words = story.made(Path(folder))
        text = printed(words, Path(folder))
    command = shlex.join(["nsaid", "identify", *words])
    return f"## {story.title}\n\n{story.lead}\n\n`{command}` prints\n\n```text\n{text}\n```\n"


HEAD = """\
# What identify prints

`nsaid identify` on three logs of 60 s, on a terminal of 80 columns. The first line is the answer:
whether the model explains the log, by how much, and the one thing to do next. The lines below it
are findings, the gravest first (✘ ▲ ·); the tables hold every gain and friction with its 95 %
interval; [your_robot.md](your_robot.md#4-read-the-result) explains the marks. In a pipe nothing is
folded or left out.

The logs are simulated, with noisy sensors; `scripts/output.py` makes this page, and compares it.
"""


def main() -> int:
    """Writes or checks the page; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    parser.add_argument("names", nargs="*", choices=[[], *STORIES], help="some of them")
    given = parser.parse_args()
    old = dict(zip(STORIES, _sections(), strict=False))
    wrong = []
    for name in given.names or STORIES:
        new = section(STORIES[name])
        if _TIMES.sub("", new) != _TIMES.sub("", old.get(name, "")):
            wrong.append(name)
        old[name] = new
    if given.check:
        print(f"differs: {', '.join(wrong)}" if wrong else "as printed")
        return bool(wrong)
    PAGE.write_text("\n".join([HEAD, *(old[name] for name in STORIES if name in old)]), "utf-8")
    return 0


def _sections() -> list[str]:
    """The sections of the page as it is."""
    text = PAGE.read_text("utf-8") if PAGE.is_file() else ""
    return [part.rstrip() + "\n" for part in re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]]


if __name__ == "__main__":
    sys.exit(main())
