"""How well logs of robots that walk identify them: fresh robots, motions, sensors and grounds.

    python -m scripts.walking [--robots go2 solo12 anymal_c g1] [--seeds 40:44] [--seconds 60]
                              [--json FILE] [field=value …]

Each log is drawn by `tests/court/walking.py`: masses ±20 %, gains and friction ±30 %, feet up to
5 mm off, slip, soft ground, 200 or 500 Hz, noise and bias of the IMU, 14-bit encoders. The robot's
total mass is told. Further `field=value` are those of `WalkingLog`, such as `command=position`, of
which kp takes the place of gains, and kv is part of viscous friction.
Prints a line for each log: errors of the gains' ratios and of the gains [%, rms], of viscous and
Coulomb friction over the gain [%, rms], how many of the 95 % intervals hold the truth, the mean
half-interval of the gains, the verdict, and CPU time. A log in which the robot fell is named, and
not counted.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from nsaid_mj.base import NsaidError
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.result import Identification
from scripts.machine import machine
from tests.court.walking import Walked, drawn_walk

BLOCKS = {
    "motor gain": "gains",
    "rotor inertia": "armature",
    "viscous friction": "viscous",
    "Coulomb friction": "coulomb",
}
"""Blocks of θ that are judged, and their truth."""


def judged(found: Identification, walk: Walked) -> dict[str, Any]:
    """Errors of the gains, and how many intervals of each block hold the truth."""
    truth = {name: np.array(walk.truth[name]) for name in BLOCKS.values()}
    if found.recordings.feedback is not None:
        truth["gains"] = np.array(walk.truth["kp"]) / found.recordings.feedback[0]
        truth["viscous"] = truth["viscous"] + np.array(walk.truth["kv"])
    gains = np.array([p.value for p in found.gains])
    ratio = gains / truth["gains"]
    half = np.array([(p.high - p.low) / (2 * p.value) for p in found.gains])
    line: dict[str, Any] = {
        "ratio": float(100 * np.std(ratio / ratio.mean())),
        "absolute": float(100 * np.sqrt(np.mean((ratio - 1) ** 2))),
        "half": float(100 * half.mean()),
        "explains": found.explains,
    }
    for block, name in BLOCKS.items():
        own = found.of(block)
        pairs = zip(own, truth[name], strict=True)
        line[name] = sum(bool(p.low <= true <= p.high) for p, true in pairs)
        over = np.array([p.value for p in own]) / truth[name] / ratio
        line[f"{name} over gain"] = float(100 * np.sqrt(np.mean((over - 1) ** 2)))
        line["of"] = len(gains)
    return line


def identified(robot: str, seed: int, chosen: dict[str, Any]) -> dict[str, Any]:
    """What is said of one drawn log."""
    with tempfile.TemporaryDirectory() as folder:
        walk = drawn_walk(seed, Path(folder), robot=robot, **chosen)
        line: dict[str, Any] = {"robot": robot, "seed": seed, "upright": walk.upright}
        begin = time.process_time()
        known = {"mass": float(walk.truth["total_mass"])}
        try:
            found = identify_forces(str(walk.model), [walk.log], known=known)
            line |= judged(found, walk)
        except NsaidError as error:
            line["refused"] = str(error).partition("\n")[0]
        return line | {"cpu": time.process_time() - begin}


def row(line: dict[str, Any]) -> str:
    """A line of the table."""
    head = f"| {line['robot']} {line['seed']}"
    if "refused" in line:
        return f"{head} | refused: {line['refused']} |"
    held = (f"{line[name]}/{line['of']}" for name in BLOCKS.values())
    fell = "" if line["upright"] else " (fell)"
    shown = ("ratio", "absolute", "viscous over gain", "coulomb over gain", "half")
    cells = [f"{line[key]:.2f}" for key in shown]
    return f"{head}{fell} | {' | '.join([*cells, *held, line['explains']])} | {line['cpu']:.0f} |"


def chosen_of(fields: list[str]) -> dict[str, Any]:
    """Fields of `WalkingLog` from words such as `rate=500`."""
    found: dict[str, Any] = {}
    for field in fields:
        name, _, value = field.partition("=")
        try:
            found[name] = json.loads(value)
        except json.JSONDecodeError:
            found[name] = value
    return found


def main() -> None:
    """Prints the table, a summary and the machine."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fields", nargs="*")
    parser.add_argument("--robots", nargs="+", default=["go2", "solo12", "anymal_c", "g1"])
    parser.add_argument("--seeds", default="40:44")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    first, end = map(int, arguments.seeds.split(":"))
    chosen = {"seconds": arguments.seconds} | chosen_of(arguments.fields)
    print(
        "| log | ratios [%] | gains [%] | viscous/gain | Coulomb/gain | ± [%] | gains held ", end=""
    )
    print("| rotors | viscous | Coulomb | explains | CPU [s] |\n" + "|---" * 12 + "|")
    lines = []
    for seed in range(first, end):
        for robot in arguments.robots:
            lines.append(identified(robot, seed, chosen))
            print(row(lines[-1]), flush=True)
            if arguments.json:
                arguments.json.write_text(json.dumps(lines, indent=1), encoding="utf-8")
    counted = [line for line in lines if line["upright"] and "refused" not in line]
    for name in BLOCKS.values():
        held = sum(line[name] for line in counted)
        print(f"{name}: {held} of {sum(line['of'] for line in counted)} intervals hold the truth")
    print(machine())


if __name__ == "__main__":
    main()
