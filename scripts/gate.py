"""Checks that refactoring leaves all recorded numbers unchanged, by hashes of short runs.

Runs every scenario briefly with the laws paper, cone and memory, with ideal and noisy sensors, arms
on both backends, and prints for each run one hash over the columns of record.arrow.

    python scripts/gate.py --save runs/gate          # before: hashes and columns
    python scripts/gate.py --against runs/gate       # after: the same hashes, or by how much not

The record's metadata are not hashed. Runs on Pinocchio's regressors, whose sums may be reordered,
pass if no column differs by more than 1e-9 of its largest value, or by 1e-7 if the memory has no
anchor (ideal sensors), because its implicit steps then amplify rounding in weakly excited
directions. All other runs must be bit-identical. Results depend on the processor and on the
versions of numpy and numba: save and compare on one machine.
"""

from __future__ import annotations

import argparse
import hashlib
import runpy
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import nsaid_mj
from nsaid_mj import Record, Scenario

SCENARIOS = Path(__file__).resolve().parent.parent / "scenarios"
STEPS, SECONDS = 300, 1.5  # duration of a run: the longer of the two
TOLERANCE, REMEMBERED = 1e-9, 1e-7  # of a column's largest value, on Pinocchio's regressors


def cases(only: str) -> Iterator[tuple[str, Scenario]]:
    """The name and scenario of every run whose name contains `only`."""
    for path in sorted(SCENARIOS.glob("[!_]*.py")):
        found = runpy.run_path(str(path))["scenario"]
        arm = any(field.name == "backend" for field in fields(found.plant))
        for backend in ("pinocchio", "compiled") if arm else ("",):
            plant = replace(found.plant, backend=backend) if arm else found.plant
            for law in ("paper", "cone", "memory"):
                for sensors in ("ideal", "noisy"):
                    name = "-".join(filter(None, (path.stem, backend, law, sensors)))
                    if only in name:
                        yield (
                            name,
                            replace(
                                found,
                                plant=plant,
                                identifier=replace(found.identifier, law=law),
                                sensors=sensors,
                                held_out=max(2 * found.dt, 0.1),
                                record_every=1,
                                duration=max(SECONDS, STEPS * found.dt),
                            ),
                        )


def columns_of(scenario: Scenario) -> dict[str, Any]:
    """Runs a scenario; returns the columns of its record."""
    with tempfile.TemporaryDirectory() as folder:
        nsaid_mj.run(scenario, Path(folder))
        return dict(Record.read(Path(folder)).columns)


def digest(columns: dict[str, Any]) -> str:
    """Twelve hexadecimal digits of all columns."""
    found = hashlib.sha256()
    for name, column in columns.items():
        found.update(f"{name} {column.shape}".encode())
        found.update(np.ascontiguousarray(column).tobytes())
    return found.hexdigest()[:12]


def difference(columns: dict[str, Any], kept: Any) -> float:
    """The largest difference of two records, as a share of each column's largest value."""
    if set(columns) != set(kept):
        return np.inf
    worst = 0.0
    for name, column in columns.items():
        other = kept[name]
        if other.shape != column.shape:
            return np.inf
        if not np.array_equal(np.isfinite(other), np.isfinite(column)):
            return np.inf  # a number on one side only
        with np.errstate(invalid="ignore"):
            apart = np.max(np.abs(np.nan_to_num(column - other)), initial=0.0)
        worst = max(worst, apart / max(np.max(np.abs(np.nan_to_num(other)), initial=0.0), 1e-300))
    return float(worst)


def main() -> int:
    """Saves or compares; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--save", type=Path, metavar="FOLDER", help="keep hashes and columns")
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="compare with these")
    parser.add_argument("--only", default="", metavar="TEXT", help="runs whose name has this")
    chosen = parser.parse_args()
    failed = 0
    for name, scenario in cases(chosen.only):
        columns = columns_of(scenario)
        words = digest(columns)
        if chosen.save:
            chosen.save.mkdir(parents=True, exist_ok=True)
            np.savez(chosen.save / f"{name}.npz", **columns)
        if chosen.against:
            with np.load(chosen.against / f"{name}.npz") as kept:
                same = digest({key: kept[key] for key in kept.files}) == words
                apart = 0.0 if same else difference(columns, kept)
            most = REMEMBERED if "-memory-" in name else TOLERANCE
            good = same or ("pinocchio" in name and apart <= most)
            words += " same" if same else f" {apart:.1e} {'within' if good else 'DIFFERENT'}"
            failed += not good
        print(f"{name:44} {words}", flush=True)
    if chosen.against:
        print(f"{failed} differ" if failed else "all hold")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
