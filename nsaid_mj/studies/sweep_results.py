"""Results of a sweep: reads its folder, groups its runs, judges them and writes tables."""

from __future__ import annotations

import itertools
import json
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ..errors import BadRun
from ..evaluation.result import Result, Statistic
from ..pages.page import Table, count
from ..parameters import ABSENT, rounded
from ..resources import atomic_write, json_of
from ..robot.findings import Finding

MANIFEST, ROWS, TABLE = "manifest.json", "rows.jsonl", "results.parquet"
FIGURES = {
    "theta_perp_ratio": ("distance at end", "%"),
    "time_to_converge": ("converged after", "s"),
}
"""Labels and units of the columns whose distributions are printed and plotted."""
QUANTILES = {"low": 0.05, "median": 0.5, "high": 0.95}
SPREADS = (
    "Medians, with 5 % and 95 % quantiles in brackets; – means never. Early: ended before the "
    "scenario's duration. Lost: no result."
)
HEADS = (*(f"{name} [{unit}]" for name, unit in FIGURES.values()), "converged", "early", "lost")
_TYPES = {"failure": pa.string(), "time_to_converge": pa.float64()}  # columns that may be all null

Row = dict[str, Any]
"""`run`, `draw`, `seed`, the varied fields, and the figures from `sweep_worker.supervised`."""


