"""The supervisor of the law `efficient`: it learns again, isolates faults, and follows drifts.

If the filter is contradicted early in a motion, it learns again from the first sample; see
`replay`. Later contradictions mean that a part has failed or that the structure is not exact; see
`faults.isolation`. If the structure is not exact, θ is given process noise, or only the gains if
that explains the motion better; see `drift`. The law then returns the filter's θ̂, because the
memory averages over the drift.
"""

from __future__ import annotations

from ..core import EfficientState, KalmanFilter, Log
from .drift import LONGEST, Rivals, walks
from .faults.isolation import Isolation
from .faults.trial import LEAD
from .replay import learned
from .state import Seen, in_motion, keeping, kept_of, moving_of, saying

_BEGINNING = 20.0  # time after which a motion has no beginning to learn from [s]
_LATER = 1.5  # durations after which learning again is tried once more


class FilterSupervisor:
    """Supervises the filter of a law, whose memory has an interval [s] of `every` samples."""

    def __init__(self, estimator: KalmanFilter, every: int, interval: float):
        self._estimator = estimator
        self._every = every
        self._interval = interval
        self._again = estimator.cautious()
        self._faults = Isolation(estimator, interval)

    def contradicted(self, state: EfficientState, log: Log) -> EfficientState:
        """Learns again, starts trials of possible faults, or restarts the filter."""
        state, explained = self._learned_again(state, log)
        if not explained:
            state = self._faults.contradicted(state, self._recent(state, log))
        return self._told(state)

    def tried(self, state: EfficientState, log: Log) -> tuple[EfficientState, int]:
        """The trials along a log, up to the end of their window of innovations."""
        trials = moving_of(state).trials
        assert trials is not None
        used = min(len(log.t) - 1, self._estimator.constants.window - trials.samples)
        return self._told(self._faults.tried(state, log.first(used + 1))), used

    def watched(self, state: EfficientState, log: Log) -> EfficientState:
        """Notes the samples; at an interval's end, looks for slow changes and drifts."""
        state = self._noted(state, log)
        rivals = moving_of(state).rivals
        if rivals is not None:
            acting = state.supervision.signals.acting(self._estimator.system, log)
            state = in_motion(state, rivals=rivals.followed(self._estimator, acting))
        if state.step % self._every == 0:
            t = float(log.t[-1])
            if state.restarts > kept_of(state).seen.restarts:
                state = keeping(state, snapshots=())
            state = self._faults.watched(state, t)
            if moving_of(state).trials is None:
                state = self._compared(state, t)
            kept = kept_of(state)
            told = state.supervision
            seen = Seen(len(told.events), told.returns, state.restarts, kept.wander)
            state = keeping(state, seen=seen)
        return self._told(state)

    def _told(self, state: EfficientState) -> EfficientState:
        """The state with what follows for the law from what the supervisor keeps."""
        kept = kept_of(state)
        walk = walks(self._estimator.system.space, kept.walk(self._seconds(state)), kept.drift)
        chosen_by = "residuals" if kept.loose is None else "unchanged"
        if kept.drift:
            chosen_by = "filter"
        trying = moving_of(state).trials is not None
        return saying(state, walk=walk, chosen_by=chosen_by, trying=trying)

    def _seconds(self, state: EfficientState) -> float:
        """Time since the first sample [s]."""
        return state.step * self._interval / self._every

    def _recent(self, state: EfficientState, log: Log) -> Log:
        """The last samples at a log's end, as many as a contradiction is judged by."""
        recent = moving_of(state).recent
        if recent is not None:  # its last sample is the log's first
            log = Log.joined(recent.first(len(recent.t) - 1), log)
        return log.last(self._estimator.constants.window + LEAD)

    def _noted(self, state: EfficientState, log: Log) -> EfficientState:
        """The state with a log's samples among the recent ones, and those of the beginning."""
        beginning = moving_of(state).beginning
        before = state.step - (len(log.t) - 1)
        if before * self._interval / self._every > _BEGINNING or state.supervision.events:
            beginning = ()
        elif beginning or not before:
            beginning = Log.extended(beginning, log.first(len(log.t) - 1))
        return in_motion(state, recent=self._recent(state, log), beginning=beginning)

    def _learned_again(self, state: EfficientState, log: Log) -> tuple[EfficientState, bool]:
        """Learns again from the first sample, after a contradiction at a log's end.

        Also returns whether the filter then explains the motion.
        """
        beginning = moving_of(state).beginning
        now = self._seconds(state) + float(log.t[-1] - log.t[0])
        if not beginning or now < _LATER * kept_of(state).learned:
            return state, False
        whole = Log.joined(*beginning, log)
        kalman = learned(self._again, state.guard.theta_hat, whole)
        state = keeping(state, learned=now)
        if kalman is None:
            return state, False
        state = keeping(state, wander=(0.0, 0.0), unnamed=0, snapshots=())
        return state._replace(filter=kalman, calm=now, handed=True), True

    def _compared(self, state: EfficientState, t: float) -> EfficientState:
        """At an interval's end: tests for a drift of the gains, unless θ is constant."""
        rivals = moving_of(state).rivals
        told = state.supervision
        kept = kept_of(state)
        seen = kept.seen
        failed = len(told.events) > seen.events
        if rivals is None or failed:
            returned = told.returns > seen.returns or kept.wander != seen.wander
            if rivals is None and (failed or not returned):
                return state
            prior = self._estimator.covariance(state.filter.theta)
            return in_motion(state, rivals=Rivals.at(state.filter, prior, t))
        best = rivals.preferred(t, kept.drift)
        if best is None:
            over = not kept.drift and t - rivals.begin > LONGEST
            return in_motion(state, rivals=None) if over else state
        ended = not best.gains
        state = state._replace(filter=best.filter.copied().tested_anew(), handed=True)
        state = keeping(
            state,
            snapshots=(),
            wander=(best.all_of * self._seconds(state), 0.0),
            drift=best.gains,
            since=kept.since if kept.drift else t,
        )
        rivals = None if ended and not best.all_of else rivals
        return in_motion(saying(state, stale=told.stale or ended), rivals=rivals)
