"""Mapping of a log's channels to a robot's q, v and u."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from ...base import InvalidInput
from ...core import GRAVITY, Array, continuous_signs
from ...robots import RobotModel
from . import matching, signals
from .evidence import limits
from .flight import flight_map
from .imu import ImuColumns, imu_columns
from .mapping import (
    ChannelSource,
    ColumnMap,
    Factors,
    Joint,
    Map,
    Pd,
    Quantity,
    Vehicle,
    matrix,
    si,
)
from .pd_law import PdLaw, known_gains
from .tables import Channel, LogTable, channel_names, listed, told_apart, values_of
from .unusable import UnmatchedChannels

NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""(3, 3) from north-east-down to east-north-up."""

FRD = np.diag([1.0, -1.0, -1.0])
"""(3, 3) from forward-right-down to forward-left-up."""


class Layout(NamedTuple):
    """The channels of a robot's log, in the order of its coordinates."""

    positions: tuple[ChannelSource, ...]  # k sources of positions
    velocities: tuple[
        ChannelSource | None, ...
    ]  # sources of velocities; empty to differentiate positions
    commands: tuple[ChannelSource | None, ...]  # n_u sources of commands; None for passive joints
    coupling: Array | None = None  # (n, n) joint velocities per motor velocity; None for a vehicle
    torque: Array | None = None  # (n_u, n_u) joint commands per motor command; None for a vehicle
    vehicle: Vehicle | None = None  # form of pose and twist; None for joints or own coordinates
    specific: tuple[ChannelSource, ...] = ()  # sources of a vehicle's specific force; () without
    voltage: ChannelSource | None = None  # of a vehicle's battery over its nominal one
    powered: tuple[bool, ...] = ()  # (n_u,) whether a command's effect goes down with it
    assumed: str = ""  # assumptions, in words; "" if the map or the names are complete
    pd: PdLaw | None = None  # law that makes torques of the commands, then targets; None for forces
    # robot whose joints without a source follow those that have one; None if all have one
    led: RobotModel | None = None
    imu: ImuColumns | None = None  # IMU of a robot that walks; None on a fixed base

    @property
    def sources(self) -> tuple[ChannelSource, ...]:
        """All sources: positions, velocities, commands."""
        more = self.pd.sources if self.pd else ()
        more = (*more, *(self.imu.sources if self.imu else ()))
        measured = (*self.velocities, *self.commands)
        supply = [self.voltage] if self.voltage else []
        return (*self.positions, *filter(None, measured), *self.specific, *supply, *more)

    @property
    def command_units(self) -> tuple[str, ...]:
        """SI unit of each command; "" where the map states none."""
        own = [si(s.column.unit_as("command")) if s else "" for s in self.commands]
        if self.pd is not None:
            own = ["N·m" if source.angle else "N" for source in self.positions]
        if self.led is None:
            return tuple(own)
        units = dict(zip(self.led.leaders, own, strict=True))
        return tuple(units.get(joint, "") for joint in self.led.joints)

    def q(self, raw: Array) -> Array:
        """Positions (N, n) of joints, or (N, m) of a vehicle, from scaled sources (N, k).

        For a vehicle in space without positions they are 0, see `placed`.
        """
        offsets = np.array([s.column.zero for s in self.positions])
        if self.vehicle is None:
            return _mixed(raw, self.coupling) + self._on_all(offsets, zero=True)
        return _pose(self.vehicle, raw + offsets)

    def _on_all(self, own: Array, zero: bool = False) -> Array:
        """(n,) values of all joints, of (k,) those with a source; with `zero` positions."""
        coupling = self.led.coupling if self.led else None
        if coupling is None:
            return own
        return coupling.ratio @ own + zero * coupling.offset

    def on_leaders(self, own: Array) -> Array:
        """(…, n_u) commands of all joints, of those (…, k) of joints with a source; 0 of others."""
        if self.led is None:
            return own
        found = np.zeros((*own.shape[:-1], len(self.led.joints)))
        found[..., list(self.led.independent)] = own
        return found

    def v(self, raw: Array, q: Array) -> Array:
        """Velocities (N, n) from scaled sources (N, n), at positions q of `self.q`."""
        offsets = np.array([s.column.offset if s else 0.0 for s in self.velocities])
        if self.vehicle is None:
            return _mixed(raw, self.coupling) + self._on_all(offsets)
        return _twist(self.vehicle, raw + offsets, q)

    def placed(self, q: Array, v: Array, rate: float) -> Array:
        """Poses (N, 7), with positions integrated from the twists if the log has none.

        q (N, 7) is that of `self.q`, v (N, 6) that of `self.v`, `rate` in rows per second [Hz].
        """
        if self.vehicle is None or self.vehicle.position is not None or self.turns_only:
            return q
        world = Rotation.from_quat(q[:, 3:]).apply(v[:, :3])
        path = scipy.integrate.cumulative_trapezoid(world, dx=1 / rate, axis=0, initial=0.0)
        return np.hstack([path, q[:, 3:]])

    @property
    def turns_only(self) -> bool:
        """Whether it is the layout of a vehicle whose translation is not measured."""
        return self.vehicle is not None and self.vehicle.turns_only

    def force(self, raw: Array, v: Array, rate: float) -> Array:
        """Specific forces (N, 3) along our axes of the body at its origin [m/s²].

        From sources (N, 3) in the map's unit, at twists v (N, 6), `rate` in rows per second [Hz].
        """
        assert self.vehicle is not None
        ned = self.vehicle.frame == "NED/FRD"
        own = raw @ FRD if ned else raw
        own = own * (GRAVITY if self.vehicle.acceleration_unit == "g" else 1.0)
        place = np.array(self.vehicle.acceleration_at)
        if not place.any():
            return own
        return own - leverage(v[:, 3:6], rate) @ (FRD @ place if ned else place)

    @property
    def quaternion(self) -> tuple[str, ...]:
        """Columns of the orientation: those of the map, or of a run of ours; () without one."""
        if self.imu is not None:
            return self.imu.orientation
        if self.vehicle is not None:
            count = 4 if self.vehicle.quaternion else 0
            return tuple(
                source.column.column for source in self.positions[len(self.positions) - count :]
            )
        if len(self.positions) != len(self.velocities) + 1:
            return ()
        return tuple(source.column.column for source in self.positions[3:7])

    def u(self, raw: Array) -> Array:
        """Commands (N, n_u) from scaled sources (N, n_u)."""
        offsets = np.array([s.column.offset if s else 0.0 for s in self.commands])
        return self.on_leaders(_mixed(raw, self.torque) + offsets)


