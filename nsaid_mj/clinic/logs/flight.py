"""A map of a vehicle's log from the standard topics of flight controllers, PX4 and ArduPilot.

Multicopters: both number the motors of a quadrotor "X" alike: 1 front right, 2 rear left, 3 front
left, 4 rear right. Sources: PX4's message definitions, https://docs.px4.io/main/en/msg_docs/, and
ArduPilot's log messages, https://ardupilot.org/copter/docs/logmessages.html. Underwater vehicles:
ArduSub's frames state for every motor which way it pushes and turns the vehicle (AP_Motors6DOF.cpp
of libraries/AP_Motors); the sheet's thrusters are those that do.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ...base import Finding
from ...core import Array
from ...robots import RobotModel
from .mapping import ColumnMap, Map, Vehicle
from .tables import LogTable, channel_names, values_of
from .unusable import UnusableLog

_X = np.array([[1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0]])
"""Sides of motors 1 to 4, forward and left."""


class _Controller(NamedTuple):
    """Names of a flight controller's channels."""

    name: str  # name of its firmware
    vehicle: Vehicle  # pose and twist
    # choices of the motors' channels, the best first: a pattern with the motor's number in it, the
    # first number, and factor and offset to a share of the full command
    motors: tuple[tuple[str, int, float, float], ...]
    # choices of their measured speeds [rpm]: a pattern and the first number
    speeds: tuple[tuple[str, int], ...]
    # pattern of the channels that say which motor a speed controller drives, and the number there
    # of the first motor; "" if there are none
    functions: tuple[str, int] = ("", 0)


_PULSE = (1e-3, -1.0)  # 1000 to 2000 µs are 0 to 1
_ENOUGH = 80.0  # of measured speeds [Hz]: straight lines between slower ones lose their variation

_PX4_RATES = (  # of firmware since 2019, then before; the last one's are those of the gyroscope
    tuple(f"vehicle_angular_velocity/xyz[{i}]" for i in range(3)),
    tuple(f"vehicle_attitude/{axis}speed" for axis in ("roll", "pitch", "yaw")),
    tuple(f"sensor_combined/gyro_rad[{i}]" for i in range(3)),
)
_ARDUPILOT_FILTERS = ("XKF1", "NKF1", "EKF1")  # messages of the estimator, the newest first

_CONTROLLERS = (
    *(
        _Controller(
            "PX4",
            Vehicle(
                quaternion=tuple(f"vehicle_attitude/q[{i}]" for i in range(4)),
                order="wxyz",
                linear=tuple(f"vehicle_local_position/v{axis}" for axis in "xyz"),
                angular=rates,
                frame="NED/FRD",
                twist="world",
            ),
            (
                ("actuator_motors/control[{}]", 0, 1.0, 0.0),
                ("actuator_outputs/output[{}]", 0, *_PULSE),
            ),
            (("esc_status/esc[{}].esc_rpm", 0),),
            ("esc_status/esc[{}].actuator_function", 101),
        )
        for rates in _PX4_RATES
    ),
    *(
        _Controller(
            "ArduPilot",
            Vehicle(
                euler=("ATT/Roll", "ATT/Pitch", "ATT/Yaw"),
                linear=tuple(f"{estimator}/V{axis}" for axis in "NED"),
                angular=("IMU/GyrX", "IMU/GyrY", "IMU/GyrZ"),
                frame="NED/FRD",
                twist="world",
            ),
            (("RCOU/C{}", 1, *_PULSE), ("RCOU/Ch{}", 1, *_PULSE)),
            (("ESC_{}/RPM", 0), ("ESC{}/RPM", 1), ("RPM_{}/RPM", 0)),
        )
        for estimator in _ARDUPILOT_FILTERS
    ),
)


def _controllers(name: str, channels: Collection[str]) -> list[_Controller]:
    """The controllers of a firmware whose pose and twist are in a log; of any for ""."""
    own = [each for each in _CONTROLLERS if name in ("", each.name)]
    return [each for each in own if {*each.vehicle.columns} <= {*channels}]


