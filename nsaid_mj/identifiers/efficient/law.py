"""The efficient law: a Kalman filter of state and parameters, guarded by the law `memory`.

The filter is as accurate as the data allow, but only locally: nothing is proven from far away, or
where the structure does not explain the motion. Beside it run the implicit steps of the law
`memory`, which converge from anywhere, without (44, 45) between them. At the end of every interval
of the memory, θ̂ is handed out from the filter if its mean residual on all remembered data is at
most `_WORSE` times that of the memory's estimate, else from the memory. Once the memory has enough
data to notice a change by itself, it pauses between two intervals for a share of the time for which
the filter has explained the motion.

Innovations larger than chance allows contradict the filter. If it had explained `_MATURE` seconds
before, an actuator may have changed: the filter returns to its estimate from before, and over one
window tries which gain, set free, explains the motion best. If none does, or if the filter is
young, it starts again at the memory's estimate, which alone is handed out until the filter has
again explained `_PROBATION` seconds. If the memory loses M̂ ≻ 0 while the filter's estimate is
handed out, it goes on from that.
"""

from __future__ import annotations

from copy import deepcopy
from typing import NamedTuple

import numpy as np

from ...bounds import Config, NonNegative, Positive, config
from ...errors import InvalidInput
from ...log import Log, Measurement
from ...parameters import Array
from ...system import SecondOrderSystem
from ..base import Confidence, Estimates, Identifier, State, Status
from ..cone.barrier import cone_of, gradient_and_hessian
from ..memory.cost import quotient
from ..memory.law import ImplicitMemory
from ..nullspace_aid import NullspaceIdentifier
from .kalman import (
    COMPLETED,
    CONTRADICTED,
    ROUNDED,
    Filter,
    Law,
    acceptable,
    filter_at,
    follow_filter,
    noise_variance,
    restart_state,
)

_WORSE = 2.0  # largest ratio of the filter's mean residual to the memory's
_EXPLAINED = 1e-8  # squared residual over squared effort that counts as none: quadrature leaves it
_PROBATION = 2.0  # time without a contradiction after a restart, before θ̂ is handed out [s]
_MATURE = 2.0  # time without a contradiction after which one is taken for a changed actuator [s]
_DETERMINED = 3  # rows of data per parameter, before the memory's residual can judge
_PAUSE = 1 / 3  # longest pause of the memory, as a share of the time without a contradiction
_FREE = 0.5  # relative standard deviation of a gain that is set free
_INDEFINITE = 1e-13  # least eigenvalue over the largest, of a P_θθ that rounding made indefinite
_ROUNDING = 1e-15  # of P_θθ relative to its largest entry


@config
class EfficientConfig(Config):
    """The filter of the law `efficient`.

    Attributes:
        prior: standard deviation of θ̂(0) in the metric of the cone, for instance the relative one
            of a positive parameter.
        linearisation: γ, standard deviation of the error of a step's linearisation relative to the
            standard deviation of what θ does in it.
        innovation_window: time over which innovations are tested against chance [s].
    """

    _path = "identifier.efficient"

    prior: Positive = 0.3
    linearisation: NonNegative = 0.3
    innovation_window: Positive = 0.1


class Witness:
    """The filter alone, for a structure with compiled forward dynamics.

    Args:
        system: the structure.
        dt: time between measurements [s].
        config: of the filter.

    Attributes:
        law: what the filter knows beforehand.

    Raises:
        InvalidInput: the system has no compiled forward dynamics.
    """

    def __init__(self, system: SecondOrderSystem, dt: float, config: EfficientConfig):
        if system.forward is None:
            raise InvalidInput(
                "law",
                "a system with compiled forward dynamics",
                type(system).__name__,
                "Take --law memory; for an arm, --plant.backend compiled.",
            )
        self._spread, self._p = config.prior, system.p
        cone, scale = cone_of(system.space), np.array(system.space.scale)
        window = max(10, round(config.innovation_window / dt))
        self.law = Law(system.forward, cone, scale, config.linearisation, window)

    def covariance(self, theta: Array) -> Array:
        """(p, p) P_θθ before any data: σ² (∇²b(θ̂) + 1)⁻¹ in units of the scale."""
        _, metric = gradient_and_hessian(self.law.cone, theta)
        balanced = metric * np.outer(self.law.scale, self.law.scale) + np.eye(self._p)
        return np.asarray(self._spread**2 * np.linalg.inv(balanced), dtype=np.float64)

    def contradictions(self, theta: Array, log: Log) -> tuple[list[float], float]:
        """Times at which a log of N measurements contradicts every θ near θ̂ (p,) [s].

        Returns:
            The times, and the mean squared normalised innovation.
        """
        count, P = len(log.t), self.covariance(theta)
        kalman, times, at = filter_at(log.q[0], log.v[0], theta, P), [], 0
        out = np.empty((count, self._p)), np.empty(log.v.shape), np.empty(count)
        while at < count - 1:
            columns = (part[at:] for part in log)
            row, end = follow_filter(self.law, kalman, *columns, *(part[at:] for part in out))
            at += row
            if end == ROUNDED:
                mend(kalman, log.at(at))
            elif end == CONTRADICTED:
                times.append(float(log.t[at]))
                kalman.theta[:], kalman.Ptt[:] = theta, P
                restart_state(kalman, log.q[at], log.v[at], noise_variance(kalman.noise))
        return times, float(kalman.totals[0] / max(1.0, kalman.totals[1]))


