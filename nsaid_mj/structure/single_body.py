"""Vehicles of one body: their inertia, and blocks of columns that act on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidInput
from ..parameters import Array, Block, Geometry, ParameterSpace
from .columns import KINDS
from .parts import Body, Column, Inertia
from .structure import Structure
from .structured import StructuredSystem
from .system import SecondOrderSystem

LEVEL = (0, 1, 5)
"""The axes of a body in the plane, among the six of one in space."""


class Term(NamedTuple):
    """A block of θ, and the columns of F that it scales.

    Attributes:
        block: names, units and guesses of the parameters.
        columns: their parameters count from the block's first.
        nominal: (k,) published values of the parameters.
        spread: relative deviation of true values, as a share of the vehicle's assumed spread.
    """

    block: Block
    columns: Sequence[Column]
    nominal: Array
    spread: float = 1.0


@dataclass(frozen=True, eq=False)
class Operation:
    """A vehicle's ranges of operation, from which random probes of its structure are drawn.

    Attributes:
        velocity: lowest and highest velocities, two (n,) [m/s, rad/s]; n is 6, 3 in the plane, or 1
            along the vertical.
        command: lowest and highest commands, two (n_u,).
        reach: largest distance from the origin along each axis [m].
        turn: standard deviation of the rotation vector's components [rad]; in the plane, yaw is
            arbitrary.
        state: draws (n,) position coordinates, (n,) velocities and (n_u,) commands, where these
            depend on each other; None if they do not.
    """

    velocity: tuple[Array, Array]
    command: tuple[Array, Array]
    reach: float = 10.0
    turn: float = 1.5
    state: Callable[[np.random.Generator], tuple[Array, Array, Array]] | None = None


class SingleBody(StructuredSystem):
    """M ν̇ + C(ν) ν = F θ (4) of one body in space, in the plane, or along the vertical.

    θ = [inertia, then the terms' blocks in order]. Axes are x forward, y left, z up.

    Args:
        body: the block of the inertia.
        tensor: (6, 6, k) tensor of M in this block; None for the ten parameters of a rigid body.
        terms: the forces.
        operation: ranges of velocities and commands.
        gravity: [m/s²], by which rigid bodies have weight.

    Attributes:
        operation: as given.
    """

    def __init__(
        self,
        body: Block,
        tensor: Array | None,
        terms: Sequence[Term],
        operation: Operation,
        gravity: float = 0.0,
    ):
        space, columns = ParameterSpace((body, *(term.block for term in terms))), list[Column]()
        for term in terms:
            start = space[term.block.name].start
            columns += [column.shifted(parameter=start) for column in term.columns]
        n = len(operation.velocity[0])
        robot = Structure(
            [Body("free" if n == 6 else "planar" if n == 3 else "slide")],
            [Inertia(0, 0, tensor)],
            columns,
            len(space),
            len(operation.command[0]),
            gravity=(0.0, 0.0, -gravity),
        )
        first = {column.parameter: column for column in reversed(columns)}
        nowhere = np.full(3, np.nan if n > 1 else 0.0)  # a torque acts at no point
        mounts = [first[k].constants.get("point", nowhere) for k in space.actuators.tolist()]
        super().__init__(robot, space, np.array(mounts, dtype=np.float64).reshape(-1, 3))
        self.operation = operation

    def constants(self, kind: str, name: str) -> Array:
        """(k, ...) a constant of every column of a kind."""
        return np.array([np.asarray(column.constants[name]) for column in self.columns(kind)])

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a place within reach, an attitude, velocities and commands of operation."""
        operation = self.operation
        if operation.state is not None:
            coordinates, v, u = operation.state(rng)
            return self.position(coordinates), v, u
        place = rng.uniform(-operation.reach, operation.reach, {6: 3, 3: 2, 1: 1}[self.n])
        turn = np.zeros(0)
        if self.n == 6:
            turn = operation.turn * rng.standard_normal(3)
        elif self.n == 3:
            turn = rng.uniform(-np.pi, np.pi, 1)
        q = self.position(np.concatenate([place, turn]))
        return q, rng.uniform(*operation.velocity), rng.uniform(*operation.command)


def single_body(system: SecondOrderSystem, blocks: Sequence[str], wanted: str) -> SingleBody:
    """The system, if it is one body with these blocks of θ; `wanted` describes it in the message.

    Raises:
        InvalidInput: it is not.
    """
    known = {block.name for block in system.space.blocks}
    if not (isinstance(system, SingleBody) and known.issuperset(blocks)):
        found = ", ".join(block.name for block in system.space.blocks)
        raise InvalidInput("excitation", wanted, f"a system with {found}", "Use MultisineCommand.")
    return system


def term(
    columns: Sequence[Column],
    labels: Mapping[str, str],
    nominal: ArrayLike,
    scale: Array,
    block: str = "",
    geometry: Geometry | None = None,
    spread: float = 1.0,
) -> Term:
    """A block of columns; the columns' kinds determine its parameters.

    Args:
        columns: their parameters count from 0.
        labels: name of every parameter, with its readable description.
        nominal: (k,) or a number, the published values.
        scale: (k,) or a number, guesses of their magnitudes.
        block: name of the block; that of the first column's kind if left out.
        geometry: which values are physical; that of the first column's kind if left out.
        spread: see `Term`.
    """
    first = [next(c for c in columns if c.parameter == k) for k in range(len(labels))]
    kind = KINDS[first[0].kind]
    return Term(
        Block(
            block or kind.block,
            tuple(labels),
            tuple(_unit(column) for column in first),
            np.broadcast_to(scale, len(labels)),
            geometry or kind.geometry,
            kind.actuator,
            labels=tuple(labels.values()),
        ),
        columns,
        np.broadcast_to(np.asarray(nominal, dtype=np.float64), len(labels)),
        spread,
    )


def _unit(column: Column) -> str:
    """The unit of a column's parameter; of a moment if it acts about an axis."""
    unit = KINDS[column.kind].unit
    if isinstance(unit, str):
        return unit
    return unit[0 if np.any(np.ravel(column.constants["axes"])[3:]) else 1]


def numbered(letter: str, label: str, count: int) -> dict[str, str]:
    """Labels of like parameters: {"thrust_1": "thrust of rotor 1", …} from "thrust of rotor"."""
    return {f"{letter}_{i}": f"{label} {i}" for i in range(1, count + 1)}
