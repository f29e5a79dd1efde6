"""The IMU on the base of a robot that walks: its columns, and what they say along the model's axes.

Columns are found by the words of their names, as in Unitree's LowState (`imu_state.quaternion[0]`),
ROS messages (`/imu/angular_velocity/x`), MuJoCo's sensors (`imu_lin_acc_0`) or plain `acc_x`. At
rest the specific force points upwards, which tells the order of a quaternion's columns and the unit
of the accelerometer.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...base import Finding
from ...core import Array, continuous_signs
from . import matching
from .mapping import ChannelSource, ColumnMap, Imu, Map, Quantity
from .tables import LogTable, values_of

GRAVITY = 9.81
"""Of the models [m/s²]."""

IMU_ROLES = ("orientation",) * 4 + ("angular velocity",) * 3 + ("specific force",) * 3
"""What the columns of an IMU are, in order."""

_KINDS: Mapping[str, tuple[frozenset[str], ...]] = {
    "orientation": tuple(map(frozenset, (["quaternion"], ["quat"], ["orientation"]))),
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
_LETTERS = {"orientation": ("wxyz",), "gyro": ("xyz",), "accelerometer": ("xyz",)}
_NOT_THE_BASE = frozenset(
    ["foot", "feet", "toe", "joint", "motor", "target", "desired", "cmd", "command"]
)
_TILT = 20.0  # of the mean force from the vertical, beyond which orientation or axes are wrong [°]
_WEIGHTLESS = 0.3  # mean force over gravity below which gravity was taken out of it
_STILL = 0.02  # rms angular velocity below which the base was held [rad/s]


class ImuColumns(NamedTuple):
    """The columns of an IMU, and how they are to be read."""

    sources: tuple[ChannelSource, ...]  # 4 of the orientation, 3 of the gyro, 3 or none of forces
    stated: Imu  # the entry of the map, or what stands for it
    assumed: str = ""  # which columns were found, in words; "" if the map states them

    @property
    def orientation(self) -> tuple[str, ...]:
        """Columns of the orientation."""
        return tuple(source.column.column for source in self.sources[:4])


def imu_columns(mapping: Map, channels: Sequence[str], walks: bool) -> ImuColumns | None:
    """The IMU of a map, or the one found among channels if the robot `walks`; None without one."""
    if mapping.base is not None:
        return ImuColumns(_sources(mapping.base, channels), mapping.base)
    found = _found(channels) if walks else None
    if found is None:
        return None
    names = f"orientation ({found.orientation[0]} …), angular velocity ({found.gyro[0]} …)"
    if found.accelerometer is not None:
        names += f" and specific force ({found.accelerometer[0]} …)"
    text = f"the base moves: its {names} were found by name"
    return ImuColumns(_sources(found, channels), found, text)


def _sources(imu: Imu, channels: Sequence[str]) -> tuple[ChannelSource, ...]:
    readings: tuple[tuple[Quantity, int], ...] = (("position", 4), ("velocity", 3), ("command", 3))
    kinds: list[Quantity] = [quantity for quantity, count in readings for _ in range(count)]
    found = []
    for quantity, name in zip(kinds, imu.columns, strict=False):
        turned = name.startswith("-") and name not in channels
        column = ColumnMap(column=name[1:] if turned else name, sign=-1 if turned else 1)
        if quantity == "velocity":
            column = replace(column, unit=imu.gyro_unit)
        factor = float(column.sign) if quantity != "velocity" else column.factor("velocity")
        found.append(ChannelSource(quantity, column, factor))
    return tuple(found)


def _found(channels: Sequence[str]) -> Imu | None:
    """The one IMU among channels; None without one, or with several."""
    parts = {}
    for kind in _KINDS:
        groups = _groups(channels, kind)
        named = [group for group in groups if "imu" in matching.words(group[0])]
        groups = named if len(named) == 1 else groups
        if len(groups) == 1:
            parts[kind] = groups[0]
    if not {"orientation", "gyro"} <= {*parts}:
        return None
    letters = _spelt_out(matching.words(parts["orientation"][0]))[-1]
    order = "wxyz" if letters == "w" else None
    return Imu(**parts, order=order)


def _groups(channels: Sequence[str], kind: str) -> list[tuple[str, ...]]:
    """Complete groups of channels of a kind: w, x, y, z or 0, 1, 2, 3 after a common stem."""
    stems: dict[str, dict[str, str]] = {}
    for channel in channels:
        own = _spelt_out(matching.words(channel))
        if len(own) < 2 or _NOT_THE_BASE & set(own):
            continue
        if any(each <= set(own[:-1]) for each in _KINDS[kind]):
            stems.setdefault(" ".join(own[:-1]), {})[own[-1]] = channel
    found = []
    for members in stems.values():
        (letters,) = _LETTERS[kind]
        count = len(letters)
        for axes in (letters, "0123"[:count], "1234"[:count]):
            if len(members) == count and set(axes) == set(members):
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


def read_imu(columns: ImuColumns, raw: Array) -> tuple[Array, list[Finding]]:
    """(N, 10) orientation x, y, z, w, angular velocity and specific force of the IMU, and findings.

    `raw` (N, k) are its columns in SI but for the force's unit; without an accelerometer the force
    is that at rest. Findings are refusals where the orientation contradicts the force.
    """
    imu = columns.stated
    findings = []
    force = np.zeros((len(raw), 3))
    if imu.accelerometer is not None:
        force = raw[:, 7:10]
        mean = float(np.median(np.linalg.norm(force, axis=1)))
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
    quaternion, tilt, words = _oriented(imu, raw[:, :4], force)
    if imu.accelerometer is None:  # at rest
        force = Rotation.from_quat(quaternion).inv().apply([0.0, 0.0, GRAVITY])
    if tilt > _TILT:
        text = f"turned by the orientation, the mean force is {tilt:.0f}° from the vertical"
        remedy = "Check `order`, `inverse` and the signs of [base], and the axes of both sensors."
        findings.append(Finding("refusal", "orientation", "base", text, remedy, {"tilt": tilt}))
    elif words and columns.assumed:
        findings.append(Finding("note", "imu", "base", f"{columns.assumed}; {words}"))
    return np.hstack([quaternion, raw[:, 4:7], force]), findings


def _oriented(imu: Imu, raw: Array, force: Array) -> tuple[Array, float, str]:
    """(N, 4) orientations x, y, z, w, their mean force's angle to the vertical [°], and the order.

    Of an order that is not stated, the one is taken with which the force points upwards.
    """
    best = None
    for order in (imu.order,) if imu.order else ("wxyz", "xyzw"):
        turns = Rotation.from_quat(raw, scalar_first=order == "wxyz")
        turns = turns.inv() if imu.inverse else turns
        up = turns.apply(force).mean(axis=0)
        size = float(np.linalg.norm(up))
        tilt = float(np.degrees(np.arccos(np.clip(up[2] / size, -1, 1)))) if size > 0 else 0.0
        if best is None or tilt < best[1]:
            best = (turns.as_quat(), tilt, f"the quaternion's columns are {order}")
    assert best is not None
    quaternion = best[0] * continuous_signs(best[0])[:, None]
    return quaternion, best[1], best[2]


def held_still(columns: ImuColumns, tables: Sequence[LogTable]) -> bool:
    """Whether the base did not turn along logs: the robot hung on a stand."""
    rates = [s.factor * values_of(s.column.column, tables) for s in columns.sources[4:7]]
    return bool(np.sqrt(sum(np.var(rate) for rate in rates)) < _STILL)
