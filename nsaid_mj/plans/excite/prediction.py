"""Predicts an experiment's results: intervals, weak directions, and improvements.

Everything is at a fixed common scale, that is, on P_⊥: motion gives no information about P_s, and
the report states what fixes it. Figures are root mean squares over the draws of the prior.

An arm may repeat its motion with a known payload, or in another pose; a vehicle may use larger
commands; both may move for longer, or have less noisy sensors. A payload's inertia is known in kg
and not only relative to the rest of θ, so it also determines directions of P_s. These remedies are
computed for the published values.

A trial run compares predicted with achieved intervals, on one of the draws with noisy sensors, so
that no truth is involved.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.linalg

from ...core import (
    Array,
    JointTree,
    Log,
    NullspaceAID,
    SensorLevels,
    Status,
    phrase,
)
from ...lab import INTERVAL, DesignedSignals, DesignedTracking, Seeds, Sensors
from ...watch import supervised
from .designing import Design, Report
from .experiment import Experiment
from .information import PRIOR, bound, rms
from .limits import extents_of
from .motions import amplified, amplitudes_of, simulated, touched

WEAK = 0.7
"""Predicted over prior deviation above which a direction counts as weak."""
_NAMED = 0.3  # weight, over the largest, of a direction's parameters from which they are named
_HELPS = 0.95  # share of a direction's deviation that a remedy must fall below to help
_CARRIED = 0.1  # payload: share of the moving mass, distance from the joint's axis [m]
_HELD = 0.1
_PAYLOADS = ((1.0, 1.0), (0.5, 1.0), (0.25, 1.0), (0.5, 0.8), (0.25, 0.6))  # of it and of swing
_POSES = 6  # other poses that are tried, and the share of the swing in them
_SWING = 0.7
_LARGER = 1.5  # vehicle's amplitudes: factor, and share of their commands' range
_LARGEST = 0.99


@dataclass(frozen=True)
class Remedy:
    """Another experiment, and its predicted results."""

    words: str
    predicted: float  # rms deviation of the requested numbers
    weak: int  # number of weak directions that it leaves
    covariance: Array  # (p, p) predicted of θ̂/scale


@dataclass(frozen=True)
class Helped:
    """A weak direction, and the experiment that improves it most."""

    words: str  # the direction's leading parameters
    left: float  # its predicted deviation, over that before the experiment
    remedy: str  # the most effective remedy; "" if none helps
    after: float  # its deviation with the remedy, over that before the experiment


def weak_directions(found: Design, covariance: Array, draw: int = 0) -> Array:
    """(p, k) unit directions of θ/scale with little information in the data, the weakest first.

    `covariance` (p, p) is the one predicted of θ̂/scale.
    """
    basis = found.experiment.bases[draw]
    variance, vectors = scipy.linalg.eigh(basis.T @ covariance @ basis)
    return basis @ vectors[:, variance > (WEAK * PRIOR) ** 2][:, ::-1]


def helped(found: Design, direction: Array, others: list[Remedy]) -> Helped:
    """The most effective remedy for a weak direction (p,) of θ/scale."""
    labels = found.experiment.system.space.labels
    size = np.abs(direction)
    leading = [i for i in np.argsort(-size) if size[i] >= _NAMED * size.max()][:4]

    def left(covariance: Array) -> float:
        return float(np.sqrt(direction @ covariance @ direction)) / PRIOR

    own = left(found.covariances[0])
    best = min(others, key=lambda each: left(each.covariance))
    after = left(best.covariance)
    words = phrase(labels[i] for i in leading)
    if after > _HELPS * own:
        return Helped(words, own, "", own)
    return Helped(words, own, best.words, after)


def remedies(found: Design) -> list[Remedy]:
    """Other experiments with the same robot, computed."""
    levels = SensorLevels(*(0.1 * level for level in found.experiment.levels))
    P = found.covariance(found.logs[0], 0, replace(found.experiment, levels=levels))
    made = [*_longer(found), _remedy(found, "sensors with a tenth of the noise", P)]
    if isinstance(found.driver, DesignedTracking):
        made += [*_loaded(found, found.driver), *_elsewhere(found, found.driver)]
    elif isinstance(found.driver, DesignedSignals):
        made += _larger(found, found.driver)
    return made


def _remedy(found: Design, words: str, covariance: Array) -> Remedy:
    predicted = rms(found.asked.deviations(covariance, found.experiment.draws[0]))
    return Remedy(words, predicted, weak_directions(found, covariance).shape[1], covariance)


def _longer(found: Design) -> Iterator[Remedy]:
    """Twice and four times the duration."""
    for factor in (2, 4):
        duration = factor * found.experiment.scenario.duration
        log = found.experiment.simulate(found.driver, 0, duration)
        if log is not None:
            words = f"{duration:g} s instead of {duration / factor:g} s"
            yield _remedy(found, words, found.covariance(log, 0))


def _loaded(found: Design, driver: DesignedTracking) -> Iterator[Remedy]:
    """The motion repeated with a known payload, the largest of some that keeps the limits."""
    experiment = found.experiment
    space = experiment.system.space
    place = _held(experiment)
    moving = sum(experiment.prior[at][0] for b, at in space if b.geometry == "pseudo_inertia")
    for part, swing in _PAYLOADS:
        mass = float(f"{part * _CARRIED * moving:.1g}")
        added = experiment.system.point_masses.change(mass, place)
        loaded = replace(experiment, prior=experiment.prior + added, draws=experiment.draws + added)
        log = _kept(found, loaded, _swung(driver, swing))
        if log is None:
            continue
        whole = np.eye(len(space))  # a payload reveals P_s too
        J = found.information(found.logs[0], 0, whole)
        P = bound(J + found.information(log, 0, whole, loaded), whole)
        Z = experiment.bases[0]
        scale = experiment.draws[0] / space.scale
        known = np.sqrt(scale @ P @ scale) / (scale @ scale)
        words = (
            f"the motion once more with a known payload, {mass:g} kg held "
            f"{100 * np.linalg.norm(place):.0f} cm off the last joint's axis"
            f"{_smaller(swing)} (also determines the common scale to {100 * known:.1g} %)"
        )
        yield _remedy(found, words, Z @ (Z.T @ P @ Z) @ Z.T)
        return


def _held(experiment: Experiment) -> Array:
    """(3,) place of a payload, in the last link's axes, at right angles to its joint's [m]."""
    arm = experiment.system
    assert isinstance(arm, JointTree)
    axis = np.asarray(arm.structure.bodies[-1].axis)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return _HELD * side / np.linalg.norm(side)


def _elsewhere(found: Design, driver: DesignedTracking) -> Iterator[Remedy]:
    """The motion repeated in another pose: the best of random ones that keep the limits."""
    experiment = found.experiment
    basis = found.experiment.bases[0]
    series = driver.series
    limit = found.limits.limits["position"]
    t = np.linspace(0, 1 / driver.fundamental, 500)
    phase = np.outer(t, series.omega)
    peak = np.abs(np.hstack([np.sin(phase), np.cos(phase)]) @ series.coefficients.T).max(axis=0)
    room = np.maximum(0.5 * (limit.high - limit.low) - _SWING * peak, 0.0)
    middle = 0.5 * (limit.low + limit.high)
    rng = np.random.default_rng(0)
    made = []
    J = found.information(found.logs[0], 0, basis)
    directions = weak_directions(found, found.covariances[0])
    for _ in range(_POSES):
        centre = middle + room * rng.uniform(-1, 1, len(room))
        moved = replace(_swung(driver, _SWING), centre=tuple(centre.tolist()))
        log = _kept(found, experiment, moved)
        if log is None:
            continue
        P = bound(J + found.information(log, 0, basis), basis)
        asked = rms(found.asked.deviations(P, experiment.draws[0]))
        cost = np.trace(directions.T @ P @ directions) if directions.size else asked
        made.append((float(cost), centre, P))
    if made:
        _, centre, P = min(made, key=lambda each: each[0])
        pose = ", ".join(f"{x:.2g}" for x in centre)
        words = f"the motion once more in another pose, about ({pose}){_smaller(_SWING)}"
        yield _remedy(found, words, P)


def _larger(found: Design, driver: DesignedSignals) -> Iterator[Remedy]:
    """A vehicle's commands, half as large again."""
    experiment = found.experiment
    names = amplitudes_of(driver.driver)
    inner = amplified(driver.driver, _LARGER, _LARGEST)
    if inner == driver.driver:
        return
    log = experiment.simulate(replace(driver, driver=inner), 0, experiment.scenario.duration)
    if log is None:
        return
    uses = found.limits.uses(extents_of(experiment.system, log, experiment.draws[0]))
    broken = phrase(name for name, use in uses.items() if use > 1)
    values = ", ".join(f"{name} {getattr(inner, name):.2g}" for name in names)
    words = f"larger commands ({values})" + (f", beyond the limits of {broken}" if broken else "")
    yield _remedy(found, words, found.covariance(log, 0))