def flight_map(robot: RobotModel, tables: Sequence[LogTable]) -> tuple[Map, str] | None:
    """The map of a log with the standard topics, and its assumptions in words.

    Velocities are those of the controller's estimator; positions, on which no force depends, are
    integrated from them. Commands are the rotors' measured speeds where the speed controllers
    report them often enough. None if topics are missing, or the vehicle does not have one rotor in
    each quadrant.

    Raises:
        UnusableLog: the log says that the vehicle has another frame than the sheet.
    """
    order = _order(robot) if robot.system.m == 7 else None
    names = set(channel_names(tables))
    if order is None and robot.system.m == 7:
        return _ardusub(robot, tables, names)
    for controller in _controllers("", names) if order is not None else ():
        for pattern, first, ratio, offset in controller.motors:
            motors = [pattern.format(first + i) for i in order or ()]
            if not {*motors} <= names:
                continue
            _check_frame("FRAME_TYPE", _COPTER_FRAMES, ("X", "H"), tables)
            columns = [ColumnMap(column=m, ratio=ratio, offset=offset) for m in motors]
            remark = "; 1000 to 2000 µs are 0 to 1" if offset else ""
            speeds = _speeds(controller, order or [], tables, names)
            if unusable := _unusable(speeds, robot, tables):
                remark += f"; the motors' measured speeds ({speeds[0]} …) {unusable}"
            elif speeds:
                columns = [
                    ColumnMap(
                        column=x, unit="rpm", sign=-1 if np.median(values_of(x, tables)) < 0 else 1
                    )
                    for x in speeds  # some controllers count one direction of rotation as negative
                ]
                motors = speeds
                remark = "; measured speeds are used, not the motors' commands"
            actuators = dict(zip(robot.joints, columns, strict=True))
            pairs = [f"{m} is {rotor}" for m, rotor in zip(motors, robot.joints, strict=True)]
            text = f"the standard topics of {controller.name} are used: {', '.join(pairs)}"
            mapping = Map(vehicle=controller.vehicle, actuators=actuators)
            return mapping, f"{text}, as in a quadrotor X{remark}"
    return None


_SUB_FRAMES: dict[str, tuple[tuple[int, ...], ...]] = {
    "vectored": (
        (0, 0, 1, 0, -1, 1),
        (0, 0, -1, 0, -1, -1),
        (0, 0, -1, 0, 1, 1),
        (0, 0, 1, 0, 1, -1),
        (1, 0, 0, -1, 0, 0),
        (-1, 0, 0, -1, 0, 0),
    ),
    "vectored 6DOF": (
        (0, 0, 1, 0, -1, 1),
        (0, 0, -1, 0, -1, -1),
        (0, 0, -1, 0, 1, 1),
        (0, 0, 1, 0, 1, -1),
        (1, -1, 0, -1, 0, 0),
        (-1, -1, 0, -1, 0, 0),
        (1, 1, 0, -1, 0, 0),
        (-1, 1, 0, -1, 0, 0),
    ),
}
"""Signs of each motor's roll, pitch (nose up), yaw (clockwise), throttle (up), forward, lateral
(right) in ArduSub's frames."""

_NEUTRAL = 1500.0  # pulse of a thruster at rest, and its largest change [µs]
_FULL = 400.0
_LEVER = 1e-3  # of the largest: a smaller push or turn counts as none


def _ardusub(
    robot: RobotModel, tables: Sequence[LogTable], names: Collection[str]
) -> tuple[Map, str] | None:
    """The map of an ArduSub's log; None if topics are missing, or thrusters fit none of its frames.

    A command is −1 to 1 for 1100 to 1900 µs; the direction that the sheet calls positive may be the
    frame's negative one, and `MOT_n_DIRECTION` may reverse a motor.
    """
    own = _controllers("ArduPilot", names)
    for frame, motors in _SUB_FRAMES.items():
        found = _thrusters(robot, motors)
        channels = [f"RCOU/C{motor + 1}" for motor, _ in found]
        if not own or len(found) != len(robot.joints) or not {*channels} <= {*names}:
            continue
        _check_frame("FRAME_CONFIG", _SUB_CONFIGS, (frame,), tables)
        columns = []
        reversed_ones = []
        for (motor, side), channel in zip(found, channels, strict=True):
            stated = values_of(f"PARM/MOT_{motor + 1}_DIRECTION", tables)
            turned = len(stated) > 0 and stated[-1] < 0
            sign = 1 if (side > 0) != turned else -1
            reversed_ones += [motor + 1] if turned else []
            share = 1 / _FULL
            columns.append(
                ColumnMap(column=channel, sign=sign, ratio=share, offset=-sign * share * _NEUTRAL)
            )
        known = any(name.startswith("PARM/MOT_") for name in names)
        remark = "MOT_n_DIRECTION of the log is used" if known else "MOT_n_DIRECTION is taken as 1"
        remark += f" (motors {reversed_ones} reversed)" if reversed_ones else ""
        pairs = [f"{c} is {joint}" for c, joint in zip(channels, robot.joints, strict=True)]
        text = f"the standard topics of ArduSub are used: {', '.join(pairs)}, as in the frame "
        text += f'"{frame}"; 1100 to 1900 µs are −1 to 1; {remark}'
        actuators = dict(zip(robot.joints, columns, strict=True))
        return Map(vehicle=own[0].vehicle, actuators=actuators), text
    return None


_SUB_CONFIGS = ("BlueROV1", "vectored", "vectored 6DOF", "vectored 6DOF 90", "SimpleROV 3")
_COPTER_FRAMES = ("+", "X", "V", "H", "V-tail", "A-tail")
"""ArduPilot's frames by the number in its parameters, the first ones."""


