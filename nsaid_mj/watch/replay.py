"""Learning again from a motion's beginning, by passes of the filter alone.

Far from the truth the filter is linearised about a wrong θ̂, and becomes overconfident: during a
gentle start, or while one joint moves at a time, it is sure of a wrong θ̂ before the motion
contradicts it. Each further pass along the same log starts from the last estimate with the
covariance of a prior, and is linearised closer to the truth.
"""

import numpy as np

from ..core import Array, FilterState, KalmanFilter, Log

_PASSES = 6  # along the log, at most


def learned(estimator: KalmanFilter, theta: Array, log: Log) -> FilterState | None:
    """The filter at the end of a log, from a θ̂ with which no innovation contradicts it.

    It begins with theta (p,); None if all passes are contradicted.
    """
    before: tuple[float, ...] = ()
    for _ in range(_PASSES):
        times, _, kalman = estimator.replay(theta, estimator.covariance(theta), log)
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
