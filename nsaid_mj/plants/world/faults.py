"""An actuator that weakens while it is watched: the truth changes, the structure still fits."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from ...bounds import Config, NonNegative, Share, config
from ...errors import InvalidInput
from ...parameters import Indices
from ...system import SecondOrderSystem


@config
class Fault(Config):
    """The loss of a part of one actuator's gain, once and for all; none by default.

    Attributes:
        loss: share of its gain that the actuator loses.
        actuator: which one: 1 is that of the first command.
        time: when, on the run's clock [s].
    """

    _path = "plant.fault"

    loss: Share = 0.0
    actuator: Annotated[int, Field(strict=True, ge=1, le=1000)] = 1
    time: NonNegative = 0.0

    def in_words(self, system: SecondOrderSystem) -> str:
        """The fault in words, "" where there is none."""
        if not self.loss:
            return ""
        names = [system.space.names[i] for i in self.gains(system)]
        verb = "loses" if len(names) == 1 else "lose"
        return f"{' and '.join(names)} {verb} {100 * self.loss:g} % at {self.time:g} s"

    def gains(self, system: SecondOrderSystem) -> Indices:
        """Where in θ the actuator's gains are: what of F θ its command changes.

        Raises:
            InvalidInput: there is no such actuator, or its gain is no parameter.
        """
        found = [_answering(system, k) for k in range(system.n_u)]
        if self.actuator > system.n_u or not found[self.actuator - 1].size:
            weak = [str(k) for k, gains in enumerate(found, 1) if gains.size]
            raise InvalidInput(
                "fault.actuator",
                f"one with a gain in θ: {', '.join(weak)}",
                self.actuator,
                "Commands are counted from 1.",
            )
        return found[self.actuator - 1]


def _answering(system: SecondOrderSystem, k: int) -> Indices:
    """The actuator parameters whose forces change with command k, at a state of operation."""
    rng = np.random.default_rng(0)
    q, v, u = system.random_state(rng)
    other = u.copy()
    other[k] = system.random_state(rng)[2][k]
    x = np.concatenate([q, v])
    moved = (system.F(0.0, x, u) != system.F(0.0, x, other)).any(axis=0)
    return system.space.actuators[moved[system.space.actuators]]
