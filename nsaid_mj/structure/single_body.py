"""Vehicles of one body: their inertia, and the terms that act on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidInput
from ..parameters import Array, Block, ParameterSpace
from .blocks import Term, mounts_of, placed
from .parts import Body, Inertia
from .structure import Structure
from .system import SecondOrderSystem

LEVEL = (0, 1, 5)
"""The axes of a body in the plane, among the six of one in space."""


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

    @staticmethod
    def within(
        speed: ArrayLike, most: Array, least: float | None = None, reach: float = 10.0
    ) -> Operation:
        """Up to a speed (n,) in both directions, and commands up to `most` (n_u,).

        The commands begin at `least`, or at −`most`.
        """
        fastest = np.array(speed, dtype=np.float64)
        lowest = -most if least is None else np.full(len(most), least)
        return Operation((-fastest, fastest), (lowest, most), reach)


class SingleBody(SecondOrderSystem):
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
        space = ParameterSpace((body, *(term.block for term in terms)))
        columns = placed(space, terms)
        n = len(operation.velocity[0])
        robot = Structure(
            [Body("free" if n == 6 else "planar" if n == 3 else "slide")],
            [Inertia(0, 0, tensor)],
            columns,
            len(space),
            len(operation.command[0]),
            gravity=(0.0, 0.0, -gravity),
        )
        super().__init__(robot, space, mounts_of(space, columns, np.nan if n > 1 else 0.0))
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
