"""Measures live identification: what an update costs the user's loop, how old the estimate is.

    python scripts/live.py [--seconds 60]  # ur5 at 500 Hz, then bluerov2 at 100 Hz
    python scripts/live.py --hour          # an hour of ur5, with the memory of both processes

Beside every update, a piece of work that nothing can delay but the machine is timed: writing the
sample as JSON.

The robot is simulated beforehand and its samples are handed over in real time, again from the start
when they end, with a gap between. The figures of docs/live.md are from here.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import nsaid_mj
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.setup import Setup
from nsaid_mj.log import Log

_SIMULATED = 60.0  # length of the motion that is repeated [s]
_SKIPPED = 1.0  # beginning that does not count, as caches are cold [s]
_PAUSE = 1.0  # gap between two repetitions [s]


def motion(robot: str, rate: float) -> Log:
    """A minute of a robot's noisy measurements."""
    scenario = replace(load(robot), duration=_SIMULATED, dt=1 / rate, sensors="noisy")
    setup = Setup.of(scenario)
    with setup.plant.running():
        return setup.simulate()


def resident(process: int) -> float:
    """Memory of a process [MB]."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def measure(robot: str, rate: float, seconds: float) -> None:
    """Prints the figures of one robot."""
    log, times, idle, ages, memory = motion(robot, rate), [], [], [], []
    rows = [log.at(k) for k in range(len(log.t))]
    count, period = round(seconds * rate), float(log.t[-1]) + _PAUSE
    with (
        tempfile.TemporaryDirectory() as folder,
        nsaid_mj.live(robot, rate=rate, prior_error=1.0, out=folder) as identifier,
    ):
        law = identifier.process
        begin = time.perf_counter()
        for k in range(count):
            turn, row = divmod(k, len(rows))
            t = rows[row].t + turn * period
            due = begin + k / rate
            while (now := time.perf_counter()) < due:
                time.sleep(max(0.0, due - now - 1e-4))
            now = time.perf_counter()
            json.dumps([part.tolist() for part in rows[row][1:]])
            idle.append(time.perf_counter() - now)
            now = time.perf_counter()
            estimate = identifier.update(t, *rows[row][1:])
            times.append(time.perf_counter() - now)
            if estimate is not None and estimate.t <= t:
                ages.append(t - estimate.t)
            if k % round(60 * rate) == round(30 * rate):
                memory.append((resident(os.getpid()), resident(law)))
        taken = identifier.estimate
        dropped = count - (taken.samples if taken else 0)
    late, alone = (np.array(x[round(_SKIPPED * rate) :]) * 1e6 for x in (times, idle))
    old = np.array(ages[round(_SKIPPED * rate) :]) * 1e3
    print(
        f"{robot} at {rate:g} Hz, {seconds:g} s: an update takes {np.median(late):.0f} µs "
        f"(median), {np.percentile(late, 99.9):.0f} µs (99.9 %), {late.max():.0f} µs (worst); "
        f"JSON alone {np.median(alone):.0f}, {np.percentile(alone, 99.9):.0f}, {alone.max():.0f}; "
        f"the estimate is {np.median(old):.1f} ms old (median), {np.percentile(old, 99):.0f} ms "
        f"(99 %), {old.max():.0f} ms (worst); {dropped} samples behind at the end; "
        f"{identifier.summary['verdict']}"
    )
    for minute, (own, other) in enumerate(memory):
        if minute in {0, len(memory) // 2, len(memory) - 1}:
            print(f"  minute {minute}: {own:.1f} MB here, {other:.1f} MB in the law's process")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--hour", action="store_true")
    chosen = parser.parse_args()
    measure("ur5", 500.0, 3600.0 if chosen.hour else chosen.seconds)
    if not chosen.hour:
        measure("bluerov2", 100.0, chosen.seconds)
