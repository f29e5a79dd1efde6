"""Walking logs identified as what they are, and as logs of a robot on a fixed base.

    python -m scripts.fixed_base [--seeds 80:81] [--robots go2 solo12 anymal_c] [--seconds 20]

Logs are those of `tests/court/walking.py`. Without the IMU's columns, `nsaid identify` takes the
base for fixed, as any tool without contacts does. Both fits have the same columns of friction, no
delay, and no mass told. Prints the second table of docs/ground.md.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from nsaid_mj.base import NsaidError
from nsaid_mj.clinic.identify.identify import identify_forces
from scripts.machine import machine
from tests.court.walking import Walked, drawn_walk
from tests.court.walking_layouts import read_walk, write_table

_OF_IMU = ("imu_", "gyro_", "acc_")


def cells(walk: Walked, log: Path) -> str:
    """Errors of the gains' ratios and of the gains [%, rms], those inside, and the verdict."""
    try:
        found = identify_forces(str(walk.model), [log], columns=[], delay=0.0)
    except NsaidError as error:
        return f"refused: {str(error).partition('.')[0]} | – | –"
    true = np.array(walk.truth["gains"])
    ratio = np.array([gain.value for gain in found.gains]) / true
    apart = 100 * np.std(ratio / ratio.mean())
    inside = sum(g.low <= x <= g.high for g, x in zip(found.gains, true, strict=True))
    return f"{apart:.2g} % | {inside}/{len(true)} | {found.explains}"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="80:81")
    parser.add_argument("--robots", nargs="+", default=["go2", "solo12", "anymal_c"])
    parser.add_argument("--seconds", type=float, default=20.0)
    chosen = parser.parse_args()
    print(machine())
    print("| log | walking: ratios of gains | inside | explains ", end="")
    print("| fixed base: ratios of gains | inside | explains |\n|" + "---|" * 7)
    first, last = map(int, chosen.seeds.split(":"))
    for seed in range(first, last):
        for robot in chosen.robots:
            with tempfile.TemporaryDirectory() as folder:
                walk = drawn_walk(seed, Path(folder), robot=robot, seconds=chosen.seconds)
                table = read_walk(walk.log)
                kept = {n: x for n, x in table.items() if not n.startswith(_OF_IMU)}
                fixed = write_table(Path(folder) / "fixed.csv", kept)
                row = f"| {robot} {seed} | {cells(walk, walk.log)} | {cells(walk, fixed)} |"
                print(row, flush=True)


if __name__ == "__main__":
    main()
