"""Start-up cost: wall time of whole commands, each in a process of its own.

    python scripts/startup.py [--runs 5]

The kernels' cache is warm: every command runs once before it is timed. For sweeps, the fixed cost
of the pool and the cost per run outside its time loop follow from two sweeps of different length.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from machine import machine

COMMANDS = (
    "--help",
    "list",
    "run ur5 --duration 1",
    "run ur5 --duration 1 --law memory",
    "run ur5 --duration 1 --plant.backend pinocchio",
    "run bluerov2 --duration 1",
)
SWEEPS = ("scalar_rov --duration 2 --held-out 1", "ur5 --duration 1 --held-out 1")
SHORT, LONG = 4, 28  # numbers of runs in the two sweeps


def seconds(command: str, folder: str) -> float:
    """Wall time of one `nsaid` command [s]."""
    words = command.split()
    if words[0] in ("run", "sweep"):
        words += ["--quiet", "--out", folder]
    if words[0] == "run":
        words += ["--force"]  # overwrite the previous run
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    nsaid = Path(sys.executable).with_name("nsaid")
    begin = time.perf_counter()
    subprocess.run([nsaid, *words], check=True, stdout=subprocess.DEVNULL, env=environment)
    return time.perf_counter() - begin


def startups(runs: int) -> None:
    """Prints median and quartiles of every command's times, measured in alternation."""
    with tempfile.TemporaryDirectory() as folder:
        times = [[seconds(command, folder) for command in COMMANDS] for _ in range(runs + 1)]
    for command, own in zip(COMMANDS, np.array(times[1:]).T, strict=True):
        low, median, high = np.percentile(own, [25, 50, 75])
        print(f"{median:6.2f} s ({low:.2f} … {high:.2f})  nsaid {command}")


def sweep(words: str, runs: int) -> None:
    """Prints a sweep's fixed cost on one worker, and a run's cost with and without its loop."""
    times, loops = [], []
    for _ in range(runs):
        took = []
        for count in (SHORT, LONG):
            with tempfile.TemporaryDirectory() as folder:
                took.append(seconds(f"sweep {words} --jobs 1 --seeds {count}", folder))
                lines = (Path(folder) / "rows.jsonl").read_text(encoding="utf-8").splitlines()
        loops += [json.loads(line)["wall_s"] for line in lines]
        run = (took[1] - took[0]) / (LONG - SHORT)
        times.append((took[0] - SHORT * run, run))
    fixed, run = np.median(times, axis=0)
    print(
        f"{fixed:6.2f} s once, {run:.3f} s a run, {run - np.median(loops):.3f} s beside its time "
        f"loop  nsaid sweep {words} --jobs 1"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    chosen = parser.parse_args()
    print(", ".join(f"{key} {value}" for key, value in machine().items()))
    startups(chosen.runs)
    for each in SWEEPS:
        sweep(each, min(chosen.runs, 3))
