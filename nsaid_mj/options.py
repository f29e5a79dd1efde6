"""A scenario's dataclasses as command line options.

Every field of Scenario, of its plant, its excitation and its identifier is a flag. A field's last
name will do where no other field has it: `--robot` is `--plant.robot`.
"""

import contextlib
import io
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import tyro

from .errors import InvalidInput, UnknownName
from .scenario import Scenario


@dataclass(frozen=True)
class Output:
    """What becomes of a run.

    Attributes:
        out: folder of the run; None is runs/NAME.
        quiet: print nothing but errors.
        json: print the summary as JSON to the standard output, and nothing else.
        live: show the run in the Rerun viewer while it runs.
    """

    out: Path | None = None
    quiet: bool = False
    json: bool = False
    live: bool = False


def parse(
    name: str, default: Scenario, arguments: Sequence[str], command: str = "run"
) -> tuple[Scenario, Output]:
    """A scenario with fields replaced by flags, and what becomes of the run.

    Args:
        name: of the scenario, for the help text.
        default: the scenario as its script has it.
        arguments: the command line after the name.
        command: of `nsaid`, for the help text.
    """

    def together(
        scenario: Annotated[Scenario, tyro.conf.arg(name="")] = default,
        output: Annotated[Output, tyro.conf.arg(name="")] = Output(),
    ) -> tuple[Scenario, Output]:
        return scenario, output

    return tyro.cli(
        together,
        prog=f"nsaid {command} {name}",
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
    """All fields of nested dataclasses, dotted."""
    parts = value if isinstance(value, Mapping) else {f.name: getattr(value, f.name)
                                                      for f in fields(value)}  # fmt: skip
    paths = []
    for name, item in parts.items():
        nested = is_dataclass(item) or isinstance(item, Mapping)
        paths += _paths(item, f"{prefix}{name}.") if nested else [f"{prefix}{name}"]
    return paths


def field_path(name: str, scenario: Scenario) -> str:
    """The full dotted path of a field, which may be given by its last name.

    Raises:
        UnknownName: there is no such field, or there are several; with near matches.
    """
    paths, wanted = _paths(scenario), name.replace("-", "_")
    if wanted in paths:
        return wanted
    same = [path for path in paths if path.endswith("." + wanted)]
    if len(same) == 1:
        return same[0]
    if same:
        raise UnknownName("field", name, same, f"It is one of {', '.join(same)}.")
    alike = paths if "." in wanted else {path.rpartition(".")[2] for path in paths}
    raise UnknownName("field", name, alike, "`nsaid run NAME --help` lists all.")


def field_value(path: str, text: str, scenario: Scenario) -> Any:
    """A field's value from a command line's words, by the field's type.

    Raises:
        InvalidInput: the words are no value of that type.
    """
    parent, _, name = f".{path}".rpartition(".")
    hint = get_type_hints(type(field_at(scenario, parent[1:])))[name]

    def parsed(value: Any) -> Any:
        return value

    parsed.__annotations__["value"] = tyro.conf.FlagConversionOff[hint]
    try:
        words = shlex.split(text)
        args = [f"--value={words[0]}"] if len(words) == 1 else ["--value", *words]
        with contextlib.redirect_stderr(io.StringIO()):
            return tyro.cli(parsed, args=args, console_outputs=False)
    except (SystemExit, ValueError) as error:
        kind = hint.__name__ if isinstance(hint, type) else str(hint).replace("typing.", "")
        raise InvalidInput(path, f"a value of type {kind}", repr(text),
                           "`nsaid run NAME --help` tells what it takes.") from error  # fmt: skip


def field_at(value: Any, path: str) -> Any:
    """The field of nested dataclasses and mappings that a dotted path leads to."""
    for name in filter(None, path.split(".")):
        value = value[name] if isinstance(value, Mapping) else getattr(value, name)
    return value


def with_field(value: Any, path: str, new: Any) -> Any:
    """Nested dataclasses and mappings with one field replaced."""
    name, _, rest = path.partition(".")
    part = with_field(field_at(value, name), rest, new) if rest else new
    if isinstance(value, Mapping):
        return {**value, name: part}
    return replace(value, **{name: part})
