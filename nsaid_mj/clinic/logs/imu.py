"""The IMU on the base of a robot that walks: its columns, and what they say along the model's axes.

Columns are found by the words of their names, as in Unitree's LowState (`imu_state.quaternion[0]`),
ROS messages (`/imu/angular_velocity/x`), MuJoCo's sensors (`imu_lin_acc_0`) and state (`qpos_3`),
arrays of training frameworks (`root_ang_vel_b_0`, `projected_gravity_b_0`) or plain `acc_x`.

Its sensors check each other. At rest the specific force points upwards, and the vertical, along the
IMU's axes û, turns as the gyroscope says: dû/dt = û × ω. Both tell the order and the direction of a
quaternion, roll, pitch and yaw from gravity's direction, degrees from radians, and signs. Yaw does
not matter: it is in no equation of a robot on level ground.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...base import Finding
from ...core import Array, continuous_signs, zero_phase
from . import matching
from .mapping import ChannelSource, ColumnMap, Imu, Map, Quantity
from .remedies import remedy_of
from .tables import LogTable, values_of

GRAVITY = 9.81
"""Of the models [m/s²]."""

_KINDS: Mapping[str, tuple[frozenset[str], ...]] = {
    "orientation": tuple(map(frozenset, (["quaternion"], ["quat"], ["orientation"]))),
    "angles": tuple(map(frozenset, (["rpy"], ["euler"]))),
    "gravity": tuple(map(frozenset, (["projected", "gravity"], ["gravity"], ["grav"]))),
    "gyro": tuple(
        map(frozenset, (["gyroscope"], ["gyro"], ["angular", "velocity"], ["ang", "vel"]))
    ),
    "accelerometer": tuple(
        map(
            frozenset,
            (["accelerometer"], ["linear", "acceleration"], ["lin", "acc"], ["acc"], ["accel"]),
        )
    ),
}
_AXES = {"orientation": ("wxyz", "0123", "1234")}
_AXES |= {kind: ("xyz", "012", "123") for kind in _KINDS if kind != "orientation"}
_ANGLES = {"roll": "x", "pitch": "y", "yaw": "z"}
_NOT_THE_BASE = frozenset(
    ["foot", "feet", "toe", "joint", "motor", "target", "desired", "cmd", "command"]
)
_TILT = 20.0  # of the mean force from the vertical, beyond which orientation or axes are wrong [°]
_WEIGHTLESS = 0.3  # mean force over gravity below which gravity was taken out of it
_STILL = 0.02  # rms angular velocity below which the base was held [rad/s]
_SLOW = 4.0  # cut-off of what is compared with the gyroscope [Hz]
_SLOWEST = 0.5  # of forces that are compared with gravity: without those of steps [Hz]
_TURNS = 0.03  # rms rate of the vertical that noise does not explain [rad/s]
_APART = 0.6  # relative difference of the vertical's rate and the gyroscope's that contradicts
_HALF_A_TURN = 1.1 * np.pi  # largest angle in radians that a logger writes
_DEGREES = 180 / np.pi


class ImuColumns(NamedTuple):
    """The columns of an IMU, and how they are to be read."""

    sources: tuple[ChannelSource, ...]  # of orientation, gyroscope and, if any, accelerometer
    stated: Imu  # the entry of the map, or what stands for it
    assumed: str = ""  # which columns were found, in words; "" if the map states them
    feet: tuple[str, ...] = ()  # columns of sensors in the feet, whose sources come last

    @property
    def orientation(self) -> tuple[str, ...]:
        """Columns of a quaternion; () where there are others."""
        names = [source.column.column for source in self.sources]
        return tuple(names[:4]) if len(self.stated.orientation) == 4 else ()

    @property
    def gyro(self) -> slice:
        """Where the gyroscope is among the columns."""
        first = len(self.stated.orientation)
        return slice(first, first + 3)

    @property
    def roles(self) -> list[str]:
        """What each column is."""
        count = len(self.stated.orientation)
        forces = 3 * (self.stated.accelerometer is not None)
        found = ["orientation"] * count + ["angular velocity"] * 3 + ["specific force"] * forces
        return found + ["force on a foot"] * len(self.feet)


def imu_columns(mapping: Map, channels: Sequence[str], walks: bool) -> ImuColumns | None:
    """The IMU of a map, or the one found among channels if the robot `walks`; None without one."""
    feet = mapping.contacts.force or foot_columns(channels)
    of_feet = tuple(ChannelSource("command", ColumnMap(column=name), 1.0) for name in feet)
    if mapping.base is not None:
        own = (*_sources(mapping.base, channels), *of_feet)
        return ImuColumns(own, mapping.base, feet=feet)
    found = _found(channels) if walks else None
    if found is None:
        return None
    names = f"orientation ({found.orientation[0]} …), angular velocity ({found.gyro[0]} …)"
    if found.accelerometer is not None:
        names += f" and specific force ({found.accelerometer[0]} …)"
    text = f"its {names} were found by name"
    return ImuColumns((*_sources(found, channels), *of_feet), found, text, feet)


_SENSED = (frozenset(["foot", "feet", "toe", "sole"]), frozenset(["force", "contact", "pressure"]))
_NOT_SENSED = frozenset(["est", "position", "pos", "speed", "velocity", "vel", *"xyz"])


def foot_columns(channels: Sequence[str]) -> tuple[str, ...]:
    """The one group of columns of sensors in feet; () without one, or with several."""
    groups: dict[str, list[str]] = {}
    for channel in channels:
        own = set(matching.words(channel))
        touch = "touch" in own
        if (touch or all(part & own for part in _SENSED)) and not _NOT_SENSED & own:
            kind = " ".join(sorted(own & (_SENSED[1] | {"touch"})))
            groups.setdefault(kind, []).append(channel)
    found = [group for group in groups.values() if len(group) > 1]
    return tuple(found[0]) if len(found) == 1 else ()


def _sources(imu: Imu, channels: Sequence[str]) -> tuple[ChannelSource, ...]:
    count = len(imu.orientation)
    widths: tuple[tuple[Quantity, int], ...] = (
        ("position", count),
        ("velocity", 3),
        ("command", 3),
    )
    kinds: list[Quantity] = [quantity for quantity, width in widths for _ in range(width)]
    found = []
    for number, (quantity, name) in enumerate(zip(kinds, imu.columns, strict=False)):
        turned = name.startswith("-") and name not in channels
        column = ColumnMap(column=name[1:] if turned else name, sign=-1 if turned else 1)
        factor = float(column.sign)
        found.append(ChannelSource(quantity, column, factor, count == 3 and number < 3))
    return tuple(found)


def _found(channels: Sequence[str]) -> Imu | None:
    """The one IMU among channels; None without one, or with several."""
    parts: dict[str, tuple[str, ...]] = {}
    for kind in _KINDS:
        groups = _groups(channels, kind)
        named = [group for group in groups if "imu" in matching.words(group[0])]
        groups = named if len(named) == 1 else groups
        if len(groups) == 1:
            parts[kind] = groups[0]
    parts |= {kind: own for kind, own in _of_state(channels).items() if kind not in parts}
    order = None
    for kind in ("angles", "gravity"):
        own = parts.pop(kind, None)
        if own is not None and "orientation" not in parts:
            parts["orientation"] = own
            order = "gravity" if kind == "gravity" else None
    if not {"orientation", "gyro"} <= {*parts}:
        return None
    if _spelt_out(matching.words(parts["orientation"][0]))[-1] == "w":
        order = "wxyz"
    known: dict[str, Any] = dict(parts)
    return Imu(**known, order=order)


def _of_state(channels: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Orientation and angular velocity in MuJoCo's state with a free joint, if it is there."""
    free = matching.free_joint(channels)
    if free is None:
        return {}
    q, v = free
    return {"orientation": tuple(q[3:7]), "gyro": tuple(v[3:6])}


