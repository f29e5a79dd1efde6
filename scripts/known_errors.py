"""What `nsaid identify` says of walking logs with one error that people make.

    python -m scripts.known_errors [--robot go2] [--seed 730] [--seconds 30] [--only WORD]

The log is drawn by `tests/court/walking.py`; then the model file, the log, or what is told is made
wrong in one way. The robot's mass is told in every row. Prints the table of known errors of
docs/ground.md: whether the structure explains the log, errors of the gains' ratios and of the gains
[%, rms], how many of the 95 % intervals hold the truth, their mean half width, and the warnings.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from nsaid_mj.base import NsaidError
from nsaid_mj.clinic.identify.identify import identify_forces
from scripts.machine import machine
from tests.court.walking import Walked, drawn_walk
from tests.court.walking_layouts import read_walk, write_table


@dataclass(frozen=True)
class Case:
    """A walking log, its model file, and what is told."""

    walk: Walked
    folder: Path
    told: float  # mass [kg]

    def with_model(self, change: Callable[[Any], None]) -> Case:
        """Another model file."""
        spec = mujoco.MjSpec.from_file(str(self.walk.model))
        change(spec)
        spec.compile()
        path = self.folder / "changed.xml"
        path.write_text(spec.to_xml(), encoding="utf-8")
        return replace(self, walk=replace(self.walk, model=path))

    def with_log(self, change: Callable[[dict[str, np.ndarray]], None]) -> Case:
        """Another log."""
        table = read_walk(self.walk.log)
        change(table)
        return replace(self, walk=replace(self.walk, log=write_table(self.folder / "c.csv", table)))


def _foot(moved: tuple[float, float, float], count: int) -> Callable[[Case], Case]:
    """The file's feet elsewhere, of the first `count` legs [m]."""

    def change(spec: Any) -> None:
        feet = [geom for geom in spec.geoms if geom.name and "foot" in geom.name.lower()]
        for geom in feet[:count]:
            geom.pos = np.array(geom.pos) + moved

    return lambda case: case.with_model(change)


def _shank(longer: float) -> Callable[[Case], Case]:
    """The file's shanks too long by a length [m]: feet lie along them."""

    def change(spec: Any) -> None:
        for geom in spec.geoms:
            if geom.name and "foot" in geom.name.lower():
                along = np.array(geom.pos) / np.linalg.norm(geom.pos)
                geom.pos = np.array(geom.pos) + longer * along

    return lambda case: case.with_model(change)


def _imu_turned(degrees: float) -> Callable[[Case], Case]:
    half = np.radians(degrees) / 2

    def change(spec: Any) -> None:
        spec.site("imu").quat = [np.cos(half), 0.0, 0.0, np.sin(half)]

    return lambda case: case.with_model(change)


def _imu_elsewhere(spec: Any) -> None:
    spec.site("imu").pos = np.array(spec.site("imu").pos) + np.array([0.08, 0.0, 0.0])


def _of_imu(name: str) -> bool:
    return name.startswith(("imu_", "gyro_", "acc_"))


def _late(seconds: float) -> Callable[[Case], Case]:
    """The IMU's columns late against the joints'."""

    def change(table: dict[str, np.ndarray]) -> None:
        rows = round(seconds / float(np.median(np.diff(table["time"]))))
        for name in filter(_of_imu, table):
            table[name] = np.concatenate([np.repeat(table[name][:1], rows), table[name][:-rows]])

    return lambda case: case.with_log(change)


def _biased(columns: dict[str, float]) -> Callable[[Case], Case]:
    def change(table: dict[str, np.ndarray]) -> None:
        for name, bias in columns.items():
            table[name] = table[name] + bias

    return lambda case: case.with_log(change)


ERRORS: dict[str, Callable[[Case], Case]] = {
    "none": lambda case: case,
    "one foot 5 cm off": _foot((0.05, 0.0, 0.0), 1),
    "all feet 2 cm off": _foot((0.02, 0.0, 0.0), 4),
    "shanks 1 cm too long": _shank(0.01),
    "shanks 3 cm too long": _shank(0.03),
    "accelerometer biased by 0.3 m/s²": _biased({"acc_x": 0.3}),
    "gyroscope biased by 0.05 rad/s": _biased({"gyro_z": 0.05}),
    "IMU turned by 5° in the file": _imu_turned(5.0),
    "IMU turned by 20° in the file": _imu_turned(20.0),
    "IMU 8 cm from its place": lambda case: case.with_model(_imu_elsewhere),
    "IMU 20 ms late": _late(0.02),
    "IMU 60 ms late": _late(0.06),
    "mass told 30 % too large": lambda case: replace(case, told=1.3 * case.told),
}
"""How a case is made wrong, by the error in words."""
PULLED = "a knee pulled by 15 N, 3 of every 9 s"
"""An error that must be simulated."""


def row(words: str, case: Case) -> str:
    """A line of the table."""
    try:
        found = identify_forces(str(case.walk.model), [case.walk.log], known={"mass": case.told})
    except NsaidError as error:
        return f"| {words} | refused | | | | {str(error).partition(chr(10))[0]} |"
    true = np.array(case.walk.truth["gains"])
    ratio = np.array([gain.value for gain in found.gains]) / true
    apart = 100 * np.std(ratio / ratio.mean())
    absolute = 100 * np.sqrt(np.mean((ratio - 1) ** 2))
    inside = sum(g.low <= x <= g.high for g, x in zip(found.gains, true, strict=True))
    half = 100 * np.mean([(g.high - g.low) / (2 * g.value) for g in found.gains])
    warnings = [f for f in found.findings if f.level != "note"]
    said = "; ".join(
        f"{f.where}: {f.text.partition(' along')[0].partition(';')[0]}" for f in warnings
    )
    cells = f"{apart:.2g}, {absolute:.2g} % | {inside}/{len(true)} | {half:.2g} %"
    return f"| {words} | {found.explains} | {cells} | {said or '–'} |"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="go2")
    parser.add_argument("--seed", type=int, default=730)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--only", default="")
    chosen = parser.parse_args()
    print("| error | explains | ratios of gains, gains | inside | ± | warnings |\n|" + "---|" * 6)
    fixed = {"robot": chosen.robot, "seconds": chosen.seconds}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        walk = drawn_walk(chosen.seed, folder, **fixed)
        case = Case(walk, folder, float(walk.truth["total_mass"]))
        for words, change in ERRORS.items():
            if chosen.only in words:
                print(row(words, change(case)), flush=True)
        if chosen.only in PULLED:
            walk = drawn_walk(chosen.seed, folder / "pulled", pulled=15.0, **fixed)
            print(row(PULLED, replace(case, walk=walk)), flush=True)
    print(machine())


if __name__ == "__main__":
    main()