def leverage(angular: Array, rate: float) -> Array:
    """(N, 3, 3) accelerations per metre of distance from the origin of a body that turns [1/s²].

    angular (N, 3) is in rad/s: the acceleration at r is dω/dt × r + ω × (ω × r).
    """
    slow = signals.low_pass(angular, signals.bandwidth(rate) / (0.5 * rate))
    turning = np.gradient(slow, 1 / rate, axis=0)
    units = np.eye(3)
    across = np.cross(turning[:, None], units)
    inward = np.cross(slow[:, None], np.cross(slow[:, None], units))
    return np.swapaxes(across + inward, 1, 2)


def _mixed(raw: Array, matrix: Array | None) -> Array:
    return raw if matrix is None else raw @ matrix.T


def with_servos(mapping: Map, robot: RobotModel, tables: Sequence[LogTable]) -> Map:
    """The map, with [pd] if a robot that walks under its file's position servos logs their targets.

    Under contact a servo's targets cannot be simulated, while its torques are known but for kp.
    """
    channels = channel_names(tables)
    servos = robot.servos is not None and mapping.pd is None
    if not servos or imu_columns(mapping, channels, robot.walks) is None:
        return mapping
    joints = [name for name in matching.named(robot) if name in robot.leaders]
    stated = mapping.joints.values()
    if any(joint.command is not None and joint.command.is_position for joint in stated):
        return replace(mapping, pd=Pd())
    if not stated and matching.match_targets(channels, joints):
        return replace(mapping, pd=Pd())
    return mapping


