"""A first map.toml, to be completed by hand."""

import json
from collections.abc import Collection, Sequence

import numpy as np

from ...core import Array
from ...robots import RobotModel
from . import signals
from .evidence import limits
from .imu import imu_columns
from .mapping import FACTORS, Map, Quantity, of_name
from .matching import (
    candidates,
    gain_columns,
    is_gripper,
    match_targets,
    named,
    set_points,
    words,
)
from .remedies import line_of
from .tables import LogTable, channel_names, values_of
from .unnamed import unnamed

WHOLE = 100.5  # of a range from −100 to 100, with rounding; larger values are degrees
_HEAD = """\
# Which columns of the log are what. Written by `nsaid inspect`, to be checked and completed by
# hand; pass it with `--map map.toml`. What is commented out is optional or was not found.
#
"""

_OF_JOINTS = """\
# unit   of positions: rad, deg, turns, ticks (with counts_per_turn), m, mm
#        of velocities: rad/s, deg/s, turns/s, rpm, ticks/s, m/s, mm/s
#        of commands: N·m, mN·m, N, A, mA, V, %, raw, of rotors also rpm;
#        of position targets: as of positions
# sign   -1 if the column counts against the joint's axis
# ratio  gear ratio, motor turns per joint turn, if the column is of the motor
# offset added last, in SI, to reach the zero of the model
# points [[value, position], [value, position]] in place of all these: positions [rad or m] that
#        two values stand for, as of a range from -100 to 100
# rest   rows with a lower speed [rad/s or m/s] are not used
"""

_OF_VEHICLE = """\
# [vehicle] is the motion: lists of columns, in m, m/s and rad/s; "-r" is a column against its axis.
# [actuators] is a column for each actuator:
# ratio  factor from the column to the model's command, as 0.001 of a pulse width
# offset added last: a pulse of 1000 to 2000 µs is -1 to 1 with ratio = 0.002, offset = -3
"""

_COUPLING = """
# Joints driven by several motors: q_motor = position · (q − offset), τ_joint = torque · τ_motor,
# rows and columns in the order of the joints below.
# [coupling]
# position = {rows}
# torque = {rows}
"""

_PD = """
# The log has position targets and the model has motors. Complete the PD law by which your
# controller makes torques of them: kp (target - q) + kd (target_velocity - dq) + feedforward.
[pd]
# kp = 20   # [N·m/rad or N/m]; one number, a list in the order of the joints, or { joint = … }
# kd = 1.5  # [N·m·s/rad or N·s/m]
"""

_DEGREES_OR_RANGE = """
# Positions and targets of all joints are in degrees, or go from -100 to 100 of each joint's range
# in the model file, as LeRobot's may. The log fits both: choose one.
[factors]
# position = "deg"
# position = "range"
"""


def _gains(tables: Sequence[LogTable], columns: dict[str, dict[str, str]]) -> str:
    """The lines of a PD law's gains whose columns never change in a log."""
    lines = []
    for key, own in columns.items():
        values = {joint: values_of(column, tables) for joint, column in own.items()}
        first = {joint: float(x[0]) for joint, x in values.items() if len(x) and not np.ptp(x)}
        if len(first) == len(own):
            alike = len(set(first.values())) == 1
            value = next(iter(first.values())) if alike else first
            lines.append(f"{line_of(key, value)}  # of {next(iter(own.values()))} …\n")
        else:
            lines.append(f"# {key} changes along the log, as {next(iter(own.values()))} says\n")
    return "".join(lines)


_ORDER = '# order = "wxyz"  # or xyzw; left out: found by gravity and the gyroscope\n'
_ANGLES = '# order = "rpy"  # or "rpy deg", or "gravity" for its direction; left out: found\n'
_MOUNTED = """\
# site = "imu"  # where it sits in the model; or place = [x, y, z] in the base's frame [m]
"""
_IMU_UNKNOWN = """
# The robot may walk, if the log has the IMU of its base:
# [base]
# orientation = ["…", "…", "…", "…"]
# gyro = ["…", "…", "…"]
# accelerometer = ["…", "…", "…"]
"""
_FEET = """
# [contacts]  # of a robot that walks; left out: feet are found in the model file
# feet = ["…"]  # geoms, sites or links
# radius = 0.02  # of round feet [m]
"""

