"""Designs an excitation: limits, a first stage by the Gramian, a search by the bound, a check.

1. The limits are those given, or else those of the scenario's own random excitation.
2. Random candidates are ranked by the Gramian on P_⊥, which costs a tenth of the bound.
3. From the best one an evolution strategy minimises the criterion, averaged over draws of θ.
4. The winner is simulated in closed loop under every draw. A motion that breaks a limit is made
   smaller until it does not, or rejected.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ...base import CHOICES, NoEstimate
from ...core import Array, Log
from ...lab import DriverConfig, FourierTracking
from .errors import NoMotion
from .experiment import DRAWS, Experiment
from .information import (
    GAINS,
    Asked,
    asked_for,
    bound_cost,
    gramian_cost,
    information,
    predicted,
    rms,
)
from .limits import COMMAND, RANDOM, Limit, Limits, envelope, extents_of, units_of
from .motions import DrivenMotions, JointMotions, Motions, checked, coarse
from .search import Found, minimise

_MOTIONS = 12  # random motions from which limits are taken
_LONGEST = 20.0  # longest of them [s]
_SCREENED = 48  # candidates of the first stage, and those that the bound then judges
_TRIED = 4
_FIRST = 0.75  # share of the search under a single draw of the prior
_STEP = 0.3  # first steps of its two parts
_LATER = 0.1
_RESOLVED = 0.1  # accepted relative change of the bound with the step
_MEDIAN = 0.5  # shares of random motions that keep the default limits
_ALL = 1.0
_MORE = 0.05  # added to both ends of the range of a vehicle's random motions: they are few
_NEXT = 40  # next best motions of a vehicle
_SAMPLE = 1.5e-5  # time of the bound per sample, and per entry of its regressor [s]
_ENTRY = 3e-8
_EFFORT = 60.0  # time of the search on one core [s]
_SIMULATED = 5e-5  # time of a simulated step of a vehicle [s]
_FEWEST = 96  # candidates of the search
_MOST = 6000

Report = Callable[[str, float | None], None]
"""Called with the current stage, and its completed share if known."""


@dataclass(frozen=True, eq=False)
class Design:
    """A designed excitation, and its objective."""

    experiment: Experiment  # the prior knowledge
    limits: Limits  # that it keeps
    asked: Asked  # the objective's numbers
    criterion: str  # the minimised criterion
    driver: DriverConfig  # makes the motion
    logs: tuple[Log, ...]  # the simulated motion under every draw, of exact sensors
    uses: dict[str, float]  # use of every limit, the largest over the draws
    covariances: Array  # (DRAWS, p, p) predicted of θ̂/scale
    # predicted rms deviations of the requested numbers, for random motions of the scenario's own
    # excitation
    compared: Array
    evaluations: int  # number of judged candidates
    stride: int  # time steps between the samples at which information is computed

    def covariance(self, log: Log, draw: int, experiment: Experiment | None = None) -> Array:
        """(p, p) predicted of θ̂/scale after a motion simulated under a draw.

        `experiment` may have other sensors than the design's.
        """
        return predicted(experiment or self.experiment, coarse(self.stride, log), draw)

    def information(
        self, log: Log, draw: int, basis: Array, experiment: Experiment | None = None
    ) -> Array:
        """(d, d) of a simulated motion about Zᵀθ/scale, Z = `basis` (p, d); see `covariance`."""
        own = experiment or self.experiment
        return information(own, coarse(self.stride, log), draw, basis)

    @property
    def deviations(self) -> Array:
        """(k,) predicted standard deviations of the requested numbers, rms over the draws."""
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
    report: Report = lambda _words, _share: None,
) -> Design:
    """Finds an excitation; equal arguments give equal bits.

    Args:
        experiment: the prior knowledge.
        wanted: the requested numbers; see `asked_for`.
        criterion: one of `CHOICES`.
        limits: maps the default limits to those that apply.
        seed: seed of the search.
        effort: multiplies the number of candidates.
        report: receives progress.

    Raises:
        InvalidInput, UnknownName: an argument cannot be used, or the system does not allow a
            design.
        NoMotion: no motion within the limits was found.
    """
    CHOICES.check("criterion", criterion)
    asked = asked_for(wanted, experiment.system.space)
    base = experiment.scenario.excitation
    report("simulating random motions", None)
    simulated = _random_motions(experiment, base)
    chosen = limits(_default_limits(experiment, base, simulated, _MEDIAN))
    largest = limits(_default_limits(experiment, base, simulated, _ALL))
    if isinstance(base, FourierTracking):
        motions: Motions = JointMotions(experiment, chosen, base)
    else:
        motions = DrivenMotions(experiment, chosen, base)
    rng = np.random.default_rng(seed)
    report("first stage: Gramian on P_⊥", None)
    _resolve(motions, asked, rng)
    start = _first_stage(motions, asked, rng)
    found, candidates = _searched(motions, asked, criterion, start, effort, rng, report)
    if not np.isfinite(found.cost):
        raise NoMotion("no motion could be simulated under the prior", "Widen the limits.")
    report("checking the motion", None)
    driver, logs, uses = checked(motions, candidates, largest)
    found_for = _covariances(motions, [*enumerate(logs), *simulated])
    random = [
        rms(asked.deviations(own, experiment.draws[draw]))
        for (draw, _), own in zip(simulated, found_for[DRAWS:], strict=True)
    ]
    covariances = np.array(found_for[:DRAWS])
    return Design(
        experiment,
        largest,
        asked,
        criterion,
        driver,
        logs,
        uses,
        covariances,
        np.array(random),
        found.evaluations,
        motions.stride,
    )


def _covariances(motions: Motions, logs: Sequence[tuple[int, Log]]) -> list[Array]:
    """Predicted (p, p) covariances of motions under draws, at steps that resolve all of them.

    Friction is stiffer in slow motion than in the random motions for which the step was chosen.

    Raises:
        NoEstimate: the time step of the simulation does not resolve it either.
    """
    while True:
        try:
            return [
                predicted(motions.experiment, coarse(motions.stride, log), draw)
                for draw, log in logs
            ]
        except NoEstimate:
            if motions.stride == 1:
                raise
            motions.stride = max(1, motions.stride // 2)


def _random_motions(experiment: Experiment, base: DriverConfig) -> list[tuple[int, Log]]:
    """Simulated random motions, each with the number of its draw; raises `NoMotion` if none."""
    duration = min(experiment.scenario.duration, _LONGEST)
    made = [
        (seed % DRAWS, experiment.simulate(base, seed % DRAWS, duration, seed))
        for seed in range(_MOTIONS)
    ]
    found = [(draw, log) for draw, log in made if log is not None]
    if not found:
        remedy = "Use a gentler excitation, a shorter time step or a smaller initial_error."
        raise NoMotion("the scenario's own excitation diverges under the prior", remedy)
    return found


def _default_limits(
    experiment: Experiment, base: DriverConfig, motions: Sequence[tuple[int, Log]], share: float
) -> Limits:
    """The limits that a share of the scenario's own random motions keep; a vehicle's are wider.

    An arm's positions may use the range given to the excitation. An arm's motion is planned within
    the limits that the median keeps, so that it is no larger than a random one, and checked against
    those that all keep, because the other joints' motion moves a light joint.
    """
    system = experiment.system
    units = units_of(experiment.system)
    extents = [extents_of(system, log, experiment.draws[draw]) for draw, log in motions]
    found = envelope(extents, _ALL if system.group else share)
    limits = {}
    for name, (low, high) in found.items():
        more = _MORE * (high - low) if system.group and name != COMMAND else 0.0
        # ends are apart also where a quantity does not change, as of a locked joint
        least = low - more
        most = high + more
        ends = np.minimum(least, most - 1e-6), np.maximum(most, least + 1e-6)
        limits[name] = Limit(*ends, units[name])
    if isinstance(base, FourierTracking):
        low, high = system.limits  # type: ignore[attr-defined]  # a JointTree
        half = 0.5 * base.reach * (high - low)
        middle = 0.5 * (high + low)
        own = limits["position"]
        limits["position"] = Limit(
            np.minimum(own.low, middle - half), np.maximum(own.high, middle + half), own.unit
        )
    return Limits(limits, sources=dict.fromkeys(limits, RANDOM))


def _first_stage(motions: Motions, asked: Asked, rng: np.random.Generator) -> Array:
    """The best of random candidates by the Gramian, then by the bound."""
    experiment = motions.experiment
    ranked = []
    for _ in range(_SCREENED if motions.parallel else _TRIED):
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

    `seen` has all judged candidates as (cost, candidate).
    """

    def __init__(self, motions: Motions, asked: Asked, criterion: str, draws: int = 1):
        self._motions = motions
        self._asked = asked
        self._criterion = criterion
        self._draws = draws
        self.seen: list[tuple[float, Array]] = []

    def __call__(self, candidates: Sequence[Array]) -> Sequence[float]:
        if self._motions.parallel:
            with ThreadPoolExecutor(2) as pool:
                found = list(pool.map(self._cost, candidates))
        else:
            found = [self._cost(candidate) for candidate in candidates]
        self.seen += zip(found, candidates, strict=True)
        return found

    def _cost(self, candidate: Array) -> float:
        return float(np.mean([self._under(candidate, draw) for draw in range(self._draws)]))

    def _under(self, candidate: Array, draw: int) -> float:
        motions = self._motions
        experiment = self._motions.experiment
        log, penalty = motions.candidate(candidate, draw)
        if not np.isfinite(penalty):
            return np.inf
        if self._criterion == "bound":
            return bound_cost(experiment, self._asked, log, draw) * (1 + penalty)
        own = gramian_cost(experiment, self._asked, motions.period(log), draw, self._criterion)
        scale = experiment.system.p if self._criterion == "d-optimal" else own
        return own + scale * penalty


