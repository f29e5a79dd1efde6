"""What a sweep has found: its folder read back, its runs by combination, tables and text."""

from __future__ import annotations

import itertools
import json
import math
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..errors import BadRun
from ..resources import atomic_write

MANIFEST, ROWS, TABLE = "manifest.json", "rows.jsonl", "results.parquet"
FIGURES = ("theta_perp_ratio", "time_to_converge")
"""Columns whose distributions are printed and plotted."""
QUANTILES = {"low": 0.05, "median": 0.5, "high": 0.95}
HEADS = ("distance at end", "converged after [s]", "converged", "early", "lost")
COSTS = (
    "wall_s", "compile_s", "real_time_factor", "identifier_us_per_step", "plant_us_per_step",
)  # fmt: skip
"""Columns that differ when a run is repeated; all others are the same to the bit."""

_TYPES = {"failure": pa.string(), "time_to_converge": pa.float64()}  # where all may be null
_LINES = 40  # of a table on the terminal

Row = dict[str, Any]
"""`run`, `draw`, `seed`, the varied fields, and what `sweep_worker.supervised` has found."""


@dataclass(frozen=True)
class Sweep:
    """A sweep, read back, whole or as far as it got.

    Attributes:
        folder: where it is.
        manifest: what it is made of; see `Plan.manifest`.
        rows: what its runs have found, in the order of their numbers.
    """

    folder: Path
    manifest: dict[str, Any]
    rows: list[Row]

    @property
    def groups(self) -> list[Group]:
        """Its runs by combination of the varied fields."""
        return self.by(*self.manifest["vary"])

    def by(self, *fields: str) -> list[Group]:
        """Its runs by the values of some of the varied fields, in the order these were given."""
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

    def command(self, row: Row) -> str:
        """The command line that repeats a run alone."""
        words = ["nsaid", "run", self.manifest["script"], *self.manifest["arguments"]]
        for path in self.manifest["vary"]:
            value = row[path]
            several = isinstance(value, list)
            words += [f"--{path}", *map(str, value)] if several else [f"--{path}={value}"]
        return shlex.join([*words, f"--seed={row['seed']}"])


@dataclass(frozen=True)
class Group:
    """Runs that share values of varied fields.

    Attributes:
        values: of the fields.
        rows: of the runs.
    """

    values: dict[str, Any]
    rows: list[Row]

    @property
    def results(self) -> list[Row]:
        """Runs that have a result, however they ended."""
        return [row for row in self.rows if row["failure"] is None]

    @property
    def early(self) -> list[Row]:
        """Runs that ended before their time, with a result."""
        return [row for row in self.results if row["status"] != "completed"]

    def column(self, key: str) -> np.ndarray:
        """A figure of the runs with a result; infinite where it is None."""
        return np.array([np.inf if row[key] is None else row[key] for row in self.results], float)

    def quantile(self, key: str, share: float) -> float:
        """The figure that a share of the runs does not exceed; infinite where there is none."""
        column = self.column(key)
        return float(np.quantile(column, share, method="inverted_cdf")) if len(column) else np.inf


def read(folder: Path) -> Sweep:
    """A sweep's folder.

    Raises:
        BadRun: there is no sweep in it, or what there is cannot be read.
    """
    rows, _ = read_rows(folder) if (folder / ROWS).is_file() else ({}, 0)
    return Sweep(folder, read_manifest(folder), [rows[number] for number in sorted(rows)])


def read_manifest(folder: Path) -> dict[str, Any]:
    """What a sweep is made of; see `Plan.manifest`.

    Raises:
        BadRun: there is no manifest, or it is not a sweep's.
    """
    try:
        found = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if {"vary", "script", "arguments", "runs"} <= found.keys():
            return found
    except FileNotFoundError as error:
        raise BadRun(
            folder,
            f"there is no sweep, for lack of a {MANIFEST}",
            "Give the folder that `nsaid sweep` has written",
        ) from error
    except (ValueError, AttributeError):
        pass
    raise BadRun(folder / MANIFEST, "not a sweep's manifest", "Take the folder away")


