"""Rows of a log at which regressors are formed."""

from __future__ import annotations

import numpy as np

from ..log import Log
from ..parameters import Array
from ..system import SecondOrderSystem

NUMBERS = 20_000_000
"""Largest number of regressor entries in memory at once."""

_ROWS = 2000  # of a trajectory, at most, at which regressors are formed


def stride_of(length: int, system: SecondOrderSystem) -> int:
    """The stride through a log of `length` rows that keeps its regressors within `NUMBERS`."""
    rows = min(_ROWS, max(50, NUMBERS // (system.n * system.p)))
    return max(1, length // rows)


def states(log: Log, stride: int) -> tuple[Array, Array, Array, Array]:
    """t (k,), x (k, m + n), v (k, n) and u (k, n_u) of every stride-th row."""
    k = slice(None, None, stride)
    v = log.v[k]
    return log.t[k], np.hstack([log.q[k], v]), v, log.u[k]


def midpoints(
    log: Log, system: SecondOrderSystem, stride: int
) -> tuple[Array, Array, Array, Array, Array]:
    """t, x, v, u and v̇ half-way between a row and its successor, for every stride-th row.

    v̇ is the finite difference of the measured velocities, so it needs no truth. The command must
    be constant between rows.
    """
    k = np.arange(0, len(log.t) - 1, stride)
    t, q, v, u = log.t, log.q, log.v, log.u[k]
    steps = [0.5 * system.difference(q[i], q[i + 1]) for i in k]
    middle = np.array([system.integrate(q[i], step) for i, step in zip(k, steps, strict=True)])
    mean = 0.5 * (v[k] + v[k + 1])
    rate = (v[k + 1] - v[k]) / (t[k + 1] - t[k])[:, None]
    return 0.5 * (t[k] + t[k + 1]), np.hstack([middle, mean]), mean, u, rate