def _swung(driver: DesignedTracking, share: float) -> DesignedTracking:
    """A motion with the swing of all joints times a share."""
    sines, cosines = (tuple(share * x for x in part) for part in (driver.sines, driver.cosines))
    return replace(driver, sines=sines, cosines=cosines)


def _smaller(swing: float) -> str:
    return "" if swing == 1 else f", with {100 * swing:.0f} % of the swing"


def _kept(found: Design, experiment: Experiment, driver: DesignedTracking) -> Log | None:
    """The simulated motion under the first draw; None if it breaks a limit under any draw."""
    logs, worst = simulated(experiment, driver, found.limits)
    if worst is None or max(use.max() for use in worst.values()) > 1:
        return None
    if touched(found.experiment, found.limits, logs, found.stride):
        return None
    return logs[0]


_LISTED = 6  # weak directions that are described


@dataclass(frozen=True)
class Interval:
    """A parameter's predicted 95 % interval, at a fixed common scale."""

    name: str  # name of the parameter
    label: str  # readable description
    kind: str  # name of its block
    unit: str  # SI unit
    value: float  # its prior
    half: float  # half width of the interval
    before: float  # half width before the experiment, in the directions that motion reveals
    observable: float  # share of the parameter, in [0, 1], that lies in these directions


@dataclass(frozen=True)
class Prediction:
    """The prediction of an experiment's results."""

    intervals: tuple[Interval, ...]  # intervals of all parameters
    asked: tuple[tuple[str, float], ...]  # names and predicted deviations of the requested numbers
    weak: tuple[Helped, ...]  # the weakest directions of θ/scale, and what helps each
    weak_count: int  # number of weak directions; `weak` describes the first of them
    unobservable: tuple[tuple[str, str], ...]  # directions of P_s in words, and what fixes each
    remedies: tuple[Remedy, ...]  # other experiments, computed


