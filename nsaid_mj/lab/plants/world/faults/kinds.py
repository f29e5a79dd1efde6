"""The kinds of faults. Each acts from `time` until `until`.

An actuator's fault scales its gains or holds its command; friction and a payload add to θ; a bias
adds to a sensor's reading. The structure continues to hold except under a held command, whose force
is constant, and under a bias.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import field
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from .....base import Config, InvalidInput, NonNegative, Number, Positive, UnknownName, config
from .....core import Array, Indices

if TYPE_CHECKING:
    from .....core import SecondOrderSystem

Index = Annotated[int, Field(strict=True, ge=1, le=1000)]
Sensor = Literal["position", "velocity"]


@config
class Fault(Config, ABC):
    """A fault, sudden and permanent unless its kind or `until` says otherwise.

    Attributes:
        time: when it begins [s of the run].
        until: when the plant is restored [s of the run]; None for never.
    """

    _path = "plant.faults"

    time: NonNegative = field(default=0.0, kw_only=True)
    until: NonNegative | None = field(default=None, kw_only=True)

    @model_validator(mode="after")
    def _check_end(self) -> Self:
        if self.until is not None and self.until <= self.time:
            raise InvalidInput(
                "faults.until", f"a time after {self.time:g} s", self.until, "Leave it out: never."
            )
        return self

    @abstractmethod
    def affected(self, system: SecondOrderSystem) -> Indices:
        """Indices in θ that the fault changes; none for a sensor.

        Raises:
            InvalidInput: the system has no such part.
        """

    @abstractmethod
    def what(self, system: SecondOrderSystem) -> str:
        """The fault in words, without its times."""

    def in_words(self, system: SecondOrderSystem) -> str:
        """The fault in words, such as `thrust_3 loses 40 % at 12 s`."""
        end = "" if self.until is None else f" until {self.until:g} s"
        return f"{self.what(system)} at {self.time:g} s{end}"


# -- actuators -------------------------------------------------------------------------------------


@config
class ActuatorFault(Fault, ABC):
    """A fault of one actuator, which loses `share` of its gains, by `rate` [1/s] unless at once.

    Attributes:
        actuator: index of its command, counted from 1.
    """

    actuator: Index = field(default=1, kw_only=True)
    _verbs: ClassVar[tuple[str, str]] = "is", "are"

    @property
    @abstractmethod
    def _words(self) -> str:
        """What follows the gains' names and the verb."""

    def factor(self, since: float) -> float:
        """Factor of its gains, `since` seconds after the fault began: 1 − the share lost so far."""
        return 1 - (self.share if self.rate is None else min(self.share, self.rate * since))

    def affected(self, system: SecondOrderSystem) -> Indices:
        """Indices in θ of the actuator's gains."""
        return gains_of(system, self.actuator)

    def what(self, system: SecondOrderSystem) -> str:
        """Such as `thrust_3 loses 40 %`, `thrust_3 is reversed`, `thrust_3 is lost`."""
        names = [system.space.names[i] for i in self.affected(system)]
        return f"{' and '.join(names)} {self._verbs[len(names) != 1]} {self._words}"


@config
class Loss(ActuatorFault):
    """An actuator that loses a share of its gain, suddenly or slowly.

    Attributes:
        share: share of its gain that it loses.
        rate: share lost per second until `share` is lost [1/s]; None for at once.
    """

    share: Annotated[float, Field(strict=True, gt=0, lt=1)] = 0.4
    rate: Positive | None = None
    _verbs: ClassVar[tuple[str, str]] = "loses", "lose"

    @property
    def _words(self) -> str:
        slowly = "" if self.rate is None else f", {100 * self.rate:g} %/s,"
        return f"{100 * self.share:g} %{slowly}"


@config
class Reversed(ActuatorFault):
    """An actuator that acts in the opposite direction, as with swapped wires."""

    share: ClassVar[float] = 2.0
    rate: ClassVar[None] = None
    _words: ClassVar[str] = "reversed"


@config
class Broken(ActuatorFault):
    """An actuator that no longer exerts any force or drag: a broken fin, a lost rotor."""

    share: ClassVar[float] = 1.0
    rate: ClassVar[None] = None
    _words: ClassVar[str] = "lost"


