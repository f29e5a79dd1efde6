"""A scenario's dataclasses as command line options.

Every field of Scenario, of its plant, its excitation and its identifier is a flag. A field's last
name will do where no other field has it: `--robot` is `--plant.robot`.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ..experiment.fields import field_paths
from ..experiment.scenario import Scenario


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
    paths = field_paths(default)
    last = Counter(path.rsplit(".", 1)[-1] for path in paths)
    wanted = flag.replace("-", "_")
    if wanted not in paths and last[wanted] == 1:
        flag = next(path for path in paths if path.endswith("." + wanted))
    return f"--{flag}{equals}{value}"
