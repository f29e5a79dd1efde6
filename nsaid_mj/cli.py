"""The command line: `nsaid list`, `nsaid run`, `nsaid view`; and `main` for scenario scripts.

Heavy modules are imported where they are needed, so that `nsaid --help` answers at once.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from .errors import BadRun, InvalidInput, NsaidError, UnknownName
from .resources import scenarios

if TYPE_CHECKING:
    from .scenario import Scenario

FAILED, UNUSABLE, INTERRUPTED = 1, 2, 130


def main(scenario: Scenario, arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs a scenario from its own script, with the flags of `nsaid run`."""
    script = Path(sys.argv[0])
    _exit(lambda: _run(script.stem, scenario, sys.argv[1:] if arguments is None else arguments))


def run_from_shell() -> NoReturn:
    """The console script `nsaid`."""
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
    if rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    if chosen.command == "view":
        return _view(chosen.run, chosen.web, chosen.rebuild)
    return _list()


def load(name: str) -> Scenario:
    """The scenario of a packed name or of a script.

    Raises:
        UnknownName: there is no such scenario, with near matches.
        InvalidInput: the script defines no `scenario`.
    """
    known = scenarios()
    path = Path(name) if name.endswith(".py") or name not in known else known[name]
    if path.suffix != ".py" or not path.is_file():
        remedy = "The name comes before all flags; a script is given by its path, ending in .py."
        raise UnknownName("scenario", name, known, remedy)
    spec = importlib.util.spec_from_file_location(f"_scenario_{path.stem}", path)
    assert spec is not None and spec.loader is not None  # a .py file always has one
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where a dataclass of the script looks up its annotations
    spec.loader.exec_module(module)
    from .scenario import Scenario

    found = getattr(module, "scenario", None)
    if not isinstance(found, Scenario):
        raise InvalidInput(
            str(path), "a script that defines `scenario = Scenario(…)`", type(found).__name__,
            "See scenarios/ur5.py.",
        )  # fmt: skip
    return found


def _run(name: str, default: Scenario, arguments: Sequence[str]) -> int:
    from .options import parse

    scenario, output = parse(name, default, arguments)
    from . import finish
    from .experiment import Observer, run
    from .identifiers import Status
    from .progress import Progress

    silent = output.quiet or output.json
    watchers: list[Observer] = [] if silent else [Progress(name)]
    if output.live:
        from .recording import Live

        watchers.append(Live(name))
    folder = output.out or Path("runs") / name
    result = run(scenario, folder, *watchers)
    summary = finish.finish(result, progress=not silent)
    if output.json:
        print(json.dumps(summary, indent=2, ensure_ascii=False))
    elif not output.quiet:
        finish.tell(name, summary, folder)
    if result.ending.status is Status.interrupted:
        return INTERRUPTED
    return 0 if result.ending.status is Status.completed else FAILED


def _list() -> int:
    from .plants.robots import known_robots

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
    from . import finish
    from .recording import FILE, viewer_command

    file = folder if folder.suffix == ".rrd" else folder / FILE
    if rebuild or not file.is_file():
        if not folder.is_dir():
            raise BadRun(folder, "there is no such run", "Give the folder of a run, e.g. runs/ur5.")
        finish.rebuild(folder)
    words = viewer_command(file, web)
    if os.name == "posix":
        os.execv(words[0], words)  # the viewer takes this process's place, and its signals
    return subprocess.call(words)
