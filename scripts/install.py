"""Makes .venv and installs this checkout into it, and says all the time what it is doing.

    python3 scripts/install.py [EXTRA,EXTRA …]

Needs nothing but Python. Wheels are not byte-compiled: Python does this on first import.
"""

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
VENV = ROOT / ".venv"
LOG = VENV / "install.log"
EVERY = 0.2 if sys.stdout.isatty() else 5.0  # time between two lines about progress [s]


class Ticker:
    """One line about what is going on, rewritten on a terminal and repeated elsewhere."""

    def __init__(self, what: str):
        self.what, self._begin, self._done = what, time.monotonic(), threading.Event()
        self._thread = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> "Ticker":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()
        self._say(end="\n")

    def _tick(self) -> None:
        while not self._done.wait(EVERY):
            self._say("" if sys.stdout.isatty() else "\n")

    def _say(self, end: str) -> None:
        seconds = time.monotonic() - self._begin
        start = "\r\033[K" if sys.stdout.isatty() else ""
        print(f"{start}  {seconds:3.0f} s  {self.what[:68]}", end=end, flush=True)


def run(words: list[str], ticker: Ticker) -> None:
    """Runs a command, shows what pip says in brief, and all of it if it fails."""
    with LOG.open("a", encoding="utf-8") as log:
        process = subprocess.Popen(
            words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        for line in process.stdout or ():
            log.write(line)
            if found := re.match(r"\s*(Collecting|Downloading|Processing) (\S+)(.*)", line):
                name = found[2].rstrip("/").rpartition("/")[2].partition("-")[0]
                size = re.search(r"\([\d.]+ \wB\)", found[3])
                ticker.what = f"fetching {name} {size[0] if size else ''}"
            elif line.startswith("Installing collected"):
                ticker.what = f"unpacking {line.count(',') + 1} packages"
        if process.wait():
            print(f"\n{LOG.read_text(encoding='utf-8')}\nInstalling failed; see above.")
            sys.exit(1)


def main() -> None:
    """Installs this checkout with the extras named on the command line."""
    extras = sys.argv[1] if len(sys.argv) > 1 else "arms,view"
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    if sys.version_info < (3, 11):  # noqa: UP036 - this script runs before anything is installed
        sys.exit(f"Python 3.11 or newer is needed, this is {version}: make PYTHON=python3.12")
    print(f"Installing nsaid-mj[{extras}] for Python {version} into {VENV.name}", flush=True)
    VENV.mkdir(exist_ok=True)
    python = VENV / ("Scripts" if os.name == "nt" else "bin") / "python"
    with Ticker("creating the environment") as ticker:
        if not python.exists():
            run([sys.executable, "-m", "venv", str(VENV)], ticker)
        own = ["--editable", f".[{extras}]"]
        run([str(python), "-m", "pip", "install", "--no-compile", "--no-input", *own], ticker)
        ticker.what = "installed"


if __name__ == "__main__":
    main()
