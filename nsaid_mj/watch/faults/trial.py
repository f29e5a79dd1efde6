"""A filter under one fault hypothesis, from the time at which the fault began.

Before a fault, eᵀe of the normalised innovations e of a sample has mean 2n and variance 4n. The
fault began at the sample from which on its average exceeds 2n + 3 √(4n): Page's likelihood ratio
test for a change at an unknown time.

For the bias of a sensor there are three filters. Each is nearly linear, so its innovations depend
linearly on a constant b that is subtracted from the measurements since the fault:
e = e₀ + g (b − b₀), with g the error's signature in the innovations. Filters at b₀ − h, b₀ and
b₀ + h give

    Σ eᵀe = N₀ + s (b − b₀) + ½ c (b − b₀)²,    c = 2 Σ gᵀg,

and with it the estimate of b, its variance, and the likelihood averaged over the prior
b ~ N(0, σ²). This is Friedland's separate estimation of a bias, with sensitivities by differences.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core import (
    Array,
    FilterState,
    KalmanFilter,
    Log,
    ParameterSpace,
    SecondOrderSystem,
    Signals,
)
from .evidence import jumped
from .hypotheses import Hypothesis, command_of, loaded, most_changed

LEAD = 4
"""Samples before the earliest possible fault: `started` takes increments from them."""
_EXCESS = 3.0  # standard deviations of eᵀe that a sample must exceed on average
_LEAST = 0.2  # command at which a stuck actuator is tried, over a typical one
_WALK = 0.012  # of δ per second, as a fault may still grow [1/√s]
_WIDE = 100.0  # prior standard deviation of an error, relative to that of the sensor's noise
_COARSE = 10.0  # step of the differences, relative to the same: several errors of `jumps_at`
_FINE = 2.0  # once the error is known


def increments(system: SecondOrderSystem, log: Log) -> Array:
    """(N−1, 2n) changes of position and velocity from sample to sample."""
    return np.hstack([system.moves(log.q), np.diff(log.v, axis=0)])


def started(estimator: KalmanFilter, kalman: FilterState, log: Log, k: int) -> FilterState:
    """A copy of a filter with its state at sample k ≥ 3 of a log, as measured there."""
    own = kalman.copied()
    own.noise.increments[:] = increments(estimator.system, log.part(k - 3, k + 1))
    estimator.restart(own, log.at(k))
    return own


def onset(estimator: KalmanFilter, kalman: FilterState, log: Log) -> int:
    """The last sample of a log before a fault, given a filter's θ̂ and P_θθ from before."""
    n = estimator.system.n
    own = started(estimator, kalman, log, LEAD - 1)
    innovations = estimator.innovations(own, log.part(LEAD - 1, len(log.t)))
    level = 2 * n + _EXCESS * np.sqrt(4.0 * n)
    excess = np.sum(innovations[1:] ** 2, axis=1) - level
    total = 0.0
    before = len(log.t) - 2
    for k, one in enumerate(excess, LEAD):
        if total <= 0.0:
            total = 0.0
            before = k - 1
        total += one
    return before if total > 0.0 else len(log.t) - 2


