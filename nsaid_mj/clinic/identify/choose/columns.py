"""The columns that a log may add to a robot, each with what it adds to θ, and a choice of them.

A choice becomes columns of the robot's system: the same for the rows of a fit and for a law that
follows the log.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ....core import (
    KINDS,
    Array,
    Column,
    Kind,
    ParameterSpace,
    Rotor,
    SecondOrderSystem,
    SingleBody,
)

# -- a tree of joints ------------------------------------------------------------------------------

SPEEDS = (0.005, 0.01, 0.02, 0.035, 0.05, 0.07, 0.1, 0.14, 0.2)
"""Candidate speeds s [rad/s or m/s] at which tanh(v/s) of Coulomb friction saturates."""
BROAD = 2  # index of the first that is tried
FALLS = (0.03, 0.05, 0.07, 0.1, 0.14, 0.2, 0.3)
"""Candidate speeds f [rad/s or m/s] at which Stribeck friction has fallen to 1/e."""
FALLEN = 3  # index of the first that is tried

_ROTOR = Kind(-1, "rotor", "rotor inertia", "rotor", ("kg·m²", "kg"))  # an entry of M
_NAMES = ("viscous", "coulomb", "stribeck", "load", "quadratic", "cubic", "spring", "offset")
COLUMNS = {"rotor": _ROTOR} | {name: KINDS[name] for name in _NAMES}
COLUMNS["spring"] = replace(KINDS["spring"], geometry="free", share=0.3)  # or a counterweight
"""Columns of a joint by name; their kinds say block, letter, unit and geometry of the parameter.

Rotor v̇, viscous v, Coulomb tanh(v/s), Stribeck tanh(v/s) exp(−(v/f)²), load tanh(v/s)·|weight's
torque|, quadratic v|v|, cubic v³, spring q, offset 1.
"""
HELD = 1.0
"""Load friction that would hold the joint whatever its load: any that exists is below."""
BASIC = frozenset({"rotor", "viscous", "coulomb"})
FASTENED = frozenset({"coulomb", "stribeck", "load"})
"""The columns that depend on a friction speed s."""

COUPLINGS = ("inertia", "viscous", "coulomb")
"""Parameters of coupled joints i, j: the motor of one turns by v_i ± v_j. Rows i and j have v̇_j and
v̇_i, v_j and v_i, tanh((v_i ± v_j)/s) and ± the same."""


@dataclass(frozen=True)
class Choice:
    """The structure of a robot's joints."""

    columns: tuple[frozenset[str], ...]  # for each joint, names of `COLUMNS`
    speed: tuple[int, ...]  # for each joint, index of its s in `SPEEDS`
    delay: Array  # (k,) delay of each command [s]
    coupled: tuple[tuple[int, int, int], ...] = ()  # pairs (i, j, ±1): the motor turns by v_i ± v_j
    falls: tuple[
        int, ...
    ] = ()  # for each joint, index of its f in `FALLS`; () for the first of all

    def fall(self, joint: int) -> int:
        """Index in `FALLS` of the speed at which a joint's Stribeck friction falls."""
        return self.falls[joint] if self.falls else FALLEN

    def with_joint(self, joint: int, names: frozenset[str], speed: int, fall: int) -> Choice:
        """A copy with these columns and speeds at one joint."""
        columns = list(self.columns)
        speeds = list(self.speed)
        falls = [self.fall(j) for j in range(len(columns))]
        columns[joint] = names
        speeds[joint] = speed
        falls[joint] = fall
        parts = {"columns": tuple(columns), "speed": tuple(speeds), "falls": tuple(falls)}
        return replace(self, **parts)

    def at(self, joint: int, *names: str, speed: int | None = None) -> Choice:
        """A copy with further columns, or another speed, at one joint."""
        columns = list(self.columns)
        speeds = list(self.speed)
        columns[joint] = columns[joint] | set(names)
        speeds[joint] = speeds[joint] if speed is None else speed
        return replace(self, columns=tuple(columns), speed=tuple(speeds))

    def terms(self, space: ParameterSpace, links: Array) -> tuple[list[Column], list[Rotor]]:
        """Friction, springs, offsets, couplings and rotors, at the parameters of their names.

        `links` (10 b,) are parameters of the links whose weight loads the friction.
        """
        columns = []
        rotors = []
        for joint, names in enumerate(self.columns):
            for name in sorted(names):
                at = space.index(f"{COLUMNS[name].letter}_{joint + 1}")
                if name == "rotor":
                    rotors.append(Rotor(joint, at))
                else:
                    at_speeds = SPEEDS[self.speed[joint]], FALLS[self.fall(joint)]
                    columns.append(joint_column(name, at, joint, at_speeds, links))
        pairs, turned = self.coupling_terms(space)
        return [*columns, *pairs], [*rotors, *turned]

    def coupling_terms(self, space: ParameterSpace) -> tuple[list[Column], list[Rotor]]:
        """Those of `terms` that act on two joints."""
        columns = []
        rotors = []
        for i, j, sign in self.coupled:
            inertia, viscous, coulomb = (space.index(x) for x in coupling_names(i, j))
            rotors.append(Rotor(i, inertia, j))
            columns += coupling_columns((i, j, sign), viscous, [(coulomb, SPEEDS[self.speed[j]])])
        return columns, rotors


