"""Logs of robots that walk as users bring them: layouts, orders, signs, an IMU that is turned.

A draw is a log of `walking` in one of the layouts of `walking_layouts`, changed in one way. Its
truth is the gains of the motors; the robot's mass is told.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from .walking import drawn_walk
from .walking_layouts import LAYOUTS, Table, Walked, by_depth, by_limbs, read_walk, write_table

ROBOTS = ("go2", "go1", "solo12", "anymal_c")
SECONDS = 20.0

Change = Callable[[Walked, np.random.Generator], Walked]


@dataclass(frozen=True)
class Drawn:
    """A log, its model file, and what is true.

    Attributes:
        model: path of the model file.
        log: the changed log.
        healthy: the log before the change, in the same layout.
        codes: codes of findings that name the cause; () where no refusal may be raised.
        mass: of the robot [kg].
        truth: true gains by name.
        words: robot and layout.
    """

    model: Path
    log: Path
    healthy: Path
    codes: tuple[str, ...]
    mass: float
    truth: dict[str, float]
    words: str


def _unchanged(walk: Walked, rng: np.random.Generator) -> Walked:
    return walk


def _with(walk: Walked, **columns: np.ndarray) -> Walked:
    """The log with other orientation, `gyro`, `force` (N, ·) or commands."""
    found = Walked(walk)
    stems = {"quaternion": "imu_q", "gyro": "gyro_", "force": "acc_"}
    for name, values in columns.items():
        axes = "wxyz" if name == "quaternion" else "xyz"
        for axis, column in zip(axes, values.T, strict=True):
            found[stems[name] + axis] = column
    return found


def _renamed(walk: Walked, kinds: str, order: list[str]) -> Walked:
    """The log in which columns carry the names of other joints: of each, one of an order's."""
    found = Walked(walk)
    for joint, other in zip(walk.joints, order, strict=True):
        for kind in kinds.split():
            found[f"{kind}_{joint}"] = walk[f"{kind}_{other}"]
    return found


def _other_limbs(walk: Walked, rng: np.random.Generator) -> list[str]:
    limbs = by_limbs(walk.joints)
    while True:
        order = rng.permutation(len(limbs))
        if (order != np.arange(len(limbs))).any():
            return [joint for k in order for joint in limbs[k]]


def _legs(walk: Walked, rng: np.random.Generator) -> Walked:
    return _renamed(walk, "q dq u", _other_limbs(walk, rng))


def _commands(walk: Walked, rng: np.random.Generator) -> Walked:
    return _renamed(walk, "u", _other_limbs(walk, rng))


def _depth(walk: Walked, rng: np.random.Generator) -> Walked:
    return _renamed(walk, "q dq u", by_depth(walk.joints))


def _reversed(walk: Walked, rng: np.random.Generator) -> Walked:
    found = Walked(walk)
    limbs = by_limbs(walk.joints)
    own = walk.joints if rng.random() < 0.5 else limbs[int(rng.integers(len(limbs)))]
    for joint in own:
        found[f"u_{joint}"] = -walk[f"u_{joint}"]
    return found


def _last(walk: Walked, rng: np.random.Generator) -> Walked:
    return _with(walk, quaternion=np.roll(walk.quaternion, -1, axis=1))


def _degrees(walk: Walked, rng: np.random.Generator) -> Walked:
    return _with(walk, gyro=np.degrees(walk.gyro))


def _axes(walk: Walked, rng: np.random.Generator) -> Walked:
    signs = np.array([1.0, -1.0, -1.0])
    return _with(walk, gyro=walk.gyro * signs, force=walk.force * signs)


def _gravity_sign(walk: Walked, rng: np.random.Generator) -> Walked:
    return _with(walk, force=-walk.force)


def _turned(walk: Walked, rng: np.random.Generator) -> Walked:
    quarter = int(rng.integers(1, 4))
    turn = Rotation.from_euler("z", 90 * quarter, degrees=True)
    if rng.random() < 0.3:
        turn = Rotation.from_euler("x", 180, degrees=True)
    own = Rotation.from_quat(walk.quaternion, scalar_first=True) * turn
    inverse = turn.inv()
    return _with(
        walk,
        quaternion=own.as_quat(scalar_first=True),
        gyro=inverse.apply(walk.gyro),
        force=inverse.apply(walk.force),
    )


def _without_forces(walk: Walked, rng: np.random.Generator) -> Walked:
    return Walked({name: x for name, x in walk.items() if not name.startswith("acc_")})


CHANGES: dict[str, tuple[Change, tuple[str, ...]]] = {
    "healthy": (_unchanged, ()),
    "legs swapped": (_legs, ("joint_order",)),
    "joints by depth": (_depth, ("joint_order",)),
    "commands swapped": (_commands, ("swapped",)),
    "commands reversed": (_reversed, ("reversed_sign",)),
    "quaternion x, y, z, w": (_last, ()),
    "gyro in deg per s": (_degrees, ()),
    "axes of the IMU": (_axes, ("orientation", "gyro")),
    "accelerometer reversed": (_gravity_sign, ("orientation",)),
    "IMU turned": (_turned, ("imu_mount",)),
    "IMU late": (_unchanged, ()),
    "no accelerometer": (_without_forces, ()),
    "policy": (_unchanged, ()),
    "layout": (_unchanged, ()),
}
"""How a log is changed, and the codes that name it, by kind."""

KINDS = tuple(f"walking: {kind}" for kind in CHANGES)


def _own(walk: Walked) -> Table:
    """The layout of `walking` itself, its quaternion without a letter that tells its order."""
    names = {f"imu_q{x}": f"imu_quat_{k}" for k, x in enumerate("wxyz")}
    return {names.get(name, name): column for name, column in walk.items()}


def draw(seed: int, folder: Path, kind: str) -> Drawn:
    """A log of one of `KINDS`."""
    name = kind.removeprefix("walking: ")
    change, codes = CHANGES[name]
    rng = np.random.default_rng([seed, 49])
    robot = str(rng.choice(ROBOTS))
    late = 0.001 * float(rng.integers(3, 16)) if name == "IMU late" else 0.0
    hold = 0.02 if name == "policy" else 0.001  # torques under targets at 50 Hz
    chosen = {"imu_late": late, "hold": hold}
    found = drawn_walk(seed, folder / "walk", robot=robot, seconds=SECONDS, **chosen)
    walk = read_walk(found.log)
    layout = "own"
    make: Callable[[Walked], Table] = _own
    if name == "layout":
        fits = [key for key in LAYOUTS if robot.startswith("go") or key not in _UNITREE]
        layout = str(rng.choice(fits))
        make = partial(LAYOUTS[layout], feet=None)  # without sensors in the feet
        if layout in _NUMBERED:
            codes = ("joint_order",)
    log = write_table(folder / "log.csv", make(change(walk, rng)))
    healthy = write_table(folder / "healthy.csv", _own(walk))
    truth = json.loads(found.log.with_name("truth.json").read_text("utf-8"))["truth"]
    gains = {f"gain_{k + 1}": float(x) for k, x in enumerate(truth["gains"])}
    words = f"{robot}, {layout}"
    mass = float(truth["total_mass"])
    return Drawn(found.model, log, healthy, codes, mass, gains, words)


_UNITREE = ("lowstate", "plotjuggler", "echo", "rpy")
"""Layouts whose motors are numbered as those of Unitree's robots."""
_NUMBERED = ("arrays", "gravity", "rpy")
"""Layouts whose columns are numbered in another order than the model's joints."""
