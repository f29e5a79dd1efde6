"""An actuator that loses gain during a run: θ changes, the structure still holds."""

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
    """A permanent, sudden loss of gain in one actuator; none by default.

    Attributes:
        loss: share of its gain that the actuator loses.
        actuator: index of its command, counted from 1.
        time: when the fault occurs [s of the run].
    """

    _path = "plant.fault"

    loss: Share = 0.0
    actuator: Annotated[int, Field(strict=True, ge=1, le=1000)] = 1
    time: NonNegative = 0.0

    def in_words(self, system: SecondOrderSystem) -> str:
        """The fault in words; "" if there is none."""
        if not self.loss:
            return ""
        names = [system.space.names[i] for i in self.gains(system)]
        verb = "loses" if len(names) == 1 else "lose"
        return f"{' and '.join(names)} {verb} {100 * self.loss:g} % at {self.time:g} s"

    def gains(self, system: SecondOrderSystem) -> Indices:
        """Indices in θ of the actuator's gains: the parameters whose force its command changes.

        Raises:
            InvalidInput: there is no such actuator, or its gain is not a parameter.
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
    """Indices of the actuator parameters whose columns of F change with command k.

    They are found by changing the command at a random state in the range of operation.
    """
    rng = np.random.default_rng(0)
    q, v, u = system.random_state(rng)
    other = u.copy()
    other[k] = system.random_state(rng)[2][k]
    x = np.concatenate([q, v])
    moved = (system.F(0.0, x, u) != system.F(0.0, x, other)).any(axis=0)
    return system.space.actuators[moved[system.space.actuators]]
