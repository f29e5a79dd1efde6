"""What a driver is: where the plant starts, and the command at every sample."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ..parameters import Array
from ..system import SecondOrderSystem


class Driver(ABC):
    """Chooses the command from time and measured state."""

    @abstractmethod
    def start(self) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) velocities to start from."""

    @abstractmethod
    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) the command from t until the next sample, from the measured state."""


@dataclass(frozen=True)
class DriverConfig(ABC):
    """A driver as data; `build` makes the thing itself."""

    @abstractmethod
    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Args:
            system: the structure.
            prior: (p,) what is believed of θ beforehand.
            rng: source of the excitation.
        """
