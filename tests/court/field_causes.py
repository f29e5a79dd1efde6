"""Logs with one common cause each, drawn from a seed: a clock, signs, units, an order, a frame.

A draw is a healthy simulated log of a robot that is changed in one way, as loggers and their users
do. The truth of a draw is that of the unchanged log: with the remedy obeyed, both are the same.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zlib import crc32

import numpy as np
from scipy.spatial.transform import Rotation

from .cases import Case
from .offline import _fingers, arm_table
from .robots import with_wrong_masses
from .simulation import Simulated, joint_names, simulated

Table = dict[str, np.ndarray]
ARMS = ("ur5", "panda", "kinova", "xarm7", "z1", "double_pendulum")
VEHICLES = {"bluerov2": ("rov", 20.0), "hummingbird": ("quad", 12.0), "remus100": ("torpedo", 30.0)}
MASSES = 0.25  # largest relative error of a model file's masses
_CLOCKS = (0.1, 0.4, 0.5, 0.6, 1.7, 2.0, 4.0, 10.0, 1000.0)
_RATES = (500.0, 250.0, 125.0, 100.0)  # of the logs of arms [Hz]
_DEGREES = 180 / np.pi


@dataclass(frozen=True)
class Drawn:
    """A log with one cause.

    Attributes:
        kind: one of `KINDS`.
        model: name of the robot, or the text of its URDF.
        tables: log by log, columns by name.
        healthy: the same before the change.
        map: lines of map.toml; "" where names match.
        lock: joints that do not move.
        codes: codes of findings that name the cause; () where no refusal may be raised.
        where: words, all of which the first finding contains, such as joints or a file.
        words: what was changed.
        simulated: the first run; its plant holds the true parameters.
    """

    kind: str
    model: str
    tables: tuple[Table, ...]
    healthy: tuple[Table, ...]
    map: str
    lock: tuple[str, ...]
    codes: tuple[str, ...]
    where: tuple[str, ...]
    words: str
    simulated: Simulated

    def write(self, folder: Path, healthy: bool = False) -> tuple[str, list[Path], Path | None]:
        """Writes the robot, and the changed or the healthy logs; paths of model, logs and map."""
        folder.mkdir(parents=True, exist_ok=True)
        model = self.model
        if model.lstrip().startswith("<"):
            model = str(folder / "model.urdf")
            Path(model).write_text(self.model, encoding="utf-8")
        paths = []
        for number, table in enumerate(self.healthy if healthy else self.tables, 1):
            paths.append(folder / f"log_{number}.csv")
            values = np.column_stack(list(table.values()))
            names = ",".join(table)
            np.savetxt(paths[-1], values, "%.9g", delimiter=",", header=names, comments="")
        if not self.map:
            return model, paths, None
        (folder / "given.toml").write_text(self.map, encoding="utf-8")
        return model, paths, folder / "given.toml"


@dataclass
class Change:
    """A change of the tables of a log, and what must be said of it."""

    codes: tuple[str, ...]
    where: tuple[str, ...] = ()
    words: str = ""


def draw(seed: int, kind: str = "", robot: str = "") -> Drawn:
    """A draw of a kind, by default one after another, and of a drawn robot or the named one."""
    kind = kind or list(KINDS)[seed % len(KINDS)]
    rng = np.random.default_rng([seed, crc32(kind.encode())])
    files = 2 if kind.endswith("of a file") else 1
    healthy, own = (_vehicle if kind in VEHICLE_KINDS else _arm)(rng, seed, kind, robot, files)
    tables = [dict(table) for table in healthy]
    said = KINDS[kind](rng, tables, own)
    found = own["simulated"]
    parts = own["model"], tuple(tables), tuple(healthy), own["map"], own["lock"]
    return Drawn(kind, *parts, said.codes, said.where, said.words, found)


# -- arms -----------------------------------------------------------------------------------------


def _arm(rng: Any, seed: int, kind: str, robot: str, files: int) -> tuple[list[Table], dict]:
    robot = robot or str(rng.choice([*ARMS, *(f"tree of {k}" for k in range(2, 8))]))
    rate = float(rng.choice(_RATES))
    velocities = kind not in ("no velocities, healthy", "clock without velocities")
    tables = []
    runs = []
    for number in range(files):
        motion = str(rng.choice(["own", "lively", "chirp", "steps", "gentle"]))
        what = robot, "arm", motion, "encoder", "nominal", None, 20.0, 2e-3, "none", 0.0
        case = Case(0, seed + 1000 * number, "identify", *what)
        if number and robot.startswith("tree"):  # the same tree, another motion
            case = replace(case, seed=seed)
        runs.append(simulated(case))
        found = runs[-1]
        n = found.setup.system.n_u
        units = np.ones(n)
        tables.append(arm_table(found, rate, velocities, units))
        if number and robot.startswith("tree"):
            half = len(tables[0]["time"]) // 2
            tables = [
                {k: x[:half] for k, x in tables[0].items()},
                {k: x[half:] for k, x in tables[0].items()},
            ]
    first = runs[0]
    from nsaid_mj.robots.assets import packed_robots

    urdf = first.urdf or packed_robots()[robot].read_text("utf-8")
    lock = tuple(_fingers(first)[:1])
    names = [name for name in joint_names(first.setup) if name not in _fingers(first)]
    model = with_wrong_masses(urdf, rng, MASSES)
    sliding = {
        j.get("name")
        for j in ElementTree.fromstring(urdf).iter("joint")
        if j.get("type") == "prismatic"
    }
    own = {"model": model, "map": "", "lock": lock, "names": names, "simulated": first}
    return tables, own | {"turning": [name for name in names if name not in sliding] or names}


def _joints(rng: Any, own: dict, least: int = 1, most: int | None = None) -> list[str]:
    """Some of the joints."""
    names = own["names"]
    count = int(rng.integers(least, (most or len(names)) + 1))
    return [names[k] for k in sorted(rng.permutation(len(names))[:count])]


def _times(tables: list[Table], joints: list[str], what: str, factor: float) -> None:
    for table in tables:
        for name in joints:
            if f"{name}_{what}" in table:
                table[f"{name}_{what}"] = factor * table[f"{name}_{what}"]


def _turning(rng: Any, own: dict) -> list[str]:
    """All joints that turn, or one of them."""
    return own["turning"] if rng.random() < 0.7 else [str(rng.choice(own["turning"]))]


def _healthy(rng: Any, tables: list[Table], own: dict) -> Change:
    return Change(())


def _clock(rng: Any, tables: list[Table], own: dict) -> Change:
    k = float(rng.choice(_CLOCKS))
    for table in tables:
        table["time"] = table["time"] / k
    return Change(("clock", "clock_unchecked"), (), f"time divided by {k:g}")


def _clock_of_file(rng: Any, tables: list[Table], own: dict) -> Change:
    k = float(rng.choice(_CLOCKS[1:-2]))
    tables[1]["time"] = tables[1]["time"] / k
    return Change(("clock",), ("log_2",), f"time of log_2 divided by {k:g}")


def _dead_of_file(rng: Any, tables: list[Table], own: dict) -> Change:
    (joint,) = _joints(rng, own, 1, 1)
    tables[1][f"{joint}_current"] = 0 * tables[1][f"{joint}_current"]
    return Change(("dead_channel",), ("log_2", joint), f"command of {joint} zero in log_2")


def _reversed_commands(rng: Any, tables: list[Table], own: dict) -> Change:
    joints = own["names"] if rng.random() < 0.5 else _joints(rng, own)
    _times(tables, joints, "current", -1.0)
    where = () if len(joints) == len(own["names"]) else tuple(joints)
    return Change(("reversed_sign",), where, f"commands of {joints} negated")


def _reversed_velocities(rng: Any, tables: list[Table], own: dict) -> Change:
    joints = own["names"] if rng.random() < 0.5 else _joints(rng, own)
    _times(tables, joints, "velocity", -1.0)
    return Change(("velocity_mismatch",), ("velocit",), f"velocities of {joints} negated")


def _reversed_positions(rng: Any, tables: list[Table], own: dict) -> Change:
    _times(tables, own["names"], "position", -1.0)
    return Change(("velocity_mismatch",), ("position",), "all positions negated")


def _reversed_axes(rng: Any, tables: list[Table], own: dict) -> Change:
    joints = _joints(rng, own)
    _times(tables, joints, "position", -1.0)
    _times(tables, joints, "velocity", -1.0)
    return Change(("reversed_sign",), (), f"positions and velocities of {joints} negated")


def _reversed_joints(rng: Any, tables: list[Table], own: dict) -> Change:
    # all axes of a planar arm reversed are the same arm seen from behind, which no log tells apart
    planar = own["simulated"].case.robot == "double_pendulum"
    joints = _joints(rng, own, 1, len(own["names"]) - planar)
    for what in ("position", "velocity", "current"):
        _times(tables, joints, what, -1.0)
    return Change(
        ("reversed_sign",), ("axes",), f"positions, velocities, commands of {joints} negated"
    )


def _degrees_of_positions(rng: Any, tables: list[Table], own: dict) -> Change:
    joints = _turning(rng, own)
    _times(tables, joints, "position", _DEGREES)
    return Change(("degrees",), ("position",), f"positions of {joints} in degrees")


def _degrees_of_velocities(rng: Any, tables: list[Table], own: dict) -> Change:
    joints = _turning(rng, own)
    _times(tables, joints, "velocity", _DEGREES)
    return Change(("degrees",), ("velocit",), f"velocities of {joints} in deg/s")


def _degrees(rng: Any, tables: list[Table], own: dict) -> Change:
    _times(tables, own["turning"], "position", _DEGREES)
    _times(tables, own["turning"], "velocity", _DEGREES)
    return Change(("degrees",), (), f"{own['turning']} in degrees")


def _motor_side(rng: Any, tables: list[Table], own: dict) -> Change:
    ratio = float(rng.choice([6.0, 9.0, 30.0, 50.0, 80.0, 100.0, 101.0, 121.0, 160.0]))
    _times(tables, own["turning"], "position", ratio)
    _times(tables, own["turning"], "velocity", ratio)
    return Change(("motor_side",), ("gears",), f"{own['turning']} before gears of {ratio:g}")


def _unit_of_velocities(rng: Any, tables: list[Table], own: dict) -> Change:
    joints = _turning(rng, own)
    _times(tables, joints, "velocity", 60 / (2 * np.pi))
    return Change(("velocity_mismatch",), ("velocit",), f"velocities of {joints} in rpm")


def _swapped_velocities(rng: Any, tables: list[Table], own: dict) -> Change:
    return _swapped(rng, tables, own, "velocity", "swapped_columns")


def _swapped_positions(rng: Any, tables: list[Table], own: dict) -> Change:
    return _swapped(rng, tables, own, "position", "swapped_columns")


def _swapped_commands(rng: Any, tables: list[Table], own: dict) -> Change:
    return _swapped(rng, tables, own, "current", "swapped")


def _swapped(rng: Any, tables: list[Table], own: dict, what: str, code: str) -> Change:
    joints = _joints(rng, own, 2)
    for table in tables:
        values = [table[f"{name}_{what}"] for name in joints]
        for k, name in enumerate(joints):
            table[f"{name}_{what}"] = values[k - 1]
    return Change((code,), (), f"{what} of {joints} shifted by one")


ARM_KINDS: dict[str, Callable[[Any, list[Table], dict], Change]] = {
    "healthy": _healthy,
    "no velocities, healthy": _healthy,
    "healthy, one of a file": _healthy,
    "clock": _clock,
    "clock without velocities": _clock,
    "clock of a file": _clock_of_file,
    "dead command of a file": _dead_of_file,
    "reversed commands": _reversed_commands,
    "reversed velocities": _reversed_velocities,
    "reversed positions": _reversed_positions,
    "reversed axes": _reversed_axes,
    "reversed joints": _reversed_joints,
    "degrees": _degrees,
    "degrees of positions": _degrees_of_positions,
    "degrees of velocities": _degrees_of_velocities,
    "motor side": _motor_side,
    "rpm": _unit_of_velocities,
    "swapped velocities": _swapped_velocities,
    "swapped positions": _swapped_positions,
    "swapped commands": _swapped_commands,
}
"""Changes of arms' logs, by name."""


