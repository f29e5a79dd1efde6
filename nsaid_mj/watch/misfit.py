"""Whether the motion contradicts the structure, judged from measurements alone.

The filter of the law `efficient` makes two passes along the log: the first from an estimate and its
stated covariance, the second from the result of the first. They show how well the structure
explains the motion:

- `contradicts`: innovations of the second pass are significantly too large within 0.1 s, more than
  once. The filter restarts each time. An exact structure is hardly ever contradicted, an inexact
  one repeatedly.
- `some`: that happens once, or the innovations are not white over longer times, or larger than the
  noise by more than an error of its level. W lacks a small effect; see below.
- Whether intervals hold: the change of the estimate during the first pass, as a whole and from part
  to part, is compared with its covariance.

If drifting gains were detected, only the log after the detection is judged, with process noise on
the gains. Isolated faults divide the log: contradictions due to a fault do not count against the
structure, all others do.

Test of whiteness: a neglected effect increases the innovations at the frequencies of the motion,
0.03 to a few hertz. That is far too little to be seen sample by sample, but it accumulates over 1
to 100 s. If the structure is exact, the periodogram of each normalised innovation is exponentially
distributed about its variance, independently at every frequency (Mehra, IEEE TAC 15(2), 1970).
Each octave of the spectrum therefore has its own test; so has each single frequency, for periodic
motions. The reference level is the mean of the upper half of the spectrum, but at least 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from scipy.special import gammaincc

from ..core import (
    Array,
    Cone,
    Confidence,
    EfficientState,
    Indices,
    KalmanFilter,
    Log,
    ParameterSpace,
    Prior,
    Replay,
    SecondOrderSystem,
    State,
)
from .drift import walks
from .state import kept_of

_LONGEST = 120.0  # length of log that is judged [s], and
_LONGEST_ON_GROUND = 20.0  # with contacts, where a pass costs four times as much
_SHORTEST = 32  # samples that have a spectrum


class Whiteness(NamedTuple):
    """Deviation of innovations from whiteness."""

    # p-value of the largest cell, an octave or line of a channel, times their number (Bonferroni)
    chance: float
    energy: float  # squared normalised innovations beyond expectation, in the significant cells
    channel: int  # channel of the largest cell; −1 if there is none
    period: float  # period of the largest cell [samples]; infinite for the mean


def whiteness(e: Array) -> Whiteness:
    """Tests normalised innovations (N, c) for whiteness; rows that are not finite are left out."""
    e = e[np.isfinite(e).all(axis=1)]
    if len(e) < _SHORTEST:
        return Whiteness(1.0, 0.0, -1, np.inf)
    power = np.abs(np.fft.rfft(e, axis=0)) ** 2 / len(e)
    upper = len(power) // 2
    level = np.maximum(1.0, power[upper:].mean(axis=0))
    octaves = (2**k - 1 for k in range(1, upper.bit_length() + 1))  # 1, 3, 7, 15 …
    edges = np.array([0, *(edge for edge in octaves if edge < upper), upper])
    sums = np.add.reduceat(power[:upper], edges[:-1], axis=0)
    lines = np.arange(1, upper)
    found = [
        _judged(power[lines] / level, np.ones(len(lines)), lines, level),
        _judged(sums / level, np.where(edges[:-1], np.diff(edges), 0.5), edges[:-1], level),
    ]
    chance = min(2.0 * one.chance for one in found)  # two families of tests
    energy = max(one.energy for one in found)
    best = min(found, key=lambda one: one.chance)
    return Whiteness(chance, energy, best.channel, len(e) * best.period)


def _judged(sums: Array, shape: Array, first: Indices, level: Array) -> Whiteness:
    """Tests b cells of a spectrum in c channels, with the period in units of the log's length.

    `sums` (b, c) of the periodogram over its level are Γ(shape, 1) of white innovations; `shape`
    (b,) counts the frequencies in each, ½ for the mean, `first` (b,) is the lowest of them.
    """
    sums = sums * np.where(shape < 1, 0.5, 1.0)[:, None]  # the mean is χ² of one degree
    chance = gammaincc(shape[:, None], sums)
    beyond = chance < 0.05 / chance.size
    energy = float(np.sum((2 * level * (sums - shape[:, None]))[beyond]))
    band, channel = np.unravel_index(np.argmin(chance), chance.shape)
    period = 1 / first[band] if first[band] else np.inf
    return Whiteness(float(chance.min() * chance.size), energy, int(channel), float(period))


NONE, SOME, CONTRADICTS = ("none", "some", "contradicts")
SETTLED = 1 / 3  # share of it in which the filter may still learn
REPEATED = 2  # contradictions that are no single event, such as a collision
LARGE = 1.3  # mean squared normalised innovation that is more than an error of the noise level
_CHANCE = 1e-4  # probability below which innovations are not white
_DOUBTFUL = 1e-2  # probability below which intervals are widened, though nothing is said
_PASSES = 3  # of the filter along a log that it does not explain at once
_PARTS = (1, 4, 16)  # of a log, whose shifts of the estimate are compared with its covariance
_LEARNED = 1e-3  # least share of its variance that a direction loses, to be judged by its shift
_VAGUE = 0.1  # deviation of θ over the prior's, where a log begins along which the gains drift
_ROUNDING = 1e-15  # least variance, relative to the prior's
_SHIFTED = 1.5  # mean squared normalised shift that is more than chance
_FAR = 3.0  # deviations by which no gain shifts by chance
_FRESH = 2.0  # the same, where the filter learns a log anew, linearised at its result


class Misfit(NamedTuple):
    """Goodness of fit of a structure to a log."""

    level: str  # `none`, `some` or `contradicts`
    contradictions: tuple[float, ...]  # times at which the innovations exceeded chance [s]
    innovations: float  # mean squared normalised innovation; 1 if the structure explains the motion
    seconds: float  # length of log that was judged [s]
    chance: float  # p-value of the whiteness test, for an exact structure
    widening: float = 1.0  # factor ≥ 1 on stated standard deviations that accounts for the misfit
    drift: float = 0.0  # largest mean relative rate at which a gain drifts [1/min]; 0 if constant

    LEVELS = (NONE, SOME, CONTRADICTS)
    FEWEST = 50  # rows that can be judged; the run that warms up has as many

    def keys(self) -> dict[str, Any]:
        """The keys of summary.json."""
        others = zip(self._fields[1:], self[1:], strict=True)
        return {"misfit": self.level} | {f"misfit_{name}": value for name, value in others}

    @staticmethod
    def longest(system: SecondOrderSystem) -> float:
        """The length of log that is judged, its end [s]."""
        return _LONGEST_ON_GROUND if system.structure.contacts else _LONGEST

    @staticmethod
    def during(state: State) -> str:
        """The level during a run, from the law's state alone; "" for a law without a filter.

        It is based on all innovations so far, and on contradictions that no fault explains. Early
        contradictions, which a wrong prior causes as well, no longer count once the filter has
        explained two thirds of the motion.
        """
        own = state.own
        if not isinstance(own, EfficientState):
            return ""
        squares, number = own.filter.totals
        late = own.calm < (1 - SETTLED) * state.t
        if late and own.restarts + kept_of(own).unnamed > REPEATED:
            return CONTRADICTS
        return SOME if number and squares > LARGE * number else NONE

    @staticmethod
    def of_estimate(
        estimator: KalmanFilter,
        theta: Array,
        stated: Confidence | None,
        prior: Array,
        log: Log,
        rest: Callable[[], None] | None = None,
    ) -> Misfit:
        """The misfit of a log for an estimate θ̂ (p,), with its covariance if any; prior is θ̂(0).

        `rest` is that of `replay`.
        """
        space = estimator.system.space
        theta = _sound(space, theta, prior)
        scale = space.scale
        P = estimator.covariance(theta)
        if stated is not None:
            P = _no_wider(stated.covariance / np.outer(scale, scale), P)
        return judged(estimator, theta, P, log, rest)

    @staticmethod
    def of_drift(estimator: KalmanFilter, along: Array, variance: float, log: Log) -> Misfit:
        """The misfit of a log of N measurements with drifting gains and θ̂ (N, p).

        In one pass, as the gains change along the log. `variance` is that of a gain's random walk
        per second, relative to the gain [1/s].
        """
        space = estimator.system.space
        k = space.actuators
        minutes = float(log.t[-1] - log.t[0]) / 60
        walking = estimator.walking(walks(space, 0.0, variance))
        theta = _sound(space, np.array(along[0]), np.array(along[-1]))
        own = walking.replay(theta, _VAGUE**2 * estimator.covariance(theta), log)
        one, energy = _judged_pass(own, log)
        if one.level == NONE:
            one = one._replace(level=SOME)
            energy = 0.0
        rates = np.abs(along[-1][k] / np.where(along[0][k] == 0, np.inf, along[0][k]) - 1) / minutes
        drift = float(np.where(along[0][k] == 0, 0.0, rates).max())
        widening = float(np.sqrt(1 + energy))
        chance = min(1.0, one.chance)
        return one._replace(seconds=60 * minutes, chance=chance, widening=widening, drift=drift)

    @staticmethod
    def worst(found: list[Misfit]) -> Misfit:
        """The misfit of several parts of a log: the worst level, the widening of the last part."""
        times = tuple(time for one in found for time in one.contradictions)
        level = max((one.level for one in found), key=Misfit.LEVELS.index)
        seconds = sum(one.seconds for one in found)
        innovations = sum(one.innovations * one.seconds for one in found) / seconds
        last = found[-1]
        return last._replace(
            level=CONTRADICTS if len(times) >= REPEATED else level,
            contradictions=times,
            innovations=innovations,
            seconds=seconds,
            chance=min(one.chance for one in found),
        )


def _sound(space: ParameterSpace, theta: Array, prior: Array) -> Array:
    """(p,) θ̂ inside the cone: gains of reversed actuators positive, of failed ones as before."""
    k = space.actuators
    theta = theta.copy()
    theta[k] = np.where(theta[k] == 0, prior[k], np.copysign(theta[k], prior[k]))
    if Cone.of(space).contains(theta):
        return theta
    return Prior(space, theta, 0.0).draw(np.random.default_rng(0))


def judged(
    estimator: KalmanFilter,
    theta: Array,
    P: Array,
    log: Log,
    rest: Callable[[], None] | None = None,
) -> Misfit:
    """The misfit of a log of N measurements, for a filter starting at θ (p,) with P_θθ (p, p)."""
    learning = estimator.replay(theta, P, log, rest)
    own = learning
    found = []
    for _ in range(_PASSES):  # far from its end, a pass is not linear enough to be judged by
        own = estimator.replay(own.filter.theta, own.filter.Ptt, log, rest)
        found.append(_judged_pass(own, log))
        if found[-1][0].level == NONE:
            break
    best, energy = min(found, key=lambda one: (Misfit.LEVELS.index(one[0].level), -one[0].chance))
    if best.level == NONE and best.chance >= _DOUBTFUL:
        energy = 0.0
    anew = estimator.replay(theta, estimator.covariance(theta), log, rest)
    widening = _widening(estimator.system.space, theta, P, learning, anew, energy)
    return best._replace(chance=min(1.0, best.chance), widening=widening)


def _judged_pass(own: Replay, log: Log) -> tuple[Misfit, float]:
    """The misfit of one pass along a log, without widening; also its innovations' energy."""
    seconds = float(log.t[-1] - log.t[0])
    colour = whiteness(own.along.innovation)
    squares, number = own.filter.totals
    times = own.contradictions
    innovations = float(squares / max(1.0, number))
    late = tuple(time for time in times if time > log.t[0] + SETTLED * seconds)
    level = NONE
    if len(late) >= REPEATED:
        level = CONTRADICTS
    elif late or innovations > LARGE or colour.chance < _CHANCE:
        level = SOME
    return Misfit(level, late, innovations, seconds, colour.chance), colour.energy


