"""A map of a multicopter's log from the standard topics of flight controllers, PX4 and ArduPilot.

Both number the motors of a quadrotor "X" alike: 1 front right, 2 rear left, 3 front left, 4 rear
right. Sources: PX4's message definitions, https://docs.px4.io/main/en/msg_docs/, and ArduPilot's
log messages, https://ardupilot.org/copter/docs/logmessages.html.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ...parameters import Array
from ..data import RobotModel
from .mapping import Column, Map, Vehicle

_X = np.array([[1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0]])
"""Sides of motors 1 to 4, forward and left."""


class _Controller(NamedTuple):
    """Names of a flight controller's channels.

    Attributes:
        name: of its firmware.
        vehicle: pose and twist.
        motors: choices of the motors' channels, the best first: a pattern with the motor's number
            in it, the first number, and factor and offset to a share of the full command.
    """

    name: str
    vehicle: Vehicle
    motors: tuple[tuple[str, int, float, float], ...]


_PULSE = (1e-3, -1.0)  # 1000 to 2000 µs are 0 to 1

_CONTROLLERS = (
    _Controller(
        "PX4",
        Vehicle(
            quaternion=tuple(f"vehicle_attitude/q[{i}]" for i in range(4)),
            order="wxyz",
            linear=tuple(f"vehicle_local_position/v{axis}" for axis in "xyz"),
            angular=tuple(f"vehicle_angular_velocity/xyz[{i}]" for i in range(3)),
            frame="NED/FRD",
            twist="world",
        ),
        (
            ("actuator_motors/control[{}]", 0, 1.0, 0.0),
            ("actuator_outputs/output[{}]", 0, *_PULSE),
        ),
    ),
    _Controller(
        "ArduPilot",
        Vehicle(
            euler=("ATT/Roll", "ATT/Pitch", "ATT/Yaw"),
            linear=("XKF1/VN", "XKF1/VE", "XKF1/VD"),
            angular=("IMU/GyrX", "IMU/GyrY", "IMU/GyrZ"),
            frame="NED/FRD",
            twist="world",
        ),
        (("RCOU/C{}", 1, *_PULSE),),
    ),
)


def flight_map(robot: RobotModel, channels: Collection[str]) -> tuple[Map, str] | None:
    """The map of a log with the standard topics, and its assumptions in words.

    Velocities are those of the controller's estimator; positions, on which no force depends, are
    integrated from them. None if topics among `channels` are missing, or the vehicle does not have
    one rotor in each quadrant.
    """
    if robot.system is None or robot.system.m != 7:
        return None
    order = _order(robot)
    for name, vehicle, choices in _CONTROLLERS:
        if order is None or not set(vehicle.columns) <= set(channels):
            continue
        for pattern, first, ratio, offset in choices:
            motors = [pattern.format(first + i) for i in order]
            if set(motors) <= set(channels):
                columns = [Column(column=m, ratio=ratio, offset=offset) for m in motors]
                mapping = Map(
                    vehicle=vehicle, actuators=dict(zip(robot.joints, columns, strict=True))
                )
                return mapping, _words(name, robot.joints, motors, offset)
    return None


def _words(name: str, rotors: Sequence[str], motors: Sequence[str], offset: float) -> str:
    pairs = ", ".join(f"{motor} is {rotor}" for motor, rotor in zip(motors, rotors, strict=True))
    scaled = "; 1000 to 2000 µs are 0 to 1" if offset else ""
    return f"the standard topics of {name} are used: {pairs}, as in a quadrotor X{scaled}"


def _order(robot: RobotModel) -> list[int] | None:
    """The controller's number of each rotor, from 0; None if not every quadrant has one."""
    structure = getattr(robot.system, "structure", None)
    rotors = [c for c in structure.columns if c.kind == "rotor"] if structure is not None else []
    sides: dict[int, Array] = {
        c.input: np.sign(np.asarray(c.constants["point"])[:2]) for c in rotors
    }
    if sorted(sides) != list(range(len(robot.joints))):
        return None
    numbers = [int(np.argmin(np.abs(_X - sides[k]).sum(axis=1))) for k in sorted(sides)]
    fits = all((_X[n] == sides[k]).all() for k, n in enumerate(numbers))
    return numbers if fits and sorted(numbers) == list(range(len(_X))) else None
