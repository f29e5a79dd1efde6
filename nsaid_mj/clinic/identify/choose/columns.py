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
    LEVEL,
    Array,
    Column,
    Kind,
    ParameterSpace,
    Rotor,
    SecondOrderSystem,
    interpolated,
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

EXTRA: Mapping[str, str] = {"damping": "free", "offset": "free"}
"""Further columns of a vehicle, one per velocity, with the geometry of their parameters: damping
−d v, and a constant force."""

_FLAT = interpolated(np.array([0.0, 1.0]), np.ones(2))  # a curve that no command changes


def further_names(system: SecondOrderSystem, name: str) -> list[str]:
    """Names of the parameters of a column of `EXTRA`, one for each velocity."""
    return [f"{name}_{i + 1}" for i in range(system.n)]


def further_columns(
    system: SecondOrderSystem, names: frozenset[str], at: Mapping[str, int]
) -> Iterator[Column]:
    """The columns of `EXTRA` on every velocity; `at` are the indices of parameters by name."""
    axes = range(6) if system.group == 6 else LEVEL
    for name in sorted(names):
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