class FaultTrial(NamedTuple):
    """A filter under one hypothesis; its tally counts from the start of the trial."""

    hypothesis: Hypothesis  # under trial
    filter: FilterState  # at the last sample
    signals: Signals  # that act under the hypothesis
    theta: Array  # (p,) θ̂ at the start
    P: Array  # (p, p) P_θθ at the start, with the hypothesis's D Dᵀ
    earlier: float = 0.0  # sum of squared normalised innovations that no longer count as evidence

    @staticmethod
    def begin(
        start: FilterState, signals: Signals, hypothesis: Hypothesis, scale: Array
    ) -> FaultTrial:
        """A trial from a filter just before the fault."""
        own = start.copied()
        own.theta[:] += scale * hypothesis.mean
        own.Ptt[:] += hypothesis.D @ hypothesis.D.T
        return FaultTrial(hypothesis, own, signals, own.theta.copy(), own.Ptt.copy())

    @property
    def squares(self) -> float:
        """Sum of the squared normalised innovations."""
        return float(self.filter.tally[2])

    @property
    def evidence(self) -> float:
        """Logarithm of the likelihood of the innovations."""
        return float(-0.5 * (self.filter.tally[2] + self.filter.tally[3]))

    def followed(
        self, estimator: KalmanFilter, log: Log, before: Signals | None = None
    ) -> FaultTrial:
        """The trial after a log; `before` are the signals at its first sample, if different."""
        own = self.filter.copied()
        acting = self.signals.acting(estimator.system, log)
        if before is not None:
            sound = before.acting(estimator.system, log.first(1))
            q = np.concatenate([sound.q, acting.q[1:]])
            v = np.concatenate([sound.v, acting.v[1:]])
            acting = Log.unchecked(acting.t, q, v, acting.u)
        estimator.carry(own, acting)
        return self._replace(filter=own)

    def freed(self, seconds: float) -> None:
        """The trial with variance added for a change that continues for the given time [s]."""
        D = self.hypothesis.D
        self.filter.Ptt[:] += _WALK**2 * seconds * (D @ D.T)

    def forgetting(self) -> FaultTrial:
        """The trial, its evidence counted from here."""
        earlier = self.earlier + self.squares
        self.filter.tally[1:] = 0.0
        return self._replace(earlier=earlier)

    def again(self, start: FilterState, estimator: KalmanFilter) -> FaultTrial:
        """A trial of a load or a seizure from the same start, linearised at this one's estimate.

        Raises:
            LinAlgError: θ with the load is not inside the cone, or too close to its boundary.
        """
        hit = self.hypothesis.D.any(axis=1)
        cone = estimator.constants.cone
        scale = estimator.constants.scale
        if self.hypothesis.kind == "stuck":
            k = int(np.argmax(hit))
            held = self.signals.held.copy()
            ratio = self.filter.theta[k] / start.theta[k]
            command = self.hypothesis.command
            typical = self.hypothesis.held
            better = command_of(self.hypothesis, held[command], ratio)
            held[command] = np.copysign(max(abs(better), _LEAST * abs(typical)), typical)
            signals = self.signals._replace(held=held)
            return FaultTrial.begin(start, signals, self.hypothesis, scale)
        mean = np.where(hit, (self.filter.theta - start.theta) / scale, 0.0)
        hypothesis = loaded(self.hypothesis, cone, scale, start.theta, mean)
        return FaultTrial.begin(start, self.signals, hypothesis, scale)

    def reported(self, space: ParameterSpace) -> tuple[Hypothesis, tuple[float, float, float]]:
        """The changed part, and the size of the change with its 95 % interval."""
        hypothesis = self.hypothesis
        kalman = self.filter
        if hypothesis.kind == "broken":
            return hypothesis, (1.0, 1.0, 1.0)
        if not hypothesis.size.any():
            return hypothesis, (0.0, 0.0, 0.0)
        shift = (kalman.theta - self.theta) / space.scale
        jump = jumped(self.P, kalman.Ptt, shift, hypothesis.D)
        hypothesis = most_changed(space, hypothesis, jump)
        change = jump.interval(hypothesis.size)
        if hypothesis.kind != "stuck":
            size, low, high = (hypothesis.offset + x for x in change)
            return hypothesis, (size, low, high)
        held = float(self.signals.held[hypothesis.command])  # command of the same effort when sound
        size, *ends = (command_of(hypothesis, held, 1 + x) for x in change)
        return hypothesis, (size, min(ends), max(ends))

    def settled(self, estimator: KalmanFilter, log: Log) -> tuple[FilterState, Signals]:
        """The filter that continues after the log that ended the trials, and its signals."""
        return self.filter, self.signals


# -- a sensor's bias -----------------------------------------------------------------------------


