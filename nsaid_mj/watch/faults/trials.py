"""Trials of all hypotheses on the same data, after a contradiction.

All trials start at the last sample before the fault, with the earlier estimate. They differ in the
parameters that they estimate anew. The evidence of a hypothesis is the likelihood of the
innovations, marginalised over the prior of these parameters: Σ −½ (eᵀe + log det S). Improbable
hypotheses are dropped on the way. The trials end when one hypothesis is probable enough, or at the
time limit.
"""

from typing import NamedTuple, TypeVar

import numpy as np

from ...core import Array, FilterState, KalmanFilter, Log, Signals
from .evidence import posterior
from .hypotheses import Hypothesis, penalty, together
from .signals import signals_under
from .trial import BiasTrial, FaultTrial, jumps_at, started

_DROPPED = 1e-9  # probability below which a hypothesis is dropped
_HOPELESS = 1000.0  # evidence below that of the best single fault at which another one is dropped
_CERTAIN = 0.995  # probability at which a hypothesis is accepted
_LONGEST = 1.0  # time after which such a probability suffices [s]
_LIKELY = 0.95
_PATIENCE = 5.0  # time after which the most probable one is accepted, as of slow vehicles [s]
_NEAR = 200.0  # evidence that repeating a trial of a sensor's error can gain
_TOGETHER = 10  # samples along which trials run at once: one by one takes four times as long
_PASSES = 4  # repeated linearisations of a trial, and what each must achieve
_BETTER = 0.99
_PATIENT = ("several", "bias", "payload")
"""Kinds not accepted early, nor is an inexact structure: with all of θ free it explains a fault as
well, until more data penalise its number of parameters; the last two so that their size can be
estimated."""


class Trials(NamedTuple):
    """Trials of several hypotheses."""

    each: tuple[FaultTrial | BiasTrial, ...]  # those still running
    start: FilterState  # the filter at the last sample before the fault
    before: Signals  # the signals known to act until then
    log: Log  # from that sample on, as recorded
    samples: int  # in the current window
    counted: int = 0  # sample of the log from which on innovations count as evidence
    due: int = 0  # length of the log from which the trials are repeated, at a window's end
    reached: int = 0  # last processed sample of the log; later ones are buffered, see `_TOGETHER`

    @property
    def begin(self) -> float:
        """Time of the first sample that may contradict the earlier estimate [s]."""
        return float(self.log.t[1])


def begin_trials(
    estimator: KalmanFilter,
    kalman: FilterState,
    signals: Signals,
    hypotheses: list[Hypothesis],
    log: Log,
    k: int,
) -> Trials:
    """Trials of hypotheses along a log, as recorded, from sample k ≥ 3, the last before the fault.

    `kalman` has θ̂ and P_θθ from before the fault, when `signals` acted.
    """
    before = signals.acting(estimator.system, log)
    start = started(estimator, kalman, before, k)
    rest = log.part(k, len(log.t))
    jumps = jumps_at(estimator.system, before, k)
    scale = estimator.constants.scale
    each = tuple(
        BiasTrial.begin(start, signals, h, jumps)
        if h.channel >= 0
        else FaultTrial.begin(start, signals_under(signals, h), h, scale)
        for h in hypotheses
    )
    each = tuple(trial.followed(estimator, rest, signals) for trial in each)
    return Trials(each, start, signals, rest, len(rest.t) - 1, reached=len(rest.t) - 1)


def follow_trials(estimator: KalmanFilter, trials: Trials, log: Log) -> Trials:
    """The trials after a log; at a window's end they are repeated where that makes them exact.

    They are repeated whenever the log has become twice as long, and once when a lower probability
    begins to suffice. All repetitions together thus cost no more than a few passes along the log.
    """
    known = Log.joined(trials.log.first(len(trials.log.t) - 1), log)
    each = trials.each
    reached = trials.reached
    last = len(known.t) - 1
    samples = trials.samples + len(log.t) - 1
    window = estimator.constants.window
    while reached < last if samples >= window else reached + _TOGETHER <= last:
        some = known.part(reached, min(reached + _TOGETHER, last) + 1)
        each = _hopeful(estimator, tuple(trial.followed(estimator, some) for trial in each))
        reached += len(some.t) - 1
    trials = trials._replace(each=each, log=known, samples=samples, reached=reached)
    if samples < window:
        return trials
    over = known.t[-1 - samples] < trials.begin + _LONGEST <= known.t[-1]
    if len(known.t) < trials.due and not over:
        return trials
    least = max(trial.evidence for trial in each) - _NEAR
    each = tuple(_repeated(trial, estimator, trials, least) for trial in each)
    return trials._replace(each=each, due=2 * len(known.t) - 1)