def layout(
    mapping: Map | None, robot: RobotModel, tables: Sequence[LogTable], targets: bool = False
) -> Layout:
    """The layout of a map, or of channels matched by name if the map lists none.

    `targets` is whether the commands are position targets, converted as positions are.

    Raises:
        UnmatchedChannels: there is no map, and the names are ambiguous.
        InvalidInput: the map names a joint or column that does not exist, or lacks one.
    """
    mapping = mapping or Map()
    channels = channel_names(tables)
    if not robot.jointed:
        return _of_vehicle(mapping, robot, tables, channels)
    if mapping.battery is not None:
        raise InvalidInput("map: battery", "a vehicle", "a robot of joints", "Leave it out.")
    if not mapping.joints:
        under_pd = mapping.pd is not None
        named = [name for name in matching.named(robot) if name in robot.leaders]
        matched = matching.match(channels, named, robot.passive, under_pd)
        mapping = replace(mapping, joints=matched.joints)
    remedy = f"The robot's actuated joints are {', '.join(robot.leaders)}."
    for joint in set(mapping.joints) ^ set(robot.leaders):
        stated = "a joint that the robot lacks" if joint in mapping.joints else "no entry"
        stated = "a joint that follows another one" if joint in robot.followers else stated
        expected = "one entry for each actuated joint"
        raise InvalidInput(f"map: joints.{joint}", expected, stated, remedy)
    of_targets = targets or mapping.pd is not None
    joints = [
        _in_units(joint, name, mapping.factors, robot, of_targets)
        for name, joint in zip(robot.leaders, _ordered(mapping, robot.leaders), strict=True)
    ]
    for name, joint in zip(robot.leaders, joints, strict=True):
        if joint.command is None and name not in robot.passive:
            expected = "a column, as the joint has a motor in the model file"
            raise InvalidInput(f"map: joints.{name}.command", expected, "none", remedy)
        if joint.command and joint.command.is_position and not targets and mapping.pd is None:
            expected = "a force or current, as the joint has a motor in the model file"
            raise InvalidInput(f"map: joints.{name}.command", expected, "a target", matching.ADD_PD)
    n = len(joints)
    own = list(zip(robot.leaders, joints, strict=True))
    factors = mapping.factors
    pd = None if mapping.pd is None or targets else _pd_law(mapping, robot, joints)
    targets = targets or pd is not None
    made = Layout(
        tuple(
            _source(
                "position",
                j.position,
                j.position.unit_as("position") not in ("m", "mm"),
                factors.of("position", name),
            )
            for name, j in own
        ),
        tuple(
            _source("velocity", j.velocity, scale=factors.of("velocity", name))
            if j.velocity
            else None
            for name, j in own
        ),
        tuple(
            _source(
                "command",
                j.command,
                scale=factors.of("command", name),
                unit_of="position" if targets else "command",
            )
            if j.command
            else None
            for name, j in own
        ),
        np.linalg.inv(matrix("position", mapping.coupling.position, n)),
        matrix("torque", mapping.coupling.torque, n),
        pd=pd,
        led=robot if robot.coupling else None,
        imu=imu_columns(mapping, channels, robot.walks),
    )
    if robot.coupling is not None and made.coupling is not None:
        made = made._replace(coupling=robot.coupling.ratio @ made.coupling)
    return _existing(made, channels)


def _in_units(
    joint: Joint, name: str, factors: Factors, robot: RobotModel, of_targets: bool
) -> Joint:
    """A joint's columns, in the units of all where its own lines state none.

    `of_targets` is whether its command is a position target. Of an arm in degrees a gripper that
    takes targets counts from 0 to 100, as LeRobot writes it.
    """
    ends = _range(robot, name)
    if of_targets and matching.is_gripper(name) and factors.position == "deg":
        factors = replace(factors, position="range")
    position = factors.with_unit("position", name, joint.position, ends)
    velocity = joint.velocity and factors.with_unit("velocity", name, joint.velocity)
    command = joint.command and (
        factors.with_unit("position", name, joint.command, ends)
        if of_targets
        else factors.with_unit("command", name, joint.command)
    )
    return replace(joint, position=position, velocity=velocity, command=command)


