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
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from .. import __version__
from ..base import (
    BadRun,
    InputFile,
    InvalidInput,
    NotWritten,
    NsaidError,
    OutputFolder,
    print_json,
    printable,
    require,
)
from ..lab import load
from ..report import ExitCode
from ..robots import listed_robots, scenarios
from .process import ending_like_ctrl_c, open_streams, silence

if TYPE_CHECKING:
    from ..lab import Run, RunResult, Scenario, Verification
    from . import grammar


_STUDIES = ("compare", "sweep", "montecarlo", "track")
_LISTED = {"compare": ("--seed", "--duration"), "track": ("--seed",)}
"""Flags of a single run that a study replaces by lists, such as --seed by --seeds."""


def main(scenario: Scenario, arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs a scenario from its script, with the flags of `nsaid run`."""
    script = Path(sys.argv[0])
    given = sys.argv[1:] if arguments is None else arguments

    def action() -> int:
        with InputFile.reading(script):
            return _with_script_errors(lambda: _run(script.stem, scenario, given))

    _exit(action)


def run_from_shell() -> NoReturn:
    """The console script `nsaid`."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # our matrices are too small for threads
    os.environ["MUJOCO_GL"] = "disable"  # MuJoCo renders nothing; a bad word would end its import
    gc.set_threshold(50_000)  # imports allocate many permanent objects; scanning them is slow
    atexit.register(gc.freeze)  # skips the scan at exit, which takes half a second
    open_streams()
    _exit(lambda: command(sys.argv[1:]))


def _exit(action: Callable[[], int]) -> NoReturn:
    warnings.formatwarning = lambda message, *_: printable(f"nsaid: {message}") + "\n"
    with ending_like_ctrl_c():
        try:
            code = action()
            sys.stdout.flush()
        except NsaidError as error:
            code = _say(error, ExitCode.UNUSABLE)
        except KeyboardInterrupt as error:
            code = _say(f"interrupted. {error}".removesuffix(". "), ExitCode.INTERRUPTED)
        except BrokenPipeError:  # `nsaid list | head`
            code = 0
        except OSError as error:  # such as a full disk behind the standard output
            what = error.filename or "the output"
            code = _say(f"{what}: {error.strerror or error}. Give another one.", ExitCode.UNUSABLE)
        silence()
    sys.exit(code)


def _say(words: object, code: int) -> int:
    """Prints one line to the standard error, unless that is closed, and returns the exit code."""
    with suppress(OSError):
        print(printable(f"nsaid: {words}"), file=sys.stderr, flush=True)
    return code


def command(arguments: Sequence[str]) -> int:
    """Executes a command line and returns the exit code."""
    with InputFile.reading():
        return _with_script_errors(lambda: _command(arguments))


def _with_script_errors(action: Callable[[], int]) -> int:
    """Executes an action; an exception or exit in a user's script becomes a `BadScript`."""
    try:
        return action()
    except NsaidError:
        raise
    except (Exception, SystemExit) as error:
        from ..lab import script_error

        if found := script_error(error):
            raise found from error
        raise


def _command(arguments: Sequence[str]) -> int:
    if list(arguments) == ["--version"]:
        print(f"nsaid {__version__}")
        return 0
    word, name, *_ = *arguments, "", ""
    if word in ("run", "verify") and name and not name.startswith("-"):
        carry_out = _run if word == "run" else _verify
        scenario = load(name)
        return carry_out(_name_of(Path(name), scenario), scenario, arguments[2:])
    if word in _STUDIES and name and not name.startswith("-"):
        return _study(word, name, arguments[2:])
    from . import grammar

    if word == "compare" and {"--log", "--models"} & {a.partition("=")[0] for a in arguments}:
        from ..clinic import compare_on_logs

        return compare_on_logs(grammar.parse_comparison(arguments[1:]))
    chosen = grammar.parse(["--want" if a == "--for" else a for a in arguments])
    if isinstance(chosen, grammar.Verify):
        if chosen.run is None:
            raise InvalidInput(
                "verify",
                "a scenario's name, or --run with a folder",
                "neither",
                "Such as `nsaid verify scalar_rov`; `nsaid verify --help` has the rest.",
            )
        OutputFolder(chosen.run).record_file()
        from ..lab import Verification

        return _judged(
            chosen.run.name, Verification.of_folder(chosen.run), chosen.json, chosen.quiet
        )
    if isinstance(chosen, grammar.ViewOptions):
        return _view(chosen.run, chosen.web, chosen.rebuild)
    if isinstance(chosen, grammar.List):
        return _list()
    if word in ("identify", "inspect", "live"):
        from ..clinic import follow_robot, identify_log, inspect_log

        of_robots = {"identify": identify_log, "inspect": inspect_log, "live": follow_robot}
        return of_robots[word](chosen)
    if word == "excite":
        from ..plans import design_experiment

        return design_experiment(chosen)
    if word == "report":
        from ..plans import draw_sweep

        return draw_sweep(chosen.sweep)
    remedy = "Put the name before all flags, as in `nsaid run ur5 --duration 20`."
    raise InvalidInput(word, "the scenario's name first", " ".join(arguments[1:]), remedy)


def _name_of(path: Path, scenario: Scenario) -> str:
    """The name of a scenario: of its script, or of the run whose scenario.json it is."""
    if path.suffix != ".json":
        return path.stem
    law = getattr(scenario.identifier, "law", "")
    return path.resolve().parent.name.removesuffix(f"-{law}")


def _study(word: str, script: str, arguments: Sequence[str]) -> int:
    """Executes a command that runs a scenario many times and returns the exit code."""
    for flag in _LISTED.get(word, ()):
        if any(argument.partition("=")[0] == flag for argument in arguments):
            raise InvalidInput(flag, f"{flag}s, with one or more values", flag, f"Give {flag}s.")
    path = Path(script)
    default = load(script)
    from ..lab import ScenarioFlags
    from ..plans import compare_methods, compare_trackers, identify_often, sweep_scenario
    from .grammar import COMMANDS

    options: Any = COMMANDS[word]
    own = ScenarioFlags(path.stem, default)
    scenario, chosen = own.parsed(arguments, word, options)
    whole = str(path.resolve()) if path.suffix in {".py", ".json"} else script
    given = {"script": whole, "scenario": scenario, "arguments": own.of(scenario)}
    folder = chosen.out or Path("runs") / f"{path.stem}-{word}"
    functions: dict[str, Callable[..., int]] = {
        "compare": compare_methods,
        "sweep": sweep_scenario,
        "montecarlo": identify_often,
        "track": compare_trackers,
    }
    return functions[word](given, chosen, folder)


def _run(name: str, default: Scenario, arguments: Sequence[str]) -> int:
    title, finished, result, output = _carry_out(name, default, arguments, "run")
    from ..lab import print_result

    if output.json:
        print_json(result.summary())
    elif not output.quiet:
        print_result(title, result, finished.folder)
    code = _code(finished, result)
    if code == ExitCode.INTERRUPTED and not output.quiet and _tests_misfit(finished.scenario):
        again = shlex.join(["nsaid", "view", "--rebuild", str(finished.folder)])
        _say(f"interrupted; `{again}` judges the misfit, too", ExitCode.INTERRUPTED)
    return code


def _tests_misfit(scenario: Scenario) -> bool:
    """Whether the scenario's law judges how far the structure is from the motion."""
    return getattr(scenario.identifier, "law", "") in {"memory", "efficient"}


def _verify(name: str, default: Scenario, arguments: Sequence[str]) -> int:
    title, finished, result, output = _carry_out(name, default, arguments, "verify")
    from ..lab import Truth, Verification

    found = Verification.of_run(finished, Truth.of(finished), result)
    found.write()
    code = _judged(title, found, output.json, output.quiet)
    return code or _code(finished, result)


def _judged(name: str, found: Verification, as_json: bool, quiet: bool) -> int:
    """Prints the verdicts and returns the exit code."""
    from rich.console import Console

    from ..report import print_page

    if as_json:
        print_json(found.document())
    elif not quiet:
        print_page(found.page(name), Console(highlight=False), [f"verdicts   {found.file}"])
    return ExitCode.of(found)


def title_of(name: str, default: Scenario, scenario: Scenario) -> str:
    """The title of a run: the scenario's name, or that of the robot chosen for it.

    `default` is the scenario as defined by its script.
    """
    robot = getattr(scenario.plant, "robot", "")
    chosen = name == "arm" or robot != getattr(default.plant, "robot", "")
    return (Path(robot).stem or name) if robot and chosen else name


def _carry_out(
    name: str, default: Scenario, arguments: Sequence[str], asked: str
) -> tuple[str, Run, RunResult, grammar.RunOptions]:
    """Runs and post-processes a scenario; returns its title, run, result and output options."""
    from ..lab import ResultsFolder, ScenarioFlags
    from .excitation import check_excitation, without_excitation
    from .grammar import RunOptions

    given, arguments = without_excitation(arguments)
    flags = ScenarioFlags(name, default)
    scenario, output = flags.parsed(arguments, asked, RunOptions)
    check_excitation(given)
    title = title_of(name, default, scenario)
    from ..lab import Observer, Progress, run

    watchers: list[Observer] = []
    if output.live:
        require("rerun", "view", "A recording")
        from ..lab import LiveRecording

        watchers.append(LiveRecording(title, output.live_speed))
    with (
        ResultsFolder(output.out, output.force).of_run(title, scenario) as folder,
        Progress(title, quiet=output.quiet or output.json) as progress,
    ):
        command = shlex.join(["nsaid", "run", name, *flags.of(scenario)])
        if given:
            from ..plans import designed

            command += f" --excitation {given}"
            scenario = replace(scenario, excitation=designed(scenario, given, progress))
        # `ResultsFolder` has asked for --force if there is a run
        finished = run(scenario, folder, progress, *watchers, force=True)
        return title, finished, _finish(finished, progress.say, command), output


def _finish(finished: Run, say: Callable[[str], None], command: str) -> RunResult:
    """Post-processes a run; if interrupted or out of disk space, says how to resume."""
    from ..lab import finish

    again = f"`nsaid view --rebuild {shlex.quote(str(finished.folder))}` finishes the run"
    try:
        return finish(finished, say, command)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(again) from None
    except NotWritten as error:
        raise NotWritten(error.path, error.reason, f"Make room on the disk; {again}") from error


def _code(finished: Run, result: RunResult) -> int:
    """The exit code of a finished run: that of its verdict, unless it was interrupted."""
    from ..core import Status

    interrupted = finished.ending.status is Status.interrupted
    return ExitCode.INTERRUPTED if interrupted else ExitCode.of(result)


def _list() -> int:
    print("Scenarios, for `nsaid run NAME`:")
    found = scenarios()
    widest = max(map(len, found))
    for name, path in found.items():
        title = path.read_text(encoding="utf-8").split('"""')[1].strip().splitlines()[0]
        print(f"  {name:{widest}}  {title}")
    print("\nRobots, for `nsaid run arm --robot NAME` (or the path of a URDF file):")
    for line in listed_robots():
        print(f"  {line}")
    return 0


def _view(folder: Path, web: bool, rebuild: bool) -> int:
    file = folder if folder.suffix == ".rrd" else folder / OutputFolder.RECORDING
    if rebuild or not file.is_file():
        if not folder.is_dir():
            raise BadRun(
                folder, "there is no such run", "Give the folder of a run, e.g. runs/ur5-paper."
            )
        OutputFolder(folder).record_file()
        from ..lab import rebuild as post_process

        post_process(folder)
    require("rerun", "view", "A recording")
    from ..lab import viewer_command

    words = viewer_command(file, web)
    if os.name == "posix":
        os.execv(words[0], words)  # the viewer replaces this process and receives its signals
    return subprocess.call(words)
