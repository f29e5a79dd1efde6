"""The commands of `nsaid` and their own options; `lab.options` adds the fields of a scenario.

Nothing heavy is imported here, so that `nsaid --help` is fast.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Union

import tyro
from tyro.conf import Positional, UseAppendAction, arg, subcommand

from ..base import with_homes
from .grammar_of_studies import (
    Compare,
    CompareModels,
    File,
    Files,
    Folder,
    Model,
    MonteCarlo,
    Names,
    Number,
    Report,
    ScenarioName,
    Sweep,
    Switch,
    Track,
    Words,
)

_MODELS = {".urdf", ".xml", ".mjb"}
"""Endings of model files; a TOML file may be a map."""


@dataclass(frozen=True)
class Identify:
    """Identify a robot's parameters from its own log.

    `nsaid identify log.csv --model arm.urdf` writes the parameters with intervals, the
    unidentifiable ones, a report, a recording, and the model file with identified values. `nsaid
    identify tx40` uses a packed log of a real arm. From an MJCF with position servos and a log of
    their targets instead of torques, it identifies kp, kv, armature, friction and delay of every
    servo, and writes them into the MJCF; `nsaid identify so101` uses such a log.

    Attributes:
        logs: log files or folders of them; CSV, JSON, Parquet, Arrow, npz, mat, a run's folder, ROS
            bag, MCAP, ULog, DataFlash, LeRobot dataset, Rerun recording; or tx40 or so101 for a
            packed log.
        log: the same as LOG.
        model: URDF, MJCF or vehicle's TOML file; name of a packed robot or vehicle.
        validate: log files on which the estimate is judged; they take no part in the fit.
        map: TOML file with the meaning of columns; `nsaid inspect` writes a first one.
        validate_map: that of the logs of --validate; by default --map.
        known: a known parameter, such as gain_1=0.11 or "mass of link_3=2.5"; repeat it for more.
        load: a weighed load that one of several logs carries, such as loaded.csv:0.25kg@gripper; it
            fixes the scale of masses, gains and friction. Repeat it for more logs.
        lock: comma-separated joints that do not move.
        joints: comma-separated joints that move; all others are locked.
        columns: auto, or comma-separated columns that all joints have besides rotor inertia,
            viscous and Coulomb friction: stribeck, load, quadratic, cubic, spring, offset; ""
            for none.
        delay: auto, or comma-separated delays of the commands [s], one or one per command.
        cutoff: cut-off frequency of the low-pass filter [Hz]; by default from the motion.
        fix: apply the remedies of the log's findings to its map first, and keep them if no
            contradiction follows; writes map-fixed.toml.
        law: batch, the fit to all rows at once; or efficient, memory, cone, paper, which also
            follow the log, sample by sample, and are compared with it; servos: batch.
        limit: largest size of an unpacked log file [GB].
        out: folder of the results; by default runs/ROBOT-identify.
        force: overwrite results in the folder.
        json: print only the results, as JSON, to the standard output.
        quiet: print only errors.
    """

    logs: Annotated[Positional[tuple[Path, ...]], arg(metavar="LOG…", help_behavior_hint="")] = ()
    model: Model = None
    log: Files = ()
    validate: Files = ()
    map: File = None
    validate_map: File = None
    known: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME=VALUE")] = ()
    load: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="FILE:MASSkg@LINK")] = ()
    lock: Names = ""
    joints: Names = ""
    columns: Annotated[str, arg(metavar="auto|NAMES")] = "auto"
    delay: Annotated[str, arg(metavar="auto|NUMBERS")] = "auto"
    cutoff: Number = None
    fix: Switch = False
    law: Annotated[str, arg(metavar="LAW")] = "batch"
    limit: float = 4.0
    out: Folder = None
    force: Switch = False
    json: Switch = False
    quiet: Switch = False


@dataclass(frozen=True)
class Inspect:
    """Show what a log holds, before `nsaid identify`.

    Prints rate, gaps, range, noise and quantisation of every channel, and all findings; draws the
    channels on a page, and writes a first map.toml to be completed by hand. Exits with 2 if `nsaid
    identify` would reject the log.

    Attributes:
        logs: log files or folders of them; CSV, JSON, Parquet, Arrow, npz, mat, a run's folder, ROS
            bag, MCAP, ULog, DataFlash, LeRobot dataset, Rerun recording; or tx40 or so101 for a
            packed log.
        log: the same as LOG.
        model: URDF, MJCF or vehicle's TOML file; name of a packed robot or vehicle.
        map: TOML file with the meaning of columns; by default they are matched by name.
        lock: comma-separated joints that do not move.
        joints: comma-separated joints that move; all others are locked.
        fix: apply the remedies of the findings to the map, and keep them if no contradiction
            follows; writes map-fixed.toml.
        limit: largest size of an unpacked log file [GB].
        out: folder of the map and the page.
        json: print figures and findings as JSON.
    """

    logs: Annotated[Positional[tuple[Path, ...]], arg(metavar="LOG…", help_behavior_hint="")] = ()
    model: Model = None
    log: Files = ()
    map: File = None
    lock: Names = ""
    joints: Names = ""
    fix: Switch = False
    limit: float = 4.0
    out: Path = Path()
    json: Switch = False


@dataclass(frozen=True)
class Excite:
    """Design an experiment, and predict its results.

    `nsaid excite NAME` designs for a scenario's robot or vehicle, `nsaid excite --model arm.urdf`
    for a robot or vehicle of your own. Writes the motion as CSV, a scenario to run it in MuJoCo, a
    report and a recording. `nsaid run NAME --excitation designed` designs and runs at once.

    Attributes:
        scenario: a name from `nsaid list`, or the path of a script or scenario.json.
        model: URDF, MJCF (.xml, .mjb) or vehicle's TOML file of your own, or a robot's name.
        duration: duration of the experiment [s].
        want: gains, all, or comma-separated names of parameters, such as mass_6; also --for.
        limits: TOML file of limits; by default those that the scenario's own excitation keeps, or
            those of the model file.
        criterion: bound (the predicted deviation), condition or d-optimal.
        noise: standard deviations of measured positions and velocities, such as 1e-4,5e-3.
        seed: seed of the search.
        effort: multiplies the number of motions to try.
        out: folder of the results; by default runs/NAME-excite.
        force: overwrite a design in the folder.
        json: print only the design, as JSON, to the standard output.
        quiet: print only errors.
    """

    scenario: Annotated[Positional[str], arg(metavar="NAME_OR_FILE", help_behavior_hint="")] = ""
    model: Model = None
    duration: float = 20.0
    want: Annotated[str, arg(metavar="gains|all|NAMES")] = "gains"
    limits: File = None
    criterion: Annotated[str, arg(metavar="WORD")] = "bound"
    noise: Words = None
    seed: int = 0
    effort: float = 1.0
    out: Folder = None
    force: Switch = False
    json: Switch = False
    quiet: Switch = False


@dataclass(frozen=True)
class Live:
    """Identify a robot while it moves.

    Reads samples, lines such as {"t": 0.002, "q": [...], "v": [...], "u": [...]}, and prints the
    actuators' gains with intervals as they narrow. The stream ends with its file, with the line
    {"end": true}, or with Ctrl-C; result and page follow. docs/live.md has axes, units and order.

    Attributes:
        model: URDF, MJCF or vehicle's TOML file, or a name from `nsaid list`.
        law: efficient, memory, cone or paper.
        rate: samples per second [Hz].
        udp: port of this machine on which samples arrive; by default they come from the standard
            input.
        frame: axes of a vehicle's pose and twist, ENU/FLU (z up) or NED/FRD.
        position_noise: standard deviation of positions [rad or m].
        velocity_noise: standard deviation of velocities [rad/s or m/s].
        prior_error: largest relative error of the model file's values and of guessed frictions.
        gain: expected force per unit of command, for commands other than forces [N·m or N].
        lock: comma-separated joints that do not move.
        joints: comma-separated joints that move; all others are locked.
        every: time between two printed estimates [s]; 0 for all.
        view: stream into the Rerun viewer.
        out: folder of the run; by default runs/NAME-live-LAW, numbered.
        force: replace a run in the folder; files of yours are never replaced.
        json: print estimates and summary as lines of JSON.
        quiet: print only errors.
    """

    model: Annotated[str, arg(metavar="FILE_OR_NAME")]
    law: Annotated[str, arg(metavar="LAW")] = "efficient"
    rate: float = 500.0
    udp: Annotated[int | None, arg(metavar="PORT", help_behavior_hint="")] = None
    frame: Annotated[str, arg(metavar="WORD")] = "ENU/FLU"
    position_noise: float = 1e-4
    velocity_noise: float = 5e-3
    prior_error: float = 1.0
    gain: Number = None
    lock: Names = ""
    joints: Names = ""
    every: Number = None
    view: Switch = False
    out: Folder = None
    force: Switch = False
    json: Switch = False
    quiet: Switch = False


@dataclass(frozen=True)
class List:
    """List scenarios, and robots for `nsaid run arm --robot`."""


@dataclass(frozen=True)
class RunOptions:
    """Run a scenario by name or file.

    The scenario's fields are flags too: `nsaid run NAME --help` lists them all.

    Attributes:
        out: folder of the run; by default runs/NAME-LAW, numbered if that holds a completed run.
        force: replace a run in the folder; files of yours are never replaced.
        quiet: print only errors.
        json: print only the summary, as JSON, to the standard output.
        live: show the run in the Rerun viewer while it runs, in real time.
        live_speed: speed of --live relative to real time; 0 for as fast as possible.
    """

    out: Folder = None
    force: Switch = False
    quiet: Switch = False
    json: Switch = False
    live: Switch = False
    live_speed: Annotated[float, arg(metavar="FACTOR")] = 1.0
    scenario: ScenarioName = field(kw_only=True)


@dataclass(frozen=True)
class Verify:
    """Check the paper's statements on a run.

    `nsaid verify NAME_OR_FILE` takes the flags of `nsaid run` and runs the scenario first; `nsaid
    verify --run FOLDER` reads the record of an earlier run.

    Attributes:
        run: folder of an earlier run, in place of a scenario's name.
        quiet: print only errors.
        json: print only the verdicts, as JSON, to the standard output.
    """

    run: Folder = None
    quiet: Switch = False
    json: Switch = False


@dataclass(frozen=True)
class ViewOptions:
    """Open a run's recording in the Rerun viewer.

    Attributes:
        run: folder of the run, e.g. runs/ur5-paper.
        web: serve the recording to a browser on this machine.
        rebuild: recreate recording and report from the record.
    """

    run: Positional[Path]
    web: Switch = False
    rebuild: Switch = False


COMMANDS: dict[str, type] = {
    "list": List,
    "identify": Identify,
    "live": Live,
    "inspect": Inspect,
    "excite": Excite,
    "run": RunOptions,
    "verify": Verify,
    "compare": Compare,
    "sweep": Sweep,
    "montecarlo": MonteCarlo,
    "track": Track,
    "report": Report,
    "view": ViewOptions,
}
"""The options of every command, by its name."""


def parse(arguments: Sequence[str]) -> Any:
    """Parses a command line without fields of a scenario; returns the options of its command.

    Only the named command's parser is made. Without a command, the help has one line for each.
    """
    word = next(iter(arguments), "")
    if word in COMMANDS:
        options = tyro.cli(
            COMMANDS[word],
            prog=f"nsaid {word}",
            args=list(arguments[1:]),
            config=(tyro.conf.FlagCreatePairsOff,),
        )
        options = with_homes(options)
        return _sorted(options) if isinstance(options, Identify | Inspect) else options
    firsts = {name: (kind.__doc__ or "").partition("\n")[0] for name, kind in COMMANDS.items()}
    choices = [
        Annotated[kind, subcommand(name, description=firsts[name])]
        for name, kind in COMMANDS.items()
    ]
    return tyro.cli(
        Union[tuple(choices)],  # type: ignore[arg-type]  # noqa: UP007 (made of a dictionary)
        prog="nsaid",
        description="Identifies the dynamics of a robot, plant and actuators together, from its "
        "motion.\n\n"
        "`nsaid COMMAND --help` explains a command, `nsaid run NAME --help` lists all fields of a "
        "scenario; `nsaid --version` prints the version. Exit codes: 0 explained, 1 not explained, "
        "2 unusable input.",
        args=list(arguments),
        config=(tyro.conf.FlagCreatePairsOff,),
    )


def _sorted(options: Identify | Inspect) -> Identify | Inspect:
    """The words of a command with all logs in one field.

    Logs and a model file may stand in any order. The name of a packed robot alone is a model for
    `nsaid identify`, which knows its log.
    """
    words = [*options.logs, *options.log]
    model = options.model
    files = [word for word in options.logs if word.suffix.lower() in _MODELS]
    if model is None and len(files) == 1:
        model = str(files[0])
        words.remove(files[0])
    if isinstance(options, Inspect):
        return replace(options, logs=tuple(words), log=(), model=model)
    named = len(options.logs) == 1 and not options.logs[0].suffix
    if model is None and named and not options.logs[0].exists():
        model = str(words.pop(0))
    return replace(options, logs=(), log=tuple(words), model=model)


def parse_comparison(arguments: Sequence[str]) -> Any:
    """Parses what follows `nsaid compare` where it begins with a flag: `CompareModels`."""
    return with_homes(tyro.cli(CompareModels, prog="nsaid compare", args=list(arguments)))