def _groups(channels: Sequence[str], kind: str) -> list[tuple[str, ...]]:
    """Complete groups of channels of a kind: w, x, y, z or 0, 1, 2, 3 after a common stem."""
    stems: dict[str, dict[str, str]] = {}
    for channel in channels:
        own = _spelt_out(matching.words(channel))
        if kind == "angles" and own and own[-1] in _ANGLES:
            own = [*own[:-1], "rpy", _ANGLES[own[-1]]]
        if len(own) < 2 or _NOT_THE_BASE & set(own):
            continue
        if any(each <= set(own[:-1]) for each in _KINDS[kind]):
            stems.setdefault(" ".join(own[:-1]), {})[own[-1]] = channel
    found = []
    for members in stems.values():
        for axes in _AXES[kind]:
            if len(members) == len(axes) and set(axes) == set(members):
                found.append(tuple(members[axis] for axis in axes))
    return found


_SHORT = re.compile("(q|quat|a|acc|g|gyro|w|omega)([wxyz])")
_WORD = {"q": "quat", "quat": "quat", "a": "acc", "acc": "acc"}


def _spelt_out(own: list[str]) -> list[str]:
    """The words of a channel, with `qw` as `quat w`, and of an IMU `ax` and `gx` as `acc x` …."""
    short = _SHORT.fullmatch(own[-1]) if own else None
    if short is None or (len(short[1]) == 1 and short[1] != "q" and "imu" not in own):
        return own
    return [*own[:-1], _WORD.get(short[1], "gyro"), short[2]]


