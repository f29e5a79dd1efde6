"""The command line: `nsaid list`, `run`, `sweep` …; `main` for scenario scripts.

Heavy modules are imported where they are needed, so that `nsaid --help` answers at once.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ..errors import BadRun, InvalidInput, NsaidError, UnknownName
from ..experiment.library import load
from ..resources import scenarios

if TYPE_CHECKING:
    from ..evaluation.verify import Verdict
    from ..experiment.loop import Run
    from ..experiment.scenario import Scenario
    from .options import Output

FAILED, UNUSABLE, INTERRUPTED = 1, 2, 130


def main(scenario: Scenario, arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs a scenario from its own script, with the flags of `nsaid run`."""
    script = Path(sys.argv[0])
    _exit(lambda: _run(script.stem, scenario, sys.argv[1:] if arguments is None else arguments))


def run_from_shell() -> NoReturn:
    """The console script `nsaid`."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # our matrices are small: threads only cost
    os.environ.setdefault("MUJOCO_GL", "disable")  # Rerun draws
    gc.set_threshold(50_000)  # what imports make stays: to look for garbage in it takes long
    atexit.register(gc.freeze)  # nor look in it when the process ends: that takes half a second
    _exit(lambda: command(sys.argv[1:]))


def _exit(action: Any) -> NoReturn:
    try:
        code = action()
    except NsaidError as error:
        print(f"nsaid: {error}", file=sys.stderr)
        code = UNUSABLE
    except KeyboardInterrupt:
        print("nsaid: interrupted", file=sys.stderr)
        code = INTERRUPTED
    except BrokenPipeError:  # `nsaid list | head`
        sys.stderr.close()
        code = 0
    sys.exit(code)


def command(arguments: Sequence[str]) -> int:
    """Does what a command line says; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="nsaid",
        description="Identifies a robot's plant and actuators together, from how it moves.",
        epilog="`nsaid run NAME --help` lists every field of a scenario.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("list", help="list the scenarios, and the robots for `run arm --robot`")
    run = commands.add_parser(
        "run",
        help="run a scenario by name or file",
        usage="nsaid run NAME_OR_FILE [--duration SECONDS --seed N --out FOLDER … any field]",
        description="Runs a scenario. `nsaid run NAME --help` lists every field that is a flag.",
        add_help=False,  # a scenario named, its fields are the help
    )
    run.add_argument(
        "scenario", nargs="?", metavar="NAME_OR_FILE", help="see `nsaid list`, or a script's path"
    )
    verify = commands.add_parser(
        "verify",
        help="run a scenario, and judge the paper's statements on it",
        usage="nsaid verify NAME_OR_FILE [flags of nsaid run]\n"
        "       nsaid verify --run FOLDER [--json] [--quiet]",
        description="Says of every statement of the paper whether it holds on a run. Exit code 1 "
        "where one fails. `nsaid verify NAME --help` lists every field that is a flag.",
        add_help=False,
        allow_abbrev=False,
    )
    verify.add_argument(
        "scenario", nargs="?", metavar="NAME_OR_FILE", help="see `nsaid list`, or a script's path"
    )
    verify.add_argument(
        "--run", type=Path, metavar="FOLDER", help="judge this run, from its record; run nothing"
    )
    compare = commands.add_parser(
        "compare",
        help="compare methods on the logs of a scenario",
        usage="nsaid compare NAME_OR_FILE [--methods ols,wls,memory --seeds 0:3 --durations 10,20\n"
        "                                   --sensors ideal,noisy --noise-scales 0.3,1,3\n"
        "                                   --budget SECONDS --out FOLDER … any field]",
        description="Runs methods on the same logs and judges them by the same figures: a table, "
        "compare.json, compare.csv and plots. Fields of the scenario are flags, as in `nsaid run`.",
        allow_abbrev=False,
    )
    compare.add_argument("scenario", metavar="NAME_OR_FILE", help="see `nsaid list`, or a path")
    compare.add_argument("--methods", metavar="A,B", help="all but sysid, unless told otherwise")
    compare.add_argument("--seeds", metavar="0,1,2 or 0:10", default="0:3", help="0:3 is 0,1,2")
    compare.add_argument("--durations", metavar="S,S", help="of the log [s]; half of it and all")
    compare.add_argument("--sensors", metavar="ideal,noisy", help="one or both")
    compare.add_argument("--noise-scales", metavar="X,X", help="multiples of the scenario's noise")
    compare.add_argument("--budget", metavar="S", help="search time of sysid, at most [s]")
    _add_sweep(commands)
    _add_montecarlo(commands)
    report = commands.add_parser("report", help="draw a sweep's distributions, on one page")
    report.add_argument("sweep", type=Path, help="the sweep's folder, e.g. runs/ur5-sweep")
    view = commands.add_parser("view", help="open a run's recording in the Rerun viewer")
    view.add_argument("run", type=Path, help="the run's folder, e.g. runs/ur5")
    view.add_argument("--web", action="store_true", help="serve it to a browser on this machine")
    view.add_argument("--rebuild", action="store_true", help="make recording and report anew")
    chosen, rest = parser.parse_known_args(arguments)
    if chosen.command == "run":
        if chosen.scenario is None:
            if {"-h", "--help"} & set(rest):
                run.print_help()
                return 0
            run.error("which scenario? `nsaid list` shows their names")
        return _run(Path(chosen.scenario).stem, load(chosen.scenario), rest)
    if chosen.command == "verify":
        if chosen.scenario is None and {"-h", "--help"} & set(rest):
            verify.print_help()
            return 0
        if (chosen.scenario is None) == (chosen.run is None):
            verify.error("either a scenario, see `nsaid list`, or --run with a run's folder")
        if chosen.scenario is not None:
            return _verify(Path(chosen.scenario).stem, load(chosen.scenario), rest)
        if unknown := set(rest) - {"--json", "--quiet"}:
            verify.error(f"unrecognized arguments: {' '.join(sorted(unknown))}")
        return _verify_folder(chosen.run, "--json" in rest, "--quiet" in rest)
    if chosen.command == "compare":
        return _compare(chosen, rest)
    if chosen.command == "sweep":
        return _sweep(chosen, rest)
    if chosen.command == "montecarlo":
        return _montecarlo(chosen, rest)
    if rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    if chosen.command == "report":
        return _report(chosen.sweep)
    if chosen.command == "view":
        return _view(chosen.run, chosen.web, chosen.rebuild)
    return _list()


