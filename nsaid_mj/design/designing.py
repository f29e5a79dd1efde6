"""Designs an excitation: limits, a first stage by the Gramian, a search by the bound, a check.

1. The limits are those given, and otherwise those that the scenario's own random excitation has.
2. Random candidates are ranked by the Gramian on P_⊥, which costs a tenth of the bound.
3. From the best one an evolution strategy minimises the criterion, averaged over draws of θ.
4. The winner is simulated in closed loop under every draw. A motion that breaks a limit is made
   smaller until it does not, or refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ..control import DriverConfig, FourierTracking
from ..errors import NoMotion
from ..log import Log
from ..parameters import Array
from .arms import JointMotions
from .asked import GAINS, Asked, asked_for
from .experiment import DRAWS, Experiment
from .information import bound_cost, check_criterion, gramian_cost, predicted, rms
from .limits import Limit, Limits, envelope, extents_of, units_of
from .search import minimise
from .vehicles import DrivenMotions

_REHEARSED = 6  # random motions from which limits are taken
_REHEARSAL = 20.0  # longest of them [s]
_SCREENED, _TRIED = 48, 4  # candidates of the first stage, and those that the bound is asked about
_STEP = 0.3  # first step of the search
_SHRINK = 0.97  # of a motion that breaks a limit, beyond what its use says
_ATTEMPTS = 8
_SAMPLE, _ENTRY = 1.5e-5, 3e-8  # time of the bound per sample, and per entry of its regressor [s]
_EFFORT = 60.0  # time of the search on one core [s]
_FEWEST, _MOST = 96, 3000  # candidates of the search

Told = Callable[[str, float | None], None]
"""Called with what is being done, and with the share that is done if that is known."""


@dataclass(frozen=True, eq=False)
class Design:
    """A designed excitation, and what it was designed for.

    Attributes:
        experiment: what was known beforehand.
        limits: that it keeps.
        asked: what it was asked for.
        criterion: what was minimised.
        driver: makes the motion.
        logs: the simulated motion under every draw, of exact sensors.
        uses: of every limit, the largest over the draws.
        covariances: (DRAWS, p, p) predicted of θ̂/scale.
        compared: predicted rms deviations of what is asked for, of random motions of the
            scenario's own excitation.
        evaluations: number of candidates that were judged.
        stride: time steps between the samples at which information is computed.
    """

    experiment: Experiment
    limits: Limits
    asked: Asked
    criterion: str
    driver: DriverConfig
    logs: tuple[Log, ...]
    uses: dict[str, float]
    covariances: Array
    compared: Array
    evaluations: int
    stride: int

    def covariance(self, log: Log, draw: int, experiment: Experiment | None = None) -> Array:
        """(p, p) predicted of θ̂/scale after a simulated motion under a draw.

        Args:
            log: the motion.
            draw: number of the draw.
            experiment: with other sensors; None for the design's own.
        """
        return predicted(experiment or self.experiment, _coarse(self.stride, log), draw)

    @property
    def deviations(self) -> Array:
        """(k,) predicted standard deviations of what is asked for, rms over the draws."""
        return np.sqrt(np.mean(self._all() ** 2, axis=0))

    @property
    def predicted(self) -> float:
        """The rms of all predicted standard deviations."""
        return rms(self._all())

    def _all(self) -> Array:
        pairs = zip(self.covariances, self.experiment.draws, strict=True)
        return np.array([self.asked.deviations(P, theta) for P, theta in pairs])


def design(
    experiment: Experiment,
    *,
    wanted: str = GAINS,
    criterion: str = "bound",
    limits: Callable[[Limits], Limits] = lambda found: found,
    seed: int = 0,
    effort: float = 1.0,
    told: Told = lambda _words, _share: None,
) -> Design:
    """Finds an excitation. The same arguments give the same bits.

    Args:
        experiment: what is known beforehand.
        wanted: what is asked for; see `asked_for`.
        criterion: one of `CRITERIA`.
        limits: turns the default limits into those that hold.
        seed: of the search.
        effort: multiplies the number of candidates.
        told: receives progress.

    Raises:
        InvalidInput, UnknownName: an argument cannot be used, or the system cannot be designed for.
        NoMotion: no motion within the limits was found.
    """
    check_criterion(criterion)
    asked = asked_for(wanted, experiment.system.space)
    base = experiment.scenario.excitation
    told("rehearsing random motions", None)
    rehearsals = _rehearsals(experiment, base)
    chosen = limits(_default_limits(experiment, base, rehearsals))
    motions = _family(experiment, chosen, base)
    rng = np.random.default_rng(seed)
    told("first stage: Gramian on P_⊥", None)
    start = _first_stage(motions, asked, rng)
    costs = _Costs(motions, asked, criterion)
    count = int(effort * _evaluations(motions, criterion))
    found = minimise(
        costs, start, _STEP, max(count, 17), rng, lambda share: told("searching", share)
    )
    if not np.isfinite(found.cost):
        raise NoMotion("no motion could be simulated under the prior", "Widen the limits.")
    told("checking the motion", None)
    driver, logs, uses = _checked(motions, found.x)
    covariances = [
        predicted(experiment, _coarse(motions.stride, log), d) for d, log in enumerate(logs)
    ]
    random = [
        rms(asked.deviations(predicted(experiment, _coarse(motions.stride, log), d), theta))
        for d, log in rehearsals
        for theta in experiment.draws[d : d + 1]
    ]
    return Design(
        experiment, chosen, asked, criterion, driver, logs, uses, np.array(covariances),
        np.array(random), found.evaluations, motions.stride,
    )  # fmt: skip


Motions = JointMotions | DrivenMotions


def _family(experiment: Experiment, limits: Limits, base: DriverConfig) -> Motions:
    """The kind of motion that suits a scenario's excitation."""
    if isinstance(base, FourierTracking):
        return JointMotions(experiment, limits, base)
    return DrivenMotions(experiment, limits, base)


