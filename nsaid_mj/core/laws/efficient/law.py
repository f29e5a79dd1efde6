"""The efficient law: a Kalman filter of state and parameters, safeguarded by the law `memory`.

The filter is statistically efficient, but only locally: its convergence is not proven from far
away, or if the structure does not explain the motion. The implicit steps of the law `memory`, which
converge globally, run in parallel, without (44, 45) between them. At the end of every
interval of the memory, the law returns the filter's estimate, unless its mean residual on the
remembered data is more than `_WORSE` times the memory's; then it returns the memory's. Once the
memory has enough data to detect a change by itself, it pauses between two intervals, for a share of
the time for which the filter has explained the motion.

Innovations that are significantly too large contradict the filter. The causes are a prior far off,
a fault, an inexact structure, or a filter that has just started. The law's `Supervisor` decides
what follows; without one, the filter restarts at the memory's estimate. After such a restart, the
law returns the memory's estimate until the filter has explained `_PROBATION` seconds. If the memory
loses M̂ ≻ 0 while the filter's estimate is returned, it continues from the filter's.
"""

from functools import partial
from typing import Any

import numpy as np

from ...log import Log, Measurement
from ...numerics.threads import beside
from ...quotient.cost import Remembered
from ...structure.system import checked
from ..base import Confidence, Estimates, Identifier, State, Status
from ..nullspace_aid import NullspaceIdentifier
from .estimator import KalmanFilter
from .filter import Along
from .state import EfficientState
from .supervision import Supervision
from .supervisor import Supervisor

_WORSE = 2.0  # largest ratio of the filter's mean residual to the memory's
_EXPLAINED = 1e-8  # squared residual over squared effort that counts as none, as of quadrature
_PROBATION = 2.0  # time without a contradiction after a restart, before θ̂ is returned [s]
_DETERMINED = 3  # rows of data per parameter, before the memory's residual can judge
_PAUSE = 1 / 3  # longest pause of the memory, as a share of the time without a contradiction
_TOGETHER = 16  # steps that the memory absorbs together, at most
_ROUNDING = 1e-15  # of P_θθ relative to its largest entry