def _add_sweep(commands: Any) -> None:
    sweep = commands.add_parser(
        "sweep",
        help="run a scenario many times, with fields varied and seeds drawn",
        usage="nsaid sweep NAME_OR_FILE [--vary FIELD=A,B,C … --seeds N --jobs N --timeout S\n"
        "                                 --engine loky|dask|ray --address ADDRESS --out FOLDER\n"
        "                                 --retry --json --quiet … any field]",
        description="Runs every combination of the varied fields with every seed, in parallel. The "
        "same command goes on where an earlier one was stopped. Fields of the scenario are flags, "
        "as in `nsaid run`; --seed is the master that all seeds are drawn from. Exit code 1 where "
        "a run has no result.",
        allow_abbrev=False,
    )
    sweep.add_argument("scenario", metavar="NAME_OR_FILE", help="see `nsaid list`, or a path")
    sweep.add_argument(
        "--vary", metavar="FIELD=A,B,C", action="append", default=[],
        help="a field's values, e.g. identifier.gain=0.1,1,10; once for every field",
    )  # fmt: skip
    sweep.add_argument("--seeds", metavar="N", type=int, default=10, help="how many; 10")
    sweep.add_argument("--jobs", metavar="N", type=int, help="at once; as many as processors")
    sweep.add_argument("--timeout", metavar="S", type=float, help="for a run, which is then lost")
    sweep.add_argument("--engine", default="loky", help="loky (this machine), dask or ray")
    sweep.add_argument("--address", help="of the cluster's scheduler")
    sweep.add_argument("--retry", action="store_true", help="make the lost runs once more")
    sweep.add_argument("--out", type=Path, metavar="FOLDER", help="runs/NAME-sweep")
    sweep.add_argument("--json", action="store_true", help="print medians and failures as JSON")
    sweep.add_argument("--quiet", action="store_true", help="print nothing but errors")


