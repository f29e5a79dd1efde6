"""Fault isolation after contradictions, by trials of hypotheses, and after slow changes.

Innovations that are significantly too large contradict the filter. What follows depends on how long
the filter had explained the motion before:

- for at least `_MATURE` seconds (twice as long after failed trials): a part may have failed. The
  filter returns to its earlier estimate. Trials determine which single fault, or an inexact
  structure, explains the motion best. Only the parameters of that fault are estimated anew;
- for less, or if no fault explains the motion: the filter restarts at the memory's estimate.

Slow changes are detected by the shift of the estimate, see `snapshots`. If the law states forces
that the structure does not explain, as on a real robot's log, only an inexact structure is tried.
"""

from typing import NamedTuple

from ...core import Array, EfficientState, FaultEvent, KalmanFilter, Log, Measurement
from ..state import in_motion, keeping, kept_of, moving_of, saying
from .events import UNNOTICED, event_of, grown, loosened, revoked, without_effect
from .hypotheses import Hypothesis, everything, hypotheses_of, inexact, nothing, restored
from .snapshots import PERIOD, rewind, slow_change, with_snapshot
from .trial import LEAD, onset
from .trials import Decision, begin_trials, follow_trials, narrowed, verdict

_MATURE = 2.0  # time without a contradiction after which one counts as a fault [s]
_DOUBLINGS = 30  # of that time after trials in vain, at most: to 70 years
_STARTS = 3  # restarts of a young filter, before a structure that is not exact is considered
_SETTLED = 5.0  # time without a contradiction from which slow changes are sought [s]
_ISOLATED = 0.9  # least probability of a slow change among the hypotheses
_ACTING = {"reversed": -1.0, "broken": 0.0, "stuck": 0.0}
"""Factor of a gain's θ̂ in terms of the commands given, after a fault of its actuator."""