_AXES = """\
# order = "xyzw"  # or wxyz, of the quaternion
# twist = "body"  # or world, the axes of `linear`; `angular_axes` those of `angular`
# frame = "ENU/FLU"  # or NED/FRD
# Instead of a quaternion, euler = ["roll", "pitch", "yaw"] in degrees, or in radians with
# euler_unit = "rad". Without `linear` or `angular` the pose is differentiated; `position` may be
# left out where `linear` is given. Without both the rotation alone is identified, with what these
# tell, if the log has them:
# depth = "depth"  # [m]
# acceleration = ["ax", "ay", "az"]  # as an accelerometer measures it; checked beside velocities
# acceleration_unit = "m/s²"  # or g
"""
_SCALAR_FIRST = "q0 q1 q2 q3"  # by convention the scalar is q0
_IN_SPACE = {
    "position": ("positionx positiony positionz", "posx posy posz", "px py pz", "x y z"),
    "quaternion": (
        "orientationx orientationy orientationz orientationw",
        "quatx quaty quatz quatw",
        "qx qy qz qw",
        _SCALAR_FIRST,
    ),
    "euler": (
        "rolldeg pitchdeg yawdeg",
        "rollrad pitchrad yawrad",
        "phi theta psi",
        "roll pitch yaw",
    ),
    "linear": (
        "linearx lineary linearz",
        "velx vely velz",
        "surge sway heave",
        "u v w",
        "vx vy vz",
    ),
    "angular": (
        "angularx angulary angularz",
        "angularvelocityx angularvelocityy angularvelocityz",
        "angvelx angvely angvelz",
        "gyrx gyry gyrz",
        "gyrox gyroy gyroz",
        "wx wy wz",
        "p q r",
    ),
    "acceleration": (
        "linearaccelerationx linearaccelerationy linearaccelerationz",
        "accbx accby accbz",
        "accx accy accz",
        "ax ay az",
    ),
}
_OTHERWISE = {"linear": frozenset({"ang", "angular", "gyro", "acc", "acceleration"})}
"""Words of names that are no such quantity in spite of their endings."""

_IN_PLANE = {
    "position": (
        "xned yned yaw",
        "north east yaw",
        "x y psi",
        "x y heading",
        "x y theta",
        "x y yaw",
    ),
    "linear": ("vx vy r", "vx vy yawrate", "surge sway yawrate"),
}
"""Endings of channels' names, letters and digits only."""

_MEANING = {
    "thruster": ("-1 to 1", -1.0, 1.0),
    "nozzle": ("0 to 1", 0.0, 1.0),
    "rotor": ("share of the top speed, 0 to 1; thrust is that of its square", 0.0, 1.0),
    "propeller": ("share of the full speed, -1 to 1", -1.0, 1.0),
    "drive": ("-1 to 1", -1.0, 1.0),
    "fin": ("deflection [rad]", 0.0, 0.0),
    "tyre": ("steering angle [rad]", 0.0, 0.0),
}
"""The command of a kind of column, in words, and its range."""

_PULSE = (1000.0, 2000.0)  # ends of a pulse width [µs]