def read_imu(columns: ImuColumns, t: Array, raw: Array) -> tuple[Array, list[Finding]]:
    """(N, 10 + f) readings of the IMU and of f sensors in feet, and findings.

    Those of the IMU are orientation x, y, z, w, angular velocity and specific force.

    `raw` (N, k) are its columns at times t (N,) of a grid; without an accelerometer the force is
    that at rest. Findings are refusals where its sensors contradict each other.
    """
    imu = columns.stated
    findings: list[Finding] = []
    at = columns.gyro
    force = raw[:, at.stop : at.stop + 3] if imu.accelerometer is not None else None
    if force is not None:
        mean = float(np.linalg.norm(np.mean(force, axis=0)))
        unit = imu.accelerometer_unit
        if unit == "g" or (unit is None and 0.7 < mean < 1.3):
            force = GRAVITY * force
            mean *= GRAVITY
        if mean < _WEIGHTLESS * GRAVITY:
            text = (
                f"the accelerometer shows {mean:.2g} m/s² on average: gravity was taken out of it"
            )
            remedy = "Log its own reading, 9.81 m/s² upwards at rest, or leave `accelerometer` out."
            findings.append(Finding("refusal", "no_gravity", "accelerometer", text, remedy))
            force = None
    given = raw[:, : at.start], raw[:, at], force
    best = _likeliest(imu, t, *given)
    wrong = best.contradictions(imu, t, raw[:, at], force)
    if wrong and (imu.order is not None or imu.inverse is not None):
        other = _likeliest(replace(imu, order=None, inverse=None), t, *given)
        if not other.contradictions(imu, t, raw[:, at], force):
            changes = {"base.order": other.order, "base.inverse": other.inverse}
            wrong = [_AxesCause("orientation", f"it agrees if {other.words}", changes)]
    if wrong:
        findings.append(_finding_of(wrong))
    if columns.assumed and not findings:
        findings.append(Finding("note", "imu", "base", f"{columns.assumed}; {best.words}"))
    if force is None:
        force = GRAVITY * best.up
    gyro = raw[:, at] / (_DEGREES if best.gyro_unit == "deg/s" else 1.0)
    feet = raw[:, raw.shape[1] - len(columns.feet) :]
    return np.hstack([best.quaternion, gyro, force, feet]), findings


class _AxesCause(NamedTuple):
    """A contradiction between an IMU's sensors."""

    code: str  # of the finding
    text: str
    changes: dict[str, object]  # values of map.toml that mend it; {} where none is known
    key: str = ""  # the one that it changes


def _finding_of(causes: Sequence[_AxesCause]) -> Finding:
    """One refusal of an IMU whose sensors contradict each other."""
    changes: dict[str, object] = {}
    for cause in causes:  # each states the whole entry
        changes |= {k: x for k, x in cause.changes.items() if k not in changes or k == cause.key}
    remedy = "Check the order, direction, axes and signs of the sensors in [base]."
    whole = all(cause.changes for cause in causes)
    text = "; ".join(cause.text for cause in causes)
    data: dict[str, object] = {"map": changes} if whole else {}
    remedy = remedy_of(changes) if whole else remedy
    return Finding("refusal", causes[0].code, "base", text, remedy, data)


