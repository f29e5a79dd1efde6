"""Results of a comparison: a cell per method and log, and statistics over the seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args, get_type_hints

import numpy as np

from ..baselines import BATCH
from ..identifiers import NullspaceAID

PRIOR = "prior"
"""Name of the prior, which is judged like a method."""

BOUND = "bound"
"""Name of the Cramér–Rao bound, whose median figures stand beside those of the methods."""

LAWS: tuple[str, ...] = get_args(get_type_hints(NullspaceAID)["law"])

METHODS = ("conventional", *LAWS, *BATCH, "sysid")
DEFAULT = METHODS[:-1]  # all but sysid, which takes minutes

FIGURES = (
    ("distance to the true set", "theta_perp_ratio"),
    ("error of gain ratios", "actuator_ratio_error"),
    ("force residual, held out", "force_residual_ratio"),
    ("wall time [s]", "wall_s"),
)
"""The figures that are compared: label, key."""


@dataclass(frozen=True)
class Cell:
    """The result of one method on one log; figures are those of summary.json, None if it failed.

    Attributes:
        noise: multiple of the scenario's sensor noise.
        duration: length of the log [s].
        force_residual_ratio: None also if the plant diverges on the held-out trajectory.
        wall_s: wall time of the method, including its regressors [s].
        note: settings that the method chose automatically.
        failure: why it failed; empty if it did not.
    """

    method: str
    seed: int
    noise: float
    duration: float
    theta_perp_ratio: float | None = None
    actuator_ratio_error: float | None = None
    force_residual_ratio: float | None = None
    wall_s: float | None = None
    note: str = ""
    failure: str = ""


def sensors(noise: float) -> str:
    """A multiple of the scenario's sensor noise, in words."""
    return "exact sensors" if noise == 0 else f"{noise:g} × noise"


@dataclass(frozen=True)
class Row:
    """Statistics of one method over all seeds, by key of `FIGURES`; failed seeds count as infinite.

    Attributes:
        noise: multiple of the scenario's sensor noise.
        duration: length of the log [s].
        failures: one reason for each failed seed.
        notes: settings that the method chose automatically, without duplicates.
        over_bound: median over that of the Cramér–Rao bound; empty where that was not computed.
    """

    method: str
    noise: float
    duration: float
    median: dict[str, float]
    worst: dict[str, float]
    best: dict[str, float]
    failures: tuple[str, ...]
    notes: tuple[str, ...]
    over_bound: dict[str, float]


def rows(cells: Sequence[Cell]) -> list[Row]:
    """Statistics over the seeds, ordered by noise, duration and `METHODS`."""
    groups: dict[tuple[float, float, str], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.noise, cell.duration, cell.method), []).append(cell)
    found: list[Row] = []
    bounds: dict[tuple[float, float], dict[str, float]] = {}
    order = (PRIOR, BOUND, *METHODS)
    for noise, duration, method in sorted(groups, key=lambda k: (*k[:2], order.index(k[2]))):
        group = groups[noise, duration, method]
        values = {
            key: np.array([_number(getattr(cell, key)) for cell in group]) for _, key in FIGURES
        }
        median = {key: float(np.median(v)) for key, v in values.items()}
        if method == BOUND:
            bounds[noise, duration] = {
                key: value for key, value in median.items() if 0 < value < np.inf
            }
        least = bounds.get((noise, duration), {}) if method not in {PRIOR, BOUND} else {}
        found.append(
            Row(
                method,
                noise,
                duration,
                median=median,
                worst={key: float(np.max(v)) for key, v in values.items()},
                best={key: float(np.min(v)) for key, v in values.items()},
                failures=tuple(cell.failure for cell in group if cell.failure),
                notes=tuple(dict.fromkeys(cell.note for cell in group if cell.note)),
                over_bound={key: median[key] / value for key, value in least.items()},
            )
        )
    return found


def _number(value: float | None) -> float:
    return np.inf if value is None else value
