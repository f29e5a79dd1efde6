"""Fault isolation after contradictions, by trials of hypotheses, and after slow changes.

Significantly large innovations contradict the filter. If it had explained `_MATURE` seconds before
(twice as many after failed trials), a fault is possible: the filter returns to its earlier
estimate, and trials determine which single fault, or an inexact structure, explains the motion
best. Only the parameters of that fault are re-estimated. Slow changes are detected by the shift of
the estimate, see `watch`. If no fault explains the motion, or the filter has just started, it
restarts at the memory's estimate. Where the law states forces that the structure does not explain,
as on a real robot's log, only an inexact structure is tried.
"""

from collections.abc import Callable
from typing import NamedTuple

from ....log import Log, Measurement
from ....parameters import Array
from ....structure.system import SecondOrderSystem
from ...faults import FaultEvent
from ..filter import Law
from ..kalman import restart_state
from ..noise import noise_variance
from ..state import EfficientState
from .events import UNNOTICED, event_of, grown, loosened, revoked, without_effect
from .hypotheses import (
    Hypothesis,
    everything,
    hypotheses_of,
    inexact,
    nothing,
    restored,
)
from .trial import LEAD, onset
from .trials import Verdict, begin_trials, follow_trials, narrowed, verdict
from .watch import PERIOD, rewind, slow_change, with_snapshot

_MATURE = 2.0  # time without a contradiction after which one counts as a fault [s]
_DOUBLINGS = 30  # of that time after trials in vain, at most: to 70 years
_STARTS = 3  # restarts of a young filter, before a structure that is not exact is considered
_SETTLED = 5.0  # time without a contradiction from which slow changes are sought [s]
_ISOLATED = 0.9  # least probability of a slow change among the hypotheses


