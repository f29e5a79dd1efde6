"""Records of faults, and the gain of an actuator that may keep failing.

A small loss of gain may be the beginning of a larger one. For some time after it the gain is
modelled as a random walk, and the reported event is updated with the total loss.
"""

from typing import NamedTuple

import numpy as np

from ...core import Array, FaultEvent, FilterState, Indices, ParameterSpace
from .hypotheses import Hypothesis

_SMALL = 0.1  # share of a gain up to which a loss may be the beginning of a slow one
_WALK = 0.006  # of a loose gain, relative, per second [1/√s]
UNNOTICED = (0.05 / _WALK) ** 2
"""Time in which such a walk is as large as a change that goes unnoticed [s]."""
_LOOSE = 10.0  # time for which a gain stays loose after its last change [s]
_GROWN = 0.01  # change of the lost share from which an event is updated
SEIZED = ("reversed", "broken", "stuck")
"""Kinds of faults that change the command that acts on an actuator."""
_MEASURED = ("loss", "payload", "bias")  # whose size is 0 where nothing has failed; friction's
# coefficients may each be 0, as they trade with one another, while their change is evident


class Loose(NamedTuple):
    """A gain that may keep falling."""

    part: str  # the actuator, in words
    gains: Indices  # indices of its gains in θ
    others: Indices  # indices of all other actuators' gains
    before: Array  # (p,) θ̂ before the loss
    until: float  # when it counts as constant again [s]

    def walked(self, kalman: FilterState, scale: Array, seconds: float) -> None:
        """Adds the random walk of some seconds to the filter's P_θθ."""
        D = np.zeros(len(scale))
        D[self.gains] = _WALK * kalman.theta[self.gains] / scale[self.gains]
        kalman.Ptt[:] += seconds * np.outer(D, D)

    def lost(self, kalman: FilterState) -> float:
        """The share of its gain, relative to the others, that it has lost so far."""
        ratio = kalman.theta / np.where(self.before == 0, 1.0, self.before)
        common = np.median(ratio[self.others]) if len(self.others) else 1.0
        return float(1 - ratio[self.gains[0]] / common)


def loosened(
    loose: Loose | None, event: FaultEvent, space: ParameterSpace, before: Array
) -> Loose | None:
    """The loose gain after an isolated fault, given θ̂ (p,) before it."""
    if event.kind != "loss":
        return None
    if loose is not None and loose.part == event.part:
        return loose._replace(until=event.found + _LOOSE)
    if abs(event.size) > _SMALL:
        return None
    gains = np.array([space.index(name) for name in event.names])
    others = np.setdiff1d(space.actuators, gains)
    return Loose(event.part, gains, others, before.copy(), event.found + _LOOSE)


def revoked(events: tuple[FaultEvent, ...], part: str) -> tuple[FaultEvent, ...]:
    """The events without those of a part found to be healthy."""
    return tuple(e for e in events if e.part != part or e.kind not in SEIZED)


def without_effect(event: FaultEvent) -> bool:
    """Whether the 95 % interval of a change contains zero."""
    return event.kind in _MEASURED and event.low <= 0.0 <= event.high


def event_of(
    hypothesis: Hypothesis,
    begin: float,
    t: float,
    size: tuple[float, float, float],
    confidence: float,
    slow: bool = False,
) -> FaultEvent:
    """A fault isolated at time t."""
    names = hypothesis.names
    unit = hypothesis.unit
    return FaultEvent(
        begin, t, hypothesis.kind, hypothesis.part, names, *size, unit, confidence, slow
    )


def grown(
    events: tuple[FaultEvent, ...], loose: Loose, kalman: FilterState, t: float
) -> tuple[tuple[FaultEvent, ...], Loose]:
    """The events, updated with a loose gain's loss since."""
    place = [i for i, e in enumerate(events) if (e.kind, e.part) == ("loss", loose.part)]
    if not place:
        return events, loose
    last = events[place[-1]]
    lost = loose.lost(kalman)
    if abs(lost - last.size) < _GROWN:
        return events, loose
    wide = (last.high - last.low) / 2
    new = last._replace(size=lost, low=lost - wide, high=lost + wide, slow=True)
    changed = (*events[: place[-1]], new, *events[place[-1] + 1 :])
    return changed, loose._replace(until=t + _LOOSE)
