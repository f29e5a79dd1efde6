"""Vehicles of one body: their inertia, and the terms that act on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base import InvalidInput
from ..parameters import Array, Block, ParameterSpace
from .blocks import Term, mounts_of, placed
from .parts import Body, Inertia, Operation
from .structure import Structure
from .system import SecondOrderSystem


class SingleBody(SecondOrderSystem):
    """M ν̇ + C(ν) ν = F θ (4) of one body in space, in the plane, or along the vertical.

    θ = [inertia, then the terms' blocks in order]. Axes are x forward, y left, z up.

    Args:
        body: the block of the inertia.
        inertia: M in this block.
        terms: the forces.
        operation: ranges of velocities and commands.
        gravity: [m/s²], by which rigid bodies have weight.

    Attributes:
        operation: as given.
        LEVEL: the axes of a body in the plane, among the six of one in space.
    """

    LEVEL = (0, 1, 5)

    def __init__(
        self,
        body: Block,
        inertia: Inertia,
        terms: Sequence[Term],
        operation: Operation,
        gravity: float = 0.0,
    ):
        space = ParameterSpace((body, *(term.block for term in terms)))
        columns = placed(space, terms)
        n = len(operation.velocity[0])
        robot = Structure(
            [Body("free" if n == 6 else "planar" if n == 3 else "slide")],
            [inertia],
            columns,
            len(space),
            len(operation.command[0]),
            gravity=(0.0, 0.0, -gravity),
        )
        super().__init__(robot, space, mounts_of(space, columns, np.nan if n > 1 else 0.0))
        self.operation = operation
        self.vertical = n == 1
        self.own_names = ["heave"] if self.vertical else []

    @classmethod
    def of(cls, system: SecondOrderSystem, blocks: Sequence[str], wanted: str) -> SingleBody:
        """The system, if it is one body with these blocks of θ; `wanted` describes it in messages.

        Raises:
            InvalidInput: it is not.
        """
        known = {block.name for block in system.space.blocks}
        if not (isinstance(system, SingleBody) and known.issuperset(blocks)):
            found = ", ".join(block.name for block in system.space.blocks)
            raise InvalidInput(
                "excitation", wanted, f"a system with {found}", "Use MultisineCommand."
            )
        return system

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
