"""`nsaid sweep`: many runs of one scenario, with varied fields and drawn seeds.

The runs are executed by processes here or on a cluster. The result of a run depends only on its
number, not on the number of workers or on the order in which they finish. A row is appended to
`rows.jsonl` as soon as its run is finished, so a killed sweep can be resumed.
"""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base import Finding, InvalidInput
from ...lab import Scenario
from ...report import Result, Statistic, Table, count
from .engine import Engine
from .folder import TABLE, opened, read
from .one_run import Job
from .runs import RunGroup, Runs, digits, words
from .study import DrawnSeeds, Study, check_count

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


def sweep_plan(
    script: str,
    scenario: Scenario,
    vary: Mapping[str, tuple[Any, ...]],
    seeds: int = 10,
    arguments: tuple[str, ...] = (),
) -> Study:
    """The runs of a sweep.

    Args:
        script: name of the packaged scenario, or path of its script.
        scenario: its own seed is the master seed.
        vary: values by dotted name of a field.
        seeds: number of draws from the master seed.
        arguments: flags of `nsaid run` that turn the script's scenario into this one.

    Raises:
        InvalidInput: there is nothing to run, a value is duplicate or not valid in the scenario.
    """
    check_count("seeds", seeds, "100 seeds give distributions.")
    for path, values in vary.items():
        if not values or len(set(values)) < len(values):
            raise InvalidInput(path, "values without duplicates", values, "Give each once.")
        if path == "seed":
            remedy = "Give --seeds, the number of draws, and --seed, the master seed."
            raise InvalidInput("seed", "a field other than the seed", "seed", remedy)
    runs = seeds * math.prod(len(values) for values in vary.values())
    check_count("runs", runs, "Vary fewer fields, or use fewer values or seeds.")
    settings = {
        "vary": {path: list(values) for path, values in vary.items()},
        "seeds": seeds,
        "master_seed": scenario.seed,
        "runs": runs,
    }
    study = Study(script, scenario, vary, DrawnSeeds(scenario.seed, seeds), settings, arguments)
    for combination in study.combinations:
        scenario.with_fields(combination)  # raises where a value is not valid
    return study


def scenario_of(study: Study, number: int) -> Scenario:
    """The scenario of a run, with its own seed."""
    draw, combination = divmod(number, len(study.combinations))
    own = study.scenario.with_fields(study.combinations[combination])
    return replace(own, seed=study.seeds[draw])


def run_sweep(
    study: Study,
    folder: Path,
    engine: Engine | None = None,
    quiet: bool = False,
    retry: bool = False,
) -> Runs:
    """Executes the runs that are missing in a folder.

    After Ctrl-C, finished runs are kept and the same call resumes the sweep. The default engine is
    local processes. `retry` repeats runs without a result.

    Raises:
        FolderInUse: another process is writing into the folder.
        NotWritten: the folder cannot be written.
        BadRun: the folder holds another sweep.
    """
    engine = engine or Engine()
    of = "{task.completed}/{task.total} {task.fields[lost]} without result"

    def job(number: int) -> Job:
        scenario = scenario_of(study, number)
        return Job(number, study.script, study.digest, scenario.to_json(), engine.time(scenario))

    with opened(folder, study.manifest, quiet, of) as (found, append, bar):
        known = {k: row for k, row in found.items() if not retry or not row["failure"]}
        lost = sum(bool(row["failure"]) for row in known.values())
        task = bar.add_task(folder.name, total=len(study), completed=len(known), lost=lost)
        todo = [number for number in range(len(study)) if number not in known]
        for figures in engine.make(todo, job):
            row = study.what(figures["run"]) | figures
            append(row)
            lost += bool(row["failure"])
            bar.update(task, advance=1, lost=lost)
    return read(folder)


# -- what is found ---------------------------------------------------------------------------------


def sweep_document(runs: Runs) -> dict[str, Any]:
    """The output of `nsaid sweep --json`; numbers may be infinite."""
    return {
        "folder": str(runs.folder),
        "runs": runs.manifest["runs"],
        "results": len(runs.rows) - len(runs.lost),
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
            for group in runs.groups
        ],
        "failures": [
            {
                "run": row["run"],
                "seed": row["seed"],
                "failure": row["failure"],
                "repeat": runs.command(row),
            }
            for row in runs.lost
        ],
    }


def lead_of(runs: Runs) -> str:
    """How many runs have a result."""
    results = len(runs.rows) - len(runs.lost)
    total = runs.manifest["runs"]
    return f"{results} of {count(total, 'run')} {'has' if total == 1 else 'have'} a result"


def table_of(runs: Runs, fields: Sequence[str]) -> Table:
    """The figures of all combinations of the varied fields, which have these names."""
    lines = [[*map(str, group.values.values()), *cells(group)] for group in runs.groups]
    return Table([*fields, *HEADS], lines, range(len(fields)))


def sweep_result(runs: Runs) -> Result:
    """The result of a sweep: the share of converged runs, and the distribution of its figures.

    A sweep shows a distribution: it fails only if no run has a result.
    """
    found = RunGroup({}, runs.rows)
    distances = RunGroup({}, found.results)  # of the same quantiles as the table
    converged = int(np.isfinite(found.column("time_to_converge")).sum())
    done = len(runs.rows)
    sentence = f"{converged} of {count(done, 'run')} converged"
    if found.results:
        median, worst = (100 * distances.quantile("theta_perp_ratio", k) for k in (0.5, 1.0))
        sentence += (
            f"; distance to the true set at the end {median:.2g} % in the median, {worst:.2g} % in "
            "the worst run"
        )
    missing = runs.manifest["runs"] - done
    unfinished = Finding("refusal", "missing", "not finished", f"{missing} of the runs")
    figures = [
        Statistic(
            f"{label}, {name}",
            unit,
            {words(group): group.quantile(key, share) for group in runs.groups},
        )
        for key, (label, unit) in FIGURES.items()
        for name, share in QUANTILES.items()
    ]
    return Result(
        explains="yes" if converged == done else "partly" if found.results else "no",
        verdict=f"{sentence}.",
        statistics=tuple(figures),
        findings=(*([unfinished] if missing else []), *map(runs.failure, runs.lost)),
        complete=not runs.lost,
    )


def files_of(runs: Runs) -> list[str]:
    """The path of the table, and the command for plots."""
    again = shlex.quote(str(runs.folder))
    return [f"table      {runs.folder / TABLE}", f"plots      nsaid report {again}"]


def cells(group: RunGroup) -> list[str]:
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
