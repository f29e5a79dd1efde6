"""Studies in memory, and what differs when one of their runs is repeated."""

from nsaid_mj.base.threads import single_threaded
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.plans.studies.montecarlo import montecarlo_plan, rows_of
from nsaid_mj.plans.studies.study import Row

COSTS = (
    "wall_s",
    "compile_s",
    "real_time_factor",
    "identifier_us_per_step",
    "plant_us_per_step",
)
"""Columns that differ when a run is repeated; all others are identical to the bit."""


@single_threaded
def monte_carlo(
    scenario: Scenario, runs: int, jobs: int | None = None, shared: bool = True
) -> list[Row]:
    """The rows of a Monte Carlo study, in order."""
    study = montecarlo_plan("none", scenario, runs, shared)
    rows = [row for part in rows_of(scenario, range(len(study)), jobs, shared) for row in part]
    return sorted(rows, key=lambda row: row["run"])