class ImuReading(NamedTuple):
    """One way to read an orientation and a gyroscope."""

    quaternion: Array  # (N, 4) x, y, z, w, from the IMU's axes to the world's
    order: str
    inverse: bool
    gyro_unit: str
    error: float  # of the vertical's rate against the gyroscope, and of the force's direction

    @property
    def up(self) -> Array:
        """(N, 3) the vertical along the IMU's axes."""
        return Rotation.from_quat(self.quaternion).as_matrix()[:, 2]

    @property
    def words(self) -> str:
        """How the columns were read."""
        what = "the orientation's columns are gravity's direction"
        if self.order.startswith("rpy"):
            unit = "degrees" if self.order.endswith("deg") else "radians"
            what = f"the orientation's columns are roll, pitch and yaw in {unit}"
        elif self.order != "gravity":
            what = f"the quaternion's columns are {self.order}"
            what += ", from the world's axes to the IMU's" if self.inverse else ""
        return what + (", and the gyroscope is in deg/s" if self.gyro_unit == "deg/s" else "")

    def contradictions(
        self, imu: Imu, t: Array, gyro: Array, force: Array | None
    ) -> list[_AxesCause]:
        """What gyroscope (N, 3) and force (N, 3), if any, say against the orientation."""
        found = [] if force is None else [*self._of_force(imu, t, force)]
        return [*found, *self._of_gyro(imu, t, gyro)]

    def _of_force(self, imu: Imu, t: Array, force: Array) -> Iterator[_AxesCause]:
        """The mean force points upwards."""
        up = self.up
        tilt = _tilt(up, force)
        if tilt <= _TILT:
            return
        text = f"turned by the orientation, the mean force is {tilt:.0f}° from the vertical"
        slow = _low_passed(t, np.hstack([force / GRAVITY, up]), _SLOWEST)
        errors = {}
        for signs in ((-1, -1, -1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)):
            if _tilt(up, force * signs) <= _TILT:
                errors[signs] = float(np.std(slow[:, :3] * signs - slow[:, 3:], axis=0).sum())
        changes: dict[str, object] = {}
        if errors:
            signs = min(errors, key=lambda one: errors[one])
            assert imu.accelerometer is not None
            changes = _entry(imu)
            changes["base.accelerometer"] = list(signed(imu.accelerometer, signs))
            text += ": all axes" if sum(signs) == -3 else ": two axes"
            text += " of the accelerometer count against those of the orientation"
        yield _AxesCause("orientation", text, changes, "base.accelerometer")

    def _of_gyro(self, imu: Imu, t: Array, gyro: Array) -> Iterator[_AxesCause]:
        """The vertical turns as the gyroscope says."""
        slow = _low_passed(t, np.hstack([self.up, gyro]), _SLOW)
        up = slow[:, :3]
        rate = np.cross(np.gradient(up, t, axis=0), up)  # without its part along the vertical
        size = np.sqrt(np.mean(rate**2, axis=0))
        if float(np.linalg.norm(size)) < _TURNS:
            return
        own = slow[:, 3:] - up * np.sum(up * slow[:, 3:], axis=1)[:, None]
        both = size * np.sqrt(np.mean(own**2, axis=0))
        together = np.mean(rate * own, axis=0) / np.maximum(both, 1e-12)
        level = int(np.argmax(np.abs(up.mean(axis=0))))
        axes = [axis for axis in range(3) if axis != level]
        certain = [axis for axis in axes if size[axis] > 0.3 * size.max()]
        if all(together[axis] > 1 - _APART for axis in certain):
            return
        names = ", ".join(f"{together[axis]:.2f} about {'xyz'[axis]}" for axis in axes)
        text = "the vertical of the orientation does not turn as the gyroscope measures "
        text += f"(correlation {names})"
        changes: dict[str, object] = {}
        if (np.abs(together[axes]) > 1 - _APART).all():
            signs = np.ones(3, dtype=int)
            signs[axes] = np.where(together[axes] < 0, -1, 1)
            signs[level] = signs[axes].prod()
            changes = _entry(imu)
            changes["base.gyro"] = list(signed(imu.gyro, signs.tolist()))
            text += ": two axes of the gyroscope count against those of the orientation"
        yield _AxesCause("gyro", text, changes, "base.gyro")


def _likeliest(imu: Imu, t: Array, raw: Array, gyro: Array, force: Array | None) -> ImuReading:
    return min(_readings(imu, t, raw, gyro, force), key=lambda one: one.error)