def _check_frame(
    parameter: str, frames: Sequence[str], own: Sequence[str], tables: Sequence[LogTable]
) -> None:
    """Raises `UnusableLog` if a log's parameter states a frame that is not the sheet's own."""
    stated = values_of(f"PARM/{parameter}", tables)
    if not len(stated):
        return
    k = int(stated[-1])
    name = frames[k] if 0 <= k < len(frames) else ""
    if name in own:
        return
    words = f'{k}, "{name}"' if name else f"{k}"
    text = f"the vehicle's {parameter} is {words}, by the parameters in the log, and the sheet's "
    text += f'frame is "{own[0]}": motors of the same numbers sit in other places'
    remedy = "Use a sheet of the vehicle's frame, or give a map.toml if the parameter is wrong."
    data = {"parameter": parameter, "stated": k, "sheet": own[0]}
    raise UnusableLog((Finding("refusal", "vehicle_frame", "", text, remedy, data),))


def _thrusters(robot: RobotModel, motors: tuple[tuple[int, ...], ...]) -> list[tuple[int, int]]:
    """For each of a vehicle's thrusters the number of its motor in a frame, and ±1 for its side.

    Empty if they do not correspond one to one.
    """
    columns = [c for c in robot.system.structure.columns if c.kind == "thruster"]
    by_input = {c.input: c for c in columns}
    if sorted(by_input) != list(range(len(motors))) or len(motors) != len(robot.joints):
        return []
    found = []
    for k in range(len(motors)):
        point, force = (np.asarray(by_input[k].constants[key]) for key in ("point", "direction"))
        turn = np.cross(point, force) * [1, -1, -1]  # axes forward, right, down
        push = np.array([force[2], force[0], -force[1]])
        turn = np.where(np.abs(turn) > _LEVER * np.abs(turn).max(initial=0.0), np.sign(turn), 0)
        push = np.where(np.abs(push) > _LEVER * np.abs(push).max(), np.sign(push), 0)
        for motor, factors in enumerate(motors):
            own = np.array(factors)
            for side in (1, -1):
                named = own[:3] != 0  # a frame names no turn that another motor's push undoes
                if (side * own[3:] == push).all() and (side * own[:3] == turn)[named].all():
                    found.append((motor, side))
    return found if len({motor for motor, _ in found}) == len(motors) == len(found) else []


def _speeds(
    controller: _Controller,
    order: Sequence[int],
    tables: Sequence[LogTable],
    names: Collection[str],
) -> list[str]:
    """The channels of the motors' measured speeds, in rotor order; [] if one is missing."""
    pattern, lowest = controller.functions
    numbers = {i: i for i in order}
    for i in order:
        said = {x for x in values_of(pattern.format(i), tables).tolist() if x >= lowest > 0}
        if len(said) == 1:
            numbers[int(said.pop()) - lowest] = i
    if sorted(numbers[i] for i in order) != sorted(order):
        return []  # two controllers say that they drive one motor, or one says it of another's
    for name, first in controller.speeds:
        # the messages of the first instance have no number
        found = [name.format(first + numbers[i]).replace("_0/", "/") for i in order]
        if set(found) <= set(names):
            return found
    return []


def _unusable(speeds: Sequence[str], robot: RobotModel, tables: Sequence[LogTable]) -> str:
    """Why measured speeds are not used, in words; "" if they are, or if there are none."""
    if not speeds:
        return ""
    if not np.isfinite(robot.top_speed):
        return "are not used: the sheet has no top speed to which they relate"
    for name in speeds:
        values = values_of(name, tables)
        if len(values) < 2 or not np.ptp(values) > 0:
            return f"are not used: {name} is {values[0] if len(values) else 'empty'} throughout"
    times = [table.channels[speeds[0]].t for table in tables if speeds[0] in table.channels]
    steps = np.concatenate([np.diff(t) for t in times])
    rate = 1 / np.median(steps) if len(steps) and np.median(steps) > 0 else 0.0
    return "" if rate >= _ENOUGH else f"are not used: they come at {rate:.3g} Hz only"


def _order(robot: RobotModel) -> list[int] | None:
    """The controller's number of each rotor, from 0; None if not every quadrant has one."""
    structure = robot.system.structure
    rotors = [c for c in structure.columns if c.kind == "rotor"] if structure is not None else []
    sides: dict[int, Array] = {
        c.input: np.sign(np.asarray(c.constants["point"])[:2]) for c in rotors
    }
    if sorted(sides) != list(range(len(robot.joints))):
        return None
    numbers = [int(np.argmin(np.abs(_X - sides[k]).sum(axis=1))) for k in sorted(sides)]
    fits = all((_X[n] == sides[k]).all() for k, n in enumerate(numbers))
    return numbers if fits and sorted(numbers) == list(range(len(_X))) else None
