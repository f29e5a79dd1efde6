"""The runs of a study: grouped by their varied values, with statistics over the seeds."""

from __future__ import annotations

import itertools
import math
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...base import Finding
from ...core import ABSENT, rounded
from .study import Row


@dataclass(frozen=True)
class Runs:
    """The runs of a study, complete or interrupted."""

    folder: Path
    manifest: dict[str, Any]  # see `Study.manifest`; `vary` holds the varied values by name
    rows: list[Row]  # rows of the finished runs, in order of their numbers
    # the damaged lines of rows on disk, which are left out, in words; empty if none. An incomplete
    # last line, which a killed sweep leaves, does not count
    damaged: str = ""
    intact: bytes = b""  # the bytes of all other lines

    @property
    def groups(self) -> list[RunGroup]:
        """The runs grouped by combination of the varied fields."""
        return self.by(*self.manifest["vary"])

    def by(self, *fields: str) -> list[RunGroup]:
        """The runs grouped by the values of some varied fields, in the order of these values."""
        values = [self.manifest["vary"][path] for path in fields]
        return [
            RunGroup(
                dict(zip(fields, combination, strict=True)),
                [
                    row
                    for row in self.rows
                    if all(row[p] == v for p, v in zip(fields, combination, strict=True))
                ],
            )
            for combination in itertools.product(*values)
        ]

    @property
    def lost(self) -> list[Row]:
        """Runs without a result."""
        return [row for row in self.rows if row["failure"]]

    def failure(self, row: Row) -> Finding:
        """A run without a result, and the command line that repeats it."""
        repeat = f"\n    {self.command(row)}"
        return Finding("refusal", "lost", f"run {row['run']}", row["failure"], repeat)

    def command(self, row: Row) -> str:
        """The command line that repeats a single run."""
        words = ["nsaid", "run", self.manifest["script"], *self.manifest["arguments"]]
        for path in self.manifest["vary"]:
            value = row[path]
            several = isinstance(value, list)
            words += [f"--{path}", *map(str, value)] if several else [f"--{path}={value}"]
        return shlex.join([*words, f"--seed={row['seed']}"])


@dataclass(frozen=True)
class RunGroup:
    """Runs with equal values, by name, of some varied fields."""

    values: dict[str, Any]
    rows: list[Row]

    @property
    def results(self) -> list[Row]:
        """Runs with a result, completed or not."""
        return [row for row in self.rows if not row["failure"]]

    @property
    def failures(self) -> list[str]:
        """Why runs have no result, one reason for each of them."""
        return [row["failure"] for row in self.rows if row["failure"]]

    @property
    def early(self) -> list[Row]:
        """Runs with a result that ended before the scenario's duration."""
        return [row for row in self.results if row["status"] != "completed"]

    def column(self, key: str) -> np.ndarray:
        """(k,) a figure of the runs with a result; infinite where it is None."""
        return np.array([np.inf if row[key] is None else row[key] for row in self.results], float)

    def quantile(self, key: str, share: float) -> float:
        """The quantile of a figure at a share of the runs; infinite if there are no runs."""
        column = self.column(key)
        return float(np.quantile(column, share, method="inverted_cdf")) if len(column) else np.inf

    def median(self, key: str) -> float:
        """The median of a figure over all runs, infinite where a run has none."""
        return float(np.median(self._all(key)))

    def best(self, key: str) -> float:
        """The smallest value of a figure over all runs; see `median`."""
        return float(np.min(self._all(key)))

    def worst(self, key: str) -> float:
        """The largest value of a figure over all runs; see `median`."""
        return float(np.max(self._all(key)))

    def _all(self, key: str) -> np.ndarray:
        return np.array([np.inf if row[key] is None else row[key] for row in self.rows], float)


def words(group: RunGroup) -> str:
    """The varied values of a group, in words."""
    return ", ".join(f"{path} {value}" for path, value in group.values.items()) or "all runs"


def digits(value: float | None, unit: str = "") -> str:
    """Formats a figure with two digits, in percent if that is its unit; – if it is not finite."""
    if value is None or not math.isfinite(value):
        return ABSENT
    return rounded(100 * value if unit == "%" else value, 2)