def _hopeful(
    estimator: KalmanFilter, each: tuple[FaultTrial | BiasTrial, ...]
) -> tuple[FaultTrial | BiasTrial, ...]:
    """The trials without hopeless single faults, provided that one trial explains the motion.

    Those with much of θ free are excluded from the comparison, as in `narrowed`.
    """
    single = [trial for trial in each if _is_single(trial.hypothesis)]
    best = max(single, key=lambda trial: trial.evidence, default=None)
    if best is None or not explains(estimator, best):
        return each
    least = best.evidence - _HOPELESS
    return tuple(t for t in each if t.evidence >= least or not _is_single(t.hypothesis))


def _is_single(hypothesis: Hypothesis) -> bool:
    """Whether it is of a single fault, or none, and leaves little of θ free."""
    return hypothesis.share == 0 and hypothesis.kind != "several"


def narrowed(estimator: KalmanFilter, trials: Trials) -> Trials:
    """The trials that continue at the end of a window, free to follow a growing fault.

    Improbable ones are dropped. Single faults are compared with one another only, because a filter
    with most of θ free explains any motion for a while. If no trial explains its window, or only
    that of all actuators does, the others have not converged to a large change yet, and all
    evidence is reset.
    """
    for trial in trials.each:
        trial.freed(estimator.constants.window * estimator.dt)
    share = posterior_of(trials)
    if np.isnan(share).all():
        return trials._replace(samples=0)
    best = trials.each[int(np.argmax(share))]
    if not explains(estimator, best) or best.hypothesis.kind == "several":
        each = tuple(trial.forgetting() for trial in trials.each)
        trials = trials._replace(counted=len(trials.log.t) - 1)
    else:
        single = np.array([_is_single(trial.hypothesis) for trial in trials.each])
        least = _DROPPED * np.where(single, share[single].max(initial=0.0), 1.0)
        each = tuple(trial for trial, kept in zip(trials.each, share >= least, strict=True) if kept)
    return trials._replace(each=each, samples=0)


def _repeated(
    trial: FaultTrial | BiasTrial, estimator: KalmanFilter, trials: Trials, least: float
) -> FaultTrial | BiasTrial:
    """A trial along the same log, linearised at its own estimate.

    A trial of a sensor's error is repeated once, if its evidence is at least `least`; one of a load
    or of a stuck actuator as long as that explains the log better.
    """
    if isinstance(trial, BiasTrial):
        if trial.evidence < least or not trial.coarse:
            return trial
        return _along(trial.again(trials.start), estimator, trials)
    far = bool(trial.hypothesis.offset) or trial.hypothesis.kind == "stuck"
    for _ in range(_PASSES if far else 0):
        try:
            again = _along(trial.again(trials.start, estimator), estimator, trials)
        except np.linalg.LinAlgError:  # it diverged
            break
        better = 1.0 if trial.hypothesis.kind == "stuck" else _BETTER
        if not again.earlier + again.squares < better * (trial.earlier + trial.squares):
            break
        trial = again
    return trial


T = TypeVar("T", FaultTrial, BiasTrial)


def _along(trial: T, estimator: KalmanFilter, trials: Trials) -> T:
    """A trial from its start along the trials' log, its evidence counted as theirs."""
    log = trials.log
    split = trials.counted
    before = trials.before
    if not split:
        return trial.followed(estimator, log, before)
    trial = trial.followed(estimator, log.first(split + 1), before).forgetting()
    return trial.followed(estimator, log.part(split, len(log.t)))


def explains(estimator: KalmanFilter, trial: FaultTrial | BiasTrial) -> bool:
    """Whether the innovations of a trial agree with their covariance."""
    return trial.squares <= estimator.acceptable(trial.filter)


def posterior_of(trials: Trials) -> Array:
    """(h,) probability of every trial's hypothesis; NaN if all filters have failed."""
    evidence = np.array([trial.evidence - penalty(trial.hypothesis) for trial in trials.each])
    return posterior(evidence) if np.isfinite(evidence).any() else np.full(len(evidence), np.nan)


class Decision(NamedTuple):
    """The outcome of trials."""

    # the most probable; None if not even that explains the data
    trial: FaultTrial | BiasTrial | None
    confidence: float = 0.0  # its probability, with that of other trials of the same fault


def verdict(estimator: KalmanFilter, trials: Trials, t: float) -> Decision | None:
    """The verdict at time t [s], at the end of a window; None while undecided."""
    share = posterior_of(trials)
    late = t - trials.begin
    if np.isnan(share).all():
        return Decision(None)
    best = int(np.argmax(share))
    trial = trials.each[best]
    fits = explains(estimator, trial)
    confidence = together(share, [trial.hypothesis for trial in trials.each], best)
    patient = trial.hypothesis.kind in _PATIENT or trial.hypothesis.share > 0
    sure = fits and confidence >= _CERTAIN and not patient
    if late >= _LONGEST and not fits:
        return Decision(None)
    likely = confidence >= _LIKELY or late >= _PATIENCE
    if not sure and not (late >= _LONGEST and likely):
        return None
    return Decision(trial, confidence)
