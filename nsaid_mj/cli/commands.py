"""The commands of `nsaid` (`list`, `run`, `sweep` …), and `main` for scenario scripts.

Heavy modules are imported only where they are needed, so that `nsaid --help` is fast.
"""

from __future__ import annotations

import atexit
import gc
import os
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from .. import __version__
from ..errors import BadRun, InvalidInput, NotWritten, NsaidError, UnknownName, printable
from ..experiment.library import load
from ..resources import (
    MORE_ROBOTS,
    has_example_robots,
    known_robots,
    print_json,
    reading,
    scenarios,
)
from .exit_codes import EXPLAINED, INTERRUPTED, NOT_EXPLAINED, UNUSABLE, code_of
from .process import ending_like_ctrl_c, open_streams, silence

if TYPE_CHECKING:
    from ..evaluation.verify import Verdict
    from ..experiment.loop import Run
    from ..experiment.scenario import Scenario
    from . import grammar

_MOST_SEEDS = 10_000  # of a comparison


def main(scenario: Scenario, arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs a scenario from its script, with the flags of `nsaid run`."""
    script = Path(sys.argv[0])
    given = sys.argv[1:] if arguments is None else arguments
    _exit(lambda: _telling(lambda: _run(script.stem, scenario, given)))


def run_from_shell() -> NoReturn:
    """The console script `nsaid`."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # our matrices are too small for threads
    os.environ.setdefault("MUJOCO_GL", "disable")  # MuJoCo renders nothing
    gc.set_threshold(50_000)  # imports allocate many permanent objects; scanning them is slow
    atexit.register(gc.freeze)  # skips the scan at exit, which takes half a second
    open_streams()
    _exit(lambda: command(sys.argv[1:]))


def _exit(action: Callable[[], int]) -> NoReturn:
    with ending_like_ctrl_c():
        try:
            code = action()
            sys.stdout.flush()
        except NsaidError as error:
            code = _say(error, UNUSABLE)
        except KeyboardInterrupt as error:
            code = _say(f"interrupted. {error}".removesuffix(". "), INTERRUPTED)
        except BrokenPipeError:  # `nsaid list | head`
            code = 0
        except OSError as error:  # such as a full disk behind the standard output
            what = error.filename or "the output"
            code = _say(f"{what}: {error.strerror or error}. Give another one.", UNUSABLE)
        silence()
    sys.exit(code)


def _say(words: object, code: int) -> int:
    """Prints one line to the standard error, if it takes it, and returns the exit code."""
    with suppress(OSError):
        print(printable(f"nsaid: {words}"), file=sys.stderr, flush=True)
    return code


def command(arguments: Sequence[str]) -> int:
    """Executes a command line and returns the exit code."""
    return _telling(lambda: _command(arguments))


def _telling(action: Callable[[], int]) -> int:
    """Executes an action; an exception in a user's script becomes a `BadScript`, an exit too."""
    try:
        return action()
    except NsaidError:
        raise
    except (Exception, SystemExit) as error:
        from ..experiment.blame import blame

        if found := blame(error):
            raise found from error
        raise


def _command(arguments: Sequence[str]) -> int:
    if list(arguments) == ["--version"]:
        print(f"nsaid {__version__}")
        return 0
    of_a_scenario: dict[str, Callable[[str, Sequence[str]], int]] = {
        "run": lambda name, rest: _run(Path(name).stem, load(name), rest),
        "verify": lambda name, rest: _verify(Path(name).stem, load(name), rest),
        "compare": _compare,
        "sweep": _sweep,
        "montecarlo": _montecarlo,
        "track": _track,
    }
    word, name, *_ = *arguments, "", ""
    if word in of_a_scenario and name and not name.startswith("-"):
        return of_a_scenario[word](name, arguments[2:])
    if word == "compare" and {"--log", "--models"} & {a.partition("=")[0] for a in arguments}:
        from .comparing import compare_on_logs

        return compare_on_logs(arguments[1:])
    from . import grammar

    chosen = grammar.parse(["--want" if a == "--for" else a for a in arguments])
    if isinstance(chosen, grammar.Verify):
        return _verify_folder(chosen.run, chosen.json, chosen.quiet)
    if isinstance(chosen, grammar.Report):
        return _report(chosen.sweep)
    if isinstance(chosen, grammar.View):
        return _view(chosen.run, chosen.web, chosen.rebuild)
    if isinstance(chosen, grammar.List):
        return _list()
    if isinstance(chosen, grammar.Identify):
        from .identifying import identify_log

        return identify_log(chosen)
    if isinstance(chosen, grammar.Live):
        from .living import follow_robot

        return follow_robot(chosen)
    if isinstance(chosen, grammar.Excite):
        from .exciting import excite

        return excite(chosen)
    if isinstance(chosen, grammar.Inspect):
        from .inspecting import inspect_log

        return inspect_log(chosen)
    remedy = "Put the name before all flags, as in `nsaid run ur5 --duration 20`."
    raise InvalidInput(word, "the scenario's name first", " ".join(arguments[1:]), remedy)


def _run(name: str, default: Scenario, arguments: Sequence[str]) -> int:
    title, result, summary, output = _carry_out(name, default, arguments, "run")
    from ..reporting.report import print_summary

    if output.json:
        print_json(summary)
    elif not output.quiet:
        print_summary(title, summary, result.folder)
    return _code(result, summary)


def _verify(name: str, default: Scenario, arguments: Sequence[str]) -> int:
    title, result, summary, output = _carry_out(name, default, arguments, "verify")
    from ..evaluation import truth_of
    from ..evaluation.verify import verify, write

    verdicts = verify(result, truth_of(result), summary)
    write(result, verdicts)
    code = _judged(title, result, verdicts, output.json, output.quiet)
    return code or _code(result, summary)


def _verify_folder(folder: Path, as_json: bool, quiet: bool) -> int:
    from ..evaluation.verify import verify_folder

    return _judged(folder.name, *verify_folder(folder), as_json, quiet)


def _judged(name: str, result: Run, verdicts: list[Verdict], as_json: bool, quiet: bool) -> int:
    """Prints the verdicts and returns the exit code."""
    from ..evaluation.verify import document, failed, print_verdicts

    if as_json:
        print_json(document(result, verdicts))
    elif not quiet:
        print_verdicts(name, result, verdicts)
    return NOT_EXPLAINED if failed(verdicts) else EXPLAINED


def _carry_out(
    name: str, default: Scenario, arguments: Sequence[str], asked: str
) -> tuple[str, Run, dict[str, Any], grammar.Output]:
    """Runs and post-processes a scenario; returns its title, run, summary and output options."""
    from .exciting import designed, without_excitation
    from .folders import folder_for, title_of
    from .options import parse, repeated

    given, arguments = without_excitation(arguments)
    scenario, output = parse(name, default, arguments, asked)
    title = title_of(name, default, scenario)
    from ..experiment.loop import Observer, run
    from ..reporting.progress import Progress

    watchers: list[Observer] = []
    if output.live:
        from ..recording import Live

        watchers.append(Live(title, output.live_speed))
    with (
        reading(name, getattr(scenario.plant, "robot", None)),
        folder_for(title, scenario, output.out, output.force) as folder,
        Progress(title, quiet=output.quiet or output.json) as progress,
    ):
        command = shlex.join(["nsaid", "run", name, *repeated(default, scenario)])
        if given:
            command += f" --excitation {given}"
            scenario = replace(scenario, excitation=designed(scenario, given, progress))
        result = run(scenario, folder, progress, *watchers)
        return title, result, _finish(result, progress.say, command), output


def _finish(result: Run, say: Callable[[str], None], command: str) -> dict[str, Any]:
    """Post-processes a run; if that is interrupted or the disk is full, says how to go on."""
    from ..postprocessing import finish

    again = f"`nsaid view --rebuild {shlex.quote(str(result.folder))}` finishes the run"
    try:
        return finish(result, say, command)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(again) from None
    except NotWritten as error:
        raise NotWritten(error.path, error.reason, f"Make room on the disk; {again}") from error


def _code(result: Run, summary: dict[str, Any]) -> int:
    """The exit code of a finished run: that of its verdict, unless it was interrupted."""
    from ..evaluation import mark_of
    from ..identifiers import Status

    interrupted = result.ending.status is Status.interrupted
    return INTERRUPTED if interrupted else code_of(mark_of(summary))


def _compare(script: str, arguments: Sequence[str]) -> int:
    from .grammar import Comparison
    from .options import parse, repeated

    for flag, own in (("--seed", "--seeds"), ("--duration", "--durations")):
        if any(argument.partition("=")[0] == flag for argument in arguments):
            raise InvalidInput(flag, f"{own}, with one or more values", flag, f"Give {own}.")
    name = Path(script).stem
    default = load(script)
    scenario, chosen = parse(name, default, arguments, "compare", Comparison)
    from ..studies import compare

    kinds = chosen.sensors or ("noisy" if chosen.noise_scales else scenario.sensors)
    kinds = kinds.split(",")
    if unknown := set(kinds) - {"ideal", "noisy"}:
        raise UnknownName("kind of sensors", unknown.pop(), ("ideal", "noisy"))
    scales = _numbers("--noise-scales", chosen.noise_scales or "1")
    plan = compare.Plan(
        _whole(script),
        scenario,
        arguments=repeated(default, scenario),
        methods=tuple(chosen.methods.split(",")) if chosen.methods else compare.DEFAULT,
        seeds=_seeds(chosen.seeds),
        durations=_numbers("--durations", chosen.durations)
        if chosen.durations
        else (0.5 * scenario.duration, scenario.duration),
        noises=(0.0,) * ("ideal" in kinds) + scales * ("noisy" in kinds),
        budget=compare.BUDGET if chosen.budget is None else chosen.budget,
        bound=chosen.bound,
    )
    folder = chosen.out or Path("runs") / f"{name}-compare"
    cells = compare.run(plan, folder, quiet=chosen.quiet or chosen.json)
    if chosen.json:
        print((folder / compare.FILES[0]).read_text(encoding="utf-8"), end="")
    from ..studies.compare_report import verdict_of

    return code_of(verdict_of(cells))


def _whole(script: str) -> str:
    """A scenario's name, or the absolute path of its script."""
    path = Path(script)
    return str(path.resolve()) if path.suffix == ".py" else script


def _sweep(script: str, arguments: Sequence[str]) -> int:
    from .grammar import Sweeping
    from .options import parse, repeated

    name, script = Path(script).stem, _whole(script)
    default = load(script)
    scenario, chosen = parse(name, default, arguments, "sweep", Sweeping)
    from ..studies import sweep, sweep_engine, sweep_results

    vary = sweep.varied(chosen.vary, scenario)
    made_by = repeated(default, scenario)
    plan = sweep.Plan(script, scenario, vary, chosen.seeds, arguments=made_by)
    engine = sweep_engine.Engine(chosen.engine, chosen.address, chosen.jobs, chosen.timeout)
    folder = chosen.out or Path("runs") / f"{name}-sweep"
    found = sweep.run(plan, folder, engine, chosen.quiet or chosen.json, chosen.retry)
    if chosen.json:
        print_json(sweep_results.document(found))
    elif not chosen.quiet:
        sweep_results.print_summary(found)
    return code_of(sweep_results.verdict_of(found), not found.lost)


def _montecarlo(script: str, arguments: Sequence[str]) -> int:
    from .grammar import Drawing
    from .options import parse, repeated

    name, script = Path(script).stem, _whole(script)
    default = load(script)
    scenario, chosen = parse(name, default, arguments, "montecarlo", Drawing)
    from ..studies import montecarlo

    made_by, shared = repeated(default, scenario), not chosen.own_plants
    plan = montecarlo.Plan(script, scenario, chosen.runs, shared, arguments=made_by)
    folder = chosen.out or Path("runs") / f"{name}-montecarlo"
    found = montecarlo.run(plan, folder, chosen.jobs, chosen.quiet or chosen.json)
    if chosen.json:
        print_json(montecarlo.document(found))
    elif not chosen.quiet:
        montecarlo.print_summary(found)
    return code_of(None, not montecarlo.lost(found))


def _track(script: str, arguments: Sequence[str]) -> int:
    from .tracking import track

    return track(script, _whole(script), arguments, _seeds)


def _report(folder: Path) -> int:
    from ..studies import sweep_report, sweep_results

    sweep = sweep_results.read(folder)
    if sweep.damaged:
        print(f"nsaid: {sweep.damaged}; the same `nsaid sweep` makes them again", file=sys.stderr)
    for path in sweep_report.write(sweep):
        print(path)
    return 0


def _seeds(text: str) -> tuple[int, ...]:
    """Parses seeds: `0,3,5`, or `0:10` for 0 to 9."""
    first, colon, last = text.partition(":")
    try:
        if not colon:
            return tuple(int(part) for part in text.split(","))
        start, end = int(first or 0), int(last)
    except ValueError as error:
        raise InvalidInput("--seeds", "0,1,2 or 0:10", text, "0:3 is 0,1,2.") from error
    if end - start > _MOST_SEEDS:
        raise InvalidInput("--seeds", f"at most {_MOST_SEEDS} seeds", text, "0:3 is 0,1,2.")
    return tuple(range(start, end))


def _numbers(flag: str, text: str) -> tuple[float, ...]:
    """Parses numbers separated by commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidInput(flag, "comma-separated numbers", text, "Such as 10,20.") from error


def _list() -> int:
    print("Scenarios, for `nsaid run NAME`:")
    for name, path in scenarios().items():
        title = path.read_text(encoding="utf-8").split('"""')[1].strip().splitlines()[0]
        print(f"  {name:16} {title}")
    print("\nRobots, for `nsaid run arm --robot NAME` (or the path of a URDF file):")
    names = known_robots()
    for start in range(0, len(names), 4):
        print("  " + "".join(f"{name:28}" for name in names[start : start + 4]).rstrip())
    if not has_example_robots():
        print(f"  {MORE_ROBOTS}")
    return 0


def _view(folder: Path, web: bool, rebuild: bool) -> int:
    from .. import postprocessing
    from ..recording import FILE, viewer_command

    file = folder if folder.suffix == ".rrd" else folder / FILE
    if rebuild or not file.is_file():
        if not folder.is_dir():
            raise BadRun(
                folder, "there is no such run", "Give the folder of a run, e.g. runs/ur5-paper."
            )
        postprocessing.rebuild(folder)
    words = viewer_command(file, web)
    if os.name == "posix":
        os.execv(words[0], words)  # the viewer replaces this process and receives its signals
    return subprocess.call(words)
