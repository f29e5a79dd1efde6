"""The command line: `nsaid list`, `nsaid run`, `nsaid view`; and `main` for scenario scripts.

A scenario's dataclasses are its options: every field of Scenario, of its plant, its excitation and
its identifier is a flag. A field's last name will do where no other field has it: `--robot` is
`--plant.robot`.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

from .errors import BadRun, InvalidInput, NsaidError, UnknownName
from .resources import scenarios

if TYPE_CHECKING:
    from .scenario import Scenario

FAILED, UNUSABLE, INTERRUPTED = 1, 2, 130


@dataclass(frozen=True)
class Output:
    """What becomes of a run.

    Attributes:
        out: folder of the run; None is runs/NAME.
        quiet: print nothing but errors.
        json: print summary.json to the standard output, and nothing else.
        live: show the run in the Rerun viewer while it runs.
    """

    out: Path | None = None
    quiet: bool = False
    json: bool = False
    live: bool = False


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
    run = commands.add_parser("run", help="run a scenario by name or file", add_help=False)
    run.add_argument("scenario", metavar="NAME_OR_FILE")
    view = commands.add_parser("view", help="open a run's recording in the Rerun viewer")
    view.add_argument("run", type=Path, help="the run's folder, e.g. runs/ur5")
    view.add_argument("--web", action="store_true", help="serve it to a browser on this machine")
    view.add_argument("--rebuild", action="store_true", help="make recording and report anew")
    chosen, rest = parser.parse_known_args(arguments)
    if chosen.command == "run":
        if chosen.scenario in ("-h", "--help"):
            parser.parse_args(["--help"])
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
    if not path.is_file():
        raise UnknownName("scenario", name, known, "A script is given by its path, ending in .py.")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None  # a .py file always has one
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    from .scenario import Scenario

    found = getattr(module, "scenario", None)
    if not isinstance(found, Scenario):
        raise InvalidInput(
            str(path), "a script that defines `scenario = Scenario(…)`", type(found).__name__,
            "See scenarios/ur5.py.",
        )  # fmt: skip
    return found


def parse(name: str, default: Scenario, arguments: Sequence[str]) -> tuple[Scenario, Output]:
    """A scenario with fields replaced by flags, and what becomes of the run."""
    import tyro

    from .scenario import Scenario

    def together(
        scenario: Annotated[Scenario, tyro.conf.arg(name="")] = default,
        output: Annotated[Output, tyro.conf.arg(name="")] = Output(),  # noqa: B008 (frozen)
    ) -> tuple[Scenario, Output]:
        return scenario, output

    return tyro.cli(
        together,
        prog=f"nsaid run {name}",
        args=[_full(argument, default) for argument in arguments],
        config=(tyro.conf.AvoidSubcommands,),
    )


def _full(argument: str, default: Scenario) -> str:
    """`--robot` as `--plant.robot`, where only one field is called robot."""
    if not argument.startswith("--"):
        return argument
    flag, equals, value = argument[2:].partition("=")
    paths = _paths(default)
    last = Counter(path.rsplit(".", 1)[-1] for path in paths)
    wanted = flag.replace("-", "_")
    if wanted not in paths and last[wanted] == 1:
        flag = next(path for path in paths if path.endswith("." + wanted))
    return f"--{flag}{equals}{value}"


def _paths(value: Any, prefix: str = "") -> list[str]:
    paths = []
    for f in fields(value):
        path, item = f"{prefix}{f.name}", getattr(value, f.name)
        paths += _paths(item, f"{path}.") if is_dataclass(item) else [path]
    return paths


def _run(name: str, default: Scenario, arguments: Sequence[str]) -> int:
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
    return subprocess.call(viewer_command(file, web))
