"""Filters that each try one hypothesis on the same data, after a contradiction.

All of them start from the estimate before the contradiction, at the same measurement, and differ in
what they leave free. The evidence of a hypothesis is the likelihood of the innovations, with its
jump averaged over its prior: Σ −½ (eᵀe + log det S). A trial goes on until one hypothesis is
probable enough or time is up; those that have become improbable are dropped.
"""

from __future__ import annotations

from copy import deepcopy
from typing import NamedTuple

import numpy as np

from ....log import Log, Measurement
from ....parameters import Array
from ..kalman import (
    COMPLETED,
    Filter,
    Law,
    acceptable,
    follow_filter,
    noise_variance,
    restart_state,
)
from .evidence import jumped, posterior
from .hypotheses import Hypothesis

_DROPPED = 1e-9  # probability below which a hypothesis is tried no longer
_CERTAIN = 0.995  # probability at which a hypothesis is accepted
_WALK = 0.012  # of δ in a second, as a fault may still grow [1/√s]
_LONGEST = 1.0  # time after which the most probable one is accepted [s]


class Commands(NamedTuple):
    """What reaches the actuators of the commands, as far as faults are known.

    Attributes:
        sign: (n_u,) −1 for a reversed actuator, else 1.
        held: (n_u,) the constant command of a stuck one, else NaN.
    """

    sign: Array
    held: Array

    @staticmethod
    def sound(n_u: int) -> Commands:
        """Every command reaches its actuator."""
        return Commands(np.ones(n_u), np.full(n_u, np.nan))

    def acting(self, log: Log) -> Log:
        """The log with the commands that act."""
        if (self.sign == 1).all() and np.isnan(self.held).all():
            return log
        u = np.where(np.isnan(self.held), self.sign * log.u, self.held)
        return Log.unchecked(log.t, log.q, log.v, u)

    def under(self, hypothesis: Hypothesis) -> Commands:
        """These commands, with those of a failed actuator as a hypothesis has them act."""
        sign, held, k = self.sign.copy(), self.held.copy(), hypothesis.command
        if hypothesis.kind == "reversed":
            sign[k], held[k] = -sign[k], np.nan
        elif hypothesis.command >= 0:
            held[k] = hypothesis.held
        return Commands(sign, held)


class Trial(NamedTuple):
    """A filter under one hypothesis; its tally counts from the start of the trial.

    Attributes:
        hypothesis: what it tries.
        filter: at the last sample.
        commands: that act under it.
        theta: (p,) θ̂ at the start.
        P: (p, p) P_θθ at the start, with the hypothesis's freedom.
        begin: when the trial began [s].
    """

    hypothesis: Hypothesis
    filter: Filter
    commands: Commands
    theta: Array
    P: Array
    begin: float

    @property
    def evidence(self) -> float:
        """Logarithm of the likelihood of the innovations."""
        return float(-0.5 * (self.filter.tally[2] + self.filter.tally[3]))


def begin_trials(
    kalman: Filter, here: Measurement, commands: Commands, hypotheses: list[Hypothesis]
) -> tuple[Trial, ...]:
    """Trials from a filter at a measurement, one for each hypothesis."""
    trials = []
    for hypothesis in hypotheses:
        own = deepcopy(kalman)
        own.Ptt[:] += hypothesis.D @ hypothesis.D.T
        restart_state(own, here.q, here.v, noise_variance(own.noise))
        acting = commands.under(hypothesis)
        P, theta = own.Ptt.copy(), own.theta.copy()
        trials.append(Trial(hypothesis, own, acting, theta, P, here.t))
    return tuple(trials)


def follow_trials(law: Law, trials: tuple[Trial, ...], log: Log) -> tuple[Trial, ...]:
    """The trials after a log."""
    patient, count = law._replace(window=10**9), len(log.t)
    n, p = log.v.shape[1], len(trials[0].theta)
    out = np.empty((count, p)), np.empty((count, n)), np.empty(count)
    followed = []
    for trial in trials:
        own = trial._replace(filter=deepcopy(trial.filter))
        _, end = follow_filter(patient, own.filter, *own.commands.acting(log), *out)
        own.filter.tally[1] = trial.filter.tally[1] + count - 1
        own.filter.tally[2] += 0.0 if end == COMPLETED else np.inf
        followed.append(own)
    return tuple(followed)


def narrowed(law: Law, trials: tuple[Trial, ...], window: float) -> tuple[Trial, ...]:
    """The trials that go on at the end of a window [s], and are free to follow a growing fault.

    Improbable ones are dropped. Where not even the best explains its window, or only the one with
    most freedom, the others have yet to learn the size of a large change: the evidence is counted
    anew from here.
    """
    for trial in trials:
        trial.filter.Ptt[:] += _WALK**2 * window * (trial.hypothesis.D @ trial.hypothesis.D.T)
    share = posterior_of(trials)
    if np.isnan(share).all():
        return trials
    best = trials[int(np.argmax(share))]
    if not explains(law, best) or best.hypothesis.kind == "several":
        for trial in trials:
            trial.filter.tally[1:] = 0.0
        return trials
    return tuple(trial for trial, p in zip(trials, share, strict=True) if p >= _DROPPED)


def explains(law: Law, trial: Trial) -> bool:
    """Whether chance explains the innovations of a trial."""
    tally = trial.filter.tally
    return bool(tally[2] <= acceptable(law._replace(window=int(tally[1])), trial.filter))


def posterior_of(trials: tuple[Trial, ...]) -> Array:
    """(h,) probability of every trial's hypothesis; NaN if all filters have failed."""
    evidence = np.array([trial.evidence for trial in trials])
    return posterior(evidence) if np.isfinite(evidence).any() else np.full(len(trials), np.nan)


class Verdict(NamedTuple):
    """The outcome of trials.

    Attributes:
        trial: the most probable one; None if not even that explains the data.
        confidence: its probability.
        size: of the change, its lower and its upper end, in the hypothesis's unit.
    """

    trial: Trial | None
    confidence: float
    size: tuple[float, float, float]


def verdict(law: Law, trials: tuple[Trial, ...], t: float) -> Verdict | None:
    """The outcome at time t [s], at the end of a window; None while it is open."""
    share = posterior_of(trials)
    late = t - trials[0].begin >= _LONGEST
    if np.isnan(share).all():
        return Verdict(None, 0.0, (0.0, 0.0, 0.0))
    best = int(np.argmax(share))
    trial, fits = trials[best], explains(law, trials[best])
    sure = fits and share[best] >= _CERTAIN and trial.hypothesis.kind != "several"
    if not late and not sure:
        return None
    if not fits:
        return Verdict(None, 0.0, (0.0, 0.0, 0.0))
    return Verdict(trial, float(share[best]), size_of(trial, law.scale))


def size_of(trial: Trial, scale: Array) -> tuple[float, float, float]:
    """The size of a trial's change and its 95 % interval."""
    hypothesis, kalman = trial.hypothesis, trial.filter
    if hypothesis.kind == "broken":
        return 1.0, 1.0, 1.0
    if not hypothesis.size.any():
        return 0.0, 0.0, 0.0
    jump = jumped(trial.P, kalman.Ptt, (kalman.theta - trial.theta) / scale, hypothesis.D)
    if hypothesis.kind != "stuck":
        return jump.interval(hypothesis.size)
    held = float(trial.commands.held[hypothesis.command])  # a sound actuator would do as much at
    size, *ends = (held * (1 + x) for x in jump.interval(hypothesis.size))
    return size, min(ends), max(ends)
