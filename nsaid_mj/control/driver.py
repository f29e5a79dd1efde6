"""What a driver is: where the plant starts, and the command at every sample."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ..bounds import Config, config
from ..parameters import Array
from ..system import SecondOrderSystem
from .computed_torque import Tracking


class Driver(ABC):
    """Chooses the command from time and measured state."""

    @abstractmethod
    def start(self) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) velocities to start from."""

    @abstractmethod
    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) the command from t until the next sample, from the measured state."""

    @abstractmethod
    def compiled(self, t: Array) -> Array | Tracking | None:
        """The control law in a form that compiled code evaluates, bit for bit as `command` does.

        Args:
            t: (k,) sample times [s].

        Returns:
            (k, n_u) the commands at t, if the driver is open loop; the parameters of
            `computed_torque`, if that is its law; None if only `command` can evaluate it.
        """


@config
class DriverConfig(Config, ABC):
    """A driver as data; `build` makes the thing itself."""

    _path = "excitation"

    @abstractmethod
    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Args:
            system: the structure.
            prior: (p,) what is believed of θ beforehand.
            rng: source of the excitation.
        """
