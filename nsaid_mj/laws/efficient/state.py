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
    """State of the efficient law.

    Attributes:
        filter: the filter.
        guard: the memory and its estimate.
        step: index of the sample.
        pause: intervals for which the memory still pauses.
        calm: time since the filter began, or was last contradicted [s].
        handed: whether the law returns the filter's θ̂.
        restarts: how often the filter restarted at the memory's estimate.
        returns: how often it returned to an earlier estimate with parameters to re-estimate.
        signals: signals of failed actuators and sensors.
        recent: the last samples, as recorded; None before the first.
        factors: (p,) factors of a gain's θ̂ by which the filter's is multiplied: −1 if its actuator
            is reversed, 0 if it is stuck.
        watch: snapshots, for slow changes.
        trials: filters under hypotheses, of which one will be chosen; None where there are none.
        events: the faults found so far.
        loose: a gain that may keep falling; None if there is none.
        stale: whether the memory's data precede a fault.
        intact: (p,) θ̂ in which gains of reversed, broken and stuck actuators are those from
            before.
        wander: relative errors of all of θ ascribed to an inexact structure: the sum of their
            squares, and the largest square.
        drift: variance that every gain, relative to itself, gains per second, as the gains drift; 0
            if they are constant [1/s].
        since: when the gains were found to drift [s].
        unnamed: consecutive trials in which no hypothesis explained the motion.
        waiting: samples not yet processed by the memory, with the acting signals; or None.
        rivals: filters that test whether the gains drift; None where θ is constant.
        beginning: all samples but the newest, until the motion has lasted long, or a fault is
            found; see `relearning`.
        learned: when the filter last learned again from them [s].
    """

    filter: Filter
    guard: State
    step: int
    pause: int
    calm: float
    handed: bool
    restarts: int
    returns: int
    signals: Signals
    factors: Array
    intact: Array
    recent: Log | None = None
    watch: Watch = Watch()
    trials: Trials | None = None
    events: tuple[FaultEvent, ...] = ()
    loose: Loose | None = None
    stale: bool = False
    wander: tuple[float, float] = (0.0, 0.0)
    drift: float = 0.0
    since: float = 0.0
    rivals: Rivals | None = None
    unnamed: int = 0
    waiting: Log | None = None
    beginning: tuple[Log, ...] = ()
    learned: float = 0.0

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