def mend(kalman: Filter, here: Measurement) -> None:
    """Makes P_θθ positive definite after rounding errors, and starts the state again."""
    values, vectors = np.linalg.eigh(kalman.Ptt)
    kalman.Ptt[:] = (vectors * np.maximum(values, _INDEFINITE * values[-1])) @ vectors.T
    restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))


class Guarded(NamedTuple):
    """State of the efficient law.

    Attributes:
        filter: the filter.
        guard: the memory and its estimate.
        step: index of the sample.
        pause: intervals for which the memory still pauses.
        calm: time since the filter began, or was last contradicted [s].
        handed: whether θ̂ is handed out from the filter.
        restarts: times the filter started again at the memory's estimate.
        returns: times it returned to an earlier estimate with gains set free.
        trials: filters that set gains free, of which one will be chosen; empty where there is none.
    """

    filter: Filter
    guard: State
    step: int
    pause: int
    calm: float
    handed: bool
    restarts: int
    returns: int
    trials: tuple[Filter, ...] = ()


def efficient_identifier(
    guard: NullspaceIdentifier, dt: float, config: EfficientConfig | None = None
) -> EfficientIdentifier:
    """The efficient law.

    Args:
        guard: the law `memory`, whose system and prior are the filter's.
        dt: time between measurements [s].
        config: of the filter; None is `EfficientConfig()`.

    Raises:
        InvalidInput: the system has no compiled forward dynamics.
    """
    return EfficientIdentifier(guard, dt, config or EfficientConfig())