def _range(robot: RobotModel, joint: str) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The ends of LeRobot's range of a joint, each with its position; None without limits."""
    low, high, _ = limits(robot, joint)
    if not np.isfinite(high - low):
        return None
    return (0.0 if matching.is_gripper(joint) else -100.0, low), (100.0, high)


def _pd_law(mapping: Map, robot: RobotModel, joints: Sequence[Joint]) -> PdLaw:
    """The law of a map's [pd], with the channels of its joints."""
    assert mapping.pd is not None
    if mapping.coupling.position or mapping.coupling.torque:
        remedy = "Give targets and gains of the joints, or the motors' torques without [pd]."
        raise InvalidInput("map", "[pd] or [coupling]", "both", remedy)
    rates = [joint.target_velocity for joint in joints]
    forward = [joint.feedforward for joint in joints]
    kp, kd = known_gains(mapping.pd, robot)
    gain = robot.gain[list(robot.independent)]
    return PdLaw(
        kp / gain,
        kd / gain,
        tuple(_source("velocity", column) if column else None for column in rates),
        tuple(_source("command", column) if column else None for column in forward),
        gain,
    )


_PART = frozenset({"joint", "motor", "axis", "actuator", "servo", "drive", "j", "m"})


def apart(mapping: Map | None, robot: RobotModel, tables: Sequence[LogTable]) -> list[LogTable]:
    """The tables, with `FILE/COLUMN` for columns of equal names in several files where needed.

    It is if the map has such names, or if only such names tell targets from measurements, as in
    `control.csv` beside `state.csv`, or the joints apart: files that are called after the joints
    (`elbow.csv`, `motor_2.csv`).
    """
    named = told_apart(tables)
    added = set(channel_names(named)) - set(channel_names(tables))
    if not added:
        return list(tables)
    if mapping is not None and (mapping.joints or mapping.vehicle):
        used = {column.column for joint in mapping.joints.values() for column in _columns(joint)}
        used |= {column.column for column in mapping.actuators.values()}
        used |= {*(mapping.vehicle.columns if mapping.vehicle else ())}
        return named if used & added else list(tables)
    if robot.jointed and _are_of_targets(tables):
        return named
    if not robot.jointed or not all(_of_a_joint(table.source, robot) for table in tables):
        return list(tables)
    try:
        layout(mapping, robot, tables)
    except UnmatchedChannels:
        return named
    return list(tables)


def _are_of_targets(tables: Sequence[LogTable]) -> bool:
    """Whether some files are called after targets, and have fewer columns than the others."""
    wanted: set[str] = set()
    measured: set[str] = set()
    for table in tables:
        own = wanted if matching.says_targets(table.source.partition(".")[0]) else measured
        own |= set(table.channels)
    return bool(wanted) and wanted < measured


def _columns(joint: Joint) -> list[ColumnMap]:
    """The columns of a joint's entry in a map."""
    parts = (joint.position, joint.velocity, joint.command, joint.target_velocity)
    return [part for part in (*parts, joint.feedforward) if part is not None]


def _of_a_joint(source: str, robot: RobotModel) -> bool:
    """Whether a file is called after a joint, or a number of one."""
    own = matching.words(source.partition(".")[0])
    each = [matching.words(joint) for joint in matching.named(robot)]
    named = any(own[k : k + len(j)] == j for j in each for k in range(len(own)))
    return named or (bool(_PART & set(own)) and any(word.isdigit() for word in own))


def with_angles(table: LogTable, robot: RobotModel) -> LogTable:
    """A table whose `q_0` … are one angle for each joint, if they were Pinocchio's coordinates.

    Other tables are returned as they are. Angles are continued across whole turns.
    """
    kinds = [body.joint for body in robot.system.structure.bodies]
    joints = len(kinds)
    count = robot.system.m
    names = [f"q_{k}" for k in range(count)]
    longer = f"q_{count}" in table.channels
    if robot.system.group or count == joints or longer or not {*names} <= {*table.channels}:
        return table
    channels = {name: channel for name, channel in table.channels.items() if name not in names}
    angles = {}
    first = 0
    for k, kind in enumerate(kinds):
        t, values = table.channels[names[first]]
        if kind == "circle":
            values = np.unwrap(np.arctan2(table.channels[names[first + 1]].values, values))
            first += 1
        angles[f"q_{k}"] = Channel(t, values)
        first += 1
    return LogTable(table.source, angles | channels, table.origin, table.findings)


