"""The commands of `nsaid` and their own options; a scenario's fields are added in `options`.

Nothing heavy is imported here, so that `nsaid --help` answers at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, UseAppendAction, arg, subcommand

ScenarioName = Annotated[
    Positional[str],
    arg(metavar="NAME_OR_FILE", help="see `nsaid list`, or give the path of a script"),
]


@dataclass(frozen=True)
class Output:
    """What becomes of a run.

    Attributes:
        out: folder of the run; by default runs/NAME-LAW, numbered where that is taken.
        force: overwrite the completed run that is in the folder.
        quiet: print nothing but errors.
        json: print the summary as JSON to the standard output, and nothing else.
        live: show the run in the Rerun viewer while it runs.
    """

    out: Path | None = None
    force: bool = False
    quiet: bool = False
    json: bool = False
    live: bool = False


@dataclass(frozen=True)
class Comparison:
    """What is compared, and where it is written.

    Attributes:
        methods: between commas; all but sysid by default.
        seeds: such as 0,1,2 or 0:10.
        durations: of the log, between commas [s]; by default half of it and all.
        sensors: ideal, noisy or ideal,noisy; by default the scenario's.
        noise_scales: multiples of the scenario's noise, between commas.
        budget: search time of sysid, at most [s].
        out: folder; by default runs/NAME-compare.
        quiet: print nothing but errors.
        json: print the table as JSON to the standard output, and nothing else.
    """

    methods: str | None = None
    seeds: str = "0:3"
    durations: str | None = None
    sensors: str | None = None
    noise_scales: str | None = None
    budget: float | None = None
    out: Path | None = None
    quiet: bool = False
    json: bool = False


@dataclass(frozen=True)
class Sweeping:
    """How a scenario is varied, and who makes the runs.

    Attributes:
        vary: a field and its values, such as identifier.gain=0.1,1,10; once for every field.
        seeds: how many are drawn from the master seed.
        jobs: how many runs at once; by default as many as there are processors.
        timeout: wall time of a run, which is then lost [s].
        engine: loky (this machine) or dask.
        address: of the cluster's scheduler.
        retry: make the lost runs once more.
        out: folder; by default runs/NAME-sweep.
        json: print medians and failures as JSON.
        quiet: print nothing but errors.
    """

    vary: UseAppendAction[tuple[Annotated[str, arg(metavar="FIELD=A,B,C")], ...]] = ()
    seeds: int = 10
    jobs: int | None = None
    timeout: float | None = None
    engine: str = "loky"
    address: str | None = None
    retry: bool = False
    out: Path | None = None
    json: bool = False
    quiet: bool = False


@dataclass(frozen=True)
class Drawing:
    """How many runs, and of what.

    Attributes:
        runs: how many.
        jobs: how many at once; by default as many as there are processors.
        own_plants: a plant with its own truth and motion for every run, instead of one for all.
        out: folder; by default runs/NAME-montecarlo.
        json: print quantiles as JSON.
        quiet: print nothing but errors.
    """

    runs: int = 256
    jobs: int | None = None
    own_plants: bool = False
    out: Path | None = None
    json: bool = False
    quiet: bool = False


@dataclass(frozen=True)
class List:
    """List the scenarios, and the robots for `nsaid run arm --robot`."""


@dataclass(frozen=True)
class Run(Output):
    """Run a scenario by name or file.

    The scenario's fields are flags too: `nsaid run NAME --help` lists them all.
    """

    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class Verify:
    """Run a scenario, or read a run, and judge the paper's statements on it.

    `nsaid verify NAME_OR_FILE` takes the flags of `nsaid run` and runs the scenario first;
    `nsaid verify --run FOLDER` judges a run from its record. Exit code 1 where a statement fails.

    Attributes:
        run: folder of the run to judge.
        quiet: print nothing but errors.
        json: print the verdicts as JSON to the standard output, and nothing else.
    """

    run: Annotated[Path, arg(metavar="FOLDER")]
    quiet: bool = False
    json: bool = False


@dataclass(frozen=True)
class Compare(Comparison):
    """Compare methods on the logs of a scenario.

    Methods get the same logs and are judged by the same figures: a table, compare.json,
    compare.csv and plots. The scenario's fields are flags too: `nsaid compare NAME --help`.
    """

    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class Sweep(Sweeping):
    """Run a scenario many times, with fields varied and seeds drawn.

    Runs every combination of the varied fields with every seed, in parallel. The same command goes
    on where an earlier one was stopped. The scenario's fields are flags too (`nsaid sweep NAME
    --help`); --seed is the master that all seeds are drawn from. Exit code 1 where a run is lost.
    """

    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class MonteCarlo(Drawing):
    """Follow one motion, or many plants', from many priors, in one process.

    Simulates first, then identifies in compiled threads, and prints the quantiles of the final
    figures. The same command goes on where an earlier one was stopped. The scenario's fields are
    flags too (`nsaid montecarlo NAME --help`); --seed is the master of all draws.
    """

    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class Report:
    """Draw a sweep's distributions on one page.

    Attributes:
        sweep: the sweep's folder, e.g. runs/ur5-sweep.
    """

    sweep: Positional[Path]


@dataclass(frozen=True)
class View:
    """Open a run's recording in the Rerun viewer.

    Attributes:
        run: the run's folder, e.g. runs/ur5-paper.
        web: serve it to a browser on this machine.
        rebuild: make recording and report anew.
    """

    run: Positional[Path]
    web: bool = False
    rebuild: bool = False


Command = (
    Annotated[List, subcommand("list")]
    | Annotated[Run, subcommand("run")]
    | Annotated[Verify, subcommand("verify")]
    | Annotated[Compare, subcommand("compare")]
    | Annotated[Sweep, subcommand("sweep")]
    | Annotated[MonteCarlo, subcommand("montecarlo")]
    | Annotated[Report, subcommand("report")]
    | Annotated[View, subcommand("view")]
)


def parse(arguments: Sequence[str]) -> Command:
    """The command of a command line that gives no scenario's fields."""
    return tyro.cli(
        Command,  # type: ignore[arg-type]  # a union is no type to pyright
        prog="nsaid",
        description="Identifies a robot's plant and actuators together, from how it moves.\n\n"
        "`nsaid run NAME --help` lists every field of a scenario; `nsaid --version` prints the "
        "version.",
        args=list(arguments),
        config=(tyro.conf.FlagCreatePairsOff,),
    )
