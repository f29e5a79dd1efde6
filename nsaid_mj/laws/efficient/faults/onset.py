"""The time at which a fault began, and the filter just before.

Before a fault, eᵀe of the normalised innovations e of a sample has mean 2n and variance 4n. The
fault began at the sample from which on its average exceeds 2n + 3 √(4n): Page's likelihood ratio
test for a change at an unknown time.
"""

from __future__ import annotations

import numpy as np

from ....log import Log
from ....parameters import Array
from ....structure.system import SecondOrderSystem
from ..filter import COMPLETED, Along, Filter, Law
from ..kalman import follow_filter, restart_state
from ..noise import noise_variance

LEAD = 4
"""Samples before the earliest possible fault: `started` takes increments from them."""
_EXCESS = 3.0  # standard deviations of eᵀe that a sample must exceed on average


def increments(system: SecondOrderSystem, log: Log) -> Array:
    """(N−1, 2n) changes of position and velocity from sample to sample."""
    moved = [system.difference(a, b) for a, b in zip(log.q[:-1], log.q[1:], strict=True)]
    return np.hstack([np.array(moved), np.diff(log.v, axis=0)])


def started(kalman: Filter, system: SecondOrderSystem, log: Log, k: int) -> Filter:
    """A copy of a filter with its state at sample k ≥ 3 of a log, as measured there."""
    own = kalman.copied()
    own.noise.increments[:] = increments(system, log.part(k - 3, k + 1))
    restart_state(own, log.q[k], log.v[k], noise_variance(own.noise))
    return own


def onset(law: Law, kalman: Filter, system: SecondOrderSystem, log: Log) -> int:
    """The last sample of a log before a fault, given a filter's θ̂ and P_θθ from before."""
    own, patient = started(kalman, system, log, LEAD - 1), law._replace(window=10**9)
    size, count, n = 2.0 * system.n, len(log.t), system.n
    level = size + _EXCESS * np.sqrt(2.0 * size)
    out = Along.empty(2, n, len(own.theta))
    total, before = 0.0, count - 2
    for k in range(LEAD, count):
        squares = own.tally[2]
        _, end = follow_filter(patient, own, *log.part(k - 1, k + 1), out)
        excess = own.tally[2] - squares - level if end == COMPLETED else np.inf
        if total <= 0.0:
            total, before = 0.0, k - 1
        total += excess
        if total == np.inf:
            break
    return before if total > 0.0 else count - 2
