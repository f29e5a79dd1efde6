"""A scenario's dataclasses as command line options.

Every field of Scenario, of its plant, its excitation and its identifier is a flag. A field's last
name will do where no other field has it: `--robot` is `--plant.robot`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

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