class EfficientIdentifier(Identifier):
    """A Kalman filter of (q, v, θ), guarded by a memory.

    Args:
        guard: the law `memory`, whose system and prior are the filter's.
        estimator: the filter.
        supervisor: what watches the filter, and decides where it is contradicted; None for a filter
            that then restarts at the memory's estimate.

    Attributes:
        every: samples in an interval of the memory, at whose end the law decides.
        interval: such an interval [s].
    """

    conserves = False

    def __init__(
        self,
        guard: NullspaceIdentifier,
        estimator: KalmanFilter,
        supervisor: Supervisor | None = None,
    ):
        assert guard.memory is not None
        self.guard = guard
        self.system = guard.system
        self.metric = guard.metric
        self.estimator = estimator
        self.supervisor = supervisor
        self._memory = guard.memory
        self.every = guard.memory.every
        self.interval = guard.memory.every * estimator.dt
        self._cautious = estimator.cautious()

    def supervised_by(self, supervisor: Supervisor) -> "EfficientIdentifier":
        """A copy of this law with a supervisor."""
        return EfficientIdentifier(self.guard, self.estimator, supervisor)

    def init(self, first: Measurement) -> State:
        """The state at the first measurement: θ̂ = prior, no past data."""
        guard = self.guard.init(first)
        theta = guard.theta_hat
        q = np.asarray(first.q, dtype=np.float64)
        kalman = self.estimator.at(q, guard.v_hat, theta, self.estimator.covariance(theta))
        own = EfficientState(kalman, guard, Supervision.none(self.system))
        return guard._replace(memory=None, own=own)

    def resume(self, state: State, here: Measurement) -> State:
        """The state at a measurement after a gap; ends what refers to the motion before."""
        here = checked(self.system, here)
        own: EfficientState = state.own
        kalman = own.filter.copied()
        n = self.system.n
        kalman.noise.increments[:, :n] = here.v * self.interval / self.every
        if kalman.tally[0]:
            self.estimator.restart(kalman, here)
        guard = own.guard
        if own.waiting is not None:
            guard = self._memory.absorb(guard, own.waiting)
        guard = self.guard.resume(guard, here)
        supervision = own.supervision.after_gap()
        own = own._replace(filter=kalman, guard=guard, supervision=supervision, waiting=None)
        return state._replace(t=here.t, v_hat=here.v.copy(), own=own)

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """Filter and memory along a log, with a decision at the end of every interval."""
        self.check(log)
        made = [Estimates.of(state)]
        at = 0
        state = state._replace(own=state.own._replace(filter=state.own.filter.copied()))
        while at < len(log.t) - 1 and state.status is Status.completed:
            steps = self.every - state.own.step % self.every
            state, estimates = self._along(state.own, log.part(at, at + steps + 1))
            made.append(estimates.after(1))
            at += len(estimates.pivot) - 1
        return state, Estimates(*(np.concatenate(part) for part in zip(*made, strict=True)))

    def _along(self, state: EfficientState, log: Log) -> tuple[State, Estimates]:
        """Filter and memory along a log that ends at an interval's end at the latest.

        `state.filter` is overwritten.
        """
        count = _finite_rows(log)
        status = Status.completed if count == len(log.t) else Status.measurement_not_finite
        log = log.first(count)
        gains = state.guard.theta_hat * state.supervision.factors
        estimates = Estimates(
            log.v.copy(),
            np.repeat(gains[None], count, axis=0),
            np.full(count, np.inf),
            np.full(count, state.guard.spent),
        )
        steps = 0 if state.pause else count - 1
        signals = state.supervision.signals
        remembered = beside(steps, self._remembered, state, log)
        state = self._filtered(state, log, estimates)
        if steps:
            if state.supervision.signals is not signals:  # the thread's are not those that act
                remembered = partial(self._remembered, state, log)
            state = state._replace(**remembered())
        if count > 1:
            state = self._ended(state._replace(step=state.step + count - 1), log)
        if count > 1 and state.step % self.every == 0:
            best = state.filter.theta if state.handed else state.guard.theta_hat
            estimates.theta_hat[-1] = best * state.supervision.factors
            estimates.spent[-1] = state.guard.spent
        return (
            State(
                t=float(log.t[-1]),
                v_hat=estimates.v_hat[-1].copy(),
                theta_hat=estimates.theta_hat[-1].copy(),
                pivot=float(estimates.pivot[-1]),
                status=status,
                own=state,
                faults=state.supervision.events,
            ),
            estimates,
        )

    def _remembered(self, state: EfficientState, log: Log) -> dict[str, Any]:
        """Passes a log to the memory, once there are `_TOGETHER` steps or the interval ends.

        With single samples, the overhead of each call of the memory would equal that of many steps.
        Returns what changes in the state.
        """
        acting = state.supervision.signals.acting(self.system, log)
        if state.waiting is not None:
            acting = Log.joined(state.waiting.first(len(state.waiting.t) - 1), acting)
        steps = len(acting.t) - 1
        memory = state.guard.memory
        assert memory is not None
        if steps < _TOGETHER and (memory.step + steps) % self.every:
            return {"waiting": acting}
        return {"guard": self._memory.absorb(state.guard, acting), "waiting": None}

    def _ended(self, state: EfficientState, log: Log) -> EfficientState:
        """At a log's end: decides, if that ends an interval, and calls the supervisor."""
        if state.step % self.every == 0:
            here = state.here(self.system, log)
            if state.supervision.stale:
                state = self._renewed(state, here)
            if not (state.supervision.trying or np.isfinite(state.filter.Ptt).all()):
                state = state.restarted(self.estimator, here)
            state = self._judged(state, here)
        return state if self.supervisor is None else self.supervisor.watched(state, log)

    def _renewed(self, state: EfficientState, here: Measurement) -> EfficientState:
        """Restarts the memory at the filter's estimate, without data from before a fault."""
        guard = state.guard._replace(
            v_hat=here.v.copy(),
            theta_hat=state.filter.theta.copy(),
            memory=self._memory.recorder.begin(here),
        )
        supervision = state.supervision._replace(stale=False)
        return state._replace(guard=guard, pause=0, supervision=supervision)

    def _judged(self, state: EfficientState, here: Measurement) -> EfficientState:
        """At an interval's end: chooses the estimate, and how long the memory pauses."""
        memory = state.guard.memory
        assert memory is not None
        if not state.pause:
            state = state._replace(handed=self._explains(state))
        awake = not memory.sure or not state.handed
        longest = 0 if awake else int(_PAUSE * state.calm / self.interval)
        pause = min(state.pause - 1, longest) if state.pause else longest
        if state.pause and not pause:
            resumed = self._memory.recorder.resume(memory, here)
            state = state._replace(guard=state.guard._replace(memory=resumed))
        return state._replace(pause=pause)

    def _filtered(self, state: EfficientState, log: Log, estimates: Estimates) -> EfficientState:
        """Runs the filter along a log and its contradictions; overwrites estimates."""
        count = len(log.t)
        at = 0
        along = Along.empty(count, self.system.n, self.system.p)
        while at < count - 1:
            handed = state.handed
            if state.supervision.trying:
                state, last = self._tried(state, log, at, along)
            else:
                state, last = self._followed(state, log, at, along)
            rows = slice(at + 1, last + state.handed)
            if handed:
                estimates.theta_hat[rows] = along.theta[rows]
            at = last
        estimates.v_hat[1:] = along.v[1:]
        estimates.pivot[1:] = along.pivot[1:]
        return state

    def _tried(
        self, state: EfficientState, log: Log, at: int, along: Along
    ) -> tuple[EfficientState, int]:
        """The supervisor's trials from row `at` of a log; also the last row that they used."""
        assert self.supervisor is not None
        theta = state.theta
        state, used = self.supervisor.tried(state, log.part(at, len(log.t)))
        rows = slice(at + 1, at + used + 1)
        along.theta[rows] = theta
        along.v[rows] = log.v[rows]
        return state, at + used

    def _followed(
        self, state: EfficientState, log: Log, at: int, along: Along
    ) -> tuple[EfficientState, int]:
        """The filter from row `at` of a log up to a contradiction; also the last row followed."""
        begun = bool(state.filter.tally[0])
        supervision = state.supervision
        piece = supervision.signals.acting(self.system, log.part(at, len(log.t)))
        estimator = self._cautious.walking(supervision.walk)
        stretch = estimator.follow(state.filter, piece, along.part(at))
        last = at + stretch.last
        along.theta[at + 1 : last + 1] *= supervision.factors
        state = state._replace(calm=state.calm + float(log.t[last] - log.t[at]) * begun)
        if stretch.contradicted:
            state = self._contradicted(state, log.first(last + 1))
        elif stretch.rounded:
            estimator.repair(state.filter, state.here(self.system, log.first(last + 1)))
        if not stretch.completed:
            along.theta[last] = state.theta
            along.v[last] = state.filter.v
        return state, last

    def _contradicted(self, state: EfficientState, log: Log) -> EfficientState:
        """After a contradiction at a log's end."""
        if self.supervisor is None:
            return state.restarted(self.estimator, state.here(self.system, log))
        return self.supervisor.contradicted(state, log)

    def _explains(self, state: EfficientState) -> bool:
        """Whether the filter's estimate explains the remembered data as well as the memory's."""
        kalman = state.filter
        memory = state.guard.memory
        supervision = state.supervision
        assert memory is not None
        if not kalman.tally[0]:
            return False
        if supervision.chosen_by == "filter":
            return True
        if supervision.chosen_by == "unchanged" or supervision.trying:
            return state.handed
        remembered = Remembered.of(memory.means, self.system.space)
        changed = supervision.returns + state.restarts > 0
        determined = memory.means.blocks * self.system.n >= _DETERMINED * self.system.p
        if remembered is None or not determined:
            return state.handed or not changed  # an estimate from few data fits them too well
        if changed and state.calm < _PROBATION:
            return state.handed  # after a change of an actuator the memory holds data from before
        theirs = np.maximum(remembered.levels(state.guard.theta_hat), _EXPLAINED)
        return bool(np.mean(remembered.levels(kalman.theta) / theirs) <= _WORSE)

    def confidence(self, state: State) -> Confidence | None:
        """The covariance of the returned estimate.

        That of the filter is scaled by the mean squared normalised innovation where it exceeds 1.
        """
        own: EfficientState = state.own
        kalman = own.filter
        prior = self.estimator.covariance(self.guard.prior)
        if not own.handed:
            stated = self.guard.confidence(own.guard)
            if stated is not None and np.isfinite(stated.covariance).all():
                return stated
            kalman = kalman._replace(Ptt=prior)  # too few data: only the prior is known
        squares, number = kalman.totals
        P = kalman.Ptt + _ROUNDING * np.diag(kalman.Ptt).max() * np.eye(self.system.p)
        scale = self.estimator.constants.scale
        unit = np.where(own.supervision.factors < 0, -scale, scale)
        units = np.outer(unit, unit)
        samples = np.full(self.system.n, number / (2 * self.system.n))
        excess = max(1.0, squares / number) if number else 1.0
        return Confidence(excess * P * units, prior * units, samples)


def _finite_rows(log: Log) -> int:
    """Number of rows before the first that is not finite; a row ends under the last one's command.

    The first row is assumed finite, since the identifier is already there.
    """
    bad = ~(np.isfinite(log.t) & np.isfinite(log.q).all(axis=1) & np.isfinite(log.v).all(axis=1))
    bad[1:] |= ~np.isfinite(log.u[:-1]).all(axis=1)
    return 1 + int(np.argmax(bad[1:])) if bad[1:].any() else len(bad)