def joint_column(
    name: str, at: int, joint: int, speeds: tuple[float, float], links: Array
) -> Column:
    """A column of `COLUMNS` on a joint, of parameter `at`.

    `speeds` are s of tanh(v/s) and f of exp(−(v/f)²); `links` (10 b,) are those whose weight loads
    the friction.
    """
    constants: dict[str, Any] = {"speed": speeds[0]} if name in FASTENED else {}
    if name == "stribeck":
        constants["stribeck"] = speeds[1]
    elif name == "load":
        moments = links.reshape(-1, 10)[:, :4]
        constants["bodies"] = np.column_stack([np.arange(len(moments)), moments])
    elif name == "offset":
        constants["force"] = -1.0
    return Column(name, at, dof=joint, **constants)


def coupling_names(i: int, j: int) -> list[str]:
    """Names of the parameters of two coupled joints, one for each of `COUPLINGS`."""
    return [f"coupling_{kind}_{i + 1}_{j + 1}" for kind in COUPLINGS]


def coupling_columns(
    pair: tuple[int, int, int], viscous: int, coulomb: list[tuple[int, float]]
) -> list[Column]:
    """Friction of the motor of two joints (i, j, ±1) that turns by v_i ± v_j, on both of them.

    `viscous` is a parameter; `coulomb` are parameters, each with its speed s of tanh.
    """
    i, j, sign = pair
    found = []
    for own, other in ((i, j), (j, i)):
        found.append(Column("shared_viscous", viscous, dof=own, other=other))
        for at, speed in coulomb:
            slip = {"other": other, "sign": sign, "speed": speed}
            found.append(Column("shared_coulomb", at, dof=own, **slip))
    return found


def motors(space: ParameterSpace, driven: list[int]) -> list[Column]:
    """The columns of the motors of some joints, whose gains are the actuators of θ, in order."""
    pairs = zip(space.actuators.tolist(), driven, strict=True)
    return [Column("motor", at, dof=joint, input=joint) for at, joint in pairs]


# -- a vehicle -------------------------------------------------------------------------------------

EXTRA: Mapping[str, str] = {"manoeuvring": "free", "damping": "free", "offset": "free"}
"""Further columns of a vehicle, with the geometry of their parameters: damping −d v and a constant
force, one per velocity, and of a vessel in the plane what manoeuvring adds, see `MANOEUVRES`."""

