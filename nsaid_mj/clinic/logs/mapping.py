"""`map.toml`: the columns of a log that are a robot's positions, velocities and commands; units."""

import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import field, replace
from math import pi
from typing import Annotated, Any, Literal, NamedTuple, cast

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    StrictBool,
    TypeAdapter,
    ValidationError,
)

from ...base import InputFile, InvalidInput, NonNegative, Number, Positive, config, path_of

Quantity = Literal["position", "velocity", "command"]

TURN = 2 * pi

FACTORS: Mapping[Quantity, Mapping[str, float]] = {
    "position": {  # ticks: over the counts per turn
        "rad": 1.0,
        "deg": pi / 180,
        "turns": TURN,
        "ticks": TURN,
        "m": 1.0,
        "mm": 1e-3,
    },
    "velocity": {
        "rad/s": 1.0,
        "deg/s": pi / 180,
        "turns/s": TURN,
        "rpm": TURN / 60,
        "ticks/s": TURN,
        "m/s": 1.0,
        "mm/s": 1e-3,
    },
    "command": {
        "N·m": 1.0,
        "mN·m": 1e-3,
        "N": 1.0,
        "A": 1.0,
        "mA": 1e-3,
        "V": 1.0,
        "%": 1.0,
        "raw": 1.0,
        "rpm": TURN / 60,
    },
}
"""Factor from each unit to the unit of `Log`: rad or m, rad/s or m/s, and `si` of a command."""

TIME = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
"""Nanoseconds in each unit of time."""

_ALIASES = {
    alias: unit
    for unit, aliases in {
        "rad": "radian radians",
        "deg": "degree degrees °",
        "turns": "rev revs turn",
        "ticks": "counts",
        "rad/s": "rads radps rad_s",
        "deg/s": "degps deg_s dps °/s",
        "m/s": "mps m_s",
        "N·m": "nm n·m n.m n*m",
        "mN·m": "mnm",
        "A": "amp amps ampere",
        "mA": "milliamps",
        "V": "volt volts",
        "%": "percent",
        "us": "µs μs usec",
        "ms": "msec",
        "ns": "nsec",
        "s": "sec secs seconds",
    }.items()
    for alias in aliases.split()
}
_KNOWN = {name.lower(): name for names in (*FACTORS.values(), TIME) for name in names}


def canonical(text: str) -> str:
    """The unit's canonical spelling: `Nm` and `n*m` are `N·m`; unknown texts are returned as is."""
    plain = text.strip()
    lower = plain.lower()
    if lower in ("ma", "a", "n", "v", "m"):
        return _KNOWN[lower]
    return _ALIASES.get(lower) or _KNOWN.get(lower) or plain


def si(unit: str) -> str:
    """The unit of a command after its conversion; "" for raw numbers."""
    return {"mN·m": "N·m", "mA": "A", "raw": "", "rpm": "rad/s"}.get(unit, unit)


def of_name(name: str, allowed: Mapping[str, float]) -> tuple[str, str]:
    """A column's name without a unit at its end, and that unit if it is in `allowed`, else "".

    `q1_deg`, `q1 [deg]`, `q1 (deg)` and `q1/deg` all state a unit.
    """
    if found := re.fullmatch(r"(.*?)[ _/.]*[\[(]([^\])]+)[\])]", name.strip()):
        unit = canonical(found[2])
        return (found[1], unit) if unit in allowed else (name, "")
    parts = re.split(r"[_ /.]+", name.strip())
    for count in (2, 1):
        if len(parts) > count:
            unit = canonical("_".join(parts[-count:]))
            joined = canonical("/".join(parts[-count:]))
            for one in (unit, joined):
                if one in allowed:
                    return "_".join(parts[:-count]), one
    return name, ""


_SPELT = BeforeValidator(lambda text: canonical(text) if isinstance(text, str) else text)
Unit = Annotated[
    Literal[
        "rad",
        "deg",
        "turns",
        "ticks",
        "m",
        "mm",
        "rad/s",
        "deg/s",
        "turns/s",
        "rpm",
        "ticks/s",
        "m/s",
        "mm/s",
        "N·m",
        "mN·m",
        "N",
        "A",
        "mA",
        "V",
        "%",
        "raw",
    ],
    _SPELT,
]
TimeUnit = Annotated[Literal["s", "ms", "us", "ns", "date"], _SPELT]


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("a number that is not 0")
    return value