@dataclass(frozen=True)
class Sweep:
    """A sweep read from its folder, complete or interrupted."""

    folder: Path
    manifest: dict[str, Any]  # see `Plan.manifest`
    rows: list[Row]  # rows of the finished runs, in order of their numbers
    # the damaged lines of rows on disk, which are left out, in words; empty if none. An incomplete
    # last line, which a killed sweep leaves, does not count
    damaged: str = ""
    intact: bytes = b""  # the bytes of all other lines

    @property
    def groups(self) -> list[Group]:
        """The runs grouped by combination of the varied fields."""
        return self.by(*self.manifest["vary"])

    def by(self, *fields: str) -> list[Group]:
        """The runs grouped by the values of some varied fields, in the order of these values."""
        values = [self.manifest["vary"][path] for path in fields]
        return [
            Group(
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
        return [row for row in self.rows if row["failure"] is not None]

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
class Group:
    """Runs with equal values, by name, of some varied fields."""

    values: dict[str, Any]
    rows: list[Row]

    @property
    def results(self) -> list[Row]:
        """Runs with a result, completed or not."""
        return [row for row in self.rows if row["failure"] is None]

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


def read(folder: Path) -> Sweep:
    """Reads a sweep's folder, of several rows of one run the last one.

    Raises:
        BadRun: there is no sweep in it, or it is unreadable.
    """
    manifest = _manifest(folder)
    try:
        data = (folder / ROWS).read_bytes()
    except FileNotFoundError:
        data = b""
    except OSError as error:
        raise BadRun(
            folder / ROWS, f"{error.strerror}", "Delete it to make all runs again"
        ) from error
    rows, damaged, intact = dict[int, Row](), list[str](), list[bytes]()
    for number, line in enumerate(data[: data.rfind(b"\n") + 1].split(b"\n")[:-1], 1):
        row = _row(line, manifest)
        if row is None:
            damaged.append(str(number))
        else:
            rows[row["run"]] = row
            intact.append(line + b"\n")
    words = ""
    if damaged:
        lines, are = ("lines", "are") if len(damaged) > 1 else ("line", "is")
        more = " …" if len(damaged) > 10 else ""
        words = f"{ROWS}: {lines} {', '.join(damaged[:10])}{more} {are} damaged"
    found = [rows[number] for number in sorted(rows)]
    return Sweep(folder, manifest, found, words, b"".join(intact))


def _manifest(folder: Path) -> dict[str, Any]:
    """Reads a sweep's manifest, or its copy in the table if that is missing or damaged."""
    for text in (
        (folder / MANIFEST).read_bytes,
        lambda: (pq.read_schema(folder / TABLE).metadata or {})[b"nsaid"],
    ):
        try:
            found = json_of(text())
            if {"vary", "script", "arguments", "runs"} <= found.keys():
                return found
        except (OSError, ValueError, AttributeError, KeyError, TypeError):
            continue
    if (folder / MANIFEST).is_file():
        raise BadRun(folder / MANIFEST, "not a sweep's manifest", "Delete the folder")
    if (folder / ROWS).is_file():
        raise BadRun(
            folder,
            f"{MANIFEST} is missing, so the sweep of its rows is unknown",
            f"Restore the file; or delete {ROWS}, to make all runs again",
        )
    raise BadRun(
        folder,
        f"not a sweep folder: {MANIFEST} is missing",
        "Give a folder that `nsaid sweep` has written",
    )


def _row(line: bytes, manifest: dict[str, Any]) -> Row | None:
    """The row in a line; None if it is damaged."""
    try:
        row = json_of(line)
        needed = {"run", "draw", "seed", "failure", *manifest["vary"]}
        if row["failure"] is None:
            needed |= {"status", *FIGURES}
        numbered = type(row["run"]) is int and 0 <= row["run"] < manifest["runs"]
        figures = all(isinstance(row.get(key), float | int | None) for key in FIGURES)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return row if numbered and figures and needed <= row.keys() else None


def write_table(folder: Path) -> Path:
    """Writes all rows as one Parquet table, with the manifest as metadata."""
    sweep = read(folder)
    names = dict.fromkeys(key for row in sweep.rows for key in row)
    table = pa.table({name: _column(name, [row.get(name) for row in sweep.rows]) for name in names})
    table = table.replace_schema_metadata({"nsaid": json.dumps(sweep.manifest)})
    path = folder / TABLE
    with atomic_write(path) as partial:
        pq.write_table(table, partial)
    return path


def _column(name: str, values: list[Any]) -> pa.Array:
    try:
        return pa.array(values, _TYPES.get(name))
    except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):  # several types, a large integer
        return pa.array([None if value is None else str(value) for value in values])


# -- the terminal ------------------------------------------------------------------------------


def document(sweep: Sweep) -> dict[str, Any]:
    """The output of `nsaid sweep --json`; numbers may be infinite."""
    return {
        "folder": str(sweep.folder),
        "runs": sweep.manifest["runs"],
        "results": len(sweep.rows) - len(sweep.lost),
        "combinations": [
            {
                "values": group.values,
                "results": len(group.results),
                "ended_early": len(group.early),
                **{
                    f"{key}_{name}": group.quantile(key, share)
                    for key in FIGURES
                    for name, share in QUANTILES.items()
                },
            }
            for group in sweep.groups
        ],
        "failures": [
            {
                "run": row["run"],
                "seed": row["seed"],
                "failure": row["failure"],
                "repeat": sweep.command(row),
            }
            for row in sweep.lost
        ],
    }


def lead_of(sweep: Sweep) -> str:
    """How many runs have a result."""
    results, runs = len(sweep.rows) - len(sweep.lost), sweep.manifest["runs"]
    return f"{results} of {count(runs, 'run')} {'has' if runs == 1 else 'have'} a result"


def table_of(sweep: Sweep, fields: Sequence[str]) -> Table:
    """The figures of all combinations of the varied fields, which have these names."""
    lines = [[*map(str, group.values.values()), *cells(group)] for group in sweep.groups]
    return Table([*fields, *HEADS], lines, range(len(fields)))


def result_of(sweep: Sweep) -> Result:
    """The result of a sweep: the share of converged runs, and the distribution of its figures.

    A sweep shows a distribution: it fails only if no run has a result.
    """
    found, lost = Group({}, sweep.rows), sweep.lost
    distances = found.column("theta_perp_ratio")
    distances = distances[np.isfinite(distances)]
    converged, runs = int(np.isfinite(found.column("time_to_converge")).sum()), len(sweep.rows)
    sentence = f"{converged} of {count(runs, 'run')} converged"
    if len(distances):
        sentence += (
            f"; distance to the true set at the end {100 * np.median(distances):.2g} % in the "
            f"median, {100 * distances.max():.2g} % in the worst run"
        )
    missing = sweep.manifest["runs"] - runs
    unfinished = Finding("refusal", "missing", "not finished", f"{missing} of the runs")
    figures = [
        Statistic(
            f"{label}, {name}", unit,
            {words(group): group.quantile(key, share) for group in sweep.groups},
        )
        for key, (label, unit) in FIGURES.items()
        for name, share in QUANTILES.items()
    ]  # fmt: skip
    return Result(
        explains="yes" if converged == runs else "partly" if found.results else "no",
        verdict=f"{sentence}.",
        statistics=tuple(figures),
        findings=(*([unfinished] if missing else []), *map(sweep.failure, lost)),
        complete=not lost,
    )


def words(group: Group) -> str:
    """The values of a group's varied fields, in words."""
    return ", ".join(f"{path} {value}" for path, value in group.values.items()) or "all runs"


def files_of(sweep: Sweep) -> list[str]:
    """The path of the table, and the command for plots."""
    again = shlex.quote(str(sweep.folder))
    return [f"table      {sweep.folder / TABLE}", f"plots      nsaid report {again}"]


def cells(group: Group) -> list[str]:
    """A group's cells in a table, in the order of `HEADS`."""
    spreads = []
    for key, (_, unit) in FIGURES.items():
        low, median, high = (
            digits(group.quantile(key, share), unit) for share in QUANTILES.values()
        )
        spreads.append("–" if median == low == high == "–" else f"{median} ({low}…{high})")
    converged = int(np.isfinite(group.column("time_to_converge")).sum())
    lost = len(group.rows) - len(group.results)
    return [*spreads, f"{converged}/{len(group.results)}", str(len(group.early)), str(lost)]


def digits(value: float | None, unit: str = "") -> str:
    """Formats a figure with two digits, in percent if that is its unit; – if it is not finite."""
    if value is None or not math.isfinite(value):
        return ABSENT
    return rounded(100 * value if unit == "%" else value, 2)