# -- vehicles -------------------------------------------------------------------------------------

_MAP = """[vehicle]
position = ["x", "y", "z"]
quaternion = ["qx", "qy", "qz", "qw"]
order = "xyzw"
linear = ["vx", "vy", "vz"]
angular = ["p", "q", "r"]

[actuators]
"""
_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_EULER = ("roll", "pitch", "yaw")
_TWIST = ("vx", "vy", "vz", "p", "q", "r")


def _vehicle(rng: Any, seed: int, kind: str, robot: str, files: int) -> tuple[list[Table], dict]:
    robot = robot or str(rng.choice(list(VEHICLES)))
    what, duration = VEHICLES[robot]
    levels = robot, what, "own", "noise", "nominal", None, duration, 0.0, "none", 0.0
    runs = [simulated(Case(0, seed + 1000 * k, "identify", *levels)) for k in range(files)]
    from nsaid_mj.clinic.identify.models import load_robot_model

    names = load_robot_model(robot, (), None).joints
    tables = []
    for log in (found.log for found in runs):
        table = {"t": log.t}
        table |= dict(zip(_POSE, log.q.T, strict=True))
        table |= dict(zip(_TWIST, log.v.T, strict=True))
        tables.append(table | {f"u{k}": column for k, column in enumerate(log.u.T, 1)})
    found = runs[0]
    lines = "".join(f'"{name}" = {{ column = "u{k}" }}\n' for k, name in enumerate(names, 1))
    text = _MAP
    if kind.startswith("Euler"):
        _set(tables[0], _EULER, _euler(tables[0]))
        text = re.sub(r"quaternion = .*\norder = .*\n", 'euler = ["roll", "pitch", "yaw"]\n', _MAP)
    own = {"model": robot, "map": text + lines, "lock": (), "names": names, "simulated": found}
    return tables, own


