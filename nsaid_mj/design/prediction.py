"""What an experiment will tell, said before it is made: intervals, weak directions, what helps.

All of it is at a fixed common scale, that is, on P_⊥: nothing is ever learned of P_s from motion,
and the report says what fixes it. Figures are root mean squares over the draws of the prior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..evaluation.confidence import INTERVAL
from ..nullspace import directions
from .designing import Design, Told
from .information import PRIOR
from .remedies import Helped, Remedy, helped, remedies, weak_directions

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
class Prediction:
    """What is said before an experiment.

    Attributes:
        intervals: of all parameters.
        asked: (names, predicted standard deviations) of what was asked for.
        weak: the weakest directions of θ/scale and what helps each, the weakest first.
        weak_count: number of weak directions; `weak` describes the first of them.
        unobservable: directions of P_s in words, and what fixes each.
        remedies: other experiments, computed.
    """

    intervals: tuple[Interval, ...]
    asked: tuple[tuple[str, float], ...]
    weak: tuple[Helped, ...]
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
    weak = [weak_directions(found, P, draw) for draw, P in enumerate(covariances)]
    told("what would help", None)
    others = remedies(found)
    return Prediction(
        _intervals(found),
        tuple(zip(found.asked.names, found.deviations.tolist(), strict=True)),
        tuple(helped(found, direction, others) for direction in weak[0].T[:_LISTED]),
        round(float(np.mean([each.shape[1] for each in weak]))),
        tuple((d.words, d.fix) for d in directions(experiment.nullspace, space)),
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
