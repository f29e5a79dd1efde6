"""Limits of a designed motion: values, sources, and their use by a motion.

A limit bounds one quantity, such as the speed of every joint, to [low, high]. The *use* of a limit
is the largest distance of the quantity from the middle of its range over half of the range: a
motion obeys all limits if no use exceeds 1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base import LARGEST, InvalidInput, UnknownName
from ...core import Array, JointTree, Log, SecondOrderSystem
from .limits_file import LIMITS_FORM, read_limits_file

Extents = Mapping[str, tuple[Array, Array]]
"""The smallest and the largest values (k,) of every limited quantity along a motion."""

_RANGES = ("position", "box")
COMMAND = "command"
"""The limit of a vehicle's commands."""


@dataclass(frozen=True)
class Limit:
    """The bounds of one quantity."""

    low: Array  # (k,) smallest values
    high: Array  # (k,) largest values
    unit: str  # unit of the values


@dataclass(frozen=True)
class Limits:
    """All limits of a motion.

    Attributes:
        limits: by quantity: position, speed, acceleration and torque of an arm's joints; box,
            speed, rate, tilt and command of a vehicle.
        margin: share of every limit that the planned motion leaves free for the tracking errors of
            its simulation, under parameters other than the planned ones.
        contacts: whether bodies must not touch one another or the ground.
        sources: origins of the limits, in words.
    """

    limits: Mapping[str, Limit]
    margin: float = 0.03
    contacts: bool = False
    sources: Mapping[str, str] = field(default_factory=dict)

    def margin_of(self, name: str) -> float:
        """The margin of a limit; 0 for a vehicle's commands, which are as planned."""
        return 0.0 if name == COMMAND else self.margin

    def uses(self, extents: Extents) -> dict[str, float]:
        """The largest use of every limit by a motion; 1 is the limit itself."""
        return {name: float(np.max(use)) for name, use in self.entries(extents).items()}

    def entries(self, extents: Extents) -> dict[str, Array]:
        """The use of every entry (k,) of every limit, such as each joint's."""
        found = {}
        for name, limit in self.limits.items():
            middle = 0.5 * (limit.low + limit.high)
            half = 0.5 * (limit.high - limit.low)
            low, high = extents[name]
            found[name] = np.maximum(high - middle, middle - low) / half
        return found

    def __post_init__(self) -> None:
        for name, limit in self.limits.items():
            bad = np.flatnonzero(~(limit.low < limit.high))
            if len(bad):
                k = int(bad[0])
                ends = f"{limit.low[k]:g} … {limit.high[k]:g} in entry {k + 1}"
                expected = "a lower end below the upper one"
                remedy = "Correct the limits' file."
                raise InvalidInput(f"limits.{name}", expected, ends, remedy)
        if not 0 <= self.margin < 1:
            raise InvalidInput("limits.margin", "a share in [0, 1)", self.margin, "Try 0.03.")


RANDOM = "random motions"
"""Name of the source of limits that come from the scenario's own excitation."""


def source_of(names: Sequence[str], missing: Sequence[str], other: str) -> str:
    """The source of a limit of some joints: the model, or `other` for joints without any."""
    if len(missing) == len(names):
        return f"{other}, as the model has none"
    return f"model; {other} for {', '.join(missing)}" if missing else "model"


def envelope(extents: Sequence[Extents], share: float) -> dict[str, tuple[Array, Array]]:
    """The bounds that a share of motions keep, 0.5 the median, 1 all, for every entry."""
    return {
        name: (
            np.quantile([each[name][0] for each in extents], 1 - share, axis=0),
            np.quantile([each[name][1] for each in extents], share, axis=0),
        )
        for name in extents[0]
    }


_SETTLED = 3.0
# time from which an arm's motion counts [s]: before, the loop settles at the arm's weight, which it
# does not know exactly, however small the motion; a real arm is held before it moves


