"""Vehicles of one body whose forces are listed, column by column."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..parameters import Array, Block, ParameterSpace
from ..structure.columns import KINDS
from ..structure.parts import Body, Column, Inertia, full
from ..structure.structure import Structure
from .structured import StructuredSystem

LEVEL = (0, 1, 5)
"""Of the six axes of a body in space, those of a body in the plane."""
_REACH = 10.0  # distance of random probes from the origin [m]


class Row(NamedTuple):
    """A column of F, one term of the force on a vehicle.

    Attributes:
        column: its kind, command and constants; its parameter is ignored.
        name: of its parameter; rows of one kind with the same name share it.
        scale: guess of the parameter's magnitude, in SI units.
    """

    column: Column
    name: str
    scale: float


class ListedVehicle(StructuredSystem):
    """M ν̇ + C(ν) ν = F θ with the columns of F as listed.

    θ = [inertia, then the parameters of the rows, kind by kind in the order of their appearance].

    Args:
        rows: the columns of F.
        inertia: block of θ: the ten parameters of a rigid body, or the upper triangle of M.
        speed: (6,) or, in the plane, (3,) velocities of operation [m/s, rad/s].
        gravity: [m/s²]; 0 unless the inertia is that of a rigid body.
    """

    def __init__(self, rows: Sequence[Row], inertia: Block, speed: Array, gravity: float):
        parameters = list(dict.fromkeys((row.column.kind, row.name) for row in rows))
        kinds = list(dict.fromkeys(kind for kind, _ in parameters))
        parameters.sort(key=lambda parameter: kinds.index(parameter[0]))
        of = {key: next(r for r in rows if (r.column.kind, r.name) == key) for key in parameters}
        blocks = [_block([of[key] for key in parameters if key[0] == kind]) for kind in kinds]
        columns = [
            Column(
                row.column.kind,
                len(inertia) + parameters.index((row.column.kind, row.name)),
                body=0,
                input=row.column.input,
                **dict[str, Any](row.column.constants),
            )
            for row in rows
        ]
        free, rigid = len(speed) == 6, inertia.geometry == "pseudo_inertia"
        tensor = None if rigid else full() if free else full(LEVEL)
        space = ParameterSpace((inertia, *blocks))
        robot = Structure(
            [Body("free" if free else "planar")],
            [Inertia(0, 0, tensor)],
            columns,
            len(space),
            1 + max((row.column.input for row in rows), default=-1),
            gravity=(0.0, 0.0, -gravity),
        )
        points = [of[key].column.constants.get("point", [np.nan] * 3) for key in parameters]
        acting = [KINDS[kind].actuator for kind, _ in parameters]
        super().__init__(robot, space, np.array(points, dtype=float).reshape(-1, 3)[acting])
        self._speed = np.asarray(speed, dtype=np.float64)

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a place within 10 m, any attitude, velocities and commands of operation."""
        turn = 1.5 * rng.standard_normal(3) if self.n == 6 else rng.uniform(-np.pi, np.pi, 1)
        place = rng.uniform(-_REACH, _REACH, self.n - len(turn))
        v, u = self._speed * rng.uniform(-1, 1, self.n), rng.uniform(-1, 1, self.n_u)
        return self.position(np.r_[place, turn]), v, u


def _block(rows: list[Row]) -> Block:
    """The block of θ of all parameters of one kind."""
    kind = KINDS[rows[0].column.kind]
    units = kind.unit if isinstance(kind.unit, tuple) else (kind.unit, kind.unit)
    turning = [np.any(np.ravel(row.column.constants.get("axes", (1,)))[3:]) for row in rows]
    return Block(
        kind.name.replace("_", " "),
        tuple(f"{kind.letter}_{row.name}".replace(" ", "_") for row in rows),
        tuple(units[0] if turns else units[1] for turns in turning),
        np.array([row.scale for row in rows]),
        kind.geometry,
        kind.actuator,
        labels=tuple(f"{kind.block} of {row.name}" for row in rows),
    )