class BiasTrial(NamedTuple):
    """Three filters under evenly spaced errors of one sensor."""

    trials: tuple[FaultTrial, ...]  # under each of the three errors
    middle: float  # error of the second one
    step: float  # between two
    prior: float  # standard deviation of the error
    coarse: bool = True  # whether this is the first trial, in which the filter is not quite linear

    @staticmethod
    def begin(
        start: FilterState, signals: Signals, hypothesis: Hypothesis, jumps: Array
    ) -> BiasTrial:
        """A trial from a filter just before the error; `jumps` (2n,) are those of the sensors."""
        sigma = float(np.sqrt(start.R[hypothesis.channel]))
        middle = float(jumps[hypothesis.channel])
        own = BiasTrial((), middle, _COARSE * sigma, _WIDE * sigma)
        return own._started(start, signals, hypothesis)

    def again(self, start: FilterState) -> BiasTrial:
        """A trial from the same start, close to this one's estimate."""
        middle = self.middle + self._fit()[0]
        step = self.step * _FINE / _COARSE
        signals = self.trials[1].signals.biased(self.hypothesis.channel, -self.middle)
        own = self._replace(middle=middle, step=step, coarse=False)
        return own._started(start, signals, self.hypothesis)

    def _started(self, start: FilterState, signals: Signals, hypothesis: Hypothesis) -> BiasTrial:
        """The trials at the three errors, from a filter and the signals before."""
        errors = (self.middle + i * self.step for i in (-1, 0, 1))
        each = (signals.biased(hypothesis.channel, error) for error in errors)
        scale = np.ones(len(start.theta))  # θ does not jump
        trials = (FaultTrial.begin(start, biased, hypothesis, scale) for biased in each)
        return self._replace(trials=tuple(trials))

    @property
    def hypothesis(self) -> Hypothesis:
        """The hypothesis under trial."""
        return self.trials[1].hypothesis

    @property
    def filter(self) -> FilterState:
        """The filter in the middle."""
        return self.trials[1].filter

    @property
    def theta(self) -> Array:
        """(p,) θ̂ at the start."""
        return self.trials[1].theta

    def _fit(self) -> tuple[float, float, float]:
        """Estimate of b − b₀, its precision, and Σ eᵀe there."""
        low, middle, high = (trial.squares for trial in self.trials)
        if not np.isfinite([low, middle, high]).all():
            return 0.0, self.prior**-2, np.inf
        slope = (high - low) / (2 * self.step)
        curvature = max(0.0, (low - 2 * middle + high) / self.step**2)
        precision = 0.5 * curvature + self.prior**-2
        change = -(0.5 * slope + self.middle * self.prior**-2) / precision
        change = min(self.step, max(-self.step, change))  # within the range tried
        return change, precision, middle + slope * change + 0.5 * curvature * change**2

    @property
    def squares(self) -> float:
        """Sum of the squared normalised innovations at the estimate of b."""
        return self._fit()[2]

    @property
    def evidence(self) -> float:
        """Logarithm of the likelihood of the innovations, averaged over b."""
        change, precision, squares = self._fit()
        own = ((self.middle + change) / self.prior) ** 2 + np.log(self.prior**2 * precision)
        return float(-0.5 * (squares + self.filter.tally[3] + own))

    def followed(
        self, estimator: KalmanFilter, log: Log, before: Signals | None = None
    ) -> BiasTrial:
        """The trials after a log; `before` are the signals at its first sample, if different."""
        trials = (trial.followed(estimator, log, before) for trial in self.trials)
        return self._replace(trials=tuple(trials))

    def freed(self, seconds: float) -> None:
        """Does nothing: a bias is constant."""

    def forgetting(self) -> BiasTrial:
        """The trial, its evidence counted from here."""
        return self._replace(trials=tuple(trial.forgetting() for trial in self.trials))

    def reported(self, space: ParameterSpace) -> tuple[Hypothesis, tuple[float, float, float]]:
        """The sensor, and its error with the 95 % interval."""
        change, precision, _ = self._fit()
        b = self.middle + change
        wide = 1.96 * precision**-0.5
        return self.hypothesis, (b, b - wide, b + wide)

    def settled(self, estimator: KalmanFilter, log: Log) -> tuple[FilterState, Signals]:
        """The filter at the estimate of b, its state as measured, and the signals without b."""
        change, precision, _ = self._fit()
        one, two, three = self.trials
        slope = (three.filter.theta - one.filter.theta) / (2 * self.step)
        scale = estimator.constants.scale
        own = two.filter
        signals = two.signals.biased(self.hypothesis.channel, change)
        own.theta[:] += change * slope
        own.Ptt[:] += np.outer(slope / scale, slope / scale) / precision
        last = log.part(len(log.t) - 1, len(log.t))
        estimator.restart(own, signals.acting(estimator.system, last).at(0))
        return own, signals


def jumps_at(system: SecondOrderSystem, log: Log, k: int) -> Array:
    """(2n,) jump of every sensor from sample k to the next, beyond what the motion explains."""
    n = system.n
    places = {6: 3, 3: 2}.get(system.group, 0)
    earlier, now = increments(system, log.part(k - 1, k + 2))
    jump = now - earlier
    jump[:n] = now[:n] - (log.t[k + 1] - log.t[k]) * log.v[k]
    jump[:places] = system.J(log.q[k])[:places, :places] @ jump[:places]  # in world axes
    return jump
