"""The commands that run a scenario many times: compare, sweep, montecarlo, track, report.

The work is in the room `studies`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from ..errors import InvalidInput, UnknownName
from ..experiment.library import load
from ..resources import print_json
from .exit_codes import code_of
from .grammar_of_studies import Comparison, Drawing, Report, Sweeping, Tracking
from .options import parse, repeated

_MOST_SEEDS = 10_000  # of a comparison


def compare(script: str, arguments: Sequence[str]) -> int:
    """Compares methods on the logs of a scenario."""
    for flag, own in (("--seed", "--seeds"), ("--duration", "--durations")):
        if any(argument.partition("=")[0] == flag for argument in arguments):
            raise InvalidInput(flag, f"{own}, with one or more values", flag, f"Give {own}.")
    name = Path(script).stem
    default = load(script)
    scenario, chosen = parse(name, default, arguments, "compare", Comparison)
    from ..studies import compare as study

    kinds = chosen.sensors or ("noisy" if chosen.noise_scales else scenario.sensors)
    kinds = kinds.split(",")
    if unknown := set(kinds) - {"ideal", "noisy"}:
        raise UnknownName("kind of sensors", unknown.pop(), ("ideal", "noisy"))
    scales = _numbers("--noise-scales", chosen.noise_scales or "1")
    plan = study.Plan(
        _whole(script),
        scenario,
        arguments=repeated(default, scenario),
        methods=tuple(chosen.methods.split(",")) if chosen.methods else study.DEFAULT,
        seeds=_seeds(chosen.seeds),
        durations=_numbers("--durations", chosen.durations)
        if chosen.durations
        else (0.5 * scenario.duration, scenario.duration),
        noises=(0.0,) * ("ideal" in kinds) + scales * ("noisy" in kinds),
        budget=study.BUDGET if chosen.budget is None else chosen.budget,
        bound=chosen.bound,
    )
    folder = chosen.out or Path("runs") / f"{name}-compare"
    cells = study.run(plan, folder, quiet=chosen.quiet or chosen.json)
    if chosen.json:
        print((folder / study.FILES[0]).read_text(encoding="utf-8"), end="")
    from ..studies.compare_report import verdict_of

    return code_of(verdict_of(cells))


def _whole(script: str) -> str:
    """A scenario's name, or the absolute path of its script."""
    path = Path(script)
    return str(path.resolve()) if path.suffix == ".py" else script


def sweep(script: str, arguments: Sequence[str]) -> int:
    """Runs a scenario with varied fields and seeds."""
    name, script = Path(script).stem, _whole(script)
    default = load(script)
    scenario, chosen = parse(name, default, arguments, "sweep", Sweeping)
    from ..studies import sweep as study
    from ..studies import sweep_engine, sweep_results

    vary = study.varied(chosen.vary, scenario)
    made_by = repeated(default, scenario)
    plan = study.Plan(script, scenario, vary, chosen.seeds, arguments=made_by)
    engine = sweep_engine.Engine(chosen.engine, chosen.address, chosen.jobs, chosen.timeout)
    folder = chosen.out or Path("runs") / f"{name}-sweep"
    found = study.run(plan, folder, engine, chosen.quiet or chosen.json, chosen.retry)
    if chosen.json:
        print_json(sweep_results.document(found))
    elif not chosen.quiet:
        sweep_results.print_summary(found)
    return code_of(sweep_results.verdict_of(found), not found.lost)


def montecarlo(script: str, arguments: Sequence[str]) -> int:
    """Identifies from many priors."""
    name, script = Path(script).stem, _whole(script)
    default = load(script)
    scenario, chosen = parse(name, default, arguments, "montecarlo", Drawing)
    from ..studies import montecarlo as study
    from ..studies import montecarlo_results

    made_by, shared = repeated(default, scenario), not chosen.own_plants
    plan = study.Plan(script, scenario, chosen.runs, shared, arguments=made_by)
    folder = chosen.out or Path("runs") / f"{name}-montecarlo"
    found = montecarlo_results.run(plan, folder, chosen.jobs, chosen.quiet or chosen.json)
    if chosen.json:
        print_json(montecarlo_results.document(found))
    elif not chosen.quiet:
        montecarlo_results.print_summary(found)
    return code_of(None, not montecarlo_results.lost(found))


def track(script: str, arguments: Sequence[str]) -> int:
    """Compares tracking laws on the plants of a scenario."""
    if any(argument.partition("=")[0] == "--seed" for argument in arguments):
        raise InvalidInput("--seed", "--seeds, with one or more values", "--seed", "Give --seeds.")
    default = load(script)
    scenario, chosen = parse(Path(script).stem, default, arguments, "track", Tracking)
    from ..studies import tracking, tracking_run

    plan = tracking.Plan(
        _whole(script),
        scenario,
        arguments=repeated(default, scenario),
        laws=tuple(chosen.laws.split(",")) if chosen.laws else tracking.LAWS,
        seeds=_seeds(chosen.seeds),
    )
    folder = chosen.out or Path("runs") / f"{Path(script).stem}-track"
    done = tracking_run.run(plan, folder, quiet=chosen.quiet or chosen.json)
    if chosen.json:
        print((folder / tracking.FILES[0]).read_text(encoding="utf-8"), end="")
    return code_of(None, all(course.figures["status"] == "completed" for course in done))


def report(chosen: Report) -> int:
    """Draws a sweep's page."""
    from ..studies import sweep_report, sweep_results

    sweep = sweep_results.read(chosen.sweep)
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