def first_map(tables: Sequence[LogTable], robot: RobotModel, times: str = "") -> str:
    """The map of a log as TOML: entries that channels' names imply, and lines to fill in.

    `times` are the lines of a given map, which says of the log only when its rows were. `read_map`
    accepts it once every joint or actuator has a position and a command.
    """
    names = channel_names(tables)
    parts = [_HEAD, _OF_JOINTS if robot.jointed else _OF_VEHICLE]
    for table in tables:
        parts.append(f"#\n# {table.source} has the columns\n")
        parts += [f"#   {name}\n" for name in table.channels]
    unknown = '# [time]\n# column = "t"\n# unit = "s"  # s, ms, us, ns, date\n'
    parts.append("\n" + (times.strip() + "\n" if times else unknown))
    for table in tables if len(tables) > 1 and not times else ():
        parts.append(f"# [files.{_quoted(table.source)}]\n")
        parts.append("# offset = 0.0  # added to its times [s]\n")
    if not robot.jointed:
        parts.append(_vehicle(tables, robot))
    else:
        own = [joint for joint in named(robot) if joint in robot.leaders]
        found = unnamed(tables, own) or candidates(names, own, robot.passive)
        targets = match_targets(names, own)
        goals = set(targets.values())
        measured = [g for g in found["position"].values() if goals.isdisjoint(g.values())]
        if targets and len(measured) == 1 and any(f.code == "servo" for f in robot.findings):
            parts += _servos(tables, robot, measured[0], targets)
        else:
            rows = np.eye(len(own), dtype=int).tolist()
            gains = gain_columns(names, own)
            if gains and all("cmd" in group.split() for group in found["command"]):
                found["command"] = {}  # what a message with gains calls tau is feed-forward
            under_pd = bool(targets) and len(measured) == 1 and not found["command"]
            if under_pd:
                found["command"] = {"targets": targets}
            law = _PD + _gains(tables, gains) if under_pd else ""
            parts.append(law or _COUPLING.format(rows=rows))
            more = None
            if under_pd:
                more = {
                    "target_velocity": set_points("velocity", names, own),
                    "feedforward": set_points("command", names, own),
                }
            parts += [_joint(joint, found, more) for joint in own]
    if robot.walks:
        parts.append(_on_ground(names))
    return "".join(parts)


def _on_ground(channels: Sequence[str]) -> str:
    """The IMU of a robot that walks, as names tell it, and its feet."""
    found = imu_columns(Map(), channels, True)
    if found is None:
        return _IMU_UNKNOWN + _FEET
    imu = found.stated
    lines = ["\n[base]  # the IMU of the base that moves\n"]
    for key in ("orientation", "gyro", "accelerometer"):
        columns = getattr(imu, key)
        if columns is not None:
            lines.append(f"{key} = {json.dumps(list(columns), ensure_ascii=False)}\n")
        else:
            lines.append(
                f'# {key} = ["…", "…", "…"]  # specific force, 9.81 m/s² upwards at rest\n'
            )
    unknown = _ORDER if len(imu.orientation) == 4 else _ANGLES
    lines.append(unknown if imu.order is None else f'order = "{imu.order}"\n')
    return "".join(lines) + _MOUNTED + _FEET


def _servos(
    tables: Sequence[LogTable], robot: RobotModel, measured: dict[str, str], targets: dict[str, str]
) -> list[str]:
    """The joints of an arm by position targets; their unit, if names and values imply it."""
    values = {
        joint: np.concatenate([values_of(own[joint], tables) for own in (measured, targets)])
        for joint in robot.joints
    }
    ends = {joint: limits(robot, joint)[:2] for joint in robot.joints}
    inside = [_inside(values[joint], *ends[joint]) for joint in robot.joints]
    arm = np.concatenate([x for joint, x in values.items() if not is_gripper(joint)])
    whole = len(arm) > 0 and arm.min() >= 0 and not (arm % 1).any()
    stated = [of_name(name, FACTORS["position"])[1] for name in measured.values()]
    open_ = not all(inside) and not whole and np.abs(arm).max(initial=0.0) <= WHOLE
    lines = [_DEGREES_OR_RANGE] if open_ and not all(stated) else []
    for joint in robot.joints:
        low, high = (round(end, 6) for end in ends[joint])
        if all(inside):
            unit = 'unit = "rad"'
        elif whole:
            unit = 'unit = "ticks", counts_per_turn = 4096, offset = -3.141593'
        elif is_gripper(joint):
            unit = f"points = [[0, {low}], [100, {high}]]"
        else:
            unit = "" if open_ else 'unit = "deg"'
        lines.append(f"\n[joints.{_key(joint)}]\n")
        for quantity, name in (("position", measured[joint]), ("command", targets[joint])):
            own = of_name(name, FACTORS["position"])[1]
            lines.append(_line(quantity, name, f'unit = "{own}"' if own else unit))
    return lines