class Isolation(NamedTuple):
    """Isolates faults."""

    law: Law  # law of the filter
    system: SecondOrderSystem  # the structure
    covariance: Callable[[Array], Array]  # covariance of a prior's θ̂/scale, given θ̂ (p,)
    dt: float  # time between measurements [s]
    interval: float  # time between two decisions [s]

    @property
    def _vague(self) -> bool:
        """Whether forces are stated that the structure does not explain; faults resemble them."""
        return len(self.law.unexplained) > 0

    def contradicted(self, inside: EfficientState, log: Log) -> EfficientState:
        """After a contradiction at a log's end: starts trials of possible faults, or restarts."""
        kalman, system, here = inside.filter, self.system, inside.here(self.system, log)
        if len(log.t) <= LEAD + 1:  # right after a gap: too short to judge
            restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))
            return inside
        doubled = 2 ** min(inside.unnamed, _DOUBLINGS)
        young = inside.calm < doubled * _MATURE and inside.loose is None
        if young and inside.restarts < _STARTS and inside.signals.as_recorded:
            return self.started_again(inside, here)
        rewind(inside.watch, here.t, kalman)
        restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))
        if inside.loose is not None:
            inside.loose.walked(kalman, self.law.scale, UNNOTICED)
        theta, signals = kalman.theta.copy(), inside.signals
        what = [nothing(system), *inexact(system, theta)]
        if not (young or self._vague):
            what += [*hypotheses_of(system, theta), everything(system, theta)]
        what += restored(system, theta, inside.intact, signals.sign, signals.held)
        k = onset(self.law, kalman, system, signals.acting(system, log))
        trials = begin_trials(self.law, kalman, system, signals, what, log, k)
        return inside._replace(trials=trials, watch=())

    def tried(self, inside: EfficientState, log: Log) -> EfficientState:
        """The trials along a log; continues with the best one once there is a verdict."""
        assert inside.trials is not None
        trials = follow_trials(self.law, self.system, inside.trials, log)
        if trials.samples < self.law.window:
            return inside._replace(trials=trials)
        found = verdict(trials, float(log.t[-1]))
        if found is None:
            trials = narrowed(trials, self.law.window * self.dt)
            return inside._replace(trials=trials)
        inside = inside._replace(trials=None)
        if found.trial is None:
            if inside.calm >= _SETTLED:
                when = trials.begin, float(log.t[-1])
                event = FaultEvent(*when, "unknown", "the robot", (), 0.0, 0.0, 0.0, "1", 1.0)
                inside = inside._replace(events=(*inside.events, event), stale=True)
            inside = inside._replace(unnamed=inside.unnamed + 1)
            return self.started_again(inside, inside.here(self.system, log))
        return self._isolated(inside, found, trials.begin, log)

    def _isolated(
        self, inside: EfficientState, found: Verdict, begin: float, log: Log
    ) -> EfficientState:
        """Continues with the filter of a trial, and records the fault if there was one."""
        trial = found.trial
        assert trial is not None
        hypothesis, size = trial.reported(self.system.space)
        kalman, signals = trial.settled(self.system, log)
        factors, intact, kind = inside.factors.copy(), inside.intact.copy(), hypothesis.kind
        space, events = self.system.space, inside.events
        hit = [space.index(name) for name in hypothesis.names if name in space.names]
        if (factors[hit] == 1).all():
            intact[hit] = trial.theta[hit]
        if kind == "sound":
            factors[hit], events = 1.0, revoked(events, hypothesis.part)
        factors[hit] *= {"reversed": -1.0, "broken": 0.0, "stuck": 0.0}.get(kind, 1.0)
        inside = inside._replace(
            filter=kalman.tested_anew(),
            signals=signals,
            factors=factors,
            intact=intact,
            events=events,
            calm=inside.calm if kind == "none" and not hypothesis.share else 0.0,
            returns=inside.returns + 1,
            unnamed=0 if kind != "none" else inside.unnamed,
        )
        event = event_of(hypothesis, begin, float(log.t[-1]), size, found.confidence)
        return self._noted(inside, hypothesis, event, trial.theta)

    def watched(self, inside: EfficientState, t: float) -> EfficientState:
        """At an interval's end: looks for slow changes, and follows a known one."""
        kalman, loose = inside.filter, inside.loose
        if loose is not None and t > loose.until:
            loose, inside = None, inside._replace(stale=True)
        if loose is not None and not inside.trials:
            loose.walked(kalman, self.law.scale, self.interval)
            events, loose = grown(inside.events, loose, kalman, t)
            inside = inside._replace(events=events)
        inside = inside._replace(loose=loose)
        watch = inside.watch
        young = inside.calm < _MATURE  # errors of linearisation exceed P_θθ
        if (
            young
            or self._vague
            or inside.trials
            or (watch and t - watch[-1].t < PERIOD * (1 - 1e-9))
        ):
            return inside
        if inside.calm < _SETTLED or loose is not None or inside.drift:
            return inside._replace(watch=with_snapshot(watch, t, kalman))
        found = slow_change(watch, kalman, self.system)
        if found is None or found.confidence < _ISOLATED:
            return inside._replace(watch=with_snapshot(watch, t, kalman))
        before = kalman.theta.copy()
        kalman.theta[:], kalman.Ptt[:] = found.theta, found.P
        kalman.safe[:], kalman.safe_P[:] = found.theta, found.P
        event = event_of(found.hypothesis, t, t, found.size, found.confidence, slow=True)
        return self._noted(inside._replace(watch=()), found.hypothesis, event, before)

    def _noted(
        self, inside: EfficientState, hypothesis: Hypothesis, event: FaultEvent, before: Array
    ) -> EfficientState:
        """Records a change, with θ̂ (p,) before it, if it is a fault; a known loss is followed."""
        inside = inside.wandered(hypothesis.share)
        if event.kind in {"none", "sound"} or without_effect(event):
            return inside
        loose = loosened(inside.loose, event, self.system.space, before)
        known = inside.loose is not None and loose is not None and loose.part == inside.loose.part
        events = inside.events if known else (*inside.events, event)
        return inside._replace(loose=loose, stale=True, events=events)

    def started_again(self, inside: EfficientState, here: Measurement) -> EfficientState:
        """The filter at the memory's estimate, with the uncertainty of a prior."""
        kalman, theta = inside.filter, inside.guard.theta_hat
        kalman.theta[:], kalman.Ptt[:] = theta, self.covariance(theta)
        restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))
        restarts = inside.restarts + 1
        return inside._replace(calm=0.0, handed=False, restarts=restarts, watch=())
