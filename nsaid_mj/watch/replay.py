"""Passes of the filter alone along a log, and learning again from a motion's beginning.

Far from the truth the filter is linearised about a wrong θ̂, and becomes overconfident: during a
gentle start, or while one joint moves at a time, it is sure of a wrong θ̂ before the motion
contradicts it. Each further pass along the same log starts from the last estimate with the
covariance of a prior, and is linearised closer to the truth.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..core import Along, Array, FilterState, KalmanFilter, Log

_PIECE = 25  # rows between two rests
_PASSES = 6  # along the log, at most


class Replay(NamedTuple):
    """A log followed by the filter alone."""

    contradictions: tuple[float, ...]  # times of significantly large innovations [s]
    along: Along  # the filter's outputs
    filter: FilterState  # at the end


def replay(
    estimator: KalmanFilter,
    theta: Array,
    P: Array,
    log: Log,
    rest: Callable[[], None] | None = None,
) -> Replay:
    """Follows a log of N measurements from θ̂ (p,) with P_θθ (p, p) of θ̂/scale.

    Where the innovations are significantly large, the filter restarts from both. `rest`, if any, is
    called after every 25 rows: a thread of a live program must not hold up its loop.
    """
    count = len(log.t)
    piece = _PIECE if rest else count
    kalman = estimator.at(log.q[0], log.v[0], theta, P)
    along = Along.empty(count, log.v.shape[1], len(theta))
    times = list[float]()
    at = 0
    while at < count - 1:
        stretch = estimator.follow(kalman, log.part(at, at + piece + 1), along.part(at))
        at += stretch.last
        if stretch.rounded:
            estimator.repair(kalman, log.at(at))
        elif stretch.contradicted:
            times.append(float(log.t[at]))
            kalman.theta[:] = theta
            kalman.Ptt[:] = P
            estimator.restart(kalman, log.at(at))
        if rest:
            rest()
    return Replay(tuple(times), along, kalman)


def learned(estimator: KalmanFilter, theta: Array, log: Log) -> FilterState | None:
    """The filter at the end of a log, from a θ̂ with which no innovation contradicts it.

    It begins with theta (p,); None if all passes are contradicted.
    """
    before: tuple[float, ...] = ()
    for _ in range(_PASSES):
        times, _, kalman = replay(estimator, theta, estimator.covariance(theta), log)
        if not np.isfinite(kalman.theta).all():
            return None
        if not times:
            return kalman
        if times == before or np.array_equal(kalman.theta, theta):
            return None  # a fault, or W lacks an effect
        constants = estimator.constants
        theta = with_scales_of(theta, kalman.theta, constants.parts, constants.scale)
        before = times
    return None


def with_scales_of(theta: Array, other: Array, parts: Array, scale: Array) -> Array:
    """(p,) another θ̂ in which every part has its scale in θ (p,), because none is observable.

    Otherwise the scale would drift from pass to pass, as each starts from the last one's end. parts
    (s, p) are those of `nullspace.parts_of`, scale (p,) that of θ.
    """
    own = parts * other / scale
    given = parts * theta / scale
    size = np.sum(given * given, axis=1) / np.sum(own * own, axis=1)
    return other * np.where(parts.any(axis=0), np.sqrt(size) @ parts, 1.0)
