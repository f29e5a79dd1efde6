"""The interface of a driver: the initial state, and the command at every sample."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...base import Config, InvalidInput, config
from ...core import Array

if TYPE_CHECKING:
    from ...core import JointTree, SecondOrderSystem
    from .computed_torque import Tracking


class Driver(ABC):
    """A controller: computes the command from time and measured state."""

    @abstractmethod
    def start(self) -> tuple[Array, Array]:
        """Resets the controller; (n,) position numbers and (n,) velocities of the initial state."""

    @abstractmethod
    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) command that is held from t [s] until the next sample; q (m,), v (n,) measured."""


@dataclass(eq=False)
class Feedback(Driver):
    """A driver without memory, made of two functions."""

    begin: Callable[[], tuple[Array, Array]]  # what `start` returns
    law: Callable[[float, Array, Array], Array]  # `command`

    def start(self) -> tuple[Array, Array]:
        """The initial state."""
        return self.begin()

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) command."""
        return self.law(t, q, v)


class CompiledDriver(Driver):
    """A driver whose law compiled code may evaluate."""

    @abstractmethod
    def compiled(self, t: Array) -> Array | Tracking | None:
        """The control law in a form that compiled code evaluates, bit for bit as `command` does.

        It is the commands (k, n_u) at times t (k,) [s], if the driver is open loop; the parameters
        of `computed_torque`, if that is its law; None if only `command` can evaluate it.
        """


class InformedDriver(Driver):
    """A driver that can use an identifier's estimate while it drives."""

    period: float  # interval at which it is informed [s]; infinite if it never is

    def steps(self, dt: float) -> float:
        """Time steps of dt [s] between two estimates; infinite if it wants none.

        They do not depend on the observers, so these do not change a run.
        """
        return max(1.0, float(np.round(self.period / dt)))

    @abstractmethod
    def inform(self, theta_hat: Array) -> None:
        """Receives the estimate θ̂ (p,) of the run's identifier, every `period`."""


@config
class DriverConfig(Config, ABC):
    """A driver's parameters, as part of a scenario; `build` makes the driver."""

    _path = "excitation"

    @abstractmethod
    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver of a structure, whose controller uses the prior θ̂(0) (p,) as its model.

        Frequencies, phases and coefficients come from `rng`.
        """


def tree(system: SecondOrderSystem, wanted: str, remedy: str, carried_by: str = "") -> JointTree:
    """The system, if it is an arm on a fixed base, or one carried by a vehicle with such columns.

    `wanted` and `remedy` are for the message.

    Raises:
        InvalidInput: it is not.
    """
    from ...core import JointTree

    suits = system.columns(carried_by) if carried_by else not system.group
    if not isinstance(system, JointTree) or not suits:
        raise InvalidInput("excitation", wanted, type(system).__name__, remedy)
    return system