def _rehearsals(experiment: Experiment, base: DriverConfig) -> list[tuple[int, Log]]:
    """Simulated random motions, each with the number of its draw.

    Raises:
        NoMotion: none can be simulated.
    """
    duration = min(experiment.scenario.duration, _REHEARSAL)
    made = [
        (seed % DRAWS, experiment.simulate(base, seed % DRAWS, duration, seed))
        for seed in range(_REHEARSED)
    ]
    found = [(draw, log) for draw, log in made if log is not None]
    if not found:
        raise NoMotion(
            "the scenario's own excitation diverges under the prior",
            "Take a gentler excitation, a shorter time step or a smaller initial_error.",
        )
    return found


def _default_limits(
    experiment: Experiment, base: DriverConfig, rehearsals: Sequence[tuple[int, Log]]
) -> Limits:
    """What the scenario's own excitation keeps: an arm's median motion, any motion of a vehicle.

    An arm's positions may use the range that the excitation is given.
    """
    system, units = experiment.system, units_of(experiment.system)
    extents = [extents_of(system, log, experiment.draws[draw]) for draw, log in rehearsals]
    found = envelope(extents, 1.0 if system.group else 0.5)
    limits = {name: Limit(*_apart(*ends), units[name]) for name, ends in found.items()}
    if isinstance(base, FourierTracking):
        low, high = system.limits  # type: ignore[attr-defined]  # a MotorTree
        half, middle = 0.5 * base.reach * (high - low), 0.5 * (high + low)
        own = limits["position"]
        limits["position"] = Limit(
            np.minimum(own.low, middle - half), np.maximum(own.high, middle + half), own.unit
        )
    return Limits(limits)


def _apart(low: Array, high: Array) -> tuple[Array, Array]:
    """The ends of ranges, moved apart where a quantity does not change, as of a locked joint."""
    return np.minimum(low, high - 1e-6), np.maximum(high, low + 1e-6)


