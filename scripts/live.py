"""Measures live identification: what an update costs the user's loop, how old the estimate is.

    python scripts/live.py [--seconds 60]  # ur5 at 500 Hz, then bluerov2 at 100 Hz
    python scripts/live.py --soak 60       # an hour of ur5, with the memory of both processes
    python scripts/live.py --robot ur5 --faults "loss 0.4 of 3 at 8 s"

Beside the time that passes in an update stands the processor's time that it takes, and how many of
the updates longer than 1 ms another process interrupted: nobody but the machine delays those. The
robot is simulated beforehand and its samples are handed over in real time, again from the start
when they end, with a gap between, which does not count in the estimate's age. The figures of
docs/live.md are from here.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import nsaid_mj
from nsaid_mj.core.log import Log
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.faults.text import parse_faults
from nsaid_mj.lab.setup import Setup

_RATES = {"ur5": 500.0, "bluerov2": 100.0}  # samples per second [Hz]
_SIMULATED = 20.0  # length of the motion that is repeated [s]
_SKIPPED = 1.0  # beginning that does not count, as caches are cold [s]
_PAUSE = 1.0  # gap between two repetitions [s]
_MEMORY = 20.0  # time between two looks at the memory [s]


def motion(robot: str, rate: float, faults: str) -> Log:
    """A stretch of a robot's noisy measurements, with faults as in `nsaid run --faults`."""
    scenario = replace(load(robot), duration=_SIMULATED, dt=1 / rate, sensors="noisy")
    scenario = replace(scenario, plant=replace(scenario.plant, faults=parse_faults(faults)))
    setup = Setup.of(scenario)
    with setup.plant.running():
        return setup.simulate()


def resident(process: int) -> float:
    """Memory of a process [MB]."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def percentiles(seconds: np.ndarray) -> str:
    """Median, 99.9 % and largest of some times [s], in words."""
    middle, most = np.percentile(seconds, [50, 99.9]) * 1e6
    return f"{middle:.0f} µs (median), {most:.0f} µs (99.9 %), {seconds.max() * 1e6:.0f} µs (worst)"


def measure(robot: str, rate: float, seconds: float, faults: str) -> None:
    """Prints the figures of one robot."""
    log, memory = motion(robot, rate, faults), []
    rows = [log.at(k) for k in range(len(log.t))]
    count, period = round(seconds * rate), float(log.t[-1]) + _PAUSE
    updates, ages = np.full((count, 3), -1.0), np.full(count, np.inf)  # they do not grow
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
            before = resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw
            now, own = time.perf_counter(), time.thread_time()
            estimate = identifier.update(t, *rows[row][1:])
            passed, taken = time.perf_counter() - now, time.thread_time() - own
            after = resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw
            updates[k] = passed, taken, after - before
            if estimate is not None:
                ages[k] = (k + 1 - estimate.samples) / rate
            if k % round(_MEMORY * rate) == round(0.5 * _MEMORY * rate):
                memory.append((resident(os.getpid()), resident(law)))
        last = identifier.estimate
        dropped = count - (last.samples if last else 0)
    passed, own, switches = updates[round(_SKIPPED * rate) :].T
    late, old = passed > 1e-3, ages[round(_SKIPPED * rate) :] * 1e3
    old = old[np.isfinite(old)]
    print(
        f"{robot} at {rate:g} Hz, {seconds:g} s: an update takes {percentiles(passed)}; of the "
        f"processor {percentiles(own)}; {np.sum(late)} longer than 1 ms, "
        f"{np.sum(late & (switches > 0))} of them interrupted by another process; "
        f"the estimate is {np.median(old):.1f} ms old (median), {np.percentile(old, 99):.0f} ms "
        f"(99 %), {old.max():.0f} ms (worst); {dropped} samples behind at the end; "
        f"{identifier.summary['verdict']}"
    )
    for k, (here, other) in enumerate(memory):
        if k in {0, len(memory) // 2, len(memory) - 1}:
            at = (k + 0.5) * _MEMORY / 60
            print(f"  after {at:.1f} min: {here:.1f} MB here, {other:.1f} MB in the law's process")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--soak", type=float, metavar="MINUTES")
    parser.add_argument("--robot", choices=_RATES, help="this one alone")
    parser.add_argument("--faults", default="", help="of the simulated robot")
    chosen = parser.parse_args()
    seconds = 60.0 * chosen.soak if chosen.soak else chosen.seconds
    alone = chosen.robot or ("ur5" if chosen.soak else None)
    for robot, rate in _RATES.items():
        if alone in (None, robot):
            measure(robot, rate, seconds, chosen.faults)