def _inside(values: Array, low: float, high: float) -> bool:
    """Whether values are within limits, or within a turn where there are none."""
    margin = 0.05 * (high - low) if np.isfinite(high - low) else 0.0
    low, high = np.clip([low - margin, high + margin], -2 * np.pi, 2 * np.pi)
    return len(values) > 0 and bool(values.min() >= low and values.max() <= high)


def _joint(
    joint: str,
    found: dict[Quantity, dict[str, dict[str, str]]],
    under_pd: dict[str, dict[str, str]] | None = None,
) -> str:
    """A joint's entry; `under_pd` are the further columns of a PD law by key and joint, if any."""
    lines = [f"\n[joints.{_key(joint)}]\n"]
    for quantity, groups in found.items():
        choices = [by_joint[joint] for by_joint in groups.values() if joint in by_joint]
        unit_of: Quantity = "position" if under_pd and quantity == "command" else quantity
        lines += [_entry(quantity, name, len(choices) > 1, unit_of) for name in choices]
        if not choices:
            lines.append(f'# {quantity} = {{ column = "…" }}\n')
    for key, columns in (under_pd or {}).items():
        known = joint in columns
        lines.append(_line(key, columns[joint]) if known else f'# {key} = {{ column = "…" }}\n')
    lines.append("# rest = 0.05\n")
    return "".join(lines)


def _entry(quantity: Quantity, name: str, several: bool, unit_of: Quantity) -> str:
    """A line for one column with a unit of some quantity; commented out if it is one of several."""
    stated = of_name(name, FACTORS[unit_of])[1]
    unit, remark = (f'unit = "{stated}"', "") if stated else ("", "state its unit")
    return _line(quantity, name, unit, remark, several=several)


def _line(key: str, name: str, more: str = "", remark: str = "", *, several: bool = False) -> str:
    """An entry for a column with `more` fields; commented out if it is one of several."""
    text = f"{key} = {{ column = {_quoted(name)}{f', {more}' if more else ''} }}"
    remark = "choose one" if several else remark
    return f"{'# ' if several else ''}{text}{f'  # {remark}' if remark else ''}\n"


def _vehicle(tables: Sequence[LogTable], robot: RobotModel) -> str:
    """Pose, velocities and commands of a vehicle."""
    channels = channel_names(tables)
    spatial = robot.system.m == 7
    lines = ["\n[vehicle]\n"]
    given = motion_columns(channels, spatial)
    other = "quaternion" if "euler" in given and "quaternion" not in given else "euler"
    for key, choices in (_IN_SPACE if spatial else _IN_PLANE).items():
        found = given.get(key)
        if key == other or (key == "acceleration" and not found):  # one tells the orientation
            continue
        names = json.dumps(found or choices[-1].split(), ensure_ascii=False)
        lines.append(f"{'' if found else '# '}{key} = {names}\n")
        if key == "quaternion" and _named(_SCALAR_FIRST.split(), found or []):
            lines.append('order = "wxyz"  # as q0 is usually the scalar\n')
        if key == "euler":
            most = max(np.abs(values_of(name, tables)).max(initial=0.0) for name in found or [])
            unit = "deg" if most > 2 * np.pi else "rad"
            lines.append(f'euler_unit = "{unit}"  # their largest is {most:.3g}\n')
    if spatial:
        lines.append(_AXES)
    else:
        heading = given.get("position", [""])[-1]
        unit = signals.heading_unit(values_of(heading, tables))
        known = "" if "position" in given else "# "
        lines.append(f'{known}heading_unit = "{unit}"  # of the heading: rad or deg\n')
        lines.append('# frame = "ENU/FLU"  # or NED/FRD: x north, y east, heading from north\n')
    lines.append("\n[actuators]\n")
    groups = candidates(channels, robot.joints)["command"]
    for k, name in enumerate(robot.joints):
        kinds = [c.kind for c in robot.system.structure.columns if c.input == k]
        known = (_MEANING[kind] for kind in kinds if kind in _MEANING)
        means, low, high = next(known, ("", 0.0, 0.0))
        own = [by_joint[name] for by_joint in groups.values()]
        moving = [column for column in own if np.ptp(values_of(column, tables)) > 0]
        for column in moving or own or ["…"]:
            scaled = ""
            values = values_of(column, tables) if high else np.zeros(0)
            if len(values) and values.min() >= 800 and 1000 < values.max() <= 2200:
                ratio = (high - low) / (_PULSE[1] - _PULSE[0])  # of pulses of a radio-control servo
                scaled = f"ratio = {ratio:g}, offset = {low - ratio * _PULSE[0]:g}"
            mark = "" if len(moving or own) == 1 else "# "
            lines.append(mark + _line(_key(name), column, scaled, means))
    return "".join(lines)


