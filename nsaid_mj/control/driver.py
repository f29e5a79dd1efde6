"""The interface of a driver: the initial state, and the command at every sample."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ..bounds import Config, config
from ..parameters import Array
from ..system import SecondOrderSystem
from .computed_torque import Tracking


class Driver(ABC):
    """A controller: computes the command from time and measured state."""

    @abstractmethod
    def start(self) -> tuple[Array, Array]:
        """Resets the controller; (n,) position numbers and (n,) velocities of the initial state."""

    @abstractmethod
    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) command that is held from t [s] until the next sample; q (m,), v (n,) measured."""

    @abstractmethod
    def compiled(self, t: Array) -> Array | Tracking | None:
        """The control law in a form that compiled code evaluates, bit for bit as `command` does.

        Args:
            t: (k,) sample times [s].

        Returns:
            (k, n_u) the commands at t, if the driver is open loop; the parameters of
            `computed_torque`, if that is its law; None if only `command` can evaluate it.
        """


class InformedDriver(Driver):
    """A driver that can use an identifier's estimate while it drives.

    Attributes:
        period: interval at which it is informed [s]; infinite if it makes no use of it.
    """

    period: float

    @abstractmethod
    def inform(self, theta_hat: Array) -> None:
        """Called with the estimate θ̂ (p,) of the run's identifier, every `period`."""


@config
class DriverConfig(Config, ABC):
    """A driver's parameters, as part of a scenario; `build` makes the driver."""

    _path = "excitation"

    @abstractmethod
    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver of a structure, whose controller uses the prior θ̂(0) (p,) as its model.

        Frequencies, phases and coefficients come from `rng`.
        """