def _widening(
    space: ParameterSpace, theta: Array, P: Array, learning: Replay, anew: Replay, energy: float
) -> float:
    """Factor on the standard deviations of a misfit.

    It is the largest of three:

    - from the energy of the innovations: the part of an unmodelled effect that lies in the span of
      W is absorbed by the parameters, and the rest indicates its size;
    - from the shifts of the estimate over their covariance, over the whole log and from part to
      part, since an intermittent effect moves the estimate back and forth (a sandwich estimator
      with the parts as blocks);
    - from the shift of each single gain when the log is learned anew, from θ̂ with the covariance of
      a prior. In the first pass a weakly coupled gain may have become sure of a wrong value while
      the filter was still linearised far from the truth.
    """
    shifts = _shifts(space.scale, theta, P, learning)
    for own, most in ((learning, _FAR), (anew, _FRESH)):
        gains = shift_of_gains(space, theta, P, own.filter.theta)
        if gains > most and not own.contradictions:
            shifts.append(gains**2)
    largest = max((shift for shift in shifts if shift > _SHIFTED), default=1.0)
    return float(np.sqrt(max(1.0 + energy, largest)))


def shift_of_gains(space: ParameterSpace, theta: Array, P: Array, after: Array) -> float:
    """Largest shift of a gain over the mean of all, from θ (p,) to `after`, in its deviations.

    P (p, p) is the covariance of θ/scale.
    """
    stated = Confidence(P * np.outer(space.scale, space.scale), P, np.zeros(0))
    deviation = np.maximum(Confidence.of_gains(stated, theta, space), _ROUNDING)
    ratio = after[space.actuators] / theta[space.actuators]
    return float(np.max(np.abs(ratio / ratio.mean() - 1) / deviation, initial=0.0))