MANOEUVRES = (
    ("u v", "N·s²/m²", 1, "N"),
    ("u r", "N·s²/(m·rad)", 1, "N"),
    ("v v", "N·s²/m²", 1, "N"),
    ("u v", "N·s²/m", 2, "N·m"),
    ("u r", "N·m·s²/(m·rad)", 2, "N·m"),
    ("r r", "N·m·s²/rad²", 2, "N·m"),
)
"""Products of surge u, sway v and yaw rate r, unit of the parameter, the velocity that it pushes
against, and the unit of the force: −|u| v, −u r, −|v| v … (Abkowitz, Lectures on ship
hydrodynamics, 1964)."""

_FLAT = Column.interpolated(np.array([0.0, 1.0]), np.ones(2))  # a curve that no command changes


def offered(system: SecondOrderSystem, name: str) -> bool:
    """Whether a further column can act on a vehicle: manoeuvring is that of a vessel."""
    kinds = {column.kind for column in system.structure.columns}
    vessel = (system.m, system.n) == (3, 3) and "tyre" not in kinds
    return name != "manoeuvring" or vessel


def further_names(system: SecondOrderSystem, name: str) -> list[str]:
    """Names of the parameters of a column of `EXTRA`, one for each velocity or manoeuvre."""
    count = len(MANOEUVRES) if name == "manoeuvring" else system.n
    return [f"{name}_{i + 1}" for i in range(count)]


def further_columns(
    system: SecondOrderSystem, names: frozenset[str], at: Mapping[str, int]
) -> Iterator[Column]:
    """The columns of `EXTRA`; `at` are the indices of parameters by name."""
    axes = range(6) if system.group == 6 else SingleBody.LEVEL
    for name in sorted(names):
        if name == "manoeuvring":
            yield from _manoeuvring([at[parameter] for parameter in further_names(system, name)])
            continue
        for i, parameter in enumerate(further_names(system, name)):
            if i >= system.group:
                kind = "viscous" if name == "damping" else "offset"
                yield Column(kind, at[parameter], dof=i)
                continue
            along = np.eye(6)[axes[i]]
            if name == "damping":
                yield Column("linear_drag", at[parameter], body=0, axes=along)
            elif axes[i] < 3:  # a thruster and a rotor's torque, which no command changes
                push = {"point": np.zeros(3), "direction": along[:3], "curve": _FLAT}
                yield Column("thruster", at[parameter], body=0, input=0, **push)
            else:
                turn = {"curve": _FLAT, "direction": along[3:]}
                yield Column("rotor_torque", at[parameter], body=0, input=0, **turn)


def _manoeuvring(at: list[int]) -> Iterator[Column]:
    """The columns of `MANOEUVRES`, with the parameters `at`, from kinds that a sheet has."""
    sway, yaw = np.eye(6)[[1, 5]]
    yield Column("lift", at[0], body=0)
    yield from _turning_force(at[1])
    yield Column("drag", at[2], body=0, axes=sway)
    yield Column("lift_moment", at[3], body=0)
    yield Column("speed_drag", at[4], body=0, axes=yaw)
    yield Column("drag", at[5], body=0, axes=yaw)


def _turning_force(parameter: int) -> Iterator[Column]:
    """The sway force −u r of a vessel that goes ahead, from kinds that a sheet has.

    Of the flow (u, w = v ± l r) at a point ± l ahead, inflow along the diagonals makes the force
    (u² + w²)/√2 ahead and −√2 u w aside. The points' difference is −2 √2 l u r aside, 4 l v r/√2
    ahead and the moment −2 √2 l u v: with l = 1/√8 m they are −u r, v r and −u v. A body's lift
    moment takes the last away, inflow across the body at ± 1/4 m the one ahead.
    """
    ahead, aside = np.eye(3)[:2]
    for side in (1.0, -1.0):
        place = {"body": 0, "point": side / np.sqrt(8) * ahead}
        for diagonal in (ahead + aside, ahead - aside):
            along = side / np.sqrt(2) * diagonal
            yield Column("rotor_inflow", parameter, direction=along, **place)
        place = {"body": 0, "point": side / 4 * ahead}
        yield Column("rotor_inflow", parameter, direction=-side * ahead, **place)
    yield Column("lift_moment", parameter, body=0)
