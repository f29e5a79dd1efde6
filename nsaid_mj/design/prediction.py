"""What an experiment will tell, said before it is made: intervals, weak directions, what helps.

All of it is at a fixed common scale, that is, on P_⊥: nothing is ever learned of P_s from motion,
and the report says what fixes it. Figures are root mean squares over the draws of the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..evaluation.bound import PRIOR
from ..evaluation.confidence import INTERVAL
from ..log import SensorLevels
from ..nullspace import directions
from ..parameters import Array, phrase
from .designing import Design, Told
from .information import rms

WEAK = 0.7
"""Predicted over prior deviation above which a direction counts as weak."""
_NAMED = 0.3  # weight over the largest of a direction's parameters that are named
_LISTED = 6  # weak directions that are described


@dataclass(frozen=True)
class Interval:
    """A parameter's predicted 95 % interval, at a fixed common scale.

    Attributes:
        name: of the parameter.
        label: readable description.
        kind: name of its block.
        unit: SI unit.
        value: its prior.
        half: half width of the interval.
        before: half width of what is known beforehand, in the directions that motion reveals.
        observable: share of the parameter, in [0, 1], that lies in these directions.
    """

    name: str
    label: str
    kind: str
    unit: str
    value: float
    half: float
    before: float
    observable: float


@dataclass(frozen=True)
class Remedy:
    """Another experiment, and what it would tell instead.

    Attributes:
        words: the experiment.
        predicted: rms deviation of what is asked for.
        weak: number of weak directions that it leaves.
    """

    words: str
    predicted: float
    weak: int


@dataclass(frozen=True)
class Prediction:
    """What is said before an experiment.

    Attributes:
        intervals: of all parameters.
        asked: (names, predicted standard deviations) of what was asked for.
        weak: directions of θ/scale that stay weak, in words, the weakest first.
        weak_count: number of weak directions; `weak` describes the first of them.
        unobservable: directions of P_s in words, and what fixes each.
        remedies: other experiments, computed.
    """

    intervals: tuple[Interval, ...]
    asked: tuple[tuple[str, float], ...]
    weak: tuple[str, ...]
    weak_count: int
    unobservable: tuple[tuple[str, str], ...]
    remedies: tuple[Remedy, ...]


def predict(found: Design, told: Told = lambda _words, _share: None) -> Prediction:
    """Predicts what a designed experiment tells, and computes what would help.

    Args:
        found: the design.
        told: receives progress.
    """
    experiment = found.experiment
    space, covariances = experiment.system.space, found.covariances
    weak, count = weak_directions(found, list(covariances))
    told("what would help", None)
    return Prediction(
        _intervals(found),
        tuple(zip(found.asked.names, found.deviations.tolist(), strict=True)),
        weak,
        count,
        tuple((d.words, d.fix) for d in directions(experiment.nullspace, space)),
        tuple(_remedies(found)),
    )


def _intervals(found: Design) -> tuple[Interval, ...]:
    experiment = found.experiment
    space = experiment.system.space
    variance = np.mean([np.diag(P) for P in found.covariances], axis=0)
    half = INTERVAL * np.sqrt(np.maximum(variance, 0.0)) * space.scale
    known = np.mean([np.sum(basis**2, axis=1) for basis in experiment.bases], axis=0)
    before = INTERVAL * PRIOR * np.sqrt(known) * space.scale
    kinds = [block.name for block in space.blocks for _ in block.names]
    rows = zip(
        space.names,
        space.labels,
        kinds,
        space.units,
        experiment.prior,
        half,
        before,
        np.sqrt(known),
        strict=True,
    )
    return tuple(Interval(*row[:4], *(float(x) for x in row[4:])) for row in rows)


def weak_directions(found: Design, covariances: Sequence[Array]) -> tuple[tuple[str, ...], int]:
    """Directions of which the data tell little, in words, and how many there are.

    Args:
        found: the design.
        covariances: predicted, one for each draw; the words are those of the first.
    """
    labels = found.experiment.system.space.labels
    described, counts = [], []
    for draw, P in enumerate(covariances):
        basis = found.experiment.bases[draw]
        variance, vectors = np.linalg.eigh(basis.T @ P @ basis)
        weak = variance > (WEAK * PRIOR) ** 2
        counts.append(int(weak.sum()))
        if draw == 0:
            described = [_words(basis @ v, labels) for v in vectors.T[weak][::-1][:_LISTED]]
    return tuple(described), round(float(np.mean(counts)))


def _words(direction: Array, labels: Sequence[str]) -> str:
    """A direction by its largest weights."""
    size = np.abs(direction)
    leading = [i for i in np.argsort(-size) if size[i] >= _NAMED * size.max()][:4]
    return phrase(labels[i] for i in leading)


def _remedies(found: Design) -> list[Remedy]:
    """What the design would tell in twice and four times its duration, and with quieter sensors."""
    experiment, made = found.experiment, []
    for factor in (2, 4):
        duration = factor * experiment.scenario.duration
        log = experiment.simulate(found.driver, 0, duration)
        if log is not None:
            P = found.covariance(log, 0)
            made.append(_remedy(found, f"{duration:g} s instead of {duration / factor:g} s", P))
    levels = SensorLevels(*(0.1 * level for level in experiment.levels))
    quiet = replace(experiment, levels=levels)
    P = found.covariance(found.logs[0], 0, quiet)
    made.append(_remedy(found, "sensors with a tenth of the noise", P))
    return made


def _remedy(found: Design, words: str, P: Array) -> Remedy:
    theta = found.experiment.draws[0]
    _, weak = weak_directions(found, [P])
    return Remedy(words, rms(found.asked.deviations(P, theta)), weak)
