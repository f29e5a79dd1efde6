"""`nsaid live`: follows the samples of a robot, from standard input or over UDP."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...base import require, without_nonfinite
from ...lab import ResultsFolder
from ...report import ExitCode
from .checks import check_live, names_in

if TYPE_CHECKING:
    from ...lab import Observer
    from ..session import LiveEstimate, Session
    from ..walking import Lines
    from .given import ToFollow

_SHOWN = 1.0  # time between two printed estimates [s]


def follow_robot(chosen: ToFollow) -> int:
    """Executes `nsaid live` and returns the exit code."""
    check_live(chosen)
    from ..identify.models import load_robot_model
    from ..walking import first_of, walks

    joints = names_in(chosen.joints) or None
    model = load_robot_model(chosen.model, names_in(chosen.lock), joints)
    if not model.walks:
        return _follow_law(chosen, None)
    _wait_for(chosen)
    first, lines = first_of(_source(chosen))
    if walks(model, first):  # it may also hang on a stand: its first sample says which
        return _follow_walking(chosen, model.joints, lines)
    return _follow_law(chosen, lines)


def _source(chosen: ToFollow) -> Lines:
    from ..logs.stream import bound, standard_input

    return standard_input() if chosen.udp is None else bound(chosen.udp)


def _follow_law(chosen: ToFollow, given: Lines | None) -> int:
    """Follows the samples with a law; `given` are those that a first one was read of, if any."""
    from ...lab import Progress, finish, print_result
    from ..identify.measured import LiveRobot, measured_scenario
    from ..session import Session

    name = Path(chosen.model).stem
    lock = names_in(chosen.lock)
    joints = names_in(chosen.joints)
    robot = LiveRobot(robot=chosen.model, lock=lock, joints=joints, gain=chosen.gain)
    noise = chosen.position_noise, chosen.velocity_noise
    scenario = measured_scenario(robot, chosen.law, chosen.rate, noise, chosen.prior_error)
    quiet = chosen.quiet or chosen.json
    with ResultsFolder(chosen.out, chosen.force).of_run(f"{name}-live", scenario) as folder:
        with Progress(name, quiet=quiet) as progress:
            progress.say("reading the model")
            session = Session(scenario, chosen.frame)
            progress.say("loading kernels")
            session.warm_up()
        lines = _source(chosen) if given is None else given
        if chosen.json:
            _print_head(session, folder)
        elif given is None:
            _wait_for(chosen)
        observers: list[Observer] = []
        if chosen.view:
            require("rerun", "view", "A recording")
            from ...lab import LiveRecording

            observers.append(LiveRecording(name, 0))
        every = chosen.every if chosen.every is not None else _SHOWN
        show = _send if chosen.json else (_print if not quiet else lambda _: None)
        run = session.run(lines, folder, show, every, observers)
        command = shlex.join(["nsaid", "live", "--model", chosen.model, "--law", chosen.law])
        with Progress(name, quiet=quiet) as progress:
            result = finish(run, progress.say, command)
    if chosen.json:
        _print_json({"summary": result.summary()})
    elif not chosen.quiet:
        print_result(f"{name} live", result, folder)
    return ExitCode.of(result)


def _print_head(session: Session, folder: Path) -> None:
    """Prints the first line of JSON: parameters and the numbers of values of a sample."""
    system = session.robot.system
    widths = {"q": system.m, "v": system.n, "u": system.n_u}
    space = system.space
    head = {"names": space.names, "units": space.units, "actuators": space.actuators.tolist()}
    _print_json(head | {"widths": widths, "folder": str(folder)})


def _print_json(found: dict[str, Any]) -> None:
    print(json.dumps(found, ensure_ascii=False, allow_nan=False), flush=True)


def _wait_for(chosen: ToFollow) -> None:
    if not (chosen.quiet or chosen.json):
        name = Path(chosen.model).stem
        where = "standard input" if chosen.udp is None else f"UDP port {chosen.udp}"
        print(f"{name}: waiting for samples from {where}", file=sys.stderr)


def _follow_walking(chosen: ToFollow, joints: tuple[str, ...], lines: Lines) -> int:
    """Identifies a robot that walks while its samples come, and writes the results."""
    from rich.console import Console

    from ...report import print_page
    from ..walking import WalkingSamples, identified_along
    from .identify import files_of_results, write

    samples = WalkingSamples(joints, lines)
    name = f"{Path(chosen.model).stem}-live"
    files = files_of_results(chosen.model)
    quiet = chosen.quiet or chosen.json
    show = _send_whole if chosen.json else (_print if not quiet else lambda _: None)
    options = {"lock": names_in(chosen.lock), "joints": names_in(chosen.joints) or None}
    with ResultsFolder(chosen.out, chosen.force).of_results(name, files, "results") as folder:

        def say(text: str) -> None:
            print(text, file=sys.stderr, flush=True)

        if chosen.json:
            k = len(joints)
            _print_json({"widths": {"q": k, "v": k, "u": k}, "folder": str(folder)})
        found = identified_along(chosen.model, options, samples, folder, show, say)
        page, written = write(found, folder, lambda _: None)
        if chosen.json:
            _print_json({"summary": without_nonfinite(page.result.summary())})
        elif not quiet:
            print_page(page, Console(), written)
    return ExitCode.of(page.result)


def _send(estimate: LiveEstimate) -> None:
    sys.stdout.buffer.write(estimate.line())
    sys.stdout.buffer.flush()


def _send_whole(estimate: LiveEstimate) -> None:
    """Prints an estimate with its names, which are known from the first fit on."""
    sys.stdout.buffer.write(estimate.line(head=True))
    sys.stdout.buffer.flush()


def _print(estimate: LiveEstimate) -> None:
    from ...core import number
    from ...report import estimate as written

    gains = "  ".join(
        f"{gain.name} {written(gain.value, gain.low, gain.high)[0]} ± "
        f"{number(0.5 * (gain.high - gain.low), significant=2)}"
        for gain in estimate.gains
    )
    doubt = f"  misfit: {estimate.misfit}" if estimate.misfit not in ("", "none") else ""
    faults = f"  faults: {'; '.join(estimate.faults)}" if estimate.faults else ""
    print(f"{estimate.t:8.2f} s  {gains}{doubt}{faults}", flush=True)
