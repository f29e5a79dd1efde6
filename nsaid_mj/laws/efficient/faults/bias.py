"""Trials of a sensor bias.

The filter is nearly linear, so its innovations depend linearly on a constant b that is subtracted
from one sensor's measurements since the fault: e = e₀ + g (b − b₀), with g the error's signature in
the innovations. Three filters, at b₀ − h, b₀ and b₀ + h, give

    Σ eᵀe = N₀ + s (b − b₀) + ½ c (b − b₀)²,    c = 2 Σ gᵀg,

and with it the estimate of b, its variance, and the likelihood averaged over the prior
b ~ N(0, σ²). This is Friedland's separate estimation of a bias, with sensitivities by differences.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....log import Log
from ....parameters import Array, ParameterSpace
from ....structure.system import SecondOrderSystem
from ..filter import Filter, Law
from ..kalman import restart_state
from ..noise import noise_variance
from .hypotheses import Hypothesis
from .onset import increments
from .signals import Signals
from .trial import Trial

_WIDE = 100.0  # prior standard deviation of an error, relative to that of the sensor's noise
_COARSE = 10.0  # step of the differences, relative to the same: several times the error of `_jumps`
_FINE = 2.0  # once the error is known


class BiasTrial(NamedTuple):
    """Three filters under evenly spaced errors of one sensor.

    Attributes:
        trials: under each error.
        middle: error of the second one.
        step: between two.
        prior: standard deviation of the error.
        coarse: whether this is the first trial, in which the filter is not quite linear.
    """

    trials: tuple[Trial, Trial, Trial]
    middle: float
    step: float
    prior: float
    coarse: bool = True

    @staticmethod
    def begin(
        start: Filter,
        signals: Signals,
        hypothesis: Hypothesis,
        system: SecondOrderSystem,
        log: Log,
        k: int,
    ) -> BiasTrial:
        """A trial from a filter at sample k of a log, after which the error begins."""
        channel = hypothesis.channel
        sigma = float(np.sqrt(noise_variance(start.noise)[channel]))
        middle, step = float(_jumps(system, log, k)[channel]), _COARSE * sigma
        trials = _three(start, signals, hypothesis, middle, step)
        return BiasTrial(trials, middle, step, _WIDE * sigma)

    def again(self, start: Filter) -> BiasTrial:
        """A trial from the same start, close to this one's estimate."""
        middle, step = self.middle + self._fit()[0], self.step * _FINE / _COARSE
        signals = self.trials[1].signals.biased(self.hypothesis.channel, -self.middle)
        trials = _three(start, signals, self.hypothesis, middle, step)
        return self._replace(trials=trials, middle=middle, step=step, coarse=False)

    @property
    def hypothesis(self) -> Hypothesis:
        """The hypothesis under trial."""
        return self.trials[1].hypothesis

    @property
    def filter(self) -> Filter:
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
        self, law: Law, system: SecondOrderSystem, log: Log, before: Signals | None = None
    ) -> BiasTrial:
        """The trials after a log; `before` are the signals at its first sample, if different."""
        one, two, three = (trial.followed(law, system, log, before) for trial in self.trials)
        return self._replace(trials=(one, two, three))

    def freed(self, seconds: float) -> None:
        """Does nothing: a bias is constant."""

    def forgetting(self) -> BiasTrial:
        """The trial, its evidence counted from here."""
        one, two, three = (trial.forgetting() for trial in self.trials)
        return self._replace(trials=(one, two, three))

    def reported(
        self,
        space: ParameterSpace,  # as of any trial
    ) -> tuple[Hypothesis, tuple[float, float, float]]:
        """The sensor, and its error with the 95 % interval."""
        change, precision, _ = self._fit()
        b, wide = self.middle + change, 1.96 * precision**-0.5
        return self.hypothesis, (b, b - wide, b + wide)

    def settled(self, system: SecondOrderSystem, scale: Array, log: Log) -> tuple[Filter, Signals]:
        """The filter at the estimate of b, its state as measured, and the signals without b."""
        change, precision, _ = self._fit()
        one, two, three = self.trials
        slope = (three.filter.theta - one.filter.theta) / (2 * self.step)
        own, signals = two.filter, two.signals.biased(self.hypothesis.channel, change)
        own.theta[:] += change * slope
        own.Ptt[:] += np.outer(slope / scale, slope / scale) / precision
        here = signals.acting(system, log.part(len(log.t) - 1, len(log.t))).at(0)
        restart_state(own, here.q, here.v, noise_variance(own.noise))
        return own, signals


def _three(
    start: Filter, signals: Signals, hypothesis: Hypothesis, middle: float, step: float
) -> tuple[Trial, Trial, Trial]:
    """Trials at three errors, from a filter and the signals before."""
    errors = [signals.biased(hypothesis.channel, middle + i * step) for i in (-1, 0, 1)]
    scale = np.ones(len(start.theta))  # its θ does not jump
    one, two, three = (Trial.begin(start, biased, hypothesis, scale) for biased in errors)
    return one, two, three


def _jumps(system: SecondOrderSystem, log: Log, k: int) -> Array:
    """(2n,) jump of every sensor from sample k to the next, beyond what the motion explains."""
    n, places = system.n, {6: 3, 3: 2}.get(system.group, 0)
    earlier, now = increments(system, log.part(k - 1, k + 2))
    jump = now - earlier
    jump[:n] = now[:n] - (log.t[k + 1] - log.t[k]) * log.v[k]
    jump[:places] = system.J(log.q[k])[:places, :places] @ jump[:places]  # in world axes
    return jump
