"""What there is to say about a kind of column, beside its compiled value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ...parameters import Geometry

Drawn = Literal["", "arrow", "ring", "patch"]
Reads = Literal["", "velocity", "pose"]
CURVE, LISTED = -1, -2
"""Sizes of a constant that is a command curve, see `curve.follow_curve`, whose default is a power
of the command; and of one that is a list of numbers, preceded by their count."""


@dataclass(frozen=True)
class Kind:
    """A kind of column of F.

    Attributes:
        number: by which kernels know it; below `BODY_KINDS` it is a force of a joint, from there on
            a wrench on a body.
        name: by which a sheet or a `Column` calls it.
        block: name of its block of θ.
        letter: prefix of its parameters' names.
        unit: of the parameter; of a joint's also for slides.
        geometry: of the block.
        share: guessed share of the largest actuator's force that the column explains; with the
            column's value in operation it gives the scale of the parameter.
        actuator: whether the parameter scales a command.
        commanded: whether it reads a command.
        reads: what of the state its value depends on: the pose of its body or joint, the velocity
            (load-dependent friction also the pose), or nothing.
        constants: names and sizes of its constants, with their defaults, None if required.
        drawn: as what its force is drawn, at `point` if it has one.
    """

    number: int
    name: str
    block: str
    letter: str
    unit: str | tuple[str, str]
    geometry: Geometry = "positive"
    share: float = 0.1
    actuator: bool = False
    commanded: bool = False
    reads: Reads = "velocity"
    constants: Mapping[str, tuple[int, float | None]] = field(default_factory=dict)
    drawn: Drawn = ""

    def scale(self, force: float, value: float) -> float:
        """A guess of the parameter.

        Args:
            force: of the strongest actuator there [N or N·m].
            value: of the column in operation, per unit of its parameter.
        """
        return self.share * force / max(abs(value), 1e-9)