def _shifts(scale: Array, theta: Array, P: Array, learning: Replay) -> list[float]:
    """Mean squared shifts of θ̂ over a log and its parts, normalised: 1 where P is right."""
    unit = 1 / np.sqrt(np.diag(P))
    values, vectors = scipy.linalg.eigh(P * np.outer(unit, unit))
    whiten = (vectors / np.sqrt(np.maximum(values, 1e-14 * values[-1]))).T * unit
    # scipy's driver `evr`: numpy's divide and conquer has failed on such a matrix of a sound run
    lost = np.eye(len(P)) - whiten @ learning.filter.Ptt @ whiten.T
    share, vectors = scipy.linalg.eigh(0.5 * (lost + lost.T))
    kept = share > _LEARNED
    if learning.contradictions or not kept.any():
        return []
    whiten = (vectors[:, kept].T @ whiten) / np.sqrt(share[kept])[:, None]
    rows = learning.along.theta
    found = []
    for parts in _PARTS:
        at = np.linspace(0, len(rows) - 1, parts + 1).astype(int)
        path = np.vstack([theta, rows[at[1:]]]) / scale
        found.append(float(np.sum((np.diff(path, axis=0) @ whiten.T) ** 2) / kept.sum()))
    return found


def widened(stated: Confidence, factor: float) -> Confidence:
    """A confidence with standard deviations times a factor; what is added is at most the prior's.

    Intervals never become narrower. A limit on the sum, instead of on what is added, would narrow
    that of a limb's scale: along θ̂ the prior's many independent errors make it seem too well known.
    """
    if factor == 1.0:
        return stated
    size = np.sqrt(np.diag(stated.prior))
    units = np.outer(size, size)
    added = _no_wider((factor**2 - 1) * stated.covariance / units, stated.prior / units)
    return stated._replace(covariance=stated.covariance + added * units)


def _no_wider(P: Array, prior: Array) -> Array:
    """(p, p) (P⁻¹ + prior⁻¹)⁻¹ ≻ 0, where P may be singular, or indefinite by rounding."""
    L = np.linalg.cholesky(prior)
    inner = np.linalg.solve(L, np.linalg.solve(L, P).T)
    values, vectors = scipy.linalg.eigh(0.5 * (inner + inner.T))
    values = np.maximum(values, _ROUNDING * max(1.0, values[-1]))
    root = L @ vectors * np.sqrt(values / (1 + values))
    return root @ root.T