@config
class Stuck(ActuatorFault):
    """An actuator that no longer follows its command and exerts a constant effort.

    Its command has no effect, so that its true gain is 0; the constant force is outside θ.

    Attributes:
        holding: the command that it keeps executing; None for the last one it received.
    """

    holding: Number | None = None
    share: ClassVar[float] = 0.0  # the command is replaced, not the gain
    rate: ClassVar[None] = None

    @property
    def _words(self) -> str:
        return "stuck" if self.holding is None else f"stuck at a command of {self.holding:g}"


def gains_of(system: SecondOrderSystem, actuator: int) -> Indices:
    """Indices in θ of an actuator's gains: the parameters whose force its command changes.

    Raises:
        InvalidInput: there is no such actuator, or its gain is not a parameter.
    """
    found = system.gains_by_command
    if actuator > system.n_u or not found[actuator - 1].size:
        weak = [str(k) for k, gains in enumerate(found, 1) if gains.size]
        raise InvalidInput(
            "faults.actuator",
            f"one with a gain in θ: {', '.join(weak)}",
            actuator,
            "Commands are counted from 1.",
        )
    return found[actuator - 1]


# -- the plant -------------------------------------------------------------------------------------


@config
class PlantFault(Fault, ABC):
    """A fault of the plant, which adds to θ."""

    @abstractmethod
    def added(self, system: SecondOrderSystem) -> Array:
        """(p,) the fault's change of θ; raises `InvalidInput` if the system has no such part."""

    def affected(self, system: SecondOrderSystem) -> Indices:
        """Indices in θ of the affected parameters."""
        return np.flatnonzero(self.added(system))


@config
class Friction(PlantFault):
    """Friction or drag added to a joint or a body.

    Attributes:
        by: the increase, in the parameter's unit.
        parameter: name of the friction or drag in θ, such as viscous_3, coulomb_3 or d_surge.
    """

    by: Positive = 1.0
    parameter: str = "viscous_1"

    def added(self, system: SecondOrderSystem) -> Array:
        """`by` at the parameter."""
        known = [
            name
            for block in system.space.blocks
            if any(word in block.name for word in ("friction", "drag", "resistance"))
            and not block.actuator
            for name in block.names
        ]
        if self.parameter not in known:
            raise UnknownName("friction or drag", self.parameter, known)
        change = np.zeros(system.p)
        change[system.space.index(self.parameter)] = self.by
        return change

    def what(self, system: SecondOrderSystem) -> str:
        """Such as `viscous_3 rises by 1.5 N·m·s/rad`."""
        unit = system.space.units[system.space.index(self.parameter)]
        return f"{self.parameter} rises by {self.by:g} {unit}"


@config
class Payload(PlantFault):
    """A point mass, fixed to a body.

    Attributes:
        mass: [kg].
        place: its position in the body's axes; for a link, those of its joint [m].
        link: name of the body's block in θ, such as `link 6`; "" for the last one.
    """

    mass: Positive = 1.0
    place: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    link: str = ""

    def added(self, system: SecondOrderSystem) -> Array:
        """The inertial parameters of a point mass; in water also its weight and moment."""
        return system.point_masses.change(self.mass, np.array(self.place), self.link)

    def what(self, system: SecondOrderSystem) -> str:
        """Such as `1 kg on link 6 is picked up`."""
        return f"{self.mass:g} kg on {self.link or system.point_masses.carrier} is picked up"


# -- sensors ---------------------------------------------------------------------------------------


@config
class Bias(Fault):
    """A constant error of one sensor.

    A place's error is along a world axis, an attitude's a turn about one of the body's own.

    Attributes:
        by: the error, in the unit of the sensor.
        sensor: `position` or `velocity`.
        channel: which of the system's coordinates, counted from 1.
    """

    by: Number = 0.01
    sensor: Sensor = "position"
    channel: Index = 1

    def affected(self, system: SecondOrderSystem) -> Indices:
        """Nothing in θ."""
        if self.channel > system.n:
            raise InvalidInput(
                "faults.channel",
                f"a coordinate from 1 to {system.n}",
                self.channel,
                "They are those of q or v, in order.",
            )
        return np.zeros(0, dtype=np.intp)

    def biases(self, n: int) -> Array:
        """(2, n) errors of positions, see `structure.sensing`, and velocities."""
        found = np.zeros((2, n))
        found[int(self.sensor == "velocity"), self.channel - 1] = self.by
        return found

    def what(self, system: SecondOrderSystem) -> str:
        """Such as `position 2 is measured 0.01 too high`."""
        self.affected(system)
        way = "high" if self.by > 0 else "low"
        return f"{self.sensor} {self.channel} is measured {abs(self.by):g} too {way}"
