"""The commands that run a scenario many times: compare, sweep, montecarlo, track, report.

Each gets the fields of its `Study` that a command line gives, the options of the command, as
`cli.grammar_of_studies` declares them, and the folder of the results; and returns the exit code.
The work is in `studies` and `track`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ..base import CHOICES, InvalidInput, UnknownName, numbers_in, print_json, printable
from ..report import ExitCode

if TYPE_CHECKING:
    from ..report import Page
    from .studies.runs import Runs


_MOST_SEEDS = 10_000  # of a comparison
_TEN = "Such as 10,20."


class ToCompareMethods(Protocol):
    """What `nsaid compare NAME` was given."""

    methods: str | None
    seeds: str
    out: Path | None
    force: bool
    durations: str | None
    sensors: str | None
    noise_scales: str | None
    budget: float | None
    bound: bool
    quiet: bool
    json: bool


class ToSweep(Protocol):
    """What `nsaid sweep NAME` was given."""

    vary: tuple[str, ...]
    seeds: int
    jobs: int | None
    timeout: float | None
    engine: str
    address: str | None
    retry: bool
    quiet: bool
    json: bool


class ToSample(Protocol):
    """What `nsaid montecarlo NAME` was given."""

    runs: int
    jobs: int | None
    own_plants: bool
    quiet: bool
    json: bool


class ToTrack(Protocol):
    """What `nsaid track NAME` was given."""

    laws: str | None
    seeds: str
    out: Path | None
    force: bool
    quiet: bool
    json: bool


def compare_methods(given: Mapping[str, Any], chosen: ToCompareMethods, folder: Path) -> int:
    """Executes `nsaid compare`: compares methods on the logs of a scenario."""
    scenario = given["scenario"]
    kinds = chosen.sensors or ("noisy" if chosen.noise_scales else scenario.sensors)
    kinds = kinds.split(",")
    if unknown := set(kinds) - {"ideal", "noisy"}:
        raise UnknownName("kind of sensors", unknown.pop(), ("ideal", "noisy"))
    scales = numbers_in("--noise-scales", chosen.noise_scales or "1", _TEN)
    methods = tuple(chosen.methods.split(",")) if chosen.methods else None
    for name in methods or ():
        CHOICES.check("method", name)
    seeds = _seeds(chosen.seeds)
    durations = (0.5 * scenario.duration, scenario.duration)
    if chosen.durations:
        durations = numbers_in("--durations", chosen.durations, _TEN)
    from .studies.compare import COMPARE_FILES, comparison_plan, run_comparison
    from .studies.compare_report import DEFAULT

    study = comparison_plan(
        **given,
        methods=DEFAULT if methods is None else methods,
        seeds=seeds,
        durations=durations,
        noises=(0.0,) * ("ideal" in kinds) + scales * ("noisy" in kinds),
        budget=chosen.budget,
        bound=chosen.bound,
    )
    files = (*COMPARE_FILES, "report.html")
    with _finished(folder, chosen, files) as own:
        result, _ = run_comparison(study, own, quiet=chosen.quiet or chosen.json)
        if chosen.json:
            print((own / COMPARE_FILES[0]).read_text(encoding="utf-8"), end="")
    return ExitCode.of(result)


def sweep_scenario(given: Mapping[str, Any], chosen: ToSweep, folder: Path) -> int:
    """Executes `nsaid sweep`: runs a scenario with varied fields and seeds."""
    vary = given["scenario"].varied(chosen.vary)
    CHOICES.check("engine", chosen.engine)
    from .studies.engine import Engine
    from .studies.sweep import run_sweep, sweep_document, sweep_plan, sweep_result

    study = sweep_plan(**given, vary=vary, seeds=chosen.seeds)
    engine = Engine(chosen.engine, chosen.address, chosen.jobs, chosen.timeout)
    found = run_sweep(study, folder, engine, chosen.quiet or chosen.json, chosen.retry)
    if chosen.json:
        print_json(sweep_document(found))
    elif not chosen.quiet:
        from .studies.sweep_report import sweep_page

        _print(sweep_page(found), found)
    return ExitCode.of(sweep_result(found))


def identify_often(given: Mapping[str, Any], chosen: ToSample, folder: Path) -> int:
    """Executes `nsaid montecarlo`: identifies from many priors."""
    from .studies.montecarlo import montecarlo_plan
    from .studies.montecarlo_results import (
        montecarlo_document,
        montecarlo_page,
        montecarlo_result,
        run_montecarlo,
    )

    study = montecarlo_plan(**given, runs=chosen.runs, shared=not chosen.own_plants)
    found = run_montecarlo(study, folder, chosen.jobs, chosen.quiet or chosen.json)
    if chosen.json:
        print_json(montecarlo_document(found))
    elif not chosen.quiet:
        _print(montecarlo_page(found), found)
    return ExitCode.of(montecarlo_result(found))


def _print(page: Page, found: Runs) -> None:
    """Prints the page of a sweep, and the paths of its files."""
    from rich.console import Console

    from ..report import print_page
    from .studies.sweep import files_of

    print_page(page, Console(highlight=False), files_of(found))


def compare_trackers(given: Mapping[str, Any], chosen: ToTrack, folder: Path) -> int:
    """Executes `nsaid track`: compares tracking laws on the plants of a scenario."""
    laws = tuple(chosen.laws.split(",")) if chosen.laws else CHOICES["tracking law"]
    for law in laws:
        CHOICES.check("tracking law", law)
    seeds = _seeds(chosen.seeds)
    from .track.run import run_tracking
    from .track.tracking import TRACKING_FILES, tracking_plan

    study = tracking_plan(**given, laws=laws, seeds=seeds)
    files = (*TRACKING_FILES, "report.html", "tracking.rrd")
    with _finished(folder, chosen, files) as own:
        result, _ = run_tracking(study, own, quiet=chosen.quiet or chosen.json)
        if chosen.json:
            print((own / TRACKING_FILES[0]).read_text(encoding="utf-8"), end="")
    return ExitCode.of(result)


def _finished(
    folder: Path, chosen: ToCompareMethods | ToTrack, files: Sequence[str]
) -> AbstractContextManager[Path]:
    """Context with the folder of a study that is not resumed: a finished one needs --force."""
    from ..lab import ResultsFolder

    own = ResultsFolder(chosen.out, chosen.force)
    return own.of_results(folder.name, files, "a finished study")


def draw_sweep(folder: Path) -> int:
    """Executes `nsaid report`: draws the page of the sweep in a folder."""
    from .studies.sweep_files import check_sweep

    check_sweep(folder)
    from .studies.folder import read
    from .studies.sweep_report import write_sweep_page

    runs = read(folder)
    if runs.damaged:
        print(f"nsaid: {runs.damaged}; the same `nsaid sweep` makes them again", file=sys.stderr)
    print(printable(str(write_sweep_page(runs))))
    return 0


def _seeds(text: str) -> tuple[int, ...]:
    """Parses seeds: `0,3,5`, or `0:10` for 0 to 9."""
    first, colon, last = text.partition(":")
    try:
        if not colon:
            return tuple(int(part) for part in text.split(","))
        start = int(first or 0)
        end = int(last)
    except ValueError as error:
        raise InvalidInput("--seeds", "0,1,2 or 0:10", text, "0:3 is 0,1,2.") from error
    if end - start > _MOST_SEEDS:
        raise InvalidInput("--seeds", f"at most {_MOST_SEEDS} seeds", text, "0:3 is 0,1,2.")
    return tuple(range(start, end))