def _readings(
    imu: Imu, t: Array, raw: Array, gyro: Array, force: Array | None
) -> Iterator[ImuReading]:
    """The ways to read (N, 4) or (N, 3) columns of an orientation, and the gyroscope's unit."""
    orders = ("wxyz", "xyzw") if raw.shape[1] == 4 else ("rpy", "rpy deg", "gravity")
    for order in (imu.order,) if imu.order else orders:
        quaternion = _quaternions(raw, order)
        ways = (False, True) if imu.inverse is None and raw.shape[1] == 4 else (bool(imu.inverse),)
        for inverse in ways:
            own = quaternion * [-1, -1, -1, 1] if inverse else quaternion
            up = Rotation.from_quat(own).as_matrix()[:, 2]
            slow = _low_passed(t, np.hstack([up, np.cross(up, gyro)]), _SLOW)
            rate = np.gradient(slow[:, :3], t, axis=0)
            noise = _TURNS * np.sqrt(len(t))
            rare = 0.0
            if order.startswith("rpy"):  # a robot that never turns by 4° or half a turn is rare
                rare = float(order.endswith("deg") == (np.abs(raw).max() < _HALF_A_TURN))
            for unit in (imu.gyro_unit,) if imu.gyro_unit else ("rad/s", "deg/s"):
                said = slow[:, 3:] / (_DEGREES if unit == "deg/s" else 1.0)
                size = float(np.linalg.norm(rate) + np.linalg.norm(said)) + noise
                error = float(np.linalg.norm(rate - said)) / size
                error += 0.5 * rare + 0.3 * inverse + 1e-3 * (unit == "deg/s")
                if force is not None:
                    tilt = _tilt(up, force)
                    error += 2.0 * (min(tilt, 180.0 - tilt) > _TILT)
                yield ImuReading(own, order, inverse, unit, error)


def _quaternions(raw: Array, order: str) -> Array:
    """(N, 4) x, y, z, w of the columns of an orientation."""
    if order == "gravity":  # the turn by which it points downwards, without yaw
        up = -raw / np.maximum(np.linalg.norm(raw, axis=1)[:, None], 1e-12)
        w = 1 + up[:, 2]
        found = np.column_stack([up[:, 1], -up[:, 0], np.zeros(len(up)), np.maximum(w, 1e-9)])
        return found / np.linalg.norm(found, axis=1)[:, None]
    if order.startswith("rpy"):
        angles = raw[:, ::-1]
        found = Rotation.from_euler("ZYX", angles, degrees=order.endswith("deg")).as_quat()
    else:
        found = Rotation.from_quat(raw, scalar_first=order == "wxyz").as_quat()
    return found * continuous_signs(found)[:, None]


def _tilt(up: Array, force: Array) -> float:
    """The mean angle of the mean (N, 3) force to the vertical (N, 3) along the same axes [°]."""
    along = float(np.mean(np.sum(up * force, axis=1)))
    whole = np.linalg.norm(np.mean(force, axis=0))
    return float(np.degrees(np.arccos(np.clip(along / max(float(whole), 1e-12), -1, 1))))


def _low_passed(t: Array, x: Array, cutoff: float) -> Array:
    """x (N, k) without what is faster than `cutoff` [Hz]."""
    rate = (len(t) - 1) / (t[-1] - t[0])
    return zero_phase(x, min(cutoff, 0.4 * rate), rate) if len(t) > 8 else x


def signed(names: Sequence[str], signs: Sequence[int]) -> tuple[str, ...]:
    """Names of columns with reversed signs where `signs` are −1."""
    turned = [name[1:] if name.startswith("-") else f"-{name}" for name in names]
    return tuple(b if s < 0 else a for a, b, s in zip(names, turned, signs, strict=True))


def _entry(imu: Imu) -> dict[str, object]:
    """The lines of map.toml that state an IMU, by table and key."""
    found: dict[str, object] = {
        "base.orientation": list(imu.orientation),
        "base.gyro": list(imu.gyro),
    }
    if imu.accelerometer is not None:
        found["base.accelerometer"] = list(imu.accelerometer)
    for key in ("order", "inverse", "gyro_unit", "accelerometer_unit"):
        value = getattr(imu, key)
        if value is not None:
            found[f"base.{key}"] = value
    return found


def held_still(columns: ImuColumns, tables: Sequence[LogTable]) -> bool:
    """Whether the base did not turn along logs: the robot hung on a stand."""
    gyro = columns.sources[columns.gyro]
    rates = [s.factor * values_of(s.column.column, tables) for s in gyro]
    degrees = columns.stated.gyro_unit == "deg/s"
    limit = _STILL * (_DEGREES if degrees else 1.0)
    return bool(np.sqrt(sum(np.var(rate) for rate in rates)) < limit)
