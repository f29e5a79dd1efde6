"""What observes a run: a progress bar, or a viewer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from ..core import Array, Log, Measurement, SecondOrderSystem, State
    from ..robots import Looks
    from .scenario import Scenario


class RobotDescription(NamedTuple):
    """The structure, prior and meshes of a robot, without true values."""

    system: SecondOrderSystem
    prior: Array  # (p,) θ̂(0)
    looks: Looks | None  # its visual meshes; None if there are none


class Observer(ABC):
    """Callbacks during a run, for a progress bar or a live viewer.

    Attributes:
        period: largest interval between two calls of `see`, in simulated time [s].
    """

    period: float = np.inf

    @abstractmethod
    def start(self, scenario: Scenario, robot: RobotDescription, first: Measurement) -> None:
        """Called at the first measurement."""

    @abstractmethod
    def see(self, log: Log, states: dict[str, State], levels: tuple[float, float]) -> None:
        """Called after every segment of the run, with the samples since the call before.

        `states` are the identifiers' states at the last one, by name, "" for the first; `levels`
        are ε₀ of (2) and of (75) over the current window.
        """

    @abstractmethod
    def stop(self) -> None:
        """Called at the end of the run, also after an error."""
