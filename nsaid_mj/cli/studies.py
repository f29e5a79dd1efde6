"""The commands that run a scenario many times: compare, sweep, montecarlo, track, report.

The work is in `studies`; `nsaid compare --log … --models …` judges model files on logs.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import tyro
from tyro.conf import arg

from ..base import (
    ENGINES,
    FITTED,
    METHODS,
    TRACKING_LAWS,
    InvalidInput,
    UnknownName,
    check_choice,
    check_sweep,
    print_json,
    printable,
)
from ..lab import load
from ..robots import check_model
from .checks import check_logs, check_map, check_plant, numbers_in
from .grammar_of_studies import Compare, MonteCarlo, Report, Sweep, Track
from .process import code_of

if TYPE_CHECKING:
    from ..clinic import Score
    from ..plans import Runs
    from ..report import Page
    from ..robots import RobotModel


_MOST_SEEDS = 10_000  # of a comparison
_TEN = "Such as 10,20."
_Options = TypeVar("_Options")


def compare(script: str, arguments: Sequence[str]) -> int:
    """Compares methods on the logs of a scenario."""
    _refuse(arguments, "--seed", "--duration")
    given, chosen, folder = _given("compare", script, arguments, Compare)
    scenario = given["scenario"]
    kinds = chosen.sensors or ("noisy" if chosen.noise_scales else scenario.sensors)
    kinds = kinds.split(",")
    if unknown := set(kinds) - {"ideal", "noisy"}:
        raise UnknownName("kind of sensors", unknown.pop(), ("ideal", "noisy"))
    scales = numbers_in("--noise-scales", chosen.noise_scales or "1", _TEN)
    methods = tuple(chosen.methods.split(",")) if chosen.methods else None
    for name in methods or ():
        check_choice("method", name, METHODS)
    seeds = _seeds(chosen.seeds)
    durations = (0.5 * scenario.duration, scenario.duration)
    if chosen.durations:
        durations = numbers_in("--durations", chosen.durations, _TEN)
    from ..plans import BUDGET, COMPARE_FILES, DEFAULT, comparison_plan, run_comparison

    study = comparison_plan(
        **given,
        methods=DEFAULT if methods is None else methods,
        seeds=seeds,
        durations=durations,
        noises=(0.0,) * ("ideal" in kinds) + scales * ("noisy" in kinds),
        budget=BUDGET if chosen.budget is None else chosen.budget,
        bound=chosen.bound,
    )
    result, _ = run_comparison(study, folder, quiet=chosen.quiet or chosen.json)
    if chosen.json:
        print((folder / COMPARE_FILES[0]).read_text(encoding="utf-8"), end="")
    return code_of(result)


def _refuse(arguments: Sequence[str], *flags: str) -> None:
    """Rejects flags of a single run that the study replaces by lists, such as --seed by --seeds."""
    for flag in flags:
        if any(argument.partition("=")[0] == flag for argument in arguments):
            raise InvalidInput(flag, f"{flag}s, with one or more values", flag, f"Give {flag}s.")


def _given(
    command: str, script: str, arguments: Sequence[str], options: type[_Options]
) -> tuple[dict[str, Any], _Options, Path]:
    """The fields of any `Study`, the command's options, and the folder of the results."""
    path = Path(script)
    default = load(script)
    from .options import parse, repeated

    scenario, chosen = parse(path.stem, default, arguments, command, options)
    check_plant(scenario.plant)
    whole = str(path.resolve()) if path.suffix == ".py" else script
    given = {"script": whole, "scenario": scenario, "arguments": repeated(default, scenario)}
    folder = getattr(chosen, "out", None) or Path("runs") / f"{path.stem}-{command}"
    return given, chosen, folder


def sweep(script: str, arguments: Sequence[str]) -> int:
    """Runs a scenario with varied fields and seeds."""
    given, chosen, folder = _given("sweep", script, arguments, Sweep)
    from ..lab import varied

    vary = varied(chosen.vary, given["scenario"])
    check_choice("engine", chosen.engine, ENGINES)
    from ..plans import Engine, run_sweep, sweep_document, sweep_plan, sweep_result

    study = sweep_plan(**given, vary=vary, seeds=chosen.seeds)
    engine = Engine(chosen.engine, chosen.address, chosen.jobs, chosen.timeout)
    found = run_sweep(study, folder, engine, chosen.quiet or chosen.json, chosen.retry)
    if chosen.json:
        print_json(sweep_document(found))
    elif not chosen.quiet:
        from ..plans import sweep_page  # matplotlib takes half a second

        _print(sweep_page(found), found)
    return code_of(sweep_result(found))


def montecarlo(script: str, arguments: Sequence[str]) -> int:
    """Identifies from many priors."""
    given, chosen, folder = _given("montecarlo", script, arguments, MonteCarlo)
    from ..plans import (
        montecarlo_document,
        montecarlo_page,
        montecarlo_plan,
        montecarlo_result,
        run_montecarlo,
    )

    study = montecarlo_plan(**given, runs=chosen.runs, shared=not chosen.own_plants)
    found = run_montecarlo(study, folder, chosen.jobs, chosen.quiet or chosen.json)
    if chosen.json:
        print_json(montecarlo_document(found))
    elif not chosen.quiet:
        _print(montecarlo_page(found), found)
    return code_of(montecarlo_result(found))