def _two_points(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if len({value for value, _ in points}) < 2 or len({position for _, position in points}) < 2:
        raise ValueError("two different values and positions, as in [[-100, -1.9], [100, 1.9]]")
    return points


Ratio = Annotated[Number, AfterValidator(_not_zero)]
Points = Annotated[tuple[tuple[Number, Number], tuple[Number, Number]], AfterValidator(_two_points)]
Three = Annotated[tuple[str, ...], Field(min_length=3, max_length=3)]
Four = Annotated[tuple[str, ...], Field(min_length=4, max_length=4)]


@config
class ColumnMap:
    """A column of a log and its conversion to SI.

    Positions and velocities become `sign · value · unit / ratio + offset`, commands
    `sign · value · unit · ratio + offset`: `ratio` is a gear ratio, motor turns per joint turn.
    Two `points` of the line from value to position replace all these.
    """

    column: str  # name of the column
    # unit of its values; None if the name states it (`q1_deg`), or it is SI
    unit: Unit | None = None
    # −1 if the column counts against the joint's axis
    sign: Annotated[Literal[-1, 1], BeforeValidator(lambda x: int(x) if x in (1, -1) else x)] = 1
    offset: Number = 0.0  # added last [rad, m, rad/s, m/s, or the command's unit]
    ratio: Ratio = 1.0  # ratio of the gear between the motor and the joint
    # counts per turn of an encoder, for `ticks` and `ticks/s`
    counts_per_turn: Positive | None = None
    # two values of the column, each with the position that it represents [rad or m]
    points: Points | None = None

    @property
    def zero(self) -> float:
        """Addend of the scaled values: `offset`, or that of the line through `points`."""
        if self.points is None:
            return self.offset
        value, position = self.points[0]
        return position - self.factor("position") * value

    @property
    def is_position(self) -> bool:
        """Whether its unit is one of positions, or it has `points`."""
        return self.points is not None or self.unit in FACTORS["position"]

    def unit_as(self, quantity: Quantity) -> str:
        """The unit stated by the map or the column's name; "" if neither states one.

        Raises:
            InvalidInput: the stated unit does not belong to such a quantity.
        """
        if self.unit is not None and self.unit not in FACTORS[quantity]:
            known = ", ".join(FACTORS[quantity])
            remedy = "Correct map.toml."
            raise InvalidInput(f"unit of {self.column!r}", f"one of {known}", self.unit, remedy)
        return self.unit or of_name(self.column, FACTORS[quantity])[1]

    def factor(self, quantity: Quantity) -> float:
        """The factor from the column's values to SI, without offset.

        Raises:
            InvalidInput: the unit does not belong to such a quantity, or `counts_per_turn` is
                missing.
        """
        if self.points is not None:
            (value, position), (other, there) = self.points
            return (there - position) / (other - value)
        unit = self.unit_as(quantity)
        scale = FACTORS[quantity].get(unit, 1.0)
        if unit.startswith("ticks"):
            if self.counts_per_turn is None:
                remedy = "Give the encoder's counts per motor turn in map.toml."
                raise InvalidInput(f"{self.column!r}", "counts_per_turn", "none", remedy)
            scale /= self.counts_per_turn
        return self.sign * scale * (self.ratio if quantity == "command" else 1 / self.ratio)


@config
class Profile:
    """Limits and smoothing of a target by a controller; 0 where there is none."""

    speed: NonNegative = 0.0  # largest speed of the limited target [rad/s or m/s]
    acceleration: NonNegative = 0.0  # largest acceleration of the limited target [rad/s² or m/s²]
    lag: NonNegative = 0.0  # time constant of a first-order filter [s]


@config
class Joint:
    """The columns of one joint."""

    position: ColumnMap  # position of the joint, or of its motor (then with `ratio`)
    # current, torque, or any other command or measurement of the actuator; None for a joint that is
    # passive in the model file
    command: ColumnMap | None = None
    velocity: ColumnMap | None = None  # None to differentiate the position
    # rows with a lower speed are not used [rad/s or m/s]; the speed's noise sets another limit, and
    # the higher one applies
    rest: NonNegative = 0.0
    # of the target of a position servo; None for that of all, or of the model file
    profile: Profile | None = None
    # with a PD law, whose target is `command`: its target velocity and its feed-forward torque
    target_velocity: ColumnMap | None = None
    feedforward: ColumnMap | None = None


class ChannelSource(NamedTuple):
    """A channel and its conversion to SI: `factor · value`."""

    quantity: Quantity  # the measured quantity
    column: ColumnMap  # its entry in the map
    factor: float  # to SI; `Layout` adds the offset
    angle: bool = False  # whether its values may jump by whole turns


Gains = NonNegative | tuple[NonNegative, ...] | dict[str, NonNegative]
"""One number for all joints, one for each in the robot's order, or by joint."""


@config
class Pd:
    """A PD law of known gains, by which targets become the motors' torques; see `logs.pd_law`."""

    kp: Gains | None = None  # stiffness [N·m/rad or N/m]; None for that of the file's servos
    # damping [N·m·s/rad or N·s/m]; None for that of the file's servos, with `kp` for none
    kd: Gains | None = None


@config
class Time:
    """The time of every file."""

    column: str | None = None  # name of the column; None to find it
    unit: TimeUnit | None = None  # None to detect it
    rate: Positive | None = None  # rows per second of files without a time [Hz]
    # multiplies the times, of a clock that runs too fast or too slowly; 1 of one known to be right,
    # None if nobody says so
    scale: Positive | None = None


@config
class File:
    """The properties of one file."""

    scale: Positive = 1.0  # multiplies the file's times, of a clock that runs wrong
    offset: Number = 0.0  # added to the file's times, to put several files on one clock [s]
    # register to which the stiffness of position servos is proportional, in any unit
    p: Positive | None = None


def _nonzero(factor: float) -> float:
    if factor == 0:
        raise ValueError("a number other than 0")
    return factor


Factor = Annotated[Number, AfterValidator(_nonzero)] | Unit | Literal["range"]
"""A factor of a joint's values, or the unit in which they are where its line states none."""

PerJoint = Factor | dict[str, Factor]
"""One for all joints, or some joints' own by name."""


@config
class Factors:
    """Signs, factors and units of whole logs, besides what the line of each joint states."""

    position: PerJoint = 1.0  # a unit is also that of targets
    velocity: PerJoint = 1.0
    command: PerJoint = 1.0

    def of(self, quantity: Quantity, joint: str) -> float:
        """The factor of a joint's position, velocity or command; 1 if it is a unit."""
        value = self._of(quantity, joint)
        return 1.0 if isinstance(value, str) else float(value)

    def with_unit(
        self, quantity: Quantity, joint: str, column: ColumnMap, ends: Points | None = None
    ) -> ColumnMap:
        """The column of a joint, in the unit of all if its own line and name state none.

        `ends` are the positions that the ends of its "range" stand for; None without limits.

        Raises:
            InvalidInput: the unit does not belong to such a quantity, or joint.
        """
        unit = self._of(quantity, joint)
        if not isinstance(unit, str) or column.points or column.unit_as(quantity):
            return column
        known = [name for name in FACTORS[quantity] if not name.startswith("ticks")]
        if unit == "range" and ends is not None:
            return replace(column, points=ends)
        if unit not in known:
            expected = f"a number, or one of {', '.join(known)}"
            where = f"map: factors.{quantity}"
            if quantity == "position":
                expected += "; range, of joints with limits in the model file"
                where += f" of {joint}"
            raise InvalidInput(where, expected, unit, "Correct map.toml.")
        return replace(column, unit=cast(Any, unit))

    def _of(self, quantity: Quantity, joint: str) -> float | str:
        given = getattr(self, quantity)
        return given.get(joint, 1.0) if isinstance(given, dict) else given


@config
class ColumnOrder:
    """Joints whose columns are swapped: by joint, the one to which its column was assigned."""

    # all joints in the order of the file's columns, where these are numbered in another order than
    # the model's, or named wrongly; the swaps below come after it
    joints: tuple[str, ...] = ()
    position: dict[str, str] = field(default_factory=dict)
    velocity: dict[str, str] = field(default_factory=dict)
    command: dict[str, str] = field(default_factory=dict)


Matrix = Annotated[tuple[tuple[Number, ...], ...], Field(min_length=1)]


@config
class MotorCoupling:
    """Joints driven by several motors, as in a wrist. Rows and columns are in the robot's order."""

    # (n, n) R with q_motor = R (q − offset); the same for velocities
    position: Matrix | None = None
    torque: Matrix | None = None  # (n, n) R_τ with τ_joint = R_τ τ_motor


@config
class Vehicle:
    """Pose and twist of a vehicle, three or four columns for each part.

    A `-` before a column's name reverses its sign.
    """

    # x, y, z [m], left out to integrate `linear`; x, y and heading of a vehicle in the plane
    position: Three | None = None
    heading_unit: Literal["rad", "deg"] | None = None  # in the plane; None to judge by its values
    quaternion: Four | None = None  # from body to world; not used in the plane
    # roll, pitch and yaw instead, the turns about x, y' and z'' from the world's axes to the
    # body's, yaw first
    euler: Three | None = None
    euler_unit: Literal["deg", "rad"] = "deg"
    # velocity; None to differentiate the position. In the plane: surge, sway, yaw rate
    linear: Three | None = None
    # angular velocity [rad/s]; None to differentiate the orientation
    angular: Three | None = None
    # depth [m] of a vehicle in space whose position and linear velocity are not measured
    depth: str | None = None
    # specific force along the body's axes, as an accelerometer measures it: at rest 1 g upwards. It
    # is checked against attitude and velocity, and takes part in the fit without a linear velocity
    acceleration: Three | None = None
    acceleration_unit: Literal["m/s²", "g"] = "m/s²"
    # place of the accelerometer from the origin of the sheet, along the body's axes of `frame` [m]
    acceleration_at: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    angular_unit: Literal["rad/s", "deg/s"] = "rad/s"
    order: Literal["xyzw", "wxyz"] = "xyzw"  # order of the quaternion's columns
    inverse: StrictBool = False  # whether the orientation is that of the world in the body's axes
    # axes of world and body: north-east-down with forward-right-down, or ours, east-north-up with
    # forward-left-up
    frame: Literal["ENU/FLU", "NED/FRD"] = "ENU/FLU"
    # whether `linear`, and `angular` in space, are given along the body's or the world's axes
    twist: Literal["body", "world"] = "body"
    angular_axes: Literal["body", "world"] = "body"

    @property
    def turns_only(self) -> bool:
        """Whether neither position nor linear velocity is measured."""
        return self.position is None and self.linear is None

    @property
    def place(self) -> tuple[str, ...]:
        """Columns of the position, or of the depth."""
        return self.position or ((self.depth,) if self.depth else ())

    @property
    def pose(self) -> tuple[str, ...]:
        """Columns of the pose."""
        return (*self.place, *(self.quaternion or self.euler or ()))

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the pose, the twist and the specific force."""
        twist = (*(self.linear or ()), *(self.angular or ()))
        return (*self.pose, *twist, *(self.acceleration or ()))


@config
class Imu:
    """What an IMU on the base of a walking robot measures, and where it sits."""

    # orientation of the IMU: the quaternion from its axes to the world's, whose z is up; or three
    # columns: roll, pitch and yaw, or the direction of gravity along its axes (0, 0, -1 if level)
    orientation: Four | Three
    gyro: Three  # angular velocity along its axes
    accelerometer: Three | None = None  # specific force along its axes: 9.81 m/s² upwards at rest
    # what the orientation's columns are; None to find it: at rest the force points upwards, and the
    # vertical turns as the gyroscope says
    order: Literal["xyzw", "wxyz", "rpy", "rpy deg", "gravity"] | None = None
    # whether the quaternion is from the world's axes to the IMU's; None to find it likewise
    inverse: StrictBool | None = None
    gyro_unit: Literal["rad/s", "deg/s"] | None = None  # None to find it likewise
    accelerometer_unit: Literal["m/s²", "g"] | None = None  # None to find it by gravity
    # site, link or frame of the model file at the IMU; None for one called imu, or the base's own
    site: str | None = None
    place: tuple[Number, Number, Number] | None = None  # place in the base's frame instead [m]
    # roll, pitch and yaw of its axes in the base's frame [deg]
    turn: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)

    @property
    def columns(self) -> tuple[str, ...]:
        """Its columns: 4 or 3 of the orientation, 3 of the gyroscope, 3 or none of the forces."""
        return (*self.orientation, *self.gyro, *(self.accelerometer or ()))


@config
class ContactMap:
    """Where a walking robot touches the ground."""

    feet: tuple[str, ...] = ()  # geoms, sites, links or frames; () to find them in the model file
    radius: NonNegative | None = None  # of round feet [m]; None for that of the file, or 0
    # whether a foot also exerts torques; None to see it from its shape
    flat: StrictBool | None = None
    # columns of sensors of force or contact in the feet, in their order and any unit; () to find
    # them by their names
    force: tuple[str, ...] = ()


@config
class Battery:
    """The supply of a vehicle's motors, with whose voltage the speed at a command goes down."""

    voltage: str  # column of its voltage
    nominal: Positive  # voltage for which the commands count, in the same unit


Span = Annotated[tuple[Number, ...], Field(min_length=2, max_length=2)]


@config
class Phases:
    """Which parts of a log take part in the fit."""

    armed: str | None = None  # column that is 0 while the motors are off
    landed: str | None = None  # column that is not 0 while the vehicle stands on the ground
    mode: str | None = None  # column of a controller's mode, a number; it is shown, nothing more
    leave_out: tuple[Span, ...] = ()  # start and end [s] of further parts
    detect: StrictBool = True  # whether parts are also found from the signals


@config
class Map:
    """The meaning and units of columns."""

    time: Time = field(default_factory=Time)  # time of every file
    files: dict[str, File] = field(default_factory=dict)  # by name of the file
    # by the robot's joint names; empty to match columns by name
    joints: dict[str, Joint] = field(default_factory=dict)
    coupling: MotorCoupling = field(
        default_factory=MotorCoupling
    )  # coupling of the joints with their motors
    factors: Factors = field(default_factory=Factors)  # of whole logs
    order: ColumnOrder = field(default_factory=ColumnOrder)  # of columns that are swapped
    vehicle: Vehicle | None = None  # pose and twist, for a vehicle instead of joints
    # commands of a vehicle by the names of its actuators
    actuators: dict[str, ColumnMap] = field(default_factory=dict)
    # of a vehicle; None if its voltage is constant, or if the commands are measured speeds
    battery: Battery | None = None
    # whether a command holds from row to row (True) or is interpolated (False)
    hold: StrictBool = False
    drop_rest: StrictBool = True  # whether rows at rest are left out of the fit
    phases: Phases = field(default_factory=Phases)  # parts of the log that are left out
    # profile of all joints' targets; None for that of the model file
    profile: Profile | None = None
    # law of motors whose commands are position targets; None if the commands are forces
    pd: Pd | None = None
    base: Imu | None = None  # IMU of a robot that stands and walks; None to find its columns
    contacts: ContactMap = field(default_factory=ContactMap)  # feet of such a robot


_ADAPTER = TypeAdapter(Map)


def read_map(path: str | os.PathLike[str]) -> Map:
    """Reads map.toml.

    Raises:
        InvalidInput: there is no such file, it is not TOML, or a field cannot be used; the message
            names the field.
    """
    file = path_of(path)
    remedy = "`nsaid inspect LOG --model M` writes a map that fits the log."
    try:
        content = tomllib.loads(InputFile(file).read().decode())
    except OSError as error:
        raise InvalidInput(str(file), "a map of columns", error.strerror, remedy) from error
    except (ValueError, RecursionError) as error:  # ValueError: not TOML, not UTF-8, 5000 digits
        raise InvalidInput(str(file), "TOML", f"{error}", remedy) from error
    return map_of(content, str(file))


def map_of(content: dict[str, Any], source: str = "map") -> Map:
    """The map of a parsed TOML document; `source` names its file in messages.

    Raises:
        InvalidInput: a field cannot be used; the message names it.
    """
    try:
        return _ADAPTER.validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        text = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
        if first["type"] == "unexpected_keyword_argument":
            text = "no such field"
        remedy = "docs/map.md lists all fields of map.toml."
        raise InvalidInput(f"{source}: {where}", text, first["input"], remedy) from error


def matrix(name: str, rows: tuple[tuple[float, ...], ...] | None, n: int) -> np.ndarray:
    """A coupling as an array (n, n), by default the identity.

    Raises:
        InvalidInput: it is not (n, n), or singular.
    """
    if rows is None:
        return np.eye(n)
    remedy = "It has one row and one column for each joint, in the robot's order."
    if len(rows) != n or any(len(row) != n for row in rows):
        shape = f"rows of {', '.join(str(len(row)) for row in rows)} numbers"
        raise InvalidInput(f"coupling.{name}", f"a {n} × {n} matrix", shape, remedy)
    found = np.array(rows, dtype=np.float64)
    if np.linalg.cond(found) > 1e8:
        raise InvalidInput(f"coupling.{name}", "an invertible matrix", "a singular one", remedy)
    return cast(np.ndarray, found)