def read_rows(folder: Path) -> tuple[dict[int, Row], int]:
    """Rows by number, the last one where there are two, and how many bytes are whole lines.

    Raises:
        BadRun: a whole line is not a row.
    """
    data = (folder / ROWS).read_bytes()
    size = data.rfind(b"\n") + 1
    try:
        rows = {row["run"]: row for row in map(json.loads, data[:size].splitlines())}
    except (ValueError, KeyError, TypeError) as error:
        raise BadRun(folder / ROWS, "not a sweep's rows", "Take the folder away") from error
    return rows, size


def write_table(folder: Path) -> Path:
    """Writes all rows there are as one Parquet table, with the manifest as its metadata."""
    sweep = read(folder)
    names = dict.fromkeys(key for row in sweep.rows for key in row)
    table = pa.table({name: _column(name, [row.get(name) for row in sweep.rows]) for name in names})
    table = table.replace_schema_metadata({"nsaid": json.dumps(sweep.manifest)})
    path = folder / TABLE
    with atomic_write(path) as partial:
        pq.write_table(table, partial)
    return path


def _column(name: str, values: list[Any]) -> pa.Array:
    if name in _TYPES:
        return pa.array(values, _TYPES[name])
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError):  # a field that takes numbers and words
        return pa.array([None if value is None else str(value) for value in values])


# -- the terminal ------------------------------------------------------------------------------


def document(sweep: Sweep) -> dict[str, Any]:
    """What `nsaid sweep --json` prints."""
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
                    f"{key}_{name}": _finite(group.quantile(key, share))
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


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def print_summary(sweep: Sweep) -> None:
    """Prints what the combinations have come to, what failed, and where the files are."""
    console = Console(highlight=False)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    fields = list(sweep.manifest["vary"])
    last = [path.rpartition(".")[2] for path in fields]
    for path, name in zip(fields, last, strict=True):
        table.add_column(name if last.count(name) == 1 else path, overflow="fold")
    for head in HEADS:
        table.add_column(head, justify="right", no_wrap=True)
    for group in sweep.groups[:_LINES]:
        table.add_row(*map(str, group.values.values()), *cells(group))
    results, runs = len(sweep.rows) - len(sweep.lost), sweep.manifest["runs"]
    console.print(f"[bold]{sweep.folder.name}[/bold]: {results} of {runs} runs have a result")
    console.print(table)
    console.print(
        "Medians, 5 % and 95 % in brackets, – is never; early: ended before their time; lost: "
        "without a result.",
        soft_wrap=True,
    )
    if len(sweep.groups) > _LINES:
        console.print(f"… and {len(sweep.groups) - _LINES} combinations more")
    for row in sweep.lost[:_LINES]:
        console.print(
            f"  [red]run {row['run']}[/red]: {escape(row['failure'])}\n"
            f"    {escape(sweep.command(row))}",
            soft_wrap=True,
        )
    if len(sweep.lost) > _LINES:
        console.print(f"  … and {len(sweep.lost) - _LINES} failures more")
    console.print(
        f"  table      {sweep.folder / TABLE}\n  plots      nsaid report {sweep.folder}",
        soft_wrap=True,
    )


def cells(group: Group) -> list[str]:
    """A group's line in a table, under `HEADS`."""
    spreads = []
    for key in FIGURES:
        low, median, high = (digits(group.quantile(key, share)) for share in QUANTILES.values())
        spreads.append(f"{median} ({low}…{high})")
    converged = int(np.isfinite(group.column("time_to_converge")).sum())
    lost = len(group.rows) - len(group.results)
    return [*spreads, f"{converged}/{len(group.results)}", str(len(group.early)), str(lost)]


def digits(value: float) -> str:
    """Two digits, without the zeros of an exponent; – where it is infinite."""
    return f"{value:.2g}".replace("e-0", "e-") if math.isfinite(value) else "–"