def _source(
    quantity: Quantity,
    column: ColumnMap,
    angle: bool = False,
    scale: float = 1.0,
    unit_of: Quantity | None = None,
) -> ChannelSource:
    """The source of a column times a scale, with a unit of `quantity`, or of another one."""
    factor = scale * column.factor(unit_of or quantity)
    if column.points is not None:
        (value, position), (other, there) = column.points
        column = replace(column, points=((value, scale * position), (other, scale * there)))
    else:
        column = replace(column, offset=scale * column.offset)
    return ChannelSource(quantity, column, factor, angle)


def _ordered(mapping: Map, names: Sequence[str]) -> list[Joint]:
    """The columns of joints in their order, after the swaps of a map."""
    joints = mapping.joints
    order = mapping.order.joints
    if order and sorted(order) != sorted(names):
        known = f"The robot's actuated joints are {', '.join(names)}."
        raise InvalidInput("map: order.joints", "every joint once", ", ".join(order), known)
    if order:
        joints = {true: mapping.joints[name] for name, true in zip(names, order, strict=True)}
    for what in ("position", "velocity", "command"):
        swaps = getattr(mapping.order, what)
        _check_order(what, swaps, names)
        taken = {joint: getattr(joints[other], what) for joint, other in swaps.items()}
        joints = joints | {j: replace(joints[j], **{what: column}) for j, column in taken.items()}
    return [joints[name] for name in names]


def _check_order(what: Quantity, swaps: Mapping[str, str], names: Sequence[str]) -> None:
    for joint in {*swaps, *swaps.values()} - set(names):
        known = f"The robot's actuated joints are {', '.join(names)}."
        raise InvalidInput(f"map: order.{what}", "joints of the robot", joint, known)


def _existing(made: Layout, channels: list[str]) -> Layout:
    missing = [s for s in made.sources if s.column.column not in channels]
    if missing:
        what = f"map: column of a {missing[0].quantity}"
        names = ", ".join(dict.fromkeys(source.column.column for source in missing))
        expected = "a column of the log" if "," not in names else "columns of the log"
        remedy = f"The log has {listed(channels)}."
        raise InvalidInput(what, expected, names, remedy)
    return made


