"""The description of a kind of column, beside its compiled value."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ...parameters import Geometry

Drawn = Literal["", "arrow", "ring", "patch"]
Reads = Literal["", "velocity", "pose"]
Constants = Mapping[str, tuple[int, float | None]]
CURVE = -1
LISTED = -2
"""Size of a constant that is a command curve, see `curve.follow_curve`, whose default is a power of
the command; and of one that is a list of numbers, preceded by their count."""


@dataclass(frozen=True)
class Kind:
    """A kind of column of F."""

    # its number in kernels; below `BODY_KINDS` it is a force of a joint, from there on a wrench on
    # a body
    number: int
    name: str  # its name in a sheet or a `Column`
    block: str  # name of its block of θ
    letter: str  # prefix of its parameters' names
    unit: str | tuple[str, str]  # unit of the parameter; for a joint, also on slides
    geometry: Geometry = "positive"  # geometry of the block
    # guessed share of the largest actuator's force that the column explains; with the column's
    # value in operation it gives the scale of the parameter
    share: float = 0.1
    actuator: bool = False  # whether the parameter scales a command
    commanded: bool = False  # whether it reads a command
    # the part of the state on which its value depends: the pose of its body or joint, the velocity
    # (load-dependent friction also the pose), or nothing
    reads: Reads = "velocity"
    # names and sizes of its constants, with their defaults, None if required
    constants: Constants = field(default_factory=dict)
    drawn: Drawn = ""  # how its force is drawn, at `point` if it has one

    def scale(self, force: float, value: float) -> float:
        """A guess of the parameter, where the strongest actuator exerts `force` [N or N·m].

        `value` is the column's value in operation, per unit of its parameter.
        """
        return self.share * force / max(abs(value), 1e-9)
