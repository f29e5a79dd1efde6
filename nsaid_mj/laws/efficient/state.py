"""The state of the efficient law."""

from __future__ import annotations

from typing import NamedTuple

from ...log import Log, Measurement
from ...parameters import Array
from ...structure.system import SecondOrderSystem
from ..base import State
from ..faults import FaultEvent
from .drift import Rivals
from .faults.events import Loose
from .faults.signals import Signals
from .faults.trials import Trials
from .faults.watch import Watch
from .filter import Filter


class EfficientState(NamedTuple):
    """State of the efficient law."""

    filter: Filter
    guard: State  # the memory and its estimate
    step: int  # index of the sample
    pause: int  # intervals for which the memory still pauses
    calm: float  # time since the filter began, or was last contradicted [s]
    handed: bool  # whether the law returns the filter's θ̂
    restarts: int  # how often the filter restarted at the memory's estimate
    returns: int  # how often it returned to an earlier estimate with parameters to re-estimate
    signals: Signals  # signals of failed actuators and sensors
    # (p,) factors of a gain's θ̂ by which the filter's is multiplied: −1 if its actuator is
    # reversed, 0 if it is stuck
    factors: Array
    intact: Array  # (p,) θ̂ with the gains of reversed, broken and stuck actuators from before
    recent: Log | None = None  # the last samples, as recorded; None before the first
    watch: Watch = ()  # snapshots, for slow changes
    # filters under hypotheses, of which one will be chosen; None where there are none
    trials: Trials | None = None
    events: tuple[FaultEvent, ...] = ()  # the faults found so far
    loose: Loose | None = None  # a gain that may keep falling; None if there is none
    stale: bool = False  # whether the memory's data precede a fault
    # relative errors of all of θ ascribed to an inexact structure: the sum of their squares, and
    # the largest square
    wander: tuple[float, float] = (0.0, 0.0)
    # variance that every gain, relative to itself, gains per second, as the gains drift; 0 if they
    # are constant [1/s]
    drift: float = 0.0
    since: float = 0.0  # when the gains were found to drift [s]
    rivals: Rivals | None = None  # filters that test whether gains drift; None where θ is constant
    unnamed: int = 0  # consecutive trials in which no hypothesis explained the motion
    waiting: Log | None = None  # samples not yet in the memory, with the acting signals; or None
    # all samples but the newest, until the motion has lasted long, or a fault is found; see
    # `replay`
    beginning: tuple[Log, ...] = ()
    learned: float = 0.0  # when the filter last learned again from them [s]

    @property
    def theta(self) -> Array:
        """(p,) the filter's θ̂ in terms of the commands given."""
        return self.filter.theta * self.factors

    def here(self, system: SecondOrderSystem, log: Log) -> Measurement:
        """The last measurement of a log without the known errors of its signals."""
        return self.signals.acting(system, log.part(len(log.t) - 1, len(log.t))).at(0)

    def wandered(self, share: float) -> EfficientState:
        """The state with another relative error of all of θ added to `wander`."""
        total, largest = self.wander
        return self._replace(wander=(total + share**2, max(largest, share**2)))

    def walk(self, seconds: float) -> float:
        """Variance that θ, relative to itself, gains per second where W is not exact [1/s].

        It is the variance that explains the motion so far, from the whole run of some seconds,
        without the largest error, which may be due to a single event such as a collision.
        """
        total, largest = self.wander
        return (total - largest) / max(seconds, 1.0)