def predict(found: Design, report: Report = lambda _words, _share: None) -> Prediction:
    """Predicts the results of a designed experiment, and of possible improvements."""
    experiment = found.experiment
    space = experiment.system.space
    covariances = found.covariances
    weak = [weak_directions(found, P, draw) for draw, P in enumerate(covariances)]
    report("what would help", None)
    others = remedies(found)
    return Prediction(
        _intervals(found),
        tuple(zip(found.asked.names, found.deviations.tolist(), strict=True)),
        tuple(helped(found, direction, others) for direction in weak[0].T[:_LISTED]),
        round(float(np.mean([each.shape[1] for each in weak]))),
        tuple((d.words, d.fix) for d in experiment.nullspace.directions(space)),
        tuple(others),
    )


def _intervals(found: Design) -> tuple[Interval, ...]:
    experiment = found.experiment
    space = experiment.system.space
    variance = np.mean([np.diag(P) for P in found.covariances], axis=0)
    half = INTERVAL * np.sqrt(np.maximum(variance, 0.0)) * space.scale
    known = np.mean([np.sum(basis**2, axis=1) for basis in experiment.bases], axis=0)
    before = INTERVAL * PRIOR * np.sqrt(known) * space.scale
    kinds = [block.name for block in space.blocks for _ in block.names]
    words = zip(space.names, space.labels, kinds, space.units, strict=True)
    figures = np.column_stack([experiment.prior, half, before, np.sqrt(known)]).tolist()
    return tuple(Interval(*of, *row) for of, row in zip(words, figures, strict=True))


_PARTS = 20  # times at which intervals are compared
_DRAW = 1  # the first one is the prior itself


@dataclass(frozen=True)
class Trial:
    """Predicted and achieved standard deviations of the requested numbers, along an experiment."""

    t: Array  # (T,) times [s]
    predicted: Array  # (T, k) predicted standard deviations
    stated: Array  # (T, k) those that the law `efficient` states; NaN where it states none
    error: Array  # (T, k) its errors, absolute
    log: Log  # the motion with exact sensors


def tried(found: Design, seed: int = 0) -> Trial | None:
    """Tries a design on a draw; None if `efficient` does not suit the scenario, or it fails."""
    experiment = found.experiment
    asked = found.asked
    scenario = experiment.scenario
    system = experiment.system
    truth = experiment.draws[_DRAW]
    basis = experiment.bases[_DRAW]
    if not isinstance(scenario.identifier, NullspaceAID):
        return None
    sensors = Sensors(scenario.noise, np.random.default_rng(Seeds.of(seed).sensors))
    log = experiment.simulate(found.driver, _DRAW, scenario.duration, seed, sensors)
    if log is None:
        return None
    config = replace(scenario.identifier, law="efficient")
    levels = experiment.levels
    law = supervised(
        config.build(system, experiment.prior, scenario.dt, levels, lambda: np.eye(system.p))
    )
    ends = np.unique(np.linspace(0, len(log.t) - 1, _PARTS + 1).astype(int))
    state = law.init(log.at(0))
    rows = []
    scale = np.array(system.space.scale)
    gains = system.space.actuators
    for start, end in pairwise(ends.tolist()):
        state, estimates = law.follow(state, log.part(start, end + 1))
        if state.status is not Status.completed:
            return None
        theta = estimates.theta_hat[-1]
        confidence = law.confidence(state)
        stated = np.full(len(asked.names), np.nan)
        if confidence is not None:
            own = basis @ basis.T @ (confidence.covariance / np.outer(scale, scale))
            stated = asked.deviations(own @ basis @ basis.T, theta)
        length = np.mean(theta[gains] / truth[gains]) if len(gains) else 1.0
        off = basis @ (basis.T @ ((theta / length - truth) / scale))
        error = np.abs(asked.rows(truth) @ off)
        predicted = asked.deviations(found.covariance(log.first(end + 1), _DRAW), truth)
        rows.append((float(log.t[end]), predicted, stated, error))
    t, predicted, stated, error = (np.array(part) for part in zip(*rows, strict=True))
    return Trial(t, predicted, stated, error, found.logs[_DRAW])
