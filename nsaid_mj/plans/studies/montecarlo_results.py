"""A Monte Carlo study in its folder, and its quantiles on the terminal."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...base import Finding, single_threaded
from ...core import Status, rounded
from ...report import Page, Result, Section, Statistic, Table, count
from . import sweep
from .folder import opened, read
from .montecarlo import JOBS, rows_of
from .runs import RunGroup, Runs, digits
from .study import MOST_JOBS, Row, Study, check_count
from .study_page import study_page

FIGURES = {
    "theta_perp_ratio": ("distance at end", "%"),
    "actuator_ratio_error": ("error of gain ratios", "%"),
    "conserved_drift": ("drift of the conserved quantity", "–"),
    "time_to_converge": ("converged after", "s"),
}
"""Labels and units of the figures that are printed, by column."""
QUANTILES = {"median": 0.5, "90 %": 0.9, "worst": 1.0}


@single_threaded
def run_montecarlo(
    study: Study, folder: Path, jobs: int | None = None, quiet: bool = False
) -> Runs:
    """Executes the runs that are missing in a folder, and writes the files of a sweep.

    After Ctrl-C, finished runs are kept and the same call resumes the study. `jobs` is a number of
    threads, by default that of the processors.

    Raises:
        BadRun: the folder cannot be written, or holds something else.
        InvalidInput: `jobs` is less than 1.
        NsaidError: the scenario cannot be started.
    """
    check_count("jobs", 1 if jobs is None else jobs, JOBS, MOST_JOBS)
    done = "{task.completed:.0f}/{task.total:.0f} runs"
    with opened(folder, study.manifest, quiet, done) as (known, append, bar):
        todo = [number for number in range(len(study)) if number not in known]
        task = bar.add_task(folder.name, total=len(study), completed=len(known))
        seen = partial(bar.advance, task)
        shared = study.settings["montecarlo"]["shared"]
        for group in rows_of(study.scenario, todo, jobs, shared, seen):
            for row in group:
                append(row)
    return read(folder)


# -- the terminal ----------------------------------------------------------------------------------


def quantiles(runs: Runs) -> dict[str, dict[str, float]]:
    """Quantiles of the figures by name, infinite if they fall on lost or unconverged runs.

    Figures of a lost run count as infinite.
    """
    last = [
        row | dict.fromkeys(FIGURES) if row["status"] != Status.completed.words else row
        for row in runs.rows
    ]
    group = RunGroup({}, last)
    return {
        key: {name: group.quantile(key, share) for name, share in QUANTILES.items()}
        for key in FIGURES
    }


def lost(runs: Runs) -> list[Row]:
    """Runs that ended before the scenario's duration."""
    return [row for row in runs.rows if row["status"] != Status.completed.words]


def cost(runs: Runs) -> float:
    """Median over the runs of an identifier's thread time per time step [µs]."""
    return float(np.median([row["identifier_us_per_step"] for row in runs.rows]))


def montecarlo_document(runs: Runs) -> dict[str, Any]:
    """The output of `nsaid montecarlo --json`."""
    found = {
        key: {name: value if np.isfinite(value) else None for name, value in each.items()}
        for key, each in quantiles(runs).items()
    }
    columns = ("run", "seed", "status", "status_time")
    return {
        "folder": str(runs.folder),
        "runs": runs.manifest["runs"],
        "quantiles": found,
        "lost": [{key: row[key] for key in columns} for row in lost(runs)],
        "identifier_us_per_step": cost(runs),
    }


def montecarlo_result(runs: Runs) -> Result:
    """The result of a study; a run is lost if it ended before the scenario's duration."""
    gone = lost(runs)
    shared = runs.manifest["montecarlo"]["shared"]
    failures = (
        Finding(
            "refusal",
            "lost",
            f"run {row['run']} (seed {row['seed']})",
            f"{row['status']} at {row['status_time']:.3g} s",
            "" if shared else f"\n    {runs.command(row)}",
        )
        for row in gone
    )
    statistics = (Statistic(*FIGURES[key], values) for key, values in quantiles(runs).items())
    own = sweep.sweep_result(runs)
    return replace(own, statistics=tuple(statistics), findings=tuple(failures), complete=not gone)


def montecarlo_page(runs: Runs) -> Page:
    """The page of a study for the terminal."""
    result = montecarlo_result(runs)
    lines = [
        [f"{f.name} [{f.unit}]", *(digits(value, f.unit) for value in f.values.values())]
        for f in result.statistics
    ]
    shared = runs.manifest["montecarlo"]["shared"]
    many = count(len(runs.rows), "prior" if shared else "plant")
    kind = "on one motion" if shared else "with its own motion each"
    spent = f"identifier {rounded(cost(runs), 2)} µs of thread time per run and time step"
    lead = f"{many} {kind}, {len(lost(runs))} lost; {spent}"
    table = Section("Statistics", [Table(["", *QUANTILES], lines)], brief=True)
    return study_page(runs, result, table, lead)
