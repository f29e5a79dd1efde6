"""Open-loop multisine commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from ...base import InvalidInput, Number, Positive, config
from ...core import Array
from ..fields import Tones
from .driver import CompiledDriver, Driver, DriverConfig

if TYPE_CHECKING:
    from ...core import SecondOrderSystem
    from .signals import Multisine

Axis = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]


@config
class MultisineCommand(DriverConfig):
    """Every actuator follows its own multisine, from rest.

    Attributes:
        low: lowest frequency [Hz].
        high: highest frequency [Hz].
        tones: number of sines in each command.
        amplitude: bound on each command's deviation from its mean.
        mean: mean of each command; 0 if empty.
    """

    low: Positive = 0.05
    high: Positive = 0.5
    tones: Tones = 8
    amplitude: Positive = 0.8
    mean: tuple[Number, ...] = ()

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver; raises `InvalidInput` unless there is one mean for each command."""
        from .signals import Multisine

        if self.mean and len(self.mean) != system.n_u:
            raise InvalidInput(
                "excitation.mean", f"{system.n_u} numbers", len(self.mean), "One for each command."
            )
        signal = Multisine(system.n_u, self.low, self.high, self.tones, self.amplitude, rng)
        return _MultisineDriver(system.n, signal, mean=self.mean or (0.0,))


@config
class AxisMultisine(DriverConfig):
    """The force or torque along each chosen axis of a free body follows a multisine, from rest.

    The prior's gains distribute it over the actuators, which push in proportion to their commands.

    Attributes:
        axes: the axes along or about which the body moves.
        low: lowest frequency [Hz].
        high: highest frequency [Hz].
        tones: number of sines on each axis.
        amplitude: largest command, where one axis moves alone.
    """

    axes: tuple[Axis, ...] = get_args(Axis)
    low: Positive = 0.05
    high: Positive = 0.5
    tones: Tones = 8
    amplitude: Positive = 0.8

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: no axis is given, or the system is not a free body with exactly one gain
                for each command.
        """
        from .signals import Multisine

        if not self.axes:
            raise InvalidInput("excitation.axes", "at least one axis", "none", "Try heave.")
        wrenches = unit_wrenches(system, prior)
        chosen = [get_args(Axis).index(axis) for axis in self.axes]
        share = np.linalg.pinv(wrenches)[:, chosen]
        signal = Multisine(len(chosen), self.low, self.high, self.tones, self.amplitude, rng)
        return _MultisineDriver(system.n, signal, share / np.abs(share).max(axis=0))


def unit_wrenches(system: SecondOrderSystem, prior: Array) -> Array:
    """(6, n_u) force and torque on a free body at rest per unit command, under the prior (p,).

    Raises:
        InvalidInput: the system is not a free body with exactly one gain for each command.
    """
    if system.n != 6 or len(system.space.actuators) != system.n_u:
        raise InvalidInput(
            "excitation",
            "a body in space with one gain for each command",
            type(system).__name__,
            "Use MultisineCommand.",
        )
    return pushes(system, prior)


def pushes(system: SecondOrderSystem, theta: Array) -> Array:
    """(n, n_u) generalised force of a full command of every actuator, at rest and under θ (p,)."""
    q = system.position(np.zeros(system.n))
    still = np.zeros(system.n)
    idle = system._F(0.0, q, still, np.zeros(system.n_u))
    return np.stack(
        [(system._F(0.0, q, still, e) - idle) @ theta for e in np.eye(system.n_u)], axis=1
    )


@dataclass(eq=False)
class _MultisineDriver(CompiledDriver):
    """Plays a multisine in open loop, from rest, distributed over the actuators by `share`."""

    n: int
    signal: Multisine
    share: Array | None = None
    mean: Sequence[float] = (0.0,)

    def _signal(self, t: float | Array) -> Array:
        signal = self.signal(t) + np.array(self.mean)
        return signal if self.share is None else np.clip(signal @ self.share.T, -1.0, 1.0)

    def start(self) -> tuple[Array, Array]:
        return np.zeros(self.n), np.zeros(self.n)

    def command(self, t: float, q: Array, v: Array) -> Array:
        return self._signal(t)

    def compiled(self, t: Array) -> Array:
        return self._signal(t)
