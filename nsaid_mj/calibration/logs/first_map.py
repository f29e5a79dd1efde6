"""A first map.toml, to be completed by hand."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from ...parameters import Array
from ..data import RobotModel
from .checks import limits
from .matching import candidates, match_targets, words
from .tables import Table
from .units import FACTORS, Quantity, of_name

_WHOLE = 100.5  # of a range from −100 to 100, with rounding; larger values are degrees
_HEAD = """\
# Which columns of the log are what. Written by `nsaid inspect`, to be checked and completed by
# hand; pass it with `--map map.toml`. What is commented out is optional or was not found.
#
# unit   of positions: rad, deg, turns, ticks (with counts_per_turn), m, mm
#        of velocities: rad/s, deg/s, turns/s, rpm, ticks/s, m/s, mm/s
#        of commands: N·m, mN·m, N, A, mA, V, %, raw; of position targets: as of positions
# sign   -1 if the column counts against the joint's axis
# ratio  gear ratio, motor turns per joint turn, if the column is of the motor
# offset added at last, in SI, to reach the zero of the model
# points [[value, position], [value, position]] in place of all these: positions [rad or m] that
#        two values stand for, as of a range from -100 to 100
# rest   rows with a lower speed [rad/s or m/s] are not used
"""

_COUPLING = """
# Joints driven by several motors: q_motor = position · (q − offset), τ_joint = torque · τ_motor,
# rows and columns in the order of the joints below.
# [coupling]
# position = {rows}
# torque = {rows}
"""


def first_map(tables: Sequence[Table], robot: RobotModel) -> str:
    """The text of a map of a log: what the names of channels tell, and lines to fill in.

    Args:
        tables: of the log's files.
        robot: whose joints or actuators are mapped.

    Returns:
        TOML that `read_map` accepts once every joint has a position and a command.
    """
    names = list(dict.fromkeys(name for table in tables for name in table.channels))
    parts = [_HEAD, _channels(tables), _time(tables)]
    if robot.system is not None:
        parts.append(_vehicle(robot))
    else:
        found, targets = candidates(names, robot.joints), match_targets(names, robot.joints)
        goals = set(targets.values())
        measured = [g for g in found["position"].values() if goals.isdisjoint(g.values())]
        if targets and len(measured) == 1 and any(f.code == "servo" for f in robot.findings):
            parts += _servos(tables, robot, measured[0], targets)
        else:
            rows = np.eye(len(robot.joints), dtype=int).tolist()
            parts.append(_COUPLING.format(rows=rows))
            parts += [_joint(joint, found) for joint in robot.joints]
    return "".join(parts)


def _servos(
    tables: Sequence[Table], robot: RobotModel, measured: dict[str, str], targets: dict[str, str]
) -> list[str]:
    """The joints of an arm by position targets; their unit, where names and values tell it."""
    values = {
        joint: np.concatenate(
            [
                table.channels[name].values
                for table in tables
                for name in (measured[joint], targets[joint])
                if name in table.channels
            ]
        )
        for joint in robot.joints
    }
    ends = {joint: limits(robot, joint)[:2] for joint in robot.joints}
    inside = [_inside(values[joint], *ends[joint]) for joint in robot.joints]
    arm = np.concatenate([x for joint, x in values.items() if not _is_gripper(joint)])
    lines = []
    for joint in robot.joints:
        low, high = (round(end, 6) for end in ends[joint])
        if all(inside):
            choices = ['unit = "rad"']
        elif np.nanmin(arm) >= 0 and not np.nanmax(arm % 1):
            choices = ['unit = "ticks", counts_per_turn = 4096, offset = -3.141593']
        elif _is_gripper(joint):
            choices = [f"points = [[0, {low}], [100, {high}]]"]
        elif np.nanmax(np.abs(arm)) > _WHOLE:
            choices = ['unit = "deg"']
        else:  # the values fit both
            choices = ['unit = "deg"', f"points = [[-100, {low}], [100, {high}]]"]
        lines.append(f"\n[joints.{_key(joint)}]\n")
        for quantity, name in (("position", measured[joint]), ("command", targets[joint])):
            stated = of_name(name, FACTORS["position"])[1]
            for unit in [f'unit = "{stated}"'] if stated else choices:
                line = f"{quantity} = {{ column = {_quoted(name)}, {unit} }}"
                several = not stated and len(choices) > 1
                lines.append(f"# {line}  # choose one\n" if several else f"{line}\n")
    return lines


def _inside(values: Array, low: float, high: float) -> bool:
    """Whether values are within limits, or are a turn or less where there are none."""
    margin = 0.05 * (high - low) if np.isfinite(high - low) else 0.0
    low, high = np.clip([low - margin, high + margin], -2 * np.pi, 2 * np.pi)
    return bool(np.nanmin(values) >= low and np.nanmax(values) <= high)


def _is_gripper(joint: str) -> bool:
    """Whether a joint is a gripper, whose position LeRobot counts from 0 to 100."""
    return bool({"gripper", "jaw"} & set(words(joint)))


def _channels(tables: Sequence[Table]) -> str:
    lines = []
    for table in tables:
        lines.append(f"#\n# {table.source} has the columns\n")
        lines += [f"#   {name}\n" for name in table.channels]
    return "".join(lines)


def _time(tables: Sequence[Table]) -> str:
    several = tables if len(tables) > 1 else ()
    files = "".join(
        f"# [files.{_quoted(table.source)}]\n# offset = 0.0  # added to its times [s]\n"
        for table in several
    )
    return f'\n# [time]\n# column = "t"\n# unit = "s"  # s, ms, us, ns, date\n{files}'


def _joint(joint: str, found: dict[Quantity, dict[str, dict[str, str]]]) -> str:
    lines = [f"\n[joints.{_key(joint)}]\n"]
    for quantity, groups in found.items():
        choices = [by_joint[joint] for by_joint in groups.values()]
        lines += [_entry(quantity, name, len(choices) > 1) for name in choices]
        if not choices:
            lines.append(f'# {quantity} = {{ column = "…" }}\n')
    lines.append("# rest = 0.05\n")
    return "".join(lines)


def _entry(quantity: Quantity, name: str, several: bool) -> str:
    """A line for one column; commented out if there are several candidates."""
    stated = of_name(name, FACTORS[quantity])[1]
    unit = f', unit = "{stated}"' if stated else ""
    line = f"{quantity} = {{ column = {_quoted(name)}{unit} }}"
    if several:
        return f"# {line}  # choose one\n"
    return f"{line}{'' if stated else '  # state its unit'}\n"


def _vehicle(robot: RobotModel) -> str:
    spatial = robot.system.m == 7
    lines = ['\n[vehicle]\n# frame = "ENU/FLU"  # or NED/FRD\n']
    lines.append(
        '# position = ["x", "y", "z"]\n' if spatial else '# position = ["x", "y", "yaw"]\n'
    )
    if spatial:
        lines.append('# quaternion = ["qx", "qy", "qz", "qw"]\n# order = "xyzw"  # or wxyz\n')
        lines.append('# linear = ["vx", "vy", "vz"]\n# angular = ["p", "q", "r"]\n')
        lines.append('# twist = "body"  # or world, of `linear`\n')
    else:
        lines.append('# linear = ["surge", "sway", "yaw_rate"]\n')
    lines.append("\n[actuators]\n")
    lines += [f'# {_key(name)} = {{ column = "…" }}\n' for name in robot.joints]
    return "".join(lines)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _key(name: str) -> str:
    """A TOML key, quoted where it must be."""
    bare = name.replace("_", "").replace("-", "")
    return name if bare.isascii() and bare.isalnum() else _quoted(name)
