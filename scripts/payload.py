"""How well a weighed load tells the scale of masses, gains and friction.

    python -m scripts.payload [--seeds 0:5]

Simulated: a UR5 by motor currents whose links are up to 25 % off the file's (scripts/scale.py),
with 2 kg on its last link in a second log; and an SO-101 by position targets, all of whose masses
are the file's times a drawn factor, with 200 g in its gripper in two of four logs, read as a real
one is. In neither is the load's place told. Prints the scale that was found over the true one, its
95 % interval, and whether this holds.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from nsaid_mj.calibration.identify import identify
from nsaid_mj.calibration.payloads import Load
from nsaid_mj.calibration.servos import identify_servos, servo_logs
from scripts.scale import HeavyWrist
from tests.calibration.servos import simulated


def main() -> None:
    """Prints the two tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0:5")
    first, last = (int(part) for part in parser.parse_args().seeds.split(":"))
    for name, trial in (("UR5, currents, 2 kg", arm), ("SO-101, targets, 200 g", servos)):
        print(f"\n| {name}: seed | found over true | 95 % interval | holds |\n|---|---|---|---|")
        for seed in range(first, last):
            with tempfile.TemporaryDirectory() as folder:
                value, low, high = trial(seed, Path(folder))
            held = "yes" if low <= 1 <= high else "no"
            print(f"| {seed} | {value:.3f} | {low:.3f} to {high:.3f} | {held} |", flush=True)


def arm(seed: int, folder: Path) -> np.ndarray:
    """The first three gains over the true ones, and the ends of their intervals, in the mean."""
    free = HeavyWrist("ur5", seed, 15.0)
    loaded = free.loaded(seed, 2.0, np.array([0.04, -0.02, 0.12]))
    logs = [free.write(folder / "free.csv"), loaded.write(folder / "loaded.csv")]
    found = identify(free.robot, logs, loads=["loaded.csv:2kg"])
    gains = found.of("motor gain")[:3]
    ratios = np.array([[g.value, g.low, g.high] for g in gains]) / free.gain[:3, None]
    return np.exp(np.log(ratios).mean(axis=0))


def servos(seed: int, folder: Path) -> np.ndarray:
    """The masses' scale over the true one, and the ends of its interval."""
    heavier = float(np.exp(np.random.default_rng([seed, 5]).uniform(-0.5, 0.5)))
    files, loads = [], []
    for k in range(4):
        load = 0.2 if k > 1 else 0.0
        motion = simulated.log(100 * seed + k, heavier=heavier, load=load)
        files.append(simulated.write(folder / f"log_{k}.csv", *motion))
        if load:
            loads.append(Load(files[-1].name, load, "gripper"))
    given = servo_logs(simulated.MODEL, files, loads=loads)
    assert given is not None
    (scale,) = identify_servos(given).scale
    return np.array([scale.value, scale.low, scale.high]) / heavier


if __name__ == "__main__":
    main()