def _resolve(motions: Motions, asked: Asked, rng: np.random.Generator) -> None:
    """Shortens an arm's time step until the bound of random motions hardly depends on it.

    Friction may be too stiff for the longest step.
    """
    if not isinstance(motions, JointMotions):
        return
    few = [motions.random(rng) for _ in range(3)]
    costs = _Costs(motions, asked, "bound", draws=2)  # those of the search
    before = np.array(costs(few))
    while motions.step > 1.5 * motions.experiment.scenario.dt:
        step = motions.step
        motions.take_step(0.5 * step)
        after = np.array(costs(few))
        if np.isfinite(before).all() and (np.abs(before / after - 1) < _RESOLVED).all():
            motions.take_step(step)
            return
        before = after


def _searched(
    motions: Motions,
    asked: Asked,
    criterion: str,
    start: Array,
    effort: float,
    rng: np.random.Generator,
    report: Report,
) -> tuple[Found, list[Array]]:
    """The best candidate, most of the search under one draw of the prior, the rest under two.

    The best ones of those tried under two draws follow, the best first.
    """
    count = effort * _evaluations(motions, criterion)
    costs = _Costs(motions, asked, criterion)
    tries = max(17, int(_FIRST * count))
    report("searching", 0.0)
    first = minimise(costs, start, _STEP, tries, rng, lambda x: report("searching", _FIRST * x))
    costs = _Costs(motions, asked, criterion, draws=2)
    tries = max(17, int(0.5 * (1 - _FIRST) * count))
    later = 1 - _FIRST
    found = minimise(
        costs, first.x, _LATER, tries, rng, lambda x: report("searching", _FIRST + later * x)
    )
    costs.seen.sort(key=lambda pair: pair[0])
    best = [candidate for _, candidate in costs.seen[:_NEXT]]
    return found._replace(evaluations=first.evaluations + found.evaluations), best


def _evaluations(motions: Motions, criterion: str) -> int:
    """Number of candidates that `_EFFORT` seconds allow."""
    system = motions.experiment.system
    scenario = motions.experiment.scenario
    log, _ = motions.candidate(np.zeros(motions.size), 0)
    samples = len(log.t) if criterion == "bound" else len(motions.period(log).t)
    each = samples * (_SAMPLE + _ENTRY * system.n * system.p)
    if not motions.parallel:
        each += _SIMULATED * scenario.duration / scenario.dt
    return int(np.clip(_EFFORT / each, _FEWEST, _MOST))
