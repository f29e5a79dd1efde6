"""`nsaid track`: tracking laws on the plants of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..errors import InvalidInput
from ..experiment.library import load
from .exit_codes import code_of
from .grammar import Tracking
from .options import parse, repeated


def track(
    name: str, script: str, arguments: Sequence[str], seeds: Callable[[str], tuple[int, ...]]
) -> int:
    """Runs the study and returns the exit code.

    Args:
        name: of the scenario, or path of its script.
        script: the same, the path absolute.
        arguments: the command line after the name.
        seeds: parses the seeds.
    """
    if any(argument.partition("=")[0] == "--seed" for argument in arguments):
        raise InvalidInput("--seed", "--seeds, with one or more values", "--seed", "Give --seeds.")
    default = load(name)
    scenario, chosen = parse(Path(name).stem, default, arguments, "track", Tracking)
    from ..studies import tracking, tracking_run

    plan = tracking.Plan(
        script,
        scenario,
        arguments=repeated(default, scenario),
        laws=tuple(chosen.laws.split(",")) if chosen.laws else tracking.LAWS,
        seeds=seeds(chosen.seeds),
    )
    folder = chosen.out or Path("runs") / f"{Path(name).stem}-track"
    done = tracking_run.run(plan, folder, quiet=chosen.quiet or chosen.json)
    if chosen.json:
        print((folder / tracking.FILES[0]).read_text(encoding="utf-8"), end="")
    return code_of(None, all(course.figures["status"] == "completed" for course in done))
