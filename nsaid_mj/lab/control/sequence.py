"""Several drivers in succession, each for a given time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from pydantic import AfterValidator, model_validator
from pydantic_core import PydanticCustomError

from ...base import Config, InvalidInput, NonNegative, Positive, config
from ...core import Array
from .driver import Driver, DriverConfig, InformedDriver
from .multisine import MultisineCommand

if TYPE_CHECKING:
    from ...core import SecondOrderSystem


def _identifier(name: str) -> str:
    if not name.isidentifier():
        raise PydanticCustomError("name", "a name such as `heave`")
    return name


@config
class Phase(Config):
    """A driver, and the duration of its command.

    Attributes:
        driver: makes the commands; its time is 0 at the beginning of the phase.
        duration: duration of the phase [s].
    """

    _path = "excitation.phases"

    driver: DriverConfig = field(default_factory=MultisineCommand)
    duration: Positive = 20.0


@config
class Sequence(DriverConfig):
    """One driver after another; the last one stays in command.

    Attributes:
        phases: the drivers in their order, by name.
        blend: duration of the linear transition from one driver to the next [s].
    """

    phases: Mapping[Annotated[str, AfterValidator(_identifier)], Phase] = field(
        default_factory=lambda: {"only": Phase()}
    )
    blend: NonNegative = 1.0

    @model_validator(mode="after")
    def _check_phases(self) -> Self:
        if not self.phases:
            raise InvalidInput("excitation.phases", "at least one phase", "none", "Add a Phase.")
        return self

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the drivers of all phases, each with its own stream of random numbers.

        Raises:
            InvalidInput: a driver does not suit the system.
        """
        phases = list(self.phases.values())
        made = [
            phase.driver.build(system, prior, own)
            for phase, own in zip(phases, rng.spawn(len(phases)), strict=True)
        ]
        begins = np.cumsum([0.0, *(phase.duration for phase in phases[:-1])])
        return _Sequence(made, begins, self.blend)


class _Sequence(InformedDriver):
    """Blends the commands of the drivers whose phase has begun."""

    def __init__(self, drivers: list[Driver], begins: Array, blend: float):
        self._drivers = drivers
        self._begins = begins
        self._blend = blend
        self._informed = [one for one in drivers if isinstance(one, InformedDriver)]
        self.period = min((one.period for one in self._informed), default=np.inf)

    def start(self) -> tuple[Array, Array]:
        first, *_ = [driver.start() for driver in self._drivers]
        return first

    def command(self, t: float, q: Array, v: Array) -> Array:
        k = int(np.searchsorted(self._begins, t, side="right")) - 1
        since = t - self._begins[k]
        u = self._drivers[k].command(since, q, v)
        if k == 0 or since >= self._blend:
            return u
        before = self._drivers[k - 1].command(t - self._begins[k - 1], q, v)
        return before + since / self._blend * (u - before)

    def inform(self, theta_hat: Array) -> None:
        for driver in self._informed:
            driver.inform(theta_hat)
