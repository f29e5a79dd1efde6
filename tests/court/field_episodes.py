"""Logs of short episodes, as in robot learning: one file with pauses, or a file for each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.robots.model import RobotModel
from tests.support.robot_logs import two_joints, write_csv

from .field_findings import Twin

_RATE = 200.0  # of `Twin.log` [Hz]


@dataclass(frozen=True)
class Drawn:
    """Episodes of one robot.

    Attributes:
        robot: the model.
        logs: files.
        seconds: of all episodes.
        truth: values of parameters by name.
        words: what was drawn.
    """

    robot: RobotModel
    logs: list[Path]
    seconds: float
    truth: dict[str, float]
    words: str


def draw(seed: int, folder: Path) -> Drawn:
    """Ten to thirty episodes of .6 to 2.5 s, each another motion, in one file or in many."""
    rng = np.random.default_rng([seed, 35])
    name = str(rng.choice(["ur5", "two joints"]))
    robot = load_robot_model("ur5") if name == "ur5" else two_joints()
    twin = Twin(robot, seed, speed=float(rng.uniform(0.4, 1.0)), fastest=1.5)
    count = int(rng.integers(10, 31))
    apart = bool(rng.random() < 0.5)
    pause = float(rng.uniform(0.5, 5.0))
    parts = []
    for number in range(count):
        part = twin.log(number, duration=float(rng.uniform(0.6, 2.5)))
        parts.append(part)
    seconds = sum(len(part["time"]) for part in parts) / _RATE
    words = f"{name}: {count} episodes, {seconds:.0f} s, in {'files' if apart else 'one file'}"
    if apart:
        logs = [write_csv(folder / f"episode_{k:02}.csv", part) for k, part in enumerate(parts)]
        return Drawn(robot, logs, seconds, twin.true, words)
    start = 0.0
    for part in parts:
        part["time"] = part["time"] + start
        start = float(part["time"][-1]) + pause
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return Drawn(robot, [write_csv(folder / "log.csv", whole)], seconds, twin.true, words)