def _print(page: Page, found: Runs) -> None:
    """Prints the page of a sweep, and the paths of its files."""
    from rich.console import Console

    from ..plans import files_of
    from ..report import print_page

    print_page(page, Console(highlight=False), files_of(found))


def track(script: str, arguments: Sequence[str]) -> int:
    """Compares tracking laws on the plants of a scenario."""
    _refuse(arguments, "--seed")
    given, chosen, folder = _given("track", script, arguments, Track)
    laws = tuple(chosen.laws.split(",")) if chosen.laws else TRACKING_LAWS
    for law in laws:
        check_choice("tracking law", law, TRACKING_LAWS)
    seeds = _seeds(chosen.seeds)
    from ..plans import TRACKING_FILES, run_tracking, tracking_plan

    study = tracking_plan(**given, laws=laws, seeds=seeds)
    result, _ = run_tracking(study, folder, quiet=chosen.quiet or chosen.json)
    if chosen.json:
        print((folder / TRACKING_FILES[0]).read_text(encoding="utf-8"), end="")
    return code_of(result)


def report(chosen: Report) -> int:
    """Draws a sweep's page."""
    check_sweep(chosen.sweep)
    from ..plans import read, write_sweep_page

    runs = read(chosen.sweep)
    if runs.damaged:
        print(f"nsaid: {runs.damaged}; the same `nsaid sweep` makes them again", file=sys.stderr)
    for path in write_sweep_page(runs):
        print(printable(str(path)))
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


_SUCH = "Such as `nsaid compare --log log.csv --models a.xml b.xml identified`."


@dataclass(frozen=True)
class CompareModels:
    """Compare model files of an arm on its own logs.

    Every model is simulated in open loop from the commands, which are targets of position servos,
    or forces. Mean position errors over 0.2 s, 2 s and the whole log are compared with those of
    simple predictions: the delayed target, or a constant velocity.

    Attributes:
        log: log files or folders of them.
        models: files with the same joints; `identified` and `sysid` (MuJoCo's own toolbox, which
            takes minutes and starts at the first file) are fitted to the logs, of which each half
            is predicted from the other.
        map: TOML file with the meaning of columns.
        json: print only the scores of every joint, as JSON, to the standard output.
        quiet: print only errors.
    """

    log: Annotated[tuple[Path, ...], arg(metavar="FILE…")] = ()
    models: Annotated[tuple[str, ...], arg(metavar="FILE…")] = ()
    map: Path | None = None
    json: bool = False
    quiet: bool = False


def compare_on_logs(arguments: Sequence[str]) -> int:
    """Executes what follows `nsaid compare` where it begins with a flag; returns the exit code."""
    chosen = tyro.cli(CompareModels, prog="nsaid compare", args=list(arguments))
    files = [model for model in chosen.models if model not in FITTED]
    if not files or not chosen.log:
        expected = "a model file and a log, or more of them"
        raise InvalidInput("--models", expected, " ".join(chosen.models) or "none", _SUCH)
    for model in files:
        check_model(model)
    check_map(chosen.map)
    check_logs(chosen.log)
    robot, scores = _compared(chosen, files[0])
    if chosen.json:
        print_json(document(robot.joints, scores))
    elif not chosen.quiet:
        from rich.console import Console

        from ..clinic import scores_page
        from ..report import print_page

        print_page(scores_page(scores, robot.small_unit), Console())
    return 0


def _compared(chosen: CompareModels, first: str) -> tuple[RobotModel, tuple[Score, ...]]:
    """The first model, and the scores."""
    from ..clinic import (
        Options,
        compare_arms,
        compare_servos,
        coupled,
        load_robot_model,
        read_map,
        recordings_of,
        servo_logs,
    )
    from ..lab import Progress

    with Progress("compare", quiet=chosen.quiet or chosen.json) as progress:
        given = servo_logs(first, chosen.log, chosen.map)
        if given is not None:
            return given.robot, compare_servos(given, chosen.models, progress.say)
        robot = load_robot_model(first)
        if not robot.jointed:
            remedy = "Vehicles are judged by `nsaid identify --validate`."
            raise InvalidInput("--models", "models of an arm", first, remedy)
        mapping = None if chosen.map is None else read_map(chosen.map)
        recordings = recordings_of(chosen.log, mapping, robot)
        options = Options(coupled=coupled(mapping))
        return robot, compare_arms(robot, recordings, chosen.models, options, progress.say)


def document(joints: tuple[str, ...], scores: tuple[Score, ...]) -> list[dict[str, Any]]:
    """Scores as plain data for JSON: errors in mrad or mm; null where undefined or diverged."""
    import numpy as np

    found = []
    for score in scores:
        rows = (*(1e3 * score.errors), score.one_step)
        named = [
            {
                name: None if not np.isfinite(x) else float(x)
                for name, x in zip(joints, row, strict=True)
            }
            for row in rows
        ]
        keys = ("mae_0.2_s", "mae_2_s", "mae_whole_log", "one_step_nrmse")
        whole = dict(zip(keys, named, strict=True))
        found.append({"model": score.model, **whole, "seconds": score.seconds})
    return found