def motion_columns(channels: Collection[str], spatial: bool) -> dict[str, list[str]]:
    """The columns of a vehicle's pose and twist that channels' names tell, by the map's keys."""
    found = {}
    for key, choices in (_IN_SPACE if spatial else _IN_PLANE).items():
        barred = _OTHERWISE.get(key, frozenset())
        own = [name for name in channels if barred.isdisjoint(words(name))]
        names = next(filter(None, (_named(choice.split(), own) for choice in choices)), None)
        if names is not None:
            found[key] = names
    return found


def lacking(channels: Collection[str], robot: RobotModel) -> tuple[list[str], list[str]]:
    """What names do not tell of a vehicle's motion and commands, and what could be done."""
    spatial = robot.system.m == 7
    given = motion_columns(channels, spatial)
    driven = set(candidates(channels, robot.joints)["command"])
    keys = _WORDS if spatial else _IN_PLANE
    lacks = [key for key in keys if key not in given]
    if spatial:  # what is required, as below
        lacks = [] if {"quaternion", "euler"} & given.keys() else ["quaternion"]
    missing = [_WORDS[key] if spatial else _FLAT[key] for key in lacks]
    if len(driven) != 1:
        missing.append(f"the commands of {', '.join(robot.joints)}")
    known = [f"{key} ({', '.join(names)})" for key, names in given.items()]
    reasons = [f"Names tell {'; '.join(known)}."] if known else []
    if not missing:
        missing = ["the motion and the commands, without a map of their axes and units"]
        reasons.append("The first map has these columns: check axes and units there.")
    elif spatial:
        reasons.append(
            "Required are the orientation and the commands. Position or linear velocity, and "
            "angular velocity, are differentiated if one of each is missing. With neither position "
            "nor linear velocity the rotation alone is identified: give what there is in "
            "[vehicle], with depth or acceleration if the log has them."
        )
    else:
        reasons.append(
            "Required are x, y and heading, and the commands; velocities are differentiated if "
            "they are missing."
        )
    return missing, reasons


_WORDS = {
    "position": "the position (x, y, z)",
    "quaternion": "the orientation (a quaternion, or roll, pitch and yaw)",
    "linear": "the linear velocity",
    "angular": "the angular velocity",
}
_FLAT = {"position": "x, y and heading", "linear": "surge, sway and yaw rate"}


def _named(suffixes: Sequence[str], channels: Collection[str]) -> list[str] | None:
    """The channels with given names or endings; None unless each is unique."""
    plain = {name: "".join(words(name)) for name in channels}
    same = [[name for name, text in plain.items() if text == suffix] for suffix in suffixes]
    ending = [[n for n, text in plain.items() if text.endswith(suffix)] for suffix in suffixes]
    several = all(len(suffix) > 1 for suffix in suffixes)
    for found in (same, ending) if several else (same,):
        if all(len(names) == 1 for names in found):
            return [names[0] for names in found]
    return None


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _key(name: str) -> str:
    """A TOML key, quoted where it must be."""
    bare = name.replace("_", "").replace("-", "")
    return name if bare.isascii() and bare.isalnum() else _quoted(name)
