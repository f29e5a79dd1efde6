"""A Monte Carlo study in its folder, and its quantiles on the terminal."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..evaluation.result import Result, Statistic
from ..laws import Status
from ..numerics.threads import single_threaded
from ..pages.page import Page, Section, Table, count
from ..parameters import rounded
from ..robot.findings import Finding
from . import sweep_results
from .montecarlo import JOBS, Plan, rows_of
from .study import MOST_JOBS, check_count
from .sweep import opened
from .sweep_results import Group, Row, Sweep, digits, read

FIGURES = {
    "theta_perp_ratio": ("distance at end", "%"),
    "actuator_ratio_error": ("error of gain ratios", "%"),
    "conserved_drift": ("drift of the conserved quantity", "–"),
    "time_to_converge": ("converged after", "s"),
}
"""Labels and units of the figures that are printed, by column."""
QUANTILES = {"median": 0.5, "90 %": 0.9, "worst": 1.0}


@single_threaded
def run(plan: Plan, folder: Path, jobs: int | None = None, quiet: bool = False) -> Sweep:
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
    with opened(folder, plan.manifest, quiet, done) as (known, append, bar):
        todo = [number for number in range(plan.runs) if number not in known]
        task = bar.add_task(folder.name, total=plan.runs, completed=len(known))
        seen = partial(bar.advance, task)
        for group in rows_of(plan.scenario, todo, jobs, plan.shared, seen):
            for row in group:
                append(row)
    return read(folder)


# -- the terminal ----------------------------------------------------------------------------------


def quantiles(sweep: Sweep) -> dict[str, dict[str, float]]:
    """Quantiles of the figures by name, infinite if they fall on lost or unconverged runs.

    Figures of a lost run count as infinite.
    """
    last = [
        row | dict.fromkeys(FIGURES) if row["status"] != Status.completed.words else row
        for row in sweep.rows
    ]
    group = Group({}, last)
    return {
        key: {name: group.quantile(key, share) for name, share in QUANTILES.items()}
        for key in FIGURES
    }


def lost(sweep: Sweep) -> list[Row]:
    """Runs that ended before the scenario's duration."""
    return [row for row in sweep.rows if row["status"] != Status.completed.words]


def cost(sweep: Sweep) -> float:
    """Median over the runs of an identifier's thread time per time step [µs]."""
    return float(np.median([row["identifier_us_per_step"] for row in sweep.rows]))


def document(sweep: Sweep) -> dict[str, Any]:
    """The output of `nsaid montecarlo --json`."""
    found = {
        key: {name: value if np.isfinite(value) else None for name, value in each.items()}
        for key, each in quantiles(sweep).items()
    }
    columns = ("run", "seed", "status", "status_time")
    return {
        "folder": str(sweep.folder),
        "runs": sweep.manifest["runs"],
        "quantiles": found,
        "lost": [{key: row[key] for key in columns} for row in lost(sweep)],
        "identifier_us_per_step": cost(sweep),
    }


def result_of(sweep: Sweep) -> Result:
    """The result of a study; a run is lost if it ended before the scenario's duration."""
    gone, shared = lost(sweep), sweep.manifest["montecarlo"]["shared"]
    failures = (
        Finding(
            "refusal", "lost", f"run {row['run']} (seed {row['seed']})",
            f"{row['status']} at {row['status_time']:.3g} s",
            "" if shared else f"\n    {sweep.command(row)}",
        )
        for row in gone
    )  # fmt: skip
    figures = (Statistic(*FIGURES[key], values) for key, values in quantiles(sweep).items())
    own = sweep_results.result_of(sweep)
    return replace(own, statistics=tuple(figures), findings=tuple(failures), complete=not gone)


def page_of(sweep: Sweep) -> Page:
    """The page of a study for the terminal."""
    result = result_of(sweep)
    lines = [
        [f"{f.name} [{f.unit}]", *(digits(value, f.unit) for value in f.values.values())]
        for f in result.statistics
    ]
    shared = sweep.manifest["montecarlo"]["shared"]
    many = count(len(sweep.rows), "prior" if shared else "plant")
    kind = "on one motion" if shared else "with its own motion each"
    spent = f"identifier {rounded(cost(sweep), 2)} µs of thread time per run and time step"
    return Page(
        heading=sweep.folder.name,
        result=result,
        lead=f"{many} {kind}, {len(lost(sweep))} lost; {spent}",
        sections=[Section("Figures", [Table(["", *QUANTILES], lines)], brief=True)],
    )
