"""Tests by competing filters whether actuator gains drift, as with temperature or a battery.

Once a constant θ no longer explains the motion, filters with three models of θ(t) process the same
data from the same estimate:

    θ constant;    all of θ a random walk, as W is not exact;    the gains alone a random walk,

each with several variances of the walk per second. The likelihood of the innovations, with
exponential forgetting, selects the model and its variance.

If only the gains walk, the covariance of the plant's parameters is unaffected. A battery's sag is
then observable, since all gains fall relative to the plant. The random walk lags behind a ramp: by
0.7 standard deviations at the most likely variance, by 0.1 at the next larger one. Gains do not
count as drifting if they need a fast walk, or if their innovations exceed the stated covariance:
then W is not exact, or a part has failed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core import Array, FilterState, KalmanFilter, Log, ParameterSpace

_WALKS = (1e-8, 1e-7, 1e-6, 1e-5)
"""Relative variances per second of a gain's random walk [1/s]; the last counts as no drift."""
_ALL = (1e-8, 1e-6)  # those of all of θ
_FREED = 0.1  # initial standard deviation of θ in rivals, over that of a prior
_MEMORY = 20.0  # time in which evidence is forgotten [s]
_EARLIEST = 5.0  # time after which they are compared [s]
LONGEST = 30.0
"""Time after which gains that seem constant are taken for constant [s]."""
_SURE = 15.0  # logarithm of the likelihood ratio at which a model is accepted
_BEHIND = 50.0  # evidence, below the best, at which a model restarts
_WHITE = 1.1  # largest mean squared normalised innovation of gains that drift
_BETTER = 3.0  # at which another variance is


class DriftHypothesis(NamedTuple):
    """A filter with one model of θ(t), and the evidence for that model."""

    filter: FilterState  # at the last sample
    all_of: float  # variance per second of all of θ, relative to itself [1/s]
    gains: float  # that of the gains, in addition [1/s]

    @property
    def evidence(self) -> float:
        """Log-likelihood of the innovations, with forgetting."""
        found = float(-0.5 * (self.filter.tally[2] + self.filter.tally[3]))
        return found if np.isfinite(found) else -np.inf

    def followed(self, estimator: KalmanFilter, log: Log) -> DriftHypothesis:
        """The rival after a log, under the signals that act."""
        own = self.filter.copied()
        fade = np.exp(-(log.t[-1] - log.t[0]) / _MEMORY)
        own.tally[2:] *= fade
        walk = walks(estimator.system.space, self.all_of, self.gains)
        estimator.walking(walk).carry(own, log)
        return self._replace(filter=own)

    def led_by(self, best: DriftHypothesis) -> DriftHypothesis:
        """This model, restarted at the estimate of the best one, with slightly less evidence.

        Without the restart a diverged filter could not win once its model becomes correct.
        """
        own = best.filter.copied()
        own.tally[2] += 2 * _BEHIND
        return self._replace(filter=own)


class Rivals(NamedTuple):
    """Rivals started at the same time."""

    each: tuple[
        DriftHypothesis, ...
    ]  # of every model and variance, the walks of the gains alone last
    begin: float  # when they began [s]

    @staticmethod
    def at(kalman: FilterState, prior: Array, t: float) -> Rivals:
        """Rivals that begin at time t [s] with the filter's estimate, but less certain of it.

        Their covariance is a share of the prior's (p, p), small enough that no parameter leaves the
        cone.
        """
        start = kalman.copied()
        start.Ptt[:] += _FREED**2 * prior
        start.tally[1:] = 0.0
        start.totals[:] = 0.0
        models = [(0.0, 0.0), *((w, 0.0) for w in _ALL), *((0.0, w) for w in _WALKS)]
        return Rivals(tuple(DriftHypothesis(start, *model) for model in models), t)

    def followed(self, estimator: KalmanFilter, log: Log) -> Rivals:
        """The rivals after a log, under the signals that act."""
        each = tuple(rival.followed(estimator, log) for rival in self.each)
        best = max(each, key=lambda rival: rival.evidence)
        least = best.evidence - 2 * _BEHIND
        each = tuple(one if one.evidence >= least else one.led_by(best) for one in each)
        return self._replace(each=each)

    def preferred(self, t: float, drift: float) -> DriftHypothesis | None:
        """The rival to continue with at time t [s]; None to keep the current filter.

        `drift` is the variance per second by which the gains walk now; 0 if constant [1/s].
        """
        if t - self.begin < _EARLIEST:
            return None
        evidence = np.array([rival.evidence for rival in self.each])
        first = len(self.each) - len(_WALKS)
        gains = first + int(np.argmax(evidence[first:]))
        other = int(np.argmax(evidence[:first]))
        squares, number = self.each[gains].filter.totals
        slow = gains + 1 < len(self.each) and bool(squares <= _WHITE * number)
        if drift and (not slow or evidence[other] > evidence[gains] + _SURE):
            return self.each[other]
        if not drift and not (slow and evidence[gains] > evidence[other] + _SURE):
            return None
        wider = gains + 1  # the lag is then well below the deviation
        now = [i for i, rival in enumerate(self.each) if drift and rival.gains == drift]
        likely = max(first, now[0] - 1) if now else None  # one below the current variance
        if likely is not None and evidence[gains] < evidence[likely] + _BETTER:
            return None
        return None if now == [wider] else self.each[wider]


def walks(space: ParameterSpace, all_of: float, gains: float) -> Array:
    """(p,) variances per second of all of θ, and of the gains in addition [1/s]."""
    found = np.full(len(space), all_of)
    found[space.actuators] += gains
    return found