def _first_stage(motions: Motions, asked: Asked, rng: np.random.Generator) -> Array:
    """The best of random candidates by the Gramian, then by the bound."""
    experiment, ranked = motions.experiment, []
    count = _SCREENED if motions.parallel else _TRIED
    for _ in range(count):
        candidate = motions.random(rng)
        log, penalty = motions.candidate(candidate, 0)
        cost = np.inf
        if np.isfinite(penalty):
            cost = gramian_cost(experiment, asked, motions.period(log), 0, "bound")
        ranked.append((cost * (1 + penalty), candidate))
    ranked.sort(key=lambda pair: pair[0])
    costs = _Costs(motions, asked, "bound")
    few = [candidate for _, candidate in ranked[:_TRIED]]
    return few[int(np.argmin(costs(few)))]


class _Costs:
    """The criterion of candidates, averaged over draws of the prior, with penalties.

    Args:
        motions: turns candidates into motions.
        asked: what is asked for.
        criterion: what is minimised.
    """

    def __init__(self, motions: Motions, asked: Asked, criterion: str):
        self._motions, self._asked, self._criterion = motions, asked, criterion

    def __call__(self, candidates: Sequence[Array]) -> Sequence[float]:
        if not self._motions.parallel:
            return [self._cost(candidate) for candidate in candidates]
        with ThreadPoolExecutor(2) as pool:
            return list(pool.map(self._cost, candidates))

    def _cost(self, candidate: Array) -> float:
        own = [self._under(candidate, draw) for draw in range(_draws(self._motions))]
        return float(np.mean(own))

    def _under(self, candidate: Array, draw: int) -> float:
        motions, experiment = self._motions, self._motions.experiment
        log, penalty = motions.candidate(candidate, draw)
        if not np.isfinite(penalty):
            return np.inf
        if self._criterion == "bound":
            return bound_cost(experiment, self._asked, log, draw) * (1 + penalty)
        own = gramian_cost(experiment, self._asked, motions.period(log), draw, self._criterion)
        scale = experiment.system.p if self._criterion == "d-optimal" else own
        return own + scale * penalty


def _draws(motions: Motions) -> int:
    return 2 if motions.parallel else 1


def _evaluations(motions: Motions, criterion: str) -> int:
    """Number of candidates that take about `_EFFORT` seconds."""
    system, scenario = motions.experiment.system, motions.experiment.scenario
    log, _ = motions.candidate(np.zeros(motions.size), 0)
    samples = len(log.t) if criterion == "bound" else len(motions.period(log).t)
    each = samples * (_SAMPLE + _ENTRY * system.n * system.p)
    if not motions.parallel:
        each += 3e-5 * scenario.duration / scenario.dt
    return int(np.clip(_EFFORT / (each * _draws(motions)), _FEWEST, _MOST))


def _coarse(every: int, log: Log) -> Log:
    """A simulated motion at the steps at which its information is computed."""
    return Log.unchecked(*(np.ascontiguousarray(part[::every]) for part in log))


def _checked(
    motions: Motions, candidate: Array
) -> tuple[DriverConfig, tuple[Log, ...], dict[str, float]]:
    """The candidate's driver, made smaller until its simulations keep all limits.

    Raises:
        NoMotion: it breaks one even so.
    """
    experiment, share = motions.experiment, 1.0
    uses: dict[str, float] = {}
    for _ in range(_ATTEMPTS):
        driver = motions.driver(candidate, share)
        logs = [
            experiment.simulate(driver, draw, experiment.scenario.duration) for draw in range(DRAWS)
        ]
        if any(log is None for log in logs):
            share *= 0.8
            continue
        found = [
            motions.limits.uses(extents_of(experiment.system, log, theta))
            for log, theta in zip(logs, experiment.draws, strict=True)
            if log is not None
        ]
        uses = {name: max(own[name] for own in found) for name in found[0]}
        if max(uses.values()) <= 1:
            return driver, tuple(log for log in logs if log is not None), uses
        share *= _SHRINK / min(max(uses.values()), 1.5)
    worst = max(uses, key=lambda name: uses[name]) if uses else "stability"
    raise NoMotion(
        f"the best motion found breaks the limit of {worst}"
        + (f" by {100 * (uses[worst] - 1):.0f} % in simulation" if uses else " in simulation"),
        f"Widen the limit of {worst}, or give a larger margin.",
    )