class Isolation(NamedTuple):
    """Isolates faults."""

    estimator: KalmanFilter  # the filter that is supervised
    interval: float  # time between two decisions [s]

    @property
    def _vague(self) -> bool:
        """Whether the law states unexplained forces: a fault could not be told from them."""
        return len(self.estimator.constants.unexplained) > 0

    def contradicted(self, state: EfficientState, log: Log) -> EfficientState:
        """After a contradiction at a log's end: starts trials of possible faults, or restarts."""
        kalman = state.filter
        system = self.estimator.system
        kept = kept_of(state)
        signals = state.supervision.signals
        here = state.here(system, log)
        if len(log.t) <= LEAD + 1:  # right after a gap: too short to judge
            self.estimator.restart(kalman, here)
            return state
        doubled = 2 ** min(kept.unnamed, _DOUBLINGS)
        young = state.calm < doubled * _MATURE and kept.loose is None
        if young and state.restarts < _STARTS and signals.as_recorded:
            return self._started_again(state, here)
        rewind(kept.snapshots, here.t, kalman)
        self.estimator.restart(kalman, here)
        if kept.loose is not None:
            kept.loose.walked(kalman, self.estimator.constants.scale, UNNOTICED)
        theta = kalman.theta.copy()
        what = [nothing(system), *inexact(system, theta)]
        if not (young or self._vague):
            what += [*hypotheses_of(system, theta), everything(system, theta)]
        intact = theta if kept.intact is None else kept.intact
        what += restored(system, theta, intact, signals.sign, signals.held)
        k = onset(self.estimator, kalman, signals.acting(system, log))
        trials = begin_trials(self.estimator, kalman, signals, what, log, k)
        return in_motion(keeping(state, snapshots=()), trials=trials)

    def tried(self, state: EfficientState, log: Log) -> EfficientState:
        """The trials along a log; continues with the best one once there is a verdict."""
        trials = moving_of(state).trials
        assert trials is not None
        trials = follow_trials(self.estimator, trials, log)
        if trials.samples < self.estimator.constants.window:
            return in_motion(state, trials=trials)
        decision = verdict(self.estimator, trials, float(log.t[-1]))
        if decision is None:
            return in_motion(state, trials=narrowed(self.estimator, trials))
        state = in_motion(state, trials=None)
        if decision.trial is not None:
            return self._isolated(state, decision, trials.begin, log)
        if state.calm >= _SETTLED:
            when = trials.begin, float(log.t[-1])
            event = FaultEvent(*when, "unknown", "the robot", (), 0.0, 0.0, 0.0, "1", 1.0)
            state = saying(state, events=(*state.supervision.events, event), stale=True)
        state = keeping(state, unnamed=kept_of(state).unnamed + 1)
        return self._started_again(state, state.here(self.estimator.system, log))

    def _isolated(
        self, state: EfficientState, decision: Decision, begin: float, log: Log
    ) -> EfficientState:
        """Continues with the filter of a trial, and records the fault if there was one."""
        trial = decision.trial
        told = state.supervision
        kept = kept_of(state)
        assert trial is not None
        space = self.estimator.system.space
        hypothesis, size = trial.reported(space)
        kalman, signals = trial.settled(self.estimator, log)
        factors = told.factors.copy()
        kind = hypothesis.kind
        events = told.events
        intact = trial.theta.copy() if kept.intact is None else kept.intact.copy()
        hit = [space.index(name) for name in hypothesis.names if name in space.names]
        if (factors[hit] == 1).all():
            intact[hit] = trial.theta[hit]
        if kind == "sound":
            factors[hit] = 1.0
            events = revoked(events, hypothesis.part)
        factors[hit] *= _ACTING.get(kind, 1.0)
        state = state._replace(
            filter=kalman.tested_anew(),
            calm=state.calm if kind == "none" and not hypothesis.share else 0.0,
        )
        returns = told.returns + 1
        state = saying(state, signals=signals, factors=factors, events=events, returns=returns)
        state = keeping(state, intact=intact, unnamed=0 if kind != "none" else kept.unnamed)
        event = event_of(hypothesis, begin, float(log.t[-1]), size, decision.confidence)
        return self._noted(state, hypothesis, event, trial.theta)

    def watched(self, state: EfficientState, t: float) -> EfficientState:
        """At an interval's end: looks for slow changes, and follows a known one."""
        kalman = state.filter
        trying = moving_of(state).trials is not None
        state = self._loosened(state, t)
        kept = kept_of(state)
        snapshots = kept.snapshots
        young = state.calm < _MATURE  # errors of linearisation exceed P_θθ
        early = bool(snapshots) and t - snapshots[-1].t < PERIOD * (1 - 1e-9)
        if young or self._vague or trying or early:
            return state
        if state.calm < _SETTLED or kept.loose is not None or kept.drift:
            return keeping(state, snapshots=with_snapshot(snapshots, t, kalman))
        change = slow_change(snapshots, kalman, self.estimator.system)
        if change is None or change.confidence < _ISOLATED:
            return keeping(state, snapshots=with_snapshot(snapshots, t, kalman))
        before = kalman.theta.copy()
        kalman.theta[:] = change.theta
        kalman.Ptt[:] = change.P
        kalman.safe[:] = change.theta
        kalman.safe_P[:] = change.P
        event = event_of(change.hypothesis, t, t, change.size, change.confidence, slow=True)
        return self._noted(keeping(state, snapshots=()), change.hypothesis, event, before)

    def _loosened(self, state: EfficientState, t: float) -> EfficientState:
        """At an interval's end: lets a gain that may keep falling walk, and updates its event."""
        loose = kept_of(state).loose
        if loose is None:
            return state
        if t > loose.until:
            return saying(keeping(state, loose=None), stale=True)
        if moving_of(state).trials is not None:
            return state
        loose.walked(state.filter, self.estimator.constants.scale, self.interval)
        events, loose = grown(state.supervision.events, loose, state.filter, t)
        return saying(keeping(state, loose=loose), events=events)

    def _noted(
        self, state: EfficientState, hypothesis: Hypothesis, event: FaultEvent, before: Array
    ) -> EfficientState:
        """Records a change, with θ̂ (p,) before it, if it is a fault; a known loss is followed."""
        kept = kept_of(state).wandered(hypothesis.share)
        state = keeping(state, wander=kept.wander)
        if event.kind in {"none", "sound"} or without_effect(event):
            return state
        loose = loosened(kept.loose, event, self.estimator.system.space, before)
        known = kept.loose is not None and loose is not None and loose.part == kept.loose.part
        events = state.supervision.events
        events = events if known else (*events, event)
        return saying(keeping(state, loose=loose), stale=True, events=events)

    def _started_again(self, state: EfficientState, here: Measurement) -> EfficientState:
        """The filter at the memory's estimate, without the snapshots of its own."""
        return keeping(state.restarted(self.estimator, here), snapshots=())
