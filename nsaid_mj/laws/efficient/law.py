"""The efficient law: a Kalman filter of state and parameters, safeguarded by the law `memory`.

The filter is statistically efficient, but only locally: its convergence is not proven from far
away, or if the structure does not explain the motion. The implicit steps of the law `memory`, which
converge globally, run in parallel, without (44, 45) between them. At the end of every interval of
the memory, the law returns the filter's θ̂ if its mean residual on all remembered data is at most
`_WORSE` times that of the memory's estimate, else the memory's. Once the memory has enough data to
detect a change by itself, it pauses between two intervals for a share of the time for which the
filter has explained the motion.

Significantly large innovations contradict the filter, because of a far prior, a fault, an inexact
structure, or a filter that has just started, see `replay` and `faults.isolation`. If the
structure is not exact, θ becomes a random walk, or the gains alone, if that explains the motion
better, see `drift`; then the law returns the filter's θ̂, as the memory averages over the drift.
After a restart at the memory's estimate, this estimate is returned until the filter has explained
`_PROBATION` seconds. If the memory loses M̂ ≻ 0 while the filter's estimate is returned, it
continues from that.
"""

from functools import partial
from typing import Any

import numpy as np

from ...log import Log, Measurement, extended
from ...numerics.threads import beside
from ...quotient.cost import Remembered
from ...structure.system import checked
from ..base import Confidence, Estimates, Identifier, State, Status
from ..nullspace_aid import NullspaceIdentifier
from ..settings import EfficientConfig
from .drift import LONGEST, Rivals, walks
from .faults.isolation import Isolation
from .faults.signals import Signals
from .faults.trial import LEAD
from .filter import COMPLETED, CONTRADICTED, ROUNDED, Along, filter_at
from .kalman import follow_filter, restart_state
from .noise import noise_variance
from .replay import FilterAlone, repair
from .state import EfficientState

_BEGINNING = 20.0  # time after which a motion has no beginning to learn from [s]
_LATER = 1.5  # durations after which learning again is tried once more
_WORSE = 2.0  # largest ratio of the filter's mean residual to the memory's
_EXPLAINED = 1e-8  # squared residual over squared effort that counts as none, as of quadrature
_PROBATION = 2.0  # time without a contradiction after a restart, before θ̂ is returned [s]
_DETERMINED = 3  # rows of data per parameter, before the memory's residual can judge
_PAUSE = 1 / 3  # longest pause of the memory, as a share of the time without a contradiction
_TOGETHER = 16  # steps that the memory absorbs together, at most
_ROUNDING = 1e-15  # of P_θθ relative to its largest entry