def _add_montecarlo(commands: Any) -> None:
    montecarlo = commands.add_parser(
        "montecarlo",
        help="follow one motion, or many plants', from many priors, in one process",
        usage="nsaid montecarlo NAME_OR_FILE [--runs N --jobs N --own-plants --out FOLDER --json\n"
        "                                      --quiet … any field]",
        description="Simulates first, then identifies in compiled threads, and tells the quantiles "
        "of the final figures. The same command goes on where an earlier one was stopped. Fields "
        "of the scenario are flags, as in `nsaid run`; --seed is the master that all draws are "
        "made from.",
        allow_abbrev=False,
    )
    montecarlo.add_argument("scenario", metavar="NAME_OR_FILE", help="see `nsaid list`, or a path")
    montecarlo.add_argument("--runs", metavar="N", type=int, default=256, help="how many; 256")
    montecarlo.add_argument("--jobs", metavar="N", type=int, help="at once; as many as processors")
    montecarlo.add_argument(
        "--own-plants", action="store_true",
        help="a plant with its own truth and motion for every run, not one for all",
    )  # fmt: skip
    montecarlo.add_argument("--out", type=Path, metavar="FOLDER", help="runs/NAME-montecarlo")
    montecarlo.add_argument("--json", action="store_true", help="print quantiles as JSON")
    montecarlo.add_argument("--quiet", action="store_true", help="print nothing but errors")


def _run(name: str, default: Scenario, arguments: Sequence[str]) -> int:
    result, summary, output = _carry_out(name, default, arguments, "run")
    from ..reporting.terminal import print_summary

    if output.json:
        print(json.dumps(summary, indent=2, ensure_ascii=False))
    elif not output.quiet:
        print_summary(name, summary, result.folder)
    return _code(result)


def _verify(name: str, default: Scenario, arguments: Sequence[str]) -> int:
    result, summary, output = _carry_out(name, default, arguments, "verify")
    from ..evaluation.verify import verify, write

    verdicts = verify(result, summary)
    write(result, verdicts)
    return _judged(name, result, verdicts, output.json, output.quiet) or _code(result)


def _verify_folder(folder: Path, as_json: bool, quiet: bool) -> int:
    from ..evaluation.verify import verify_folder

    return _judged(folder.name, *verify_folder(folder), as_json, quiet)


def _judged(name: str, result: Run, verdicts: list[Verdict], as_json: bool, quiet: bool) -> int:
    """Shows the verdicts; returns the exit code."""
    from ..evaluation.verify import document, failed, tell

    if as_json:
        print(json.dumps(document(result, verdicts), indent=2, ensure_ascii=False))
    elif not quiet:
        tell(name, result, verdicts)
    return FAILED if failed(verdicts) else 0


def _carry_out(
    name: str, default: Scenario, arguments: Sequence[str], asked: str
) -> tuple[Run, dict[str, Any], Output]:
    """Runs a scenario as a command line says, and finishes it."""
    from .options import parse

    scenario, output = parse(name, default, arguments, asked)
    from ..experiment.loop import Observer, run
    from ..reporting.finish import finish
    from ..reporting.progress import Progress
    from ..reporting.warmup import warm_up

    folder = output.out or Path("runs") / name
    watchers: list[Observer] = []
    if output.live:
        from ..recording import Live

        watchers.append(Live(name))
    with Progress(name, quiet=output.quiet or output.json) as progress:
        compiled = warm_up(scenario)
        result = run(scenario, folder, progress, *watchers)
        result.cost.compile += compiled
        return result, finish(result, progress.say), output


def _code(result: Run) -> int:
    """The exit code of a run, however it ended."""
    from ..identifiers import Status

    if result.ending.status is Status.interrupted:
        return INTERRUPTED
    return 0 if result.ending.status is Status.completed else FAILED


def _compare(chosen: argparse.Namespace, arguments: Sequence[str]) -> int:
    from .options import parse

    for flag, own in (("--seed", "--seeds"), ("--duration", "--durations")):
        if any(argument.partition("=")[0] == flag for argument in arguments):
            raise InvalidInput(flag, f"{own}, with one value or more", flag, f"Give {own}.")
    name = Path(chosen.scenario).stem
    scenario, output = parse(name, load(chosen.scenario), arguments, "compare")
    from ..studies import compare

    kinds = chosen.sensors or ("noisy" if chosen.noise_scales else scenario.sensors)
    kinds = kinds.split(",")
    if unknown := set(kinds) - {"ideal", "noisy"}:
        raise UnknownName("kind of sensors", unknown.pop(), ("ideal", "noisy"))
    scales = _numbers("--noise-scales", chosen.noise_scales or "1")
    plan = compare.Plan(
        scenario,
        methods=tuple(chosen.methods.split(",")) if chosen.methods else compare.DEFAULT,
        seeds=_seeds(chosen.seeds),
        durations=_numbers("--durations", chosen.durations)
        if chosen.durations
        else (0.5 * scenario.duration, scenario.duration),
        noises=(0.0,) * ("ideal" in kinds) + scales * ("noisy" in kinds),
        budget=_numbers("--budget", chosen.budget)[0] if chosen.budget else compare.BUDGET,
    )
    folder = output.out or Path("runs") / f"{name}-compare"
    compare.run(plan, folder, quiet=output.quiet or output.json)
    if output.json:
        print((folder / compare.FILES[0]).read_text(encoding="utf-8"), end="")
    return 0