def _set(table: Table, names: tuple[str, ...], values: np.ndarray) -> None:
    table.update(zip(names, values.T, strict=True))


def _get(table: Table, names: tuple[str, ...]) -> np.ndarray:
    return np.column_stack([table[name] for name in names])


def _vehicle_clock(rng: Any, tables: list[Table], own: dict) -> Change:
    k = float(rng.choice(_CLOCKS[1:-1]))
    tables[0]["t"] = tables[0]["t"] / k
    return Change(("clock",), (), f"time divided by {k:g}")


def _vehicle_clock_of_file(rng: Any, tables: list[Table], own: dict) -> Change:
    k = float(rng.choice(_CLOCKS[1:-2]))
    tables[1]["t"] = tables[1]["t"] / k
    return Change(("clock",), ("log_2",), f"time of log_2 divided by {k:g}")


def _rates_signs(rng: Any, tables: list[Table], own: dict) -> Change:
    signs = np.array([1.0, 1.0, 1.0])
    while (signs == 1).all():
        signs = rng.choice([-1.0, 1.0], 3)
    rates = _TWIST[3:]
    _set(tables[0], rates, signs * _get(tables[0], rates))
    return Change(("frame",), ("angular",), f"rates times {signs}")


def _rates_order(rng: Any, tables: list[Table], own: dict) -> Change:
    order = [(1, 0, 2), (1, 2, 0), (2, 1, 0), (0, 2, 1)][int(rng.integers(4))]
    signs = rng.choice([-1.0, 1.0], 3)
    rates = _TWIST[3:]
    _set(tables[0], rates, signs * _get(tables[0], rates)[:, order])
    return Change(("frame",), ("angular",), f"rates {order} times {signs}")


