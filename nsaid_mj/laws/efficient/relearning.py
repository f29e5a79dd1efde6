"""Learning again from a motion's beginning, where a far prior has led the filter astray.

Steps of θ̂ from far away are linearised at the wrong θ̂, and count as information what is not: along
a gentle start, or while one joint moves at a time, a filter becomes sure of a wrong θ̂ before the
motion contradicts it. Restarted at the end of one pass along the same log, with the covariance of a
prior, it is linearised closer to the truth in each pass.
"""

import numpy as np

from ...log import Log
from ...parameters import Array
from .filter import Filter, Law
from .replay import FilterAlone

LONGEST = 20.0  # time after which a motion has no beginning to learn from [s]
LATER = 1.5  # durations after which learning again is tried once more

_PASSES = 6  # along the log, at most


def learned(alone: FilterAlone, theta: Array, log: Log) -> Filter | None:
    """The filter at the end of a log, from a θ̂ with which no innovation contradicts it.

    It begins with theta (p,); None if all passes are contradicted.
    """
    before: tuple[float, ...] = ()
    for _ in range(_PASSES):
        replay = alone.replay(theta, alone.covariance(theta), log)
        found, times = replay.filter.theta, replay.contradictions
        if not np.isfinite(found).all():
            return None
        if not times:
            return replay.filter
        if times == before or np.array_equal(found, theta):  # a fault, or W lacks an effect
            return None
        before, theta = times, _with_scales_of(theta, found, alone.law)
    return None


def _with_scales_of(theta: Array, found: Array, law: Law) -> Array:
    """(p,) a found θ̂, in which every part has the scale it has in θ (p,), as none is observable.

    Otherwise the passes, each about the last one's end, would carry it away.
    """
    own, given = law.parts * found / law.scale, law.parts * theta / law.scale
    size = np.sum(given * given, axis=1) / np.sum(own * own, axis=1)
    return found * np.where(law.parts.any(axis=0), np.sqrt(size) @ law.parts, 1.0)
