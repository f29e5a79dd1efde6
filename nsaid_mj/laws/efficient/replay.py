"""The filter alone: its prior, and its passes along a log.

Steps of θ̂ from far away are linearised at the wrong θ̂, and count as information what is not: along
a gentle start, or while one joint moves at a time, a filter becomes sure of a wrong θ̂ before the
motion contradicts it. Restarted at the end of one pass along the same log, with the covariance of a
prior, it is linearised closer to the truth in each pass.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ...errors import InvalidInput
from ...log import Log, Measurement
from ...nullspace import parts_of
from ...parameters import Array
from ...quotient.cone import cone_of
from ...structure.system import SecondOrderSystem
from ..cone.prior import drawn_covariance, spread_of_numbers
from ..settings import EfficientConfig
from .filter import CONTRADICTED, NEAR, ROUNDED, Along, Filter, Law, filter_at
from .kalman import follow_filter, restart_state
from .noise import noise_variance
from .steps import margin_of

USUAL = 0.3
"""Default of the largest relative error of a prior."""
_PIECE = 25  # rows between two rests
_PASSES = 6  # along the log, at most
_INDEFINITE = 1e-13  # least eigenvalue over the largest, of a P_θθ that rounding made indefinite


class Replay(NamedTuple):
    """A log followed by the filter alone."""

    contradictions: tuple[float, ...]  # times of significantly large innovations [s]
    along: Along  # the filter's outputs
    filter: Filter  # at the end


class FilterAlone:
    """The filter alone, for a structure with compiled forward dynamics.

    `dt` is the time between measurements [s]; the attribute `law` the filter's prior knowledge,
    near θ; `rest`, if any, is called by a replay after every 25 rows: a thread of a live program
    must not hold up its loop.

    Raises:
        InvalidInput: the system has no compiled forward dynamics.
    """

    rest: Callable[[], None] | None = None

    def __init__(self, system: SecondOrderSystem, dt: float, config: EfficientConfig):
        if system.forward is None:
            raise InvalidInput(
                "law",
                "a system with compiled forward dynamics",
                type(system).__name__,
                "Use --law memory; for an arm, --plant.backend compiled.",
            )
        self._error, self._p, self.space = config.prior or USUAL, system.p, system.space
        cone, scale = cone_of(system.space), np.array(system.space.scale)
        window = max(10, round(config.innovation_window / dt))
        unexplained = np.array(config.unexplained, dtype=np.float64)
        motor = system.p - 1 in system.space.actuators
        if len(unexplained) and (len(unexplained) != system.n or not motor):
            raise InvalidInput(
                "identifier.efficient.unexplained", f"{system.n} numbers, for a robot with motors",
                len(unexplained), "Give one for every velocity, or none.",
            )  # fmt: skip
        self.law = Law(
            system.forward, cone, scale, margin_of(cone, scale), NEAR, window,
            np.zeros(system.p), unexplained, parts_of(system),
        )  # fmt: skip

    def covariance(self, theta: Array) -> Array:
        """(p, p) P_θθ of θ̂/scale before any data: that of the draw of a prior.

        Limbs that only the base connects also differ in their scale, by as much as one number.
        """
        found = drawn_covariance(self.space, theta, self._error)
        if len(self.law.parts) > 1:
            own = self.law.parts * theta / self.law.scale
            found += spread_of_numbers(np.ones(1), np.ones(1), self._error) * own.T @ own
        return found

    def replay(self, theta: Array, P: Array, log: Log) -> Replay:
        """Follows a log of N measurements from θ̂ (p,) with P_θθ (p, p) of θ̂/scale.

        Where the innovations are significantly large, the filter restarts from both.
        """
        count = len(log.t)
        piece = _PIECE if self.rest else count
        kalman, times, at = filter_at(log.q[0], log.v[0], theta, P), [], 0
        along = Along.empty(count, log.v.shape[1], self._p)
        while at < count - 1:
            columns = (part[at : at + piece + 1] for part in log)
            row, end = follow_filter(self.law, kalman, *columns, along.part(at))
            at += row
            if end == ROUNDED:
                repair(kalman, log.at(at))
            elif end == CONTRADICTED:
                times.append(float(log.t[at]))
                kalman.theta[:], kalman.Ptt[:] = theta, P
                restart_state(kalman, log.q[at], log.v[at], noise_variance(kalman.noise))
            if self.rest:
                self.rest()
        return Replay(tuple(times), along, kalman)

    def learned(self, theta: Array, log: Log) -> Filter | None:
        """The filter at the end of a log, from a θ̂ with which no innovation contradicts it.

        It begins with theta (p,); None if all passes are contradicted.
        """
        before: tuple[float, ...] = ()
        for _ in range(_PASSES):
            times, _, kalman = self.replay(theta, self.covariance(theta), log)
            if not np.isfinite(kalman.theta).all():
                return None
            if not times:
                return kalman
            if times == before or np.array_equal(kalman.theta, theta):
                return None  # a fault, or W lacks an effect
            before, theta = times, with_scales_of(theta, kalman.theta, self.law)
        return None


def with_scales_of(theta: Array, found: Array, law: Law) -> Array:
    """(p,) a found θ̂, in which every part has the scale it has in θ (p,), as none is observable.

    Otherwise the passes, each about the last one's end, would carry it away.
    """
    own, given = law.parts * found / law.scale, law.parts * theta / law.scale
    size = np.sum(given * given, axis=1) / np.sum(own * own, axis=1)
    return found * np.where(law.parts.any(axis=0), np.sqrt(size) @ law.parts, 1.0)


def repair(kalman: Filter, here: Measurement) -> None:
    """Makes P_θθ positive definite after rounding errors, and restarts the state."""
    values, vectors = scipy.linalg.eigh(kalman.Ptt)
    kalman.Ptt[:] = (vectors * np.maximum(values, _INDEFINITE * values[-1])) @ vectors.T
    restart_state(kalman, here.q, here.v, noise_variance(kalman.noise))
