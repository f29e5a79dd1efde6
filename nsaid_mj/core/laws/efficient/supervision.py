"""What a supervisor tells the efficient law, and what it keeps in the law's state."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np

from ...parameters import Array
from ...structure.system import SecondOrderSystem
from ..faults import FaultEvent
from .signals import Signals


class Supervision(NamedTuple):
    """What a supervisor tells the law, and what it keeps for itself."""

    signals: Signals  # the signals that act, where they are known to differ from the recorded ones
    # (p,) factors of a gain's θ̂ by which the filter's is multiplied: −1 if its actuator is
    # reversed, 0 if it is stuck
    factors: Array
    walk: Array  # (p,) variance that θ, relative to itself, gains per second [1/s]; 0 if constant
    # what decides whether the law returns the filter's θ̂ or the memory's: their mean `residuals` on
    # the remembered data; nothing, as the memory averages over a change, so that the choice is
    # `unchanged`; or the supervisor, who wants the `filter`'s, as the gains drift
    chosen_by: Literal["residuals", "unchanged", "filter"] = "residuals"
    trying: bool = False  # whether the filter rests while explanations of a contradiction are tried
    stale: bool = False  # whether the memory's data precede a change; the law then begins it anew
    returns: int = 0  # how often the filter went on from an earlier estimate, a part of it free
    events: tuple[FaultEvent, ...] = ()  # the faults found so far
    kept: Any = None  # the supervisor's own state; None before its first call
    moving: Any = None  # the part of it that refers to an uninterrupted motion; None after a gap

    @staticmethod
    def none(system: SecondOrderSystem) -> Supervision:
        """Nothing is known of a robot: all parts are healthy, and θ is constant."""
        return Supervision(Signals.sound(system), np.ones(system.p), np.zeros(system.p))

    def after_gap(self) -> Supervision:
        """A copy without what refers to the motion so far."""
        return self._replace(trying=False, moving=None)
