"""The tables and the picture of docs/tracking.md.

`python scripts/tracking.py [--scenarios track_ur5,track_bluerov2] [--seeds 0,1,2]
[--sensors ideal,noisy] [--picture docs/tracking.png] [--every 1]`; the picture is of the first
scenario with the first kind of sensors, its first seed. `--every` adds the first seed's rms error
over intervals of so many seconds. About half a minute for each seed of track_ur5.
"""

import argparse
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from nsaid_mj.experiment.library import load
from nsaid_mj.studies.tracking import Course, Plan, table_of
from nsaid_mj.studies.tracking_run import PICTURE, run


def over_time(course: Course, every: float) -> str:
    """The rms error over all coordinates in intervals of a run [1e-3 rad or m]."""
    motion = course.motion
    interval = (motion.t // every).astype(int)
    errors = [motion.error[interval == k] for k in range(interval[-1] + 1)]
    return " ".join(f"{1e3 * np.sqrt((error**2).mean()):.2g}" for error in errors)


def main() -> None:
    """Runs every scenario with every kind of sensors, and prints Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenarios", default="track_ur5,track_bluerov2,track_uvms,track_payload")
    parser.add_argument("--seeds", default=",".join(map(str, range(10))))
    parser.add_argument("--sensors", default="ideal,noisy")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--every", type=float)
    chosen = parser.parse_args()
    seeds = tuple(int(seed) for seed in chosen.seeds.split(","))
    for name in chosen.scenarios.split(","):
        for sensors in chosen.sensors.split(","):
            plan = Plan(name, replace(load(name), sensors=sensors), seeds=seeds)
            with tempfile.TemporaryDirectory() as folder:
                done = run(plan, Path(folder), quiet=True)
                if chosen.picture:
                    shutil.copy(Path(folder) / PICTURE, chosen.picture)
                    chosen.picture = None
            table = table_of(plan, done)
            print(f"`{name}`, {sensors} sensors, {len(seeds)} seeds\n")
            print("| " + " | ".join(table.heads) + " |")
            print("|---" * len(table.heads) + "|")
            for row in table.lines:
                print("| " + " | ".join(map(str, row)) + " |")
            for course in done if chosen.every else ():
                if course.seed == seeds[0]:
                    errors = over_time(course, chosen.every)
                    print(f"\n{course.law}, every {chosen.every:g} s: {errors}")
            print(flush=True)


if __name__ == "__main__":
    main()