class EfficientIdentifier(Identifier):
    """A Kalman filter of (q, v, θ), guarded by the law `memory`; arguments as above."""

    conserves = proven = False
    cancelling = 0.0

    def __init__(self, guard: NullspaceIdentifier, dt: float, config: EfficientConfig):
        assert isinstance(guard.memory, ImplicitMemory)
        self.guard, self.system, self._memory = guard, guard.system, guard.memory
        self._every, self._interval = guard.memory.every, guard.memory.every * dt
        witness = Witness(guard.system, dt, config)
        self._law, self._covariance = witness.law, witness.covariance
        self._scale = self._law.scale
        self._patient = self._law._replace(window=10**9)  # never contradicted

    def init(self, first: Measurement) -> State:
        """The state at the first measurement: θ̂ = prior, no past data."""
        guard = self.guard.init(first)
        theta = guard.theta_hat
        q = np.asarray(first.q, dtype=np.float64)
        kalman = filter_at(q, guard.v_hat, theta, self._covariance(theta))
        inside = Guarded(kalman, guard, 0, 0, 0.0, False, 0, 0)
        return guard._replace(memory=None, filter=inside)

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """Filter and memory along a log, with a decision at the end of every interval."""
        self.check(log)
        made, at, inside = [Estimates.of(state)], 0, state.filter
        state = state._replace(filter=inside._replace(filter=deepcopy(inside.filter)))
        while at < len(log.t) - 1 and state.status is Status.completed:
            steps = self._every - state.filter.step % self._every
            state, estimates = self._along(state, log.part(at, at + steps + 1))
            made.append(estimates.after(1))
            at += len(estimates.pivot) - 1
        return state, Estimates(*(np.concatenate(part) for part in zip(*made, strict=True)))

    def _along(self, state: State, log: Log) -> tuple[State, Estimates]:
        """Filter and memory along a log that ends at the latest at an interval's end.

        `state.filter.filter` is overwritten.
        """
        count = _finite_rows(log)
        status = Status.completed if count == len(log.t) else Status.measurement_not_finite
        inside, log = state.filter, log.first(count)
        estimates = Estimates(
            log.v.copy(),
            np.repeat(inside.guard.theta_hat[None], count, axis=0),
            np.full(count, np.inf),
            np.full(count, inside.guard.spent),
        )
        inside = self._filtered(inside, log, estimates)
        if not inside.pause and count > 1:
            inside = inside._replace(guard=self._memory.absorb(inside.guard, log))
        inside = inside._replace(step=inside.step + count - 1)
        if inside.step % self._every == 0 and count > 1:
            inside = self._judged(inside, log.at(-1))
            best = inside.filter.theta if inside.handed else inside.guard.theta_hat
            estimates.theta_hat[-1], estimates.spent[-1] = best, inside.guard.spent
        last = estimates.v_hat[-1].copy(), estimates.theta_hat[-1].copy()
        pivot = float(estimates.pivot[-1])
        return State(float(log.t[-1]), *last, pivot, status, filter=inside), estimates

    def _judged(self, inside: Guarded, here: Measurement) -> Guarded:
        """At an interval's end: which estimate is handed out, and how long the memory pauses."""
        memory = inside.guard.memory
        assert memory is not None
        if not inside.pause:
            inside = inside._replace(handed=self._explains(inside))
        awake = memory.alarmed or not memory.sure or not inside.handed
        longest = 0 if awake else int(_PAUSE * inside.calm / self._interval)
        pause = min(inside.pause - 1, longest) if inside.pause else longest
        if inside.pause and not pause:
            resumed = self._memory.recorder.resume(memory, here)
            inside = inside._replace(guard=inside.guard._replace(memory=resumed))
        return inside._replace(pause=pause)

    def _filtered(self, inside: Guarded, log: Log, estimates: Estimates) -> Guarded:
        """The filter along a log, through contradictions; overwrites what it hands out."""
        count, at = len(log.t), 0
        thetas, v_hats = np.empty(estimates.theta_hat.shape), np.empty(log.v.shape)
        pivots = np.full(count, np.inf)
        while at < count - 1:
            handed = inside.handed
            if inside.trials:
                last = min(count - 1, at + self._law.window - int(inside.trials[0].tally[1]))
                thetas[at + 1 : last + 1] = inside.filter.theta
                v_hats[at + 1 : last + 1] = log.v[at + 1 : last + 1]
                inside = self._tried(inside, log.part(at, last + 1))
            else:
                begun, kalman = bool(inside.filter.tally[0]), inside.filter
                out = thetas[at:], v_hats[at:], pivots[at:]
                row, end = follow_filter(self._law, kalman, *(part[at:] for part in log), *out)
                last, calm = at + row, inside.calm + float(log.t[at + row] - log.t[at]) * begun
                inside = inside._replace(calm=calm)
                if end == CONTRADICTED:
                    inside = self._contradicted(inside, log.at(last))
                elif end == ROUNDED:
                    mend(kalman, log.at(last))
                if end != COMPLETED:
                    thetas[last], v_hats[last] = inside.filter.theta, inside.filter.v
            own = slice(at + 1, last + inside.handed)
            if handed:
                estimates.theta_hat[own] = thetas[own]
            at = last
        estimates.v_hat[1:], estimates.pivot[1:] = v_hats[1:], pivots[1:]
        return inside

    def _contradicted(self, inside: Guarded, here: Measurement) -> Guarded:
        """After a contradiction: trials of an earlier estimate with free gains, or a new start.

        One trial for each actuator sets its gain alone free, the last one all of them.
        """
        if inside.calm < _MATURE:
            return self._started_again(inside, here)
        kalman, trials = inside.filter, []
        kalman.theta[:], kalman.Ptt[:] = kalman.safe[0], kalman.safe_P[0]
        restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))
        actuators = self.system.space.actuators
        for k in [*actuators[:, None], actuators]:
            trial = deepcopy(kalman)
            trial.Ptt[k], trial.Ptt[:, k] = 0.0, 0.0
            trial.Ptt[k, k] = (_FREE * trial.theta[k] / self._scale[k]) ** 2
            trials.append(trial)
        return inside._replace(trials=tuple(trials))

    def _tried(self, inside: Guarded, log: Log) -> Guarded:
        """The trials along a log, of which the best goes on at the end of a window."""
        trials, count = tuple(map(deepcopy, inside.trials)), len(log.t)
        out = np.empty((count, self.system.p)), np.empty((count, self.system.n)), np.empty(count)
        filled = trials[0].tally[1] + count - 1
        for trial in trials:
            _, end = follow_filter(self._patient, trial, *log, *out)
            trial.tally[1] = filled
            trial.tally[2] += 0.0 if end == COMPLETED else np.inf
        if filled < self._law.window:
            return inside._replace(trials=trials)
        *single, whole = trials  # the last one has most freedom: only if no single gain will do
        best = min(single, key=lambda trial: trial.tally[2])
        if best.tally[2] > acceptable(self._law, best):
            best = whole
        if best.tally[2] > acceptable(self._law, best):
            return self._started_again(inside._replace(trials=()), log.at(-1))
        best.tally[1:3] = 0.0
        best.safe[:], best.safe_P[:] = best.theta, best.Ptt
        return inside._replace(filter=best, trials=(), calm=0.0, returns=inside.returns + 1)

    def _started_again(self, inside: Guarded, here: Measurement) -> Guarded:
        """The filter at the memory's estimate, with the uncertainty of a prior."""
        kalman, theta = inside.filter, inside.guard.theta_hat
        kalman.theta[:], kalman.Ptt[:] = theta, self._covariance(theta)
        restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))
        return inside._replace(calm=0.0, handed=False, restarts=inside.restarts + 1)

    def _explains(self, inside: Guarded) -> bool:
        """Whether the filter's estimate explains the remembered data as well as the memory's."""
        kalman, memory, system = inside.filter, inside.guard.memory, self.system
        assert memory is not None
        if not kalman.tally[0]:
            return False
        remembered = quotient(memory.means, system.space)
        changed = inside.returns + inside.restarts > 0
        if remembered is None or memory.means.blocks * system.n < _DETERMINED * system.p:
            return inside.handed or not changed  # an estimate from few data fits them too well
        if changed and inside.calm < _PROBATION:
            return inside.handed  # after a change of an actuator the memory holds data from before
        theirs = np.maximum(remembered.levels(inside.guard.theta_hat), _EXPLAINED)
        return bool(np.mean(remembered.levels(kalman.theta) / theirs) <= _WORSE)

    def conserved(self, theta_hat: Array) -> Array:
        """(...,) the quantity that the law `memory` would conserve."""
        return self.guard.conserved(theta_hat)

    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) the second term of V of the law `memory`, at θ (p,) and estimates (..., p)."""
        return self.guard.divergence(theta, theta_hat)

    def implicit(self, t: Array) -> np.ndarray:
        """(N−1,) True: every update of the filter is a step outside (44, 45)."""
        return np.ones(max(0, len(t) - 1), dtype=bool)

    def slacks(self, log: Log, theta: Array) -> Array:
        """(N−1,) infinity: nothing is proven of V."""
        return np.full(max(0, len(log.t) - 1), np.inf)

    def confidence(self, state: State) -> Confidence | None:
        """The covariance of the estimate that is handed out.

        That of the filter is scaled by the mean squared normalised innovation where it exceeds 1.
        """
        inside: Guarded = state.filter
        if not inside.handed:
            return self.guard.confidence(inside.guard)
        kalman, prior = inside.filter, self._covariance(self.guard.prior)
        squares, number = kalman.totals
        P = kalman.Ptt + _ROUNDING * np.diag(kalman.Ptt).max() * np.eye(self.system.p)
        units = np.outer(self._scale, self._scale)
        samples = np.full(self.system.n, number / (2 * self.system.n))
        return Confidence(max(1.0, squares / number) * P * units, prior * units, samples)


def _finite_rows(log: Log) -> int:
    """Number of rows before the first that is not finite; a row ends under the last one's command.

    The first row is taken to be finite, since the identifier is already there.
    """
    bad = ~(np.isfinite(log.t) & np.isfinite(log.q).all(axis=1) & np.isfinite(log.v).all(axis=1))
    bad[1:] |= ~np.isfinite(log.u[:-1]).all(axis=1)
    return 1 + int(np.argmax(bad[1:])) if bad[1:].any() else len(bad)