def _twist_in_frd(rng: Any, tables: list[Table], own: dict) -> Change:
    for names in (_TWIST[:3], _TWIST[3:]):
        _set(tables[0], names, [1, -1, -1] * _get(tables[0], names))
    return Change(("frame",), (), "twist in FRD, pose in ENU/FLU")


def _world_velocities(rng: Any, tables: list[Table], own: dict) -> Change:
    names = _TWIST[:3]
    turn = Rotation.from_quat(_get(tables[0], _POSE[3:]))
    _set(tables[0], names, turn.apply(_get(tables[0], names)))
    return Change(("frame",), ("world",), "linear velocities along the world's axes")


def _quaternion_order(rng: Any, tables: list[Table], own: dict) -> Change:
    _set(tables[0], _POSE[3:], np.roll(_get(tables[0], _POSE[3:]), 1, axis=1))
    return Change(("frame",), ("wxyz",), "quaternion in the order wxyz")


def _quaternion_inverse(rng: Any, tables: list[Table], own: dict) -> Change:
    _set(tables[0], _POSE[3:], [-1, -1, -1, 1] * _get(tables[0], _POSE[3:]))
    return Change(("frame",), ("world to body",), "quaternion from world to body")


_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FRD = np.diag([1.0, -1.0, -1.0])


