"""The filter alone: its configuration, its prior, and whether a log contradicts it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...bounds import Config, NonNegative, Positive, config
from ...errors import InvalidInput
from ...log import Log, Measurement
from ...parameters import Array
from ...system import SecondOrderSystem
from ..cone.barrier import cone_of, gradient_and_hessian
from .kalman import (
    CONTRADICTED,
    ROUNDED,
    Along,
    Filter,
    Law,
    filter_at,
    follow_filter,
    noise_variance,
    restart_state,
)

_INDEFINITE = 1e-13  # least eigenvalue over the largest, of a P_θθ that rounding made indefinite


@config
class EfficientConfig(Config):
    """The filter of the law `efficient`.

    Attributes:
        prior: standard deviation of θ̂(0) in the metric of the cone, for instance the relative one
            of a positive parameter.
        linearisation: γ, standard deviation of the error of a step's linearisation relative to the
            standard deviation of what θ does in it.
        innovation_window: time over which innovations are tested against chance [s].
    """

    _path = "identifier.efficient"

    prior: Positive = 0.3
    linearisation: NonNegative = 0.3
    innovation_window: Positive = 0.1


class Replay(NamedTuple):
    """A log as the filter alone sees it.

    Attributes:
        contradictions: times at which the log contradicted every θ that P allows [s].
        along: what the filter wrote.
        filter: at the end.
    """

    contradictions: tuple[float, ...]
    along: Along
    filter: Filter


class Witness:
    """The filter alone, for a structure with compiled forward dynamics.

    Args:
        system: the structure.
        dt: time between measurements [s].
        config: of the filter.

    Attributes:
        law: what the filter knows beforehand.

    Raises:
        InvalidInput: the system has no compiled forward dynamics.
    """

    def __init__(self, system: SecondOrderSystem, dt: float, config: EfficientConfig):
        if system.forward is None:
            raise InvalidInput(
                "law",
                "a system with compiled forward dynamics",
                type(system).__name__,
                "Take --law memory; for an arm, --plant.backend compiled.",
            )
        self._spread, self._p = config.prior, system.p
        cone, scale = cone_of(system.space), np.array(system.space.scale)
        window = max(10, round(config.innovation_window / dt))
        self.law = Law(system.forward, cone, scale, config.linearisation, window)

    def covariance(self, theta: Array) -> Array:
        """(p, p) P_θθ before any data: σ² (∇²b(θ̂) + 1)⁻¹ in units of the scale."""
        _, metric = gradient_and_hessian(self.law.cone, theta)
        balanced = metric * np.outer(self.law.scale, self.law.scale) + np.eye(self._p)
        return np.asarray(self._spread**2 * np.linalg.inv(balanced), dtype=np.float64)

    def replay(self, theta: Array, P: Array, log: Log) -> Replay:
        """Follows a log of N measurements from θ̂ (p,) with P_θθ (p, p) of θ̂/scale.

        Where the log contradicts every θ that P allows, the filter starts again from both.
        """
        count = len(log.t)
        kalman, times, at = filter_at(log.q[0], log.v[0], theta, P), [], 0
        along = Along.empty(count, log.v.shape[1], self._p)
        while at < count - 1:
            columns = (part[at:] for part in log)
            row, end = follow_filter(self.law, kalman, *columns, along.part(at))
            at += row
            if end == ROUNDED:
                mend(kalman, log.at(at))
            elif end == CONTRADICTED:
                times.append(float(log.t[at]))
                kalman.theta[:], kalman.Ptt[:] = theta, P
                restart_state(kalman, log.q[at], log.v[at], noise_variance(kalman.noise))
        return Replay(tuple(times), along, kalman)


def mend(kalman: Filter, here: Measurement) -> None:
    """Makes P_θθ positive definite after rounding errors, and starts the state again."""
    values, vectors = np.linalg.eigh(kalman.Ptt)
    kalman.Ptt[:] = (vectors * np.maximum(values, _INDEFINITE * values[-1])) @ vectors.T
    restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))
