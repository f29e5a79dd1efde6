"""Underwater vehicles (6): rigid body, added mass, drag, buoyancy and thrusters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..parameters import Array, Block, ParameterSpace
from ..structure.columns.curve import odd
from ..structure.parts import Body, Column, Inertia, columns_at, full
from ..structure.structure import Structure
from .structured import StructuredSystem

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class UnderwaterScales:
    """An engineer's guesses for an underwater vehicle, which become the scale of θ.

    Attributes:
        mass: (6,) diagonal of M, added mass included [kg, kg·m²].
        linear: (6,) linear drag [N·s/m, N·m·s/rad].
        quadratic: (6,) quadratic drag [N·s²/m², N·m·s²/rad²].
        net_weight: weight minus buoyancy [N].
        righting: moment of weight and buoyancy [N·m].
        thrust: (k,) thrust of each thruster at full command [N].
        speed: (6,) velocities of operation [m/s, rad/s], for random probes of the structure.
    """

    mass: Array
    linear: Array
    quadratic: Array
    net_weight: float
    righting: float
    thrust: Array
    speed: Array


class UnderwaterVehicle(StructuredSystem):
    """M ν̇ + C(ν) ν = −D ν − D_q |ν| ν − g(q) + Σ k_i f(u_i) w_i (6), Fossen's model.

    θ = [M (21), linear drag (6), quadratic drag (6), net weight, righting moments (3), thrust (k)].
    Axes are x forward, y left, z up. Righting moments are r_B B − r_G W, in the body's axes.

    Args:
        scales: guesses.
        positions: (k, 3) of the thrusters [m].
        directions: (k, 3) unit vectors along which they push.
        curve: coefficients of u, u³, u⁵ … of the command curve; their sum is 1.
    """

    def __init__(self, scales: UnderwaterScales, positions: Array, directions: Array, curve: Array):
        space, k = body_space(scales), len(positions)
        columns = [
            *water_columns(21),
            *columns_at("thruster", 37, positions, directions, curve=odd(*curve)),
        ]
        robot = Structure([Body("free")], [Inertia(0, 0, full())], columns, len(space), k)
        super().__init__(robot, space, positions)
        self._speed = scales.speed

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a position within 10 m, any attitude, velocities and commands of operation."""
        q = self.position(np.r_[rng.uniform(-10, 10, 3), 1.5 * rng.standard_normal(3)])
        return q, self._speed * rng.uniform(-1, 1, 6), rng.uniform(-1, 1, self.n_u)


def water_columns(start: int) -> list[Column]:
    """Drag, net weight and righting moments of the first body, from θ[start] on."""
    return [
        *(Column("linear_drag", start + i, body=0, axes=axis) for i, axis in enumerate(np.eye(6))),
        *(Column("drag", start + 6 + i, body=0, axes=axis) for i, axis in enumerate(np.eye(6))),
        Column("weight", start + 12, body=0),
        *(Column("righting", start + 13 + i, body=0, axis=e) for i, e in enumerate(np.eye(3))),
    ]


def mass_block(diagonal: Array, axes: Sequence[int] = range(6)) -> Block:
    """The entries of a symmetric M (n, n), upper triangle row by row.

    Args:
        diagonal: (n,) guess of M's diagonal [kg, kg·m²]; off it, a quarter of the geometric mean.
        axes: along and about which the body moves, of the six.
    """
    rows, columns = np.triu_indices(len(axes))
    share = np.where(rows == columns, 1.0, 0.25)
    scale = share * np.sqrt(diagonal[rows] * diagonal[columns])
    rows, columns = np.asarray(axes)[rows], np.asarray(axes)[columns]
    pairs = list(zip(rows.tolist(), columns.tolist(), strict=True))
    units = np.array(["kg", "kg·m", "kg·m²"])[(rows >= 3).astype(int) + (columns >= 3)]
    return Block(
        "mass matrix",
        tuple(f"M_{i + 1}{j + 1}" for i, j in pairs),
        tuple(units.tolist()),
        scale,
        "spd",
        labels=tuple(_mass_label(i, j) for i, j in pairs),
    )


def _mass_label(i: int, j: int) -> str:
    """The label of entry (i, j) of M; "effective" because it includes added mass."""
    if i == j:
        return f"effective {AXES[i]} {'mass' if i < 3 else 'inertia'}"
    return f"{AXES[i]}–{AXES[j]} coupling of M"


def per_axis(name: str, letter: str, units: tuple[str, str], scale: Array) -> Block:
    """A block of six, one per axis; free of sign, since a true value may be 0."""
    return Block(
        name,
        tuple(f"{letter}_{axis}" for axis in AXES),
        (units[0],) * 3 + (units[1],) * 3,
        scale,
        labels=tuple(f"{name} in {axis}" for axis in AXES),
    )


def body_space(s: UnderwaterScales) -> ParameterSpace:
    """θ of one body in water: M, linear and quadratic drag, net weight, righting, thrusters."""
    k = len(s.thrust)
    return ParameterSpace(
        (
            mass_block(s.mass),
            per_axis("linear drag", "d", ("N·s/m", "N·m·s/rad"), s.linear),
            per_axis("quadratic drag", "dq", ("N·s²/m²", "N·m·s²/rad²"), s.quadratic),
            Block("net weight", ("net weight",), ("N",), np.array([s.net_weight])),
            Block(
                "righting moment",
                tuple(f"righting_{axis}" for axis in "xyz"),
                ("N·m",) * 3,
                np.full(3, s.righting),
                labels=tuple(f"righting moment about {axis}" for axis in "xyz"),
            ),
            Block(
                "thruster gain",
                tuple(f"thrust_{i + 1}" for i in range(k)),
                ("N",) * k,
                s.thrust,
                "positive",
                actuator=True,
                labels=tuple(f"thrust of thruster {i + 1}" for i in range(k)),
            ),
        )
    )