def _frame_of_file(rng: Any, tables: list[Table], own: dict) -> Change:
    kinds = (_rates_signs, _twist_in_frd, _world_velocities, _quaternion_inverse)
    said = kinds[int(rng.integers(len(kinds)))](rng, tables[1:], own)
    return Change(("frame",), ("log_2",), f"{said.words}, in log_2")


def _ned(rng: Any, tables: list[Table], own: dict) -> Change:
    _ned_pose(rng, tables, own)
    _twist_in_frd(rng, tables, own)
    return Change(("frame",), ("NED/FRD",), "all in NED/FRD")


def _ned_pose(rng: Any, tables: list[Table], own: dict) -> Change:
    table = tables[0]
    _set(table, _POSE[:3], _get(table, _POSE[:3]) @ _NED.T)
    turn = Rotation.from_quat(_get(table, _POSE[3:])).as_matrix()
    _set(table, _POSE[3:], Rotation.from_matrix(_NED @ turn @ _FRD).as_quat())
    return Change(("frame",), (), "pose in NED/FRD, twist in FLU")


def _euler(table: Table) -> np.ndarray:
    """(N, 3) roll, pitch and yaw [deg]."""
    turns = Rotation.from_quat(_get(table, _POSE[3:]))
    return turns.as_euler("ZYX", degrees=True)[:, ::-1]


def _euler_radians(rng: Any, tables: list[Table], own: dict) -> Change:
    _set(tables[0], _EULER, np.radians(_get(tables[0], _EULER)))
    return Change(("frame",), ("rad",), "roll, pitch and yaw in rad")


def _euler_rates_in_degrees(rng: Any, tables: list[Table], own: dict) -> Change:
    _set(tables[0], _TWIST[3:], np.degrees(_get(tables[0], _TWIST[3:])))
    return Change(("velocity_mismatch",), ("deg/s",), "roll, pitch, yaw; body rates in deg/s")


def _euler_ned(rng: Any, tables: list[Table], own: dict) -> Change:
    _ned(rng, tables, own)
    _set(tables[0], _EULER, _euler(tables[0]))
    return Change(("frame",), ("NED/FRD",), "roll, pitch and yaw and all else in NED/FRD")


def _vehicle_reversed(rng: Any, tables: list[Table], own: dict) -> Change:
    for k in range(1, len(own["names"]) + 1):
        tables[0][f"u{k}"] = -tables[0][f"u{k}"]
    return Change(("reversed_sign",), (), "all commands negated")


def _one_reversed(rng: Any, tables: list[Table], own: dict) -> Change:
    name = f"u{1 + int(rng.integers(len(own['names'])))}"
    tables[0][name] = -tables[0][name]
    return Change(("reversed_sign",), (), f"{name} negated")


def _two_swapped(rng: Any, tables: list[Table], own: dict) -> Change:
    one, other = rng.choice(np.arange(1, len(own["names"]) + 1), 2, replace=False).tolist()
    table = tables[0]
    table[f"u{one}"], table[f"u{other}"] = table[f"u{other}"], table[f"u{one}"]
    return Change(("order",), (), f"u{one} and u{other} swapped")


VEHICLE_KINDS: dict[str, Callable[[Any, list[Table], dict], Change]] = {
    "vehicle, healthy": _healthy,
    "vehicle's clock": _vehicle_clock,
    "vehicle's clock of a file": _vehicle_clock_of_file,
    "signs of rates": _rates_signs,
    "order of rates": _rates_order,
    "twist in FRD": _twist_in_frd,
    "world velocities": _world_velocities,
    "quaternion's order": _quaternion_order,
    "quaternion's inverse": _quaternion_inverse,
    "pose in NED": _ned_pose,
    "frame of a file": _frame_of_file,
    "all in NED": _ned,
    "vehicle's reversed commands": _vehicle_reversed,
    "one command reversed": _one_reversed,
    "two commands swapped": _two_swapped,
    "Euler angles, healthy": _healthy,
    "Euler angles in radians": _euler_radians,
    "Euler angles, rates in deg/s": _euler_rates_in_degrees,
    "Euler angles, all in NED": _euler_ned,
}
"""Changes of vehicles' logs, by name."""

KINDS = ARM_KINDS | VEHICLE_KINDS