class EfficientIdentifier(Identifier):
    """A Kalman filter of (q, v, θ), for measurements dt [s] apart.

    `guard` is the law `memory`, whose system and prior are the filter's.

    Raises:
        InvalidInput: the system has no compiled forward dynamics.
    """

    conserves = False

    def __init__(self, guard: NullspaceIdentifier, dt: float, config: EfficientConfig):
        assert guard.memory is not None
        self.guard, self.system, self._memory = guard, guard.system, guard.memory
        self.metric = guard.metric
        self._every, self._interval = guard.memory.every, guard.memory.every * dt
        alone = FilterAlone(guard.system, dt, config)
        self._law, self._covariance = alone.law, alone.covariance
        self._gamma = config.linearisation
        alone.law = self._law._replace(gamma=self._gamma)
        self._again = alone
        self._faults = Isolation(self._law, self.system, self._covariance, dt, self._interval)

    def init(self, first: Measurement) -> State:
        """The state at the first measurement: θ̂ = prior, no past data."""
        guard = self.guard.init(first)
        theta = guard.theta_hat
        q = np.asarray(first.q, dtype=np.float64)
        kalman = filter_at(q, guard.v_hat, theta, self._covariance(theta))
        sound = Signals.sound(self.system), np.ones(self.system.p), theta.copy()
        inside = EfficientState(kalman, guard, 0, 0, 0.0, False, 0, 0, *sound)
        return guard._replace(memory=None, filter=inside)

    def resume(self, state: State, here: Measurement) -> State:
        """The state at a measurement after a gap; ends any trials and comparisons."""
        here = checked(self.system, here)
        inside = state.filter
        kalman, n = inside.filter.copied(), self.system.n
        kalman.noise.increments[:, :n] = here.v * self._interval / self._every
        if kalman.tally[0]:
            restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))
        guard = inside.guard
        if inside.waiting is not None:
            guard = self._memory.absorb(guard, inside.waiting)
        guard = self.guard.resume(guard, here)
        inside = inside._replace(filter=kalman, guard=guard, beginning=())
        inside = inside._replace(trials=None, rivals=None, recent=None, waiting=None)
        return state._replace(t=here.t, v_hat=here.v.copy(), filter=inside)

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """Filter and memory along a log, with a decision at the end of every interval."""
        self.check(log)
        made, at, inside = [Estimates.of(state)], 0, state.filter
        state = state._replace(filter=inside._replace(filter=inside.filter.copied()))
        while at < len(log.t) - 1 and state.status is Status.completed:
            steps = self._every - state.filter.step % self._every
            state, estimates = self._along(state, log.part(at, at + steps + 1))
            made.append(estimates.after(1))
            at += len(estimates.pivot) - 1
        return state, Estimates(*(np.concatenate(part) for part in zip(*made, strict=True)))

    def _along(self, state: State, log: Log) -> tuple[State, Estimates]:
        """Filter and memory along a log that ends at an interval's end at the latest.

        `state.filter.filter` is overwritten.
        """
        count = _finite_rows(log)
        status = Status.completed if count == len(log.t) else Status.measurement_not_finite
        inside, log = state.filter, log.first(count)
        estimates = Estimates(
            log.v.copy(),
            np.repeat((inside.guard.theta_hat * inside.factors)[None], count, axis=0),
            np.full(count, np.inf),
            np.full(count, inside.guard.spent),
        )
        steps = 0 if inside.pause else count - 1
        before, remembered = inside, beside(steps, self._remembered, inside, log)
        inside = self._filtered(inside, log, estimates)
        if steps:
            if inside.signals is not before.signals:  # the thread's are not those that act
                remembered = partial(self._remembered, inside, log)
            inside = inside._replace(**remembered())
        if inside.rivals is not None and count > 1:
            acting = inside.signals.acting(self.system, log)
            rivals = inside.rivals.followed(self._law, self.system.space, acting)
            inside = inside._replace(rivals=rivals)
        inside = inside._replace(step=inside.step + count - 1)
        if inside.step % self._every == 0 and count > 1:
            here = inside.here(self.system, log)
            inside = self._renewed(inside, here) if inside.stale else inside
            if not (inside.trials or np.isfinite(inside.filter.Ptt).all()):
                inside = self._faults.started_again(inside, here)
            inside = self._faults.watched(self._judged(inside, here), here.t)
            if not inside.trials:
                inside = self._compared(inside, before, here.t)
            best = inside.filter.theta if inside.handed else inside.guard.theta_hat
            best = best * inside.factors
            estimates.theta_hat[-1], estimates.spent[-1] = best, inside.guard.spent
        last = estimates.v_hat[-1].copy(), estimates.theta_hat[-1].copy()
        pivot = float(estimates.pivot[-1])
        return (
            State(float(log.t[-1]), *last, pivot, status, filter=inside, faults=inside.events),
            estimates,
        )

    def _remembered(self, inside: EfficientState, log: Log) -> dict[str, Any]:
        """Passes a log to the memory, once there are `_TOGETHER` steps or the interval ends.

        With single samples, the overhead of each call of the memory would equal that of many steps.
        Returns what changes in `inside`.
        """
        acting = inside.signals.acting(self.system, log)
        if inside.waiting is not None:
            acting = Log.joined(inside.waiting.first(len(inside.waiting.t) - 1), acting)
        steps, memory = len(acting.t) - 1, inside.guard.memory
        assert memory is not None
        if steps < _TOGETHER and (memory.step + steps) % self._every:
            return {"waiting": acting}
        return {"guard": self._memory.absorb(inside.guard, acting), "waiting": None}

    def _seconds(self, inside: EfficientState) -> float:
        """Time since the first sample [s]."""
        return inside.step * self._interval / self._every

    def _renewed(self, inside: EfficientState, here: Measurement) -> EfficientState:
        """Restarts the memory at the filter's estimate, without data from before a fault."""
        guard = inside.guard._replace(
            v_hat=here.v.copy(),
            theta_hat=inside.filter.theta.copy(),
            memory=self._memory.recorder.begin(here),
        )
        return inside._replace(guard=guard, pause=0, stale=False)

    def _judged(self, inside: EfficientState, here: Measurement) -> EfficientState:
        """At an interval's end: chooses the estimate, and how long the memory pauses."""
        memory = inside.guard.memory
        assert memory is not None
        if not inside.pause:
            inside = inside._replace(handed=self._explains(inside))
        awake = not memory.sure or not inside.handed
        longest = 0 if awake else int(_PAUSE * inside.calm / self._interval)
        pause = min(inside.pause - 1, longest) if inside.pause else longest
        if inside.pause and not pause:
            resumed = self._memory.recorder.resume(memory, here)
            inside = inside._replace(guard=inside.guard._replace(memory=resumed))
        return inside._replace(pause=pause)

    def _filtered(self, inside: EfficientState, log: Log, estimates: Estimates) -> EfficientState:
        """Runs the filter along a log and its contradictions; overwrites estimates."""
        count, at, space = len(log.t), 0, self.system.space
        along, past = Along.empty(count, self.system.n, self.system.p), log
        thetas, v_hats, pivots, _ = along
        if inside.recent is not None:  # its last sample is the log's first
            past = Log.joined(inside.recent.first(len(inside.recent.t) - 1), log)
        while at < count - 1:
            handed = inside.handed
            if inside.trials:
                last = min(count - 1, at + self._law.window - inside.trials.samples)
                thetas[at + 1 : last + 1] = inside.theta
                v_hats[at + 1 : last + 1] = log.v[at + 1 : last + 1]
                inside = self._faults.tried(inside, log.part(at, last + 1))
            else:
                begun, kalman = bool(inside.filter.tally[0]), inside.filter
                piece = inside.signals.acting(self.system, log.part(at, count))
                walk = walks(space, inside.walk(self._seconds(inside)), inside.drift)
                law = self._law._replace(walk=walk, gamma=self._gamma)
                row, end = follow_filter(law, kalman, *piece, along.part(at))
                last, calm = at + row, inside.calm + float(log.t[at + row] - log.t[at]) * begun
                thetas[at + 1 : last + 1] *= inside.factors
                inside = inside._replace(calm=calm)
                if end == CONTRADICTED:
                    inside, explained = self._learned_again(inside, log.first(last + 1))
                if end == CONTRADICTED and not explained:
                    known = past.first(len(past.t) - count + last + 1)
                    inside = self._faults.contradicted(inside, known.last(self._law.window + LEAD))
                elif end == ROUNDED:
                    repair(kalman, inside.here(self.system, log.first(last + 1)))
                if end != COMPLETED:
                    thetas[last], v_hats[last] = inside.theta, inside.filter.v
            own = slice(at + 1, last + inside.handed)
            if handed:
                estimates.theta_hat[own] = thetas[own]
            at = last
        estimates.v_hat[1:], estimates.pivot[1:] = v_hats[1:], pivots[1:]
        if self._seconds(inside) > _BEGINNING or inside.events:
            inside = inside._replace(beginning=())
        elif inside.beginning or not inside.step:
            beginning = extended(inside.beginning, log.first(count - 1))
            inside = inside._replace(beginning=beginning)
        return inside._replace(recent=past.last(self._law.window + LEAD))

    def _learned_again(self, inside: EfficientState, log: Log) -> tuple[EfficientState, bool]:
        """Learns again from the first sample, after a contradiction at a log's end.

        Also returns whether the filter then explains the motion.
        """
        now = self._seconds(inside) + float(log.t[-1] - log.t[0])
        if not inside.beginning or now < _LATER * inside.learned:
            return inside, False
        whole = Log.joined(*inside.beginning, log)
        kalman = self._again.learned(inside.guard.theta_hat, whole)
        inside = inside._replace(learned=now)
        if kalman is None:
            return inside, False
        fresh = {"wander": (0.0, 0.0), "unnamed": 0, "watch": ()}
        return inside._replace(filter=kalman, calm=now, handed=True, **fresh), True

    def _compared(self, inside: EfficientState, before: EfficientState, t: float) -> EfficientState:
        """At an interval's end: tests for a drift of the gains, unless θ is constant."""
        rivals, failed = inside.rivals, len(inside.events) > len(before.events)
        if rivals is None or failed:
            returned = inside.returns > before.returns or inside.wander != before.wander
            if rivals is None and (failed or not returned):
                return inside
            prior = self._covariance(inside.filter.theta)
            return inside._replace(rivals=Rivals.at(inside.filter, prior, t))
        best = rivals.preferred(t, inside.drift)
        if best is None:
            over = not inside.drift and t - rivals.begin > LONGEST
            return inside._replace(rivals=None) if over else inside
        ended = not best.gains
        return inside._replace(
            filter=best.filter.copied().tested_anew(),
            watch=(),
            wander=(best.all_of * self._seconds(inside), 0.0),
            drift=best.gains,
            since=inside.since if inside.drift else t,
            rivals=None if ended and not best.all_of else rivals,
            handed=True,
            stale=inside.stale or ended,
        )

    def _explains(self, inside: EfficientState) -> bool:
        """Whether the filter's estimate explains the remembered data as well as the memory's."""
        kalman, memory, system = inside.filter, inside.guard.memory, self.system
        assert memory is not None
        if not kalman.tally[0]:
            return False
        if inside.drift:
            return True
        if inside.loose is not None or inside.trials:
            return inside.handed  # the memory averages over the change
        remembered = Remembered.of(memory.means, system.space)
        changed = inside.returns + inside.restarts > 0
        determined = memory.means.blocks * system.n >= _DETERMINED * system.p
        if remembered is None or not determined:
            return inside.handed or not changed  # an estimate from few data fits them too well
        if changed and inside.calm < _PROBATION:
            return inside.handed  # after a change of an actuator the memory holds data from before
        theirs = np.maximum(remembered.levels(inside.guard.theta_hat), _EXPLAINED)
        return bool(np.mean(remembered.levels(kalman.theta) / theirs) <= _WORSE)

    def confidence(self, state: State) -> Confidence | None:
        """The covariance of the returned estimate.

        That of the filter is scaled by the mean squared normalised innovation where it exceeds 1.
        """
        inside: EfficientState = state.filter
        kalman, prior = inside.filter, self._covariance(self.guard.prior)
        if not inside.handed:
            stated = self.guard.confidence(inside.guard)
            if stated is not None and np.isfinite(stated.covariance).all():
                return stated
            kalman = kalman._replace(Ptt=prior)  # too few data: only the prior is known
        squares, number = kalman.totals
        P = kalman.Ptt + _ROUNDING * np.diag(kalman.Ptt).max() * np.eye(self.system.p)
        unit = np.where(inside.factors < 0, -self._law.scale, self._law.scale)
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
