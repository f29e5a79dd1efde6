"""Start-up cost: wall time of whole commands, each in a process of its own.

    python scripts/startup.py [--runs 5] [FILE.json]

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
from typing import Any

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
_CALL = "from nsaid_mj.cli import run_from_shell; run_from_shell()"


def seconds(command: str, folder: str) -> float:
    """Wall time of one `nsaid` command [s]."""
    words = command.split()
    if words[0] in ("run", "sweep"):
        words += ["--quiet", "--out", folder]
    if words[0] == "run":
        words += ["--force"]  # overwrite the previous run
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    begin = time.perf_counter()
    called = [sys.executable, "-c", _CALL, *words]
    subprocess.run(called, check=True, stdout=subprocess.DEVNULL, env=environment)
    return time.perf_counter() - begin


def startups(runs: int) -> list[dict[str, Any]]:
    """A row for each command: median and quartiles of its times, measured in alternation."""
    with tempfile.TemporaryDirectory() as folder:
        times = [[seconds(command, folder) for command in COMMANDS] for _ in range(runs + 1)]
    low, median, high = np.percentile(times[1:], [25, 50, 75], axis=0)
    return [
        {
            "what": f"nsaid {command}",
            "seconds": float(m),
            "quartiles": [float(a), float(b)],
            "runs": runs,
        }
        for command, m, a, b in zip(COMMANDS, median, low, high, strict=True)
    ]


def sweeps(runs: int) -> list[dict[str, Any]]:
    """A row for each sweep on one worker: fixed cost, cost per run with and without the loop."""
    rows = []
    for sweep in SWEEPS:
        times, loops = [], []
        for _ in range(runs):
            took = []
            for count in (SHORT, LONG):
                with tempfile.TemporaryDirectory() as folder:
                    took.append(seconds(f"sweep {sweep} --jobs 1 --seeds {count}", folder))
                    lines = (Path(folder) / "rows.jsonl").read_text(encoding="utf-8").splitlines()
            loops += [json.loads(line)["wall_s"] for line in lines]
            run = (took[1] - took[0]) / (LONG - SHORT)
            times.append((took[0] - SHORT * run, run))
        fixed, run = np.median(times, axis=0)
        rows.append(
            {
                "what": f"nsaid sweep {sweep} --jobs 1",
                "fixed_s": float(fixed),
                "run_s": float(run),
                "run_without_loop_s": float(run - np.median(loops)),
                "runs": runs,
            }
        )
    return rows


def main() -> None:
    """Prints a table; also writes JSON if a file is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, nargs="?")
    parser.add_argument("--runs", type=int, default=5)
    chosen = parser.parse_args()
    here, rows, repeated = machine(), startups(chosen.runs), sweeps(min(chosen.runs, 3))
    print(", ".join(f"{key} {value}" for key, value in here.items()))
    for row in rows:
        low, high = row["quartiles"]
        print(f"{row['seconds']:6.2f} s ({low:.2f} … {high:.2f})  {row['what']}")
    for row in repeated:
        print(
            f"{row['fixed_s']:6.2f} s once, {row['run_s']:.3f} s a run, "
            f"{row['run_without_loop_s']:.3f} s beside its time loop  {row['what']}"
        )
    if chosen.file:
        found = {"machine": here, "rows": rows, "sweeps": repeated}
        chosen.file.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
