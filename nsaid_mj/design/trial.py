"""Tries an experiment on a draw of the prior, to compare predicted with reached intervals.

The trial's robot is one of the draws, with noisy sensors, so that no truth is involved.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..experiment.setup import Seeds
from ..identifiers import NullspaceAID, Status
from ..log import Log
from ..parameters import Array
from ..plants import Sensors
from .designing import Design

_PARTS = 20  # times at which intervals are compared
_DRAW = 1  # the first one is the prior itself


@dataclass(frozen=True)
class Trial:
    """Predicted and reached deviations of the requested numbers, along an experiment.

    Attributes:
        t: (T,) times [s].
        predicted: (T, k) predicted standard deviations.
        stated: (T, k) standard deviations that the law `efficient` states; NaN where it states
            none.
        error: (T, k) its errors, absolute.
        log: the motion with exact sensors.
    """

    t: Array
    predicted: Array
    stated: Array
    error: Array
    log: Log


def tried(found: Design, seed: int = 0) -> Trial | None:
    """Tries a design on a draw; None if `efficient` does not suit the scenario, or it fails."""
    experiment, asked = found.experiment, found.asked
    scenario, system = experiment.scenario, experiment.system
    truth, basis = experiment.draws[_DRAW], experiment.bases[_DRAW]
    if not isinstance(scenario.identifier, NullspaceAID):
        return None
    sensors = Sensors(scenario.noise, np.random.default_rng(Seeds.of(seed).sensors))
    log = experiment.simulate(found.driver, _DRAW, scenario.duration, seed, sensors)
    if log is None:
        return None
    config = replace(scenario.identifier, law="efficient")
    law = config.build(
        system, experiment.prior, scenario.dt, experiment.levels, lambda: np.eye(system.p)
    )
    ends = np.unique(np.linspace(0, len(log.t) - 1, _PARTS + 1).astype(int))
    state, rows = law.init(log.at(0)), []
    scale, gains = np.array(system.space.scale), system.space.actuators
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
