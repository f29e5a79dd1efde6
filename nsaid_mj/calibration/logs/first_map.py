"""A first map.toml, to be completed by hand."""

from __future__ import annotations

import json
from collections.abc import Sequence

from ..data import RobotModel
from .matching import candidates
from .tables import Table
from .units import FACTORS, Quantity, of_name

_HEAD = """\
# Which columns of the log are what. Written by `nsaid inspect`, to be checked and completed by
# hand; pass it with `--map map.toml`. What is commented out is optional or was not found.
#
# unit   of positions: rad, deg, turns, ticks (with counts_per_turn), m, mm
#        of velocities: rad/s, deg/s, turns/s, rpm, ticks/s, m/s, mm/s
#        of commands: N·m, mN·m, N, A, mA, V, %, raw
# sign   -1 if the column counts against the joint's axis
# ratio  gear ratio, motor turns per joint turn, if the column is of the motor
# offset added at last, in SI, to reach the zero of the model
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
        n = len(robot.joints)
        rows = [[int(i == j) for j in range(n)] for i in range(n)]
        parts.append(_COUPLING.format(rows=rows))
        found = candidates(names, robot.joints)
        parts += [_joint(joint, found) for joint in robot.joints]
    return "".join(parts)


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