def _of_vehicle(
    mapping: Map, robot: RobotModel, tables: Sequence[LogTable], channels: list[str]
) -> Layout:
    """The layout of a vehicle's pose, twist and commands; without a map, that of our own runs."""
    m = robot.system.m
    n = robot.system.n
    count = len(robot.joints)
    assumed = ""
    if mapping.vehicle is None and (standard := flight_map(robot, tables)) is not None:
        mapping, assumed = standard
    vehicle = mapping.vehicle
    if vehicle is None:
        widths = {"q": m, "v": n, "u": count}
        parts = [[ColumnMap(column=f"{x}_{k}") for k in range(w)] for x, w in widths.items()]
        if not {column.column for part in parts for column in part} <= set(channels):
            from .first_map import lacking

            raise UnmatchedChannels(*lacking(channels, robot), channels)
    else:
        actuators = {name.replace("_", " "): column for name, column in mapping.actuators.items()}
        plain = [name.replace("_", " ") for name in robot.joints]
        _check_vehicle(vehicle, m, n, [name for name in plain if name not in actuators])
        swaps = mapping.order.command
        _check_order("command", swaps, robot.joints)
        taken = {a: actuators[b.replace("_", " ")] for a, b in swaps.items()}
        actuators |= {a.replace("_", " "): column for a, column in taken.items()}
        parts = [
            [_signed(name, channels) for name in vehicle.pose],
            [
                None if name is None else _signed(name, channels)
                for part, count in ((vehicle.linear, 3), (vehicle.angular, n - 3))
                for name in part or (None,) * count
            ],
            [_relative(actuators[name], robot) for name in plain],
        ]
    if vehicle is not None and vehicle.angular is not None and vehicle.angular_unit == "deg/s":
        parts[1][-3:] = [replace(column, unit="deg/s") for column in parts[1][-3:] if column]
    velocities = tuple(_source("velocity", c) if c else None for c in parts[1])
    positions = tuple(_source("position", c) for c in parts[0] if c)
    if vehicle is not None and vehicle.euler is not None:
        angles = [replace(column, unit=vehicle.euler_unit) for column in parts[0][-3:]]
        positions = (*positions[:-3], *(_source("position", c, angle=True) for c in angles))
    if vehicle is not None and m == 3:
        heading = parts[0][-1]
        unit = vehicle.heading_unit or signals.heading_unit(values_of(heading.column, tables))
        positions = (*positions[:-1], _source("position", replace(heading, unit=unit), angle=True))
        if unit == "deg" and vehicle.heading_unit is None:
            assumed = f"the heading ({heading.column}) is in degrees, judging by its values"
    commands = tuple(
        _source(
            "command",
            mapping.factors.with_unit("command", name, c),
            scale=mapping.factors.of("command", name),
        )
        for c, name in zip(parts[2], robot.joints, strict=True)
        if c
    )
    felt = (vehicle.acceleration if vehicle else None) or ()
    specific = tuple(_source("velocity", _signed(name, channels)) for name in felt)
    voltage = None
    if mapping.battery is not None:
        own = ColumnMap(column=mapping.battery.voltage)
        voltage = ChannelSource("command", own, 1 / mapping.battery.nominal)
    powered = tuple(
        source.column.unit_as("command") != "rpm"
        and any(c.kind in _POWERED for c in robot.system.structure.columns if c.input == k)
        for k, source in enumerate(commands)
    )
    supply = {"voltage": voltage, "powered": powered}
    more = {"vehicle": vehicle, "specific": specific, "assumed": assumed, **supply}
    return _existing(Layout(positions, velocities, commands, **more), channels)


_POWERED = {"rotor", "rotor_torque", "thruster", "propeller", "propeller_torque", "drive"}
"""Kinds of columns of motors whose speed goes down with the supply's voltage."""


def _signed(name: str, channels: Sequence[str]) -> ColumnMap:
    """A column of a vehicle's map, which counts against its axis if `-` stands before its name."""
    if name.startswith("-") and name not in channels:
        return ColumnMap(column=name[1:], sign=-1)
    return ColumnMap(column=name)


def _relative(command: ColumnMap, robot: RobotModel) -> ColumnMap:
    """A command as a share of its full size: a rotor's measured speed is divided by the top one."""
    if command.unit_as("command") != "rpm" or command.ratio != 1:
        return command
    if not np.isfinite(robot.top_speed):
        remedy = "Give the `ratio` 1/(top speed in rad/s) in the map."
        raise InvalidInput(f"map: {command.column}", "a sheet with a top speed", "none", remedy)
    return replace(command, ratio=1 / robot.top_speed)


def _check_vehicle(vehicle: Vehicle, m: int, n: int, idle: Sequence[str]) -> None:
    """Checks that a map has the parts that a system with such coordinates needs.

    `idle` are the actuators without an entry.
    """
    if (m, n) not in ((7, 6), (3, 3)):
        expected = "a single body in space or in the plane"
        remedy = "Identify it from a log of a run of ours, or without its arm."
        raise InvalidInput("map: vehicle", expected, f"{m} positions of the system", remedy)
    given = {key for key in _PARTS if getattr(vehicle, key) is not None}
    both = ("quaternion and euler",) if {"quaternion", "euler"} <= given else ()
    if m == 3:
        lacking = ["position (x, y, heading)"] if "position" not in given else []
        excess = sorted(given - {"position", "linear"})
        remedy = "In the plane give x, y and heading as position, and surge, sway and yaw rate as "
        remedy += "linear, or leave that out to differentiate the position."
    else:
        lacking = [] if given & {"quaternion", "euler"} else ["quaternion or euler"]
        excess = [*both]
        if {"position", "linear"} & given:
            excess += sorted({"depth"} & given)
        remedy = "A body in space needs its orientation, as quaternion or euler, and the commands. "
        remedy += "Angular velocity and linear velocity are differentiated where they are left out."
        remedy += " Without position and linear its rotation alone is identified, with depth or "
        remedy += "acceleration also the motions that they tell."
    where = "map: vehicle"
    expected = f"a motion of {n} velocities"
    if idle and not lacking and not excess:
        where = "map: actuators"
        expected = "one entry for each actuator"
        remedy = "Give the column of each command, such as `thruster_1 = { column = … }`."
    lacking += [f"actuators {', '.join(idle)}"] if idle else []
    if lacking or excess:
        got = [*(f"no {name}" for name in lacking), *excess]
        raise InvalidInput(where, expected, ", ".join(got), remedy)


