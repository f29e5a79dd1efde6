"""A live estimate, in numbers that can be printed or sent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import orjson

from ..evaluation.confidence import INTERVAL
from ..evaluation.misfit import running_misfit
from ..identifiers import State
from ..parameters import Array, ParameterSpace


class Gain(NamedTuple):
    """An actuator's parameter, with the 95 % interval of its ratio to the mean of all.

    No motion reveals the common scale of θ, so the interval takes the mean as exact.

    Attributes:
        name: of the parameter.
        unit: SI unit.
        value: estimate.
        low: lower end of the interval; −inf before the law states one.
        high: upper end; inf before the law states one.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Estimate:
    """The estimate at a sample.

    Attributes:
        t: time of the sample, since the first [s].
        samples: number used so far.
        names: (p,) names of the parameters.
        units: (p,) their SI units.
        theta_hat: (p,) θ̂.
        gains: of the actuators.
        misfit: whether the motion contradicts the structure: `none`, `some` or `contradicts`; ""
            from a law that does not test it.
        faults: found so far, in words.
    """

    t: float
    samples: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    theta_hat: Array
    gains: tuple[Gain, ...]
    misfit: str
    faults: tuple[str, ...]

    def line(self) -> bytes:
        """The estimate as a line of JSON, without names and units; null for what is not finite."""
        found: dict[str, Any] = {"t": self.t, "samples": self.samples}
        found |= {"theta": self.theta_hat, "gains": [[g.value, g.low, g.high] for g in self.gains]}
        found |= {"misfit": self.misfit, "faults": self.faults}
        return orjson.dumps(found, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_APPEND_NEWLINE)

    @staticmethod
    def of_line(found: dict[str, Any], space: ParameterSpace) -> Estimate:
        """The estimate of such a line."""
        gains = (
            Gain(space.names[k], space.units[k], value, *_ends(low, high))
            for k, (value, low, high) in zip(space.actuators, found["gains"], strict=True)
        )
        return Estimate(
            found["t"], found["samples"], tuple(space.names), tuple(space.units),
            np.array(found["theta"]), tuple(gains), found["misfit"], tuple(found["faults"]),
        )  # fmt: skip


def estimate_of(space: ParameterSpace, state: State, samples: int, deviation: Array) -> Estimate:
    """The estimate of a state, with (a,) relative deviations of the gains."""
    gains = []
    for k, spread in zip(space.actuators, deviation, strict=True):
        value = float(state.theta_hat[k])
        half = INTERVAL * abs(value) * float(spread)
        gains.append(Gain(space.names[k], space.units[k], value, value - half, value + half))
    faults = tuple(fault.in_words for fault in state.faults)
    return Estimate(
        state.t, samples, tuple(space.names), tuple(space.units), state.theta_hat,
        tuple(gains), running_misfit(state), faults,
    )  # fmt: skip


def _ends(low: float | None, high: float | None) -> tuple[float, float]:
    return -np.inf if low is None else low, np.inf if high is None else high
