"""Identifiers along one motion, as many at once as numbers fit into a vector register."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..log import Log
from ..numerics.lanes import LANES
from ..numerics.packs import packed
from ..structure.arrays import Workspace, workspace
from ..structure.motion_types import StructureMotion
from ..system import Motion
from .base import Estimates, State, Status
from .metric import Flat
from .nullspace_aid import NullspaceIdentifier, end_of
from .rk4 import follow_abreast

Run = tuple[NullspaceIdentifier, State]
"""An identifier, and its state at a log's first measurement."""


def along(runs: Sequence[Run], log: Log, motion: Motion) -> Iterator[tuple[State, Estimates]]:
    """Yields what `NullspaceIdentifier.along` returns for each of several runs, to the bit.

    Runs of the paper's law with diagonal gains are computed `LANES` at a time, if they share a
    structure's motion and none fails. The rest are computed one by one.

    Args:
        runs: identifiers of one system, with their states at the log's first measurement.
        log: N measurements.
        motion: of that log.
    """
    for first in range(0, len(runs), LANES):
        some = runs[first : first + LANES]
        made = _abreast(some, log, motion) if len(some) == LANES else None
        yield from made or (law.along(state, log, motion) for law, state in some)


def _abreast(runs: Sequence[Run], log: Log, motion: Motion) -> list[tuple[State, Estimates]] | None:
    """What `along` yields for `LANES` runs; None if they cannot be computed at once."""
    if not isinstance(motion, StructureMotion) or not all(map(_suits, runs)):
        return None
    N, n, p = len(log.t), runs[0][0].system.n, runs[0][0].system.p
    v_hats, theta_hats, pivots = packed(N, n), packed(N, p), packed(N)
    laws = Flat(packed(n), packed(p))
    for lane, (identifier, state) in enumerate(runs):
        for part, numbers in zip(laws, identifier.law, strict=True):
            part[:, lane] = numbers
        starts = state.v_hat, state.theta_hat, state.pivot
        for part, start in zip((v_hats, theta_hats, pivots), starts, strict=True):
            part[0, ..., lane] = start
    work = Workspace(*(packed(*x.shape) for x in workspace(len(motion.structure.bodies), n)))
    parts = v_hats, theta_hats, pivots
    if follow_abreast(laws, motion, *parts, packed(7, n + p), work) < N:
        return None
    rows = [np.ascontiguousarray(np.moveaxis(part, -1, 0)) for part in parts]
    made = []
    for lane, (_, state) in enumerate(runs):
        v_hat, theta_hat, pivot = (part[lane] for part in rows)
        estimates = Estimates(v_hat, theta_hat, pivot, np.full(N, state.spent))
        made.append(end_of(state, log, estimates, N))
    return made


def _suits(run: Run) -> bool:
    """Whether it has not failed, and has the paper's law with diagonal gains."""
    law, state = run[0].law, run[1]
    flat = isinstance(law, Flat) and law.K.ndim == law.Gamma.ndim == 1
    return flat and state.status is Status.completed