_PARTS = ("position", "quaternion", "euler", "linear", "angular", "depth", "acceleration")


def _pose(vehicle: Vehicle, raw: Array) -> Array:
    """Poses [p, (x, y, z, w)] (N, 7) or [x, y, ψ] (N, 3) in our axes."""
    ned = vehicle.frame == "NED/FRD"
    if vehicle.quaternion is None and vehicle.euler is None:
        x, y, heading = raw.T
        return np.column_stack([y, x, np.pi / 2 - heading]) if ned else raw
    count = len(vehicle.place)
    places = np.zeros((len(raw), 3))
    if vehicle.position is not None:
        places = raw[:, :3]
    elif count:
        places[:, 2] = raw[:, 0] if ned else -raw[:, 0]
    if vehicle.quaternion is None:  # roll, pitch and yaw
        turns = Rotation.from_euler("ZYX", raw[:, count:][:, ::-1])
    else:
        turns = Rotation.from_quat(raw[:, count:], scalar_first=vehicle.order == "wxyz")
    if vehicle.inverse:
        turns = turns.inv()
    if ned:
        places = places @ NED.T
        turns = Rotation.from_matrix(NED @ turns.as_matrix() @ FRD)
    quaternions = turns.as_quat()
    return np.column_stack([places, quaternions * continuous_signs(quaternions)[:, None]])


def _twist(vehicle: Vehicle, raw: Array, q: Array) -> Array:
    """Twists along the body's axes (N, n), in our axes, at our poses q."""
    ned = vehicle.frame == "NED/FRD"
    if raw.shape[1] == 3:
        if vehicle.twist == "body":
            return raw * [1.0, -1.0, -1.0] if ned else raw.copy()
        east, north, rate = (raw[:, 1], raw[:, 0], -raw[:, 2]) if ned else raw.T
        c = np.cos(q[:, 2])
        s = np.sin(q[:, 2])
        return np.column_stack([c * east + s * north, c * north - s * east, rate])
    linear = raw[:, :3]
    angular = raw[:, 3:]
    if vehicle.twist == "world":
        world = linear @ NED.T if ned else linear
        linear = Rotation.from_quat(q[:, 3:]).inv().apply(world)
    elif ned:
        linear = linear @ FRD
    if vehicle.angular_axes == "world":
        world = angular @ NED.T if ned else angular
        angular = Rotation.from_quat(q[:, 3:]).inv().apply(world)
    elif ned:
        angular = angular @ FRD
    return np.column_stack([linear, angular])


def pose_velocity(q: Array, rate: float) -> Array:
    """Twists (N, n) along the body's axes, from central differences of poses, `rate` [Hz].

    q are poses in space (N, 7) or [x, y, ψ] in the plane (N, 3).
    """
    slopes = np.gradient(q, 1 / rate, axis=0)
    if q.shape[1] == 3:
        c = np.cos(q[:, 2])
        s = np.sin(q[:, 2])
        dx, dy, turn = slopes.T
        return np.column_stack([c * dx + s * dy, c * dy - s * dx, turn])
    ahead = np.arange(1, len(q) + 1)
    behind = np.arange(-1, len(q) - 1)
    ahead[-1] = len(q) - 1
    behind[0] = 0
    before, now, after = (Rotation.from_quat(x[:, 3:]) for x in (q[behind], q, q[ahead]))
    angular = (before.inv() * after).as_rotvec() * rate / (ahead - behind)[:, None]
    return np.hstack([now.inv().apply(slopes[:, :3]), angular])
