"""What a method is: a function from a log, a structure, a prior and stated noise to an estimate."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..log import EXACT, Log, SensorLevels
from ..parameters import Array
from ..system import SecondOrderSystem


class Problem(NamedTuple):
    """All that a method may know.

    Attributes:
        system: the structure.
        log: what was measured.
        prior: (p,) θ̂(0).
        noise: what is stated of the sensors.
    """

    system: SecondOrderSystem
    log: Log
    prior: Array
    noise: SensorLevels = EXACT


class Estimate(NamedTuple):
    """What a method has found.

    Attributes:
        theta: (p,) the estimate.
        note: what the method chose by itself, in words.
    """

    theta: Array
    note: str = ""


Method = Callable[[Problem], Estimate]
"""A method raises an `NsaidError` where it finds no estimate."""
