"""What a comparison finds: a cell for each method on each stretch of log, and their medians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args, get_type_hints

import numpy as np

from ..baselines import BATCH
from ..identifiers import NullspaceAID

PRIOR = "prior"
"""The prior itself, judged beside the methods."""

LAWS: tuple[str, ...] = get_args(get_type_hints(NullspaceAID)["law"])

METHODS = ("conventional", *LAWS, *BATCH, "sysid")
DEFAULT = METHODS[:-1]  # all that take seconds

FIGURES = (
    ("distance to the true set", "theta_perp_ratio"),
    ("error of an actuator's share", "actuator_ratio_error"),
    ("force residual, held out", "force_residual_ratio"),
    ("wall time [s]", "wall_s"),
)
"""What is compared: label, key."""


@dataclass(frozen=True)
class Cell:
    """One method on one stretch of one log.

    Attributes:
        method: its name.
        seed: of the run.
        noise: multiple of the scenario's sensor noise.
        duration: of the log [s].
        theta_perp_ratio: as in summary.json; None, as those below, where the method failed.
        actuator_ratio_error: as in summary.json.
        force_residual_ratio: as in summary.json; None too where the plant diverges on the
            held-out trajectory.
        wall_s: what the method took, forming its regressors included [s].
        note: what it chose by itself.
        failure: why it failed, "" where it did not.
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
    """A multiple of the scenario's noise in words."""
    return "exact sensors" if noise == 0 else f"{noise:g} × noise"


@dataclass(frozen=True)
class Row:
    """One method over all seeds; a figure of a failed seed counts as infinite.

    Attributes:
        method: its name.
        noise: multiple of the scenario's sensor noise.
        duration: of the log [s].
        median: median over the seeds, by key of `FIGURES`.
        worst: largest over the seeds, by key of `FIGURES`.
        best: smallest over the seeds, by key of `FIGURES`.
        failures: why it failed, one for each seed that did.
        notes: what it chose by itself, each once.
    """

    method: str
    noise: float
    duration: float
    median: dict[str, float]
    worst: dict[str, float]
    best: dict[str, float]
    failures: tuple[str, ...]
    notes: tuple[str, ...]


def rows(cells: Sequence[Cell]) -> list[Row]:
    """Medians, worst and best over the seeds, in the order of `METHODS`."""
    groups: dict[tuple[float, float, str], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.noise, cell.duration, cell.method), []).append(cell)
    found = []
    order = (PRIOR, *METHODS)
    for noise, duration, method in sorted(groups, key=lambda k: (*k[:2], order.index(k[2]))):
        group = groups[noise, duration, method]
        values = {
            key: np.array([_number(getattr(cell, key)) for cell in group]) for _, key in FIGURES
        }
        found.append(
            Row(
                method,
                noise,
                duration,
                median={key: float(np.median(v)) for key, v in values.items()},
                worst={key: float(np.max(v)) for key, v in values.items()},
                best={key: float(np.min(v)) for key, v in values.items()},
                failures=tuple(cell.failure for cell in group if cell.failure),
                notes=tuple(dict.fromkeys(cell.note for cell in group if cell.note)),
            )
        )
    return found


def _number(value: float | None) -> float:
    return np.inf if value is None else value