def settled(system: SecondOrderSystem, log: Log) -> Log:
    """The part of a simulated motion to which limits apply: an arm's once its loop has settled."""
    if system.group:
        return log
    return log.part(min(int(np.searchsorted(log.t, _SETTLED)), len(log.t) // 2), len(log.t))


def extents_of(system: SecondOrderSystem, log: Log, theta: Array) -> dict[str, tuple[Array, Array]]:
    """The limited quantities along an exact motion of a plant with θ (p,); see `settled`."""
    if system.group:
        return _vehicle(system, log)
    log = settled(system, log)
    found = {
        "position": _range(np.unwrap(coordinates_of(system, log.q), axis=0)),
        "speed": _up_to(np.abs(log.v)),
        "acceleration": _up_to(np.abs(np.gradient(log.v, log.t, axis=0))),
    }
    gains = system.space.actuators
    if len(gains) == system.n_u:
        found["torque"] = _up_to(np.abs(log.u * theta[gains]))
    return found


def _range(rows: Array) -> tuple[Array, Array]:
    return rows.min(axis=0), rows.max(axis=0)


def coordinates_of(system: SecondOrderSystem, q: Array) -> Array:
    """(N, n) coordinates of an arm's positions q (N, m): (cos, sin) become angles; else q."""
    return system.angles(q) if isinstance(system, JointTree) and not system.group else q


def _vehicle(system: SecondOrderSystem, log: Log) -> dict[str, tuple[Array, Array]]:
    """Place [m], speed [m/s], rate of turn [rad/s] and commands; in space, tilt [rad] too."""
    axes = 3 if system.group == 6 else 2
    size = np.linalg.norm
    found = {
        "box": _range(log.q[:, :axes]),
        "speed": _up_to(size(log.v[:, :axes], axis=1)),
        "rate": _up_to(size(log.v[:, axes : system.group], axis=1)),
        COMMAND: _up_to(np.abs(log.u)),
    }
    if axes == 3:
        x, y = log.q[:, 3:5].T  # of a unit quaternion
        upright = 1 - 2 * (x**2 + y**2)  # R_33
        found["tilt"] = _up_to(np.arccos(np.clip(upright, -1, 1)))
    return found


def _up_to(size: Array) -> tuple[Array, Array]:
    """Symmetric ends for sizes (N,) or (N, k)."""
    largest = np.atleast_1d(size.max(axis=0))
    return -largest, largest


def units_of(system: SecondOrderSystem) -> dict[str, str]:
    """The unit of every limited quantity."""
    if system.group:
        return {"box": "m", "speed": "m/s", "rate": "rad/s", "tilt": "rad", COMMAND: "units of u"}
    return {
        "position": "rad or m",
        "speed": "rad/s or m/s",
        "acceleration": "rad/s² or m/s²",
        "torque": "N·m or N",
    }


def read_limits(path: Path, default: Limits) -> Limits:
    """Reads a TOML file of limits, which replace the default ones.

    The keys are `margin`, `contacts`, and the quantities of `default`. `position` and `box` are
    tables of `low` and `high`, all others one largest absolute value. A single number holds for
    all joints, a list has one number for each.

    Raises:
        InvalidInput: the file cannot be read, or a value is not a number in its range.
        UnknownName: there is no such quantity.
    """
    table = read_limits_file(path)
    limits = dict(default.limits)
    sources = dict(default.sources)
    for name, value in table.items():
        if name in ("margin", "contacts"):
            continue
        if name not in limits:
            raise UnknownName("limit", name, [*limits, "margin", "contacts"], LIMITS_FORM)
        limits[name] = _limit(name, value, limits[name])
        sources[name] = path.name
    contacts = table.get("contacts", default.contacts)
    if not isinstance(contacts, bool):
        raise InvalidInput("limits.contacts", "true or false", contacts, LIMITS_FORM)
    margin = float(_numbers("margin", table.get("margin", default.margin), 1)[0])
    return replace(default, limits=limits, margin=margin, contacts=contacts, sources=sources)


def _limit(name: str, value: Any, default: Limit) -> Limit:
    count = len(default.low)
    if name in _RANGES:
        if not isinstance(value, dict) or set(value) - {"low", "high"}:
            raise InvalidInput(f"limits.{name}", "a table of low and high", value, LIMITS_FORM)
        ends = {"low": default.low, "high": default.high}
        ends |= {end: _numbers(f"{name}.{end}", given, count) for end, given in value.items()}
        return Limit(ends["low"], ends["high"], default.unit)
    largest = _numbers(name, value, count)
    if not (largest > 0).all():
        raise InvalidInput(f"limits.{name}", "numbers > 0", value, LIMITS_FORM)
    return Limit(-largest, largest, default.unit)


def _numbers(name: str, value: Any, count: int) -> Array:
    """(count,) finite numbers from a number or a list."""
    given = value if isinstance(value, list) else [value] * count
    plain = all(isinstance(x, int | float) and not isinstance(x, bool) for x in given)
    if len(given) != count or not plain or not all(abs(x) <= LARGEST for x in given):
        expected = f"a finite number, or a list of {count}"
        raise InvalidInput(f"limits.{name}", expected, value, LIMITS_FORM)
    return np.array(given, dtype=np.float64)
