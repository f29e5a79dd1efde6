"""Rows of a record at which regressors are formed."""

from __future__ import annotations

import numpy as np

from ..experiment.record import Record
from ..parameters import Array
from ..system import SecondOrderSystem

NUMBERS = 20_000_000
"""How many numbers of regressors are held at once."""

_ROWS = 2000  # how many rows of a trajectory are judged, at most


def stride_of(record: Record, system: SecondOrderSystem) -> int:
    """Every how many rows one is taken, so that not more regressors are held than needed."""
    rows = min(_ROWS, max(50, NUMBERS // (system.n * system.p)))
    return max(1, len(record) // rows)


def states(record: Record, stride: int) -> tuple[Array, Array, Array, Array]:
    """(t, x, v, u) of every stride-th row."""
    k = slice(None, None, stride)
    v = record["v"][k]
    return record["t"][k], np.hstack([record["q"][k], v]), v, record["u"][k]