def _of_many(chosen: argparse.Namespace, arguments: Sequence[str]) -> tuple[str, str, Scenario]:
    """Name, script and scenario of many runs."""
    from .options import Output, parse

    path = Path(chosen.scenario)
    script = str(path.resolve()) if path.suffix == ".py" else chosen.scenario
    scenario, output = parse(path.stem, load(script), arguments, chosen.command)
    if output != Output():
        raise InvalidInput("--live", "a flag of single runs to be left out", "it", "Leave it out.")
    return path.stem, script, scenario


def _sweep(chosen: argparse.Namespace, arguments: Sequence[str]) -> int:
    name, script, scenario = _of_many(chosen, arguments)
    from ..studies import sweep, sweep_engine, sweep_results

    vary = sweep.varied(chosen.vary, scenario)
    plan = sweep.Plan(script, scenario, vary, chosen.seeds, tuple(arguments))
    engine = sweep_engine.Engine(chosen.engine, chosen.address, chosen.jobs, chosen.timeout)
    folder = chosen.out or Path("runs") / f"{name}-sweep"
    found = sweep.run(plan, folder, engine, chosen.quiet or chosen.json, chosen.retry)
    if chosen.json:
        print(json.dumps(sweep_results.document(found), indent=2, ensure_ascii=False))
    elif not chosen.quiet:
        sweep_results.tell(found)
    return FAILED if found.lost else 0


def _montecarlo(chosen: argparse.Namespace, arguments: Sequence[str]) -> int:
    name, script, scenario = _of_many(chosen, arguments)
    from ..studies import montecarlo

    plan = montecarlo.Plan(script, scenario, chosen.runs, not chosen.own_plants, tuple(arguments))
    folder = chosen.out or Path("runs") / f"{name}-montecarlo"
    found = montecarlo.run(plan, folder, chosen.jobs, chosen.quiet or chosen.json)
    if chosen.json:
        print(json.dumps(montecarlo.document(found), indent=2, ensure_ascii=False))
    elif not chosen.quiet:
        montecarlo.tell(found)
    return 0


def _report(folder: Path) -> int:
    from ..studies import sweep_report, sweep_results

    for path in sweep_report.write(sweep_results.read(folder)):
        print(path)
    return 0


def _seeds(text: str) -> tuple[int, ...]:
    """`0,3,5`, or `0:10` for 0 to 9."""
    first, colon, last = text.partition(":")
    try:
        if colon:
            return tuple(range(int(first or 0), int(last)))
        return tuple(int(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidInput("--seeds", "0,1,2 or 0:10", text, "0:3 is 0,1,2.") from error


def _numbers(flag: str, text: str) -> tuple[float, ...]:
    """Numbers between commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidInput(flag, "numbers between commas", text, "10,20 are two.") from error


def _list() -> int:
    from ..plants.world.robots import known_robots

    print("Scenarios, for `nsaid run NAME`:")
    for name, path in scenarios().items():
        title = path.read_text(encoding="utf-8").split('"""')[1].strip().splitlines()[0]
        print(f"  {name:16} {title}")
    print("\nRobots, for `nsaid run arm --robot NAME` (or a URDF file's path):")
    names = known_robots()
    for start in range(0, len(names), 4):
        print("  " + "".join(f"{name:28}" for name in names[start : start + 4]).rstrip())
    return 0


def _view(folder: Path, web: bool, rebuild: bool) -> int:
    from ..recording import FILE, viewer_command
    from ..reporting import finish

    file = folder if folder.suffix == ".rrd" else folder / FILE
    if rebuild or not file.is_file():
        if not folder.is_dir():
            raise BadRun(folder, "there is no such run", "Give the folder of a run, e.g. runs/ur5.")
        finish.rebuild(folder)
    words = viewer_command(file, web)
    if os.name == "posix":
        os.execv(words[0], words)  # the viewer takes this process's place, and its signals
    return subprocess.call(words)
