"""What the supervisor keeps in the law's state."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..core import Array, EfficientState, Log, State
from .drift import Rivals
from .faults.events import Loose
from .faults.snapshots import Snapshots
from .faults.trials import Trials


class Seen(NamedTuple):
    """What the supervisor had seen at the end of the last interval, to notice what is new."""

    events: int = 0  # number of faults found
    returns: int = 0  # see `Supervision`
    restarts: int = 0  # see `EfficientState`
    wander: tuple[float, float] = (0.0, 0.0)  # see `Kept`


class Kept(NamedTuple):
    """What is known of the robot, also after a gap."""

    snapshots: Snapshots = ()  # of the filter, for slow changes
    loose: Loose | None = None  # a gain that may keep falling; None if there is none
    # (p,) θ̂ with the gains of reversed, broken and stuck actuators from before; None without them
    intact: Array | None = None
    # relative errors of all of θ ascribed to an inexact structure: the sum of their squares, and
    # the largest square
    wander: tuple[float, float] = (0.0, 0.0)
    # variance that every gain, relative to itself, gains per second, as the gains drift; 0 if they
    # are constant [1/s]
    drift: float = 0.0
    since: float = 0.0  # when drifting gains were detected [s]
    unnamed: int = 0  # consecutive trials in which no hypothesis explained the motion
    learned: float = 0.0  # when the filter last learned again from the motion's beginning [s]
    seen: Seen = Seen()

    def wandered(self, share: float) -> Kept:
        """A copy with another relative error of all of θ."""
        total, largest = self.wander
        return self._replace(wander=(total + share**2, max(largest, share**2)))

    def walk(self, seconds: float) -> float:
        """Variance that θ, relative to itself, gains per second where W is not exact [1/s].

        It is the variance that explains the errors of the last seconds, without the largest one,
        which may be due to a single event such as a collision.
        """
        total, largest = self.wander
        return (total - largest) / max(seconds, 1.0)


class Moving(NamedTuple):
    """What refers to an uninterrupted motion."""

    recent: Log | None = None  # the last samples, as recorded; None before the first
    # filters under hypotheses, of which one will be chosen; None where there are none
    trials: Trials | None = None
    rivals: Rivals | None = None  # filters that test whether gains drift; None where θ is constant
    # all samples but the newest, until the motion has lasted long, or a fault is found; see
    # `replay`
    beginning: tuple[Log, ...] = ()


def kept_of(state: EfficientState) -> Kept:
    """What the supervisor keeps of a robot."""
    kept: Kept | None = state.supervision.kept
    return Kept() if kept is None else kept


def moving_of(state: EfficientState) -> Moving:
    """What the supervisor keeps of a motion."""
    moving: Moving | None = state.supervision.moving
    return Moving() if moving is None else moving


def keeping(state: EfficientState, **fields: Any) -> EfficientState:
    """The state with fields of `Kept` replaced."""
    kept = kept_of(state)._replace(**fields)
    return state._replace(supervision=state.supervision._replace(kept=kept))


def in_motion(state: EfficientState, **fields: Any) -> EfficientState:
    """The state with fields of `Moving` replaced."""
    moving = moving_of(state)._replace(**fields)
    return state._replace(supervision=state.supervision._replace(moving=moving))


def saying(state: EfficientState, **fields: Any) -> EfficientState:
    """The state with fields of `Supervision` replaced: what the law is told."""
    return state._replace(supervision=state.supervision._replace(**fields))


def drift_of(state: State) -> tuple[float, float]:
    """Variance per second by which a law's gains walk [1/s], and since when [s]; 0 if constant."""
    if not isinstance(state.own, EfficientState):
        return 0.0, 0.0
    kept = kept_of(state.own)
    return kept.drift, kept.since
