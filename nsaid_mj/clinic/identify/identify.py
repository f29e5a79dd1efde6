"""`identify`: from a model file and log files to parameters with intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...base import CHOICES, InvalidInput, UnknownName, single_threaded
from ...robots import asset, mjcf_of
from ..logs.unusable import UnreadableLog, UnusableLog

if TYPE_CHECKING:
    from ...robots import RobotModel
    from ..logs.mapping import Map
    from ..logs.recordings import Recordings
    from ..servos.logs import ServoLogs
    from ..servos.result import ServoIdentification
    from .loads import Load
    from .result import Identification, Options

PathLike = str | Path


@single_threaded
def identify(
    model: str | RobotModel,
    logs: PathLike | Sequence[PathLike] = (),
    *,
    validate: PathLike | Sequence[PathLike] = (),
    mapping: PathLike | Map | None = None,
    validate_mapping: PathLike | Map | None = None,
    known: Mapping[str, float] | None = None,
    loads: Sequence[str | Load] = (),
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
    delay: float | Sequence[float] | None = None,
    cutoff: float | None = None,
    law: str = "batch",
    folder: PathLike | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> Identification | ServoIdentification:
    """Identifies plant and actuator parameters of a robot from logs of its motion.

    Args:
        model: path of a URDF, MJCF or vehicle's TOML file; the name of a robot or vehicle, packed
            or of example-robot-data; or a model already loaded.
        logs: files of position, velocity (if any), command; none for a packed robot's own log.
        validate: files excluded from the fit, on which the estimate is validated.
        mapping: the meaning of the logs' columns, or its map.toml; None to match joints by name.
        validate_mapping: that of `validate`; None for `mapping`.
        known: known parameters by name or label [SI], such as {"gain_1": 0.11}.
        loads: weighed loads, such as "loaded.csv:0.25kg@gripper", which fix the common scale.
        lock: joints that do not move.
        joints: the joints that move; all others are locked.
        columns: columns of all joints besides rotor inertia, viscous and Coulomb friction, names of
            `COLUMNS` of `choose.columns`; None to choose them for every joint inside the log.
        delay: delay of the commands [s], one or one per command; None to search within ±0.2 s.
        cutoff: cut-off frequency of the low-pass filter [Hz]; None for the motion's bandwidth.
        law: `batch`, the fit to all rows at once; `efficient`, `memory`, `cone` and `paper` also
            follow the log, sample by sample, with the columns, delays and prior of the fit.
        folder: folder of the record of such a law; None keeps no files.
        report: called with the name of every stage, for progress.

    Returns:
        The result, whose `explains` and `verdict` say whether the model explains the log at all; of
        an MJCF with position servos and logs of their targets, these servos.

    Raises:
        UnusableLog: a fault of the log, such as a reversed or dead channel, with all findings.
        NsaidError: a file cannot be read, a name is unknown, or a value is not physical.
    """
    CHOICES.check("law", law)
    own = _read_map(mapping)
    other = _read_map(validate_mapping)
    carried = tuple(map(_load, loads))
    servos = servos_of(model, _listed(logs), own, lock, joints, carried)
    if servos is not None:
        from ..servos.identify import check_servo_options, identify_servos

        check_servo_options(law, known=known, columns=columns, delay=delay, cutoff=cutoff)
        found = identify_servos(servos, report)
        unseen = _listed(validate)
        others = servos_of(model, unseen, other or own, lock, joints) if unseen else None
        if others is None:
            return found
        from ..servos.export import with_replay

        report("simulating the validation logs with the identified servos")
        return with_replay(found, servos, others)
    return identify_forces(
        model,
        logs,
        validate=validate,
        mapping=own,
        validate_mapping=other,
        known=known,
        loads=carried,
        lock=lock,
        joints=joints,
        columns=columns,
        delay=delay,
        cutoff=cutoff,
        law=law,
        folder=folder,
        report=report,
    )


@single_threaded
def identify_forces(
    model: str | RobotModel,
    logs: PathLike | Sequence[PathLike] = (),
    *,
    validate: PathLike | Sequence[PathLike] = (),
    mapping: PathLike | Map | None = None,
    validate_mapping: PathLike | Map | None = None,
    known: Mapping[str, float] | None = None,
    loads: Sequence[str | Load] = (),
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
    delay: float | Sequence[float] | None = None,
    cutoff: float | None = None,
    law: str = "batch",
    folder: PathLike | None = None,
    report: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identifies a robot from logs whose commands are forces, in any unit; see `identify`."""
    CHOICES.check("law", law)
    from .models import floating

    report("reading the model")
    robot = _robot(model, lock, joints)
    files, chosen = files_of(model, _listed(logs), mapping)
    report("reading the log")
    recordings = recordings_of(files, chosen, robot)
    if recordings.feedback is not None:  # the servos' targets make torques
        robot = replace(robot, findings=tuple(f for f in robot.findings if f.code != "servo"))
    other = chosen if validate_mapping is None else _read_map(validate_mapping)
    validation = _validation(_listed(validate), other, robot)
    if recordings.imu is not None:
        robot = floating(robot)
    options = _options(robot, columns, coupled(chosen), delay, cutoff, loads)
    options = replace(options, known=known or {})
    return _fitted(robot, recordings, validation, options, law, folder, report)


def _fitted(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    law: str,
    folder: PathLike | None,
    report: Callable[[str], None],
) -> Identification:
    """The result of the fit to all rows, and of a law along them if one is named."""
    from ..logs.phases import parts_in_words
    from .calibrate import calibrate
    from .foreign_phases import (
        PASSES,
        foreign_in_validation,
        foreign_phases,
        unfiltered,
        without,
    )
    from .translation import left_out

    if robot.floating:
        _check_walking(robot, options, law)
    if law != "batch" and robot.followers:
        remedy = f"Leave --law out, or lock them: `--lock {','.join(robot.followers)}`."
        expected = "batch, as joints follow others"
        raise InvalidInput("--law", expected, law, remedy)
    if law != "batch" and recordings.turns_only:
        expected = "batch, as the translation is not measured"
        raise InvalidInput("--law", expected, law, "Leave --law out.")
    if law != "batch" and options.loads and not robot.jointed:
        expected = "batch, as a load is carried in some of the logs"
        raise InvalidInput("--law", expected, law, "Leave --law or --load out.")
    found = calibrate(robot, recordings, validation, options, report)
    for _ in range(PASSES):
        foreign = foreign_phases(found)
        unseen = foreign_in_validation(found, validation)
        if not foreign and not unseen:
            break
        report("fitting without phases that the rest contradicts")
        rest = without(found.recordings, foreign)
        if validation is not None:
            validation = without(validation, unseen)
        found = calibrate(robot, rest, validation, options, report)
    parts = parts_in_words(found.recordings.phases)
    sentence = " ".join(filter(None, (found.verdict, left_out(found.findings), parts)))
    findings = (*found.findings, *unfiltered(found))
    found = replace(found, verdict=sentence, findings=findings)
    if law == "batch":
        return found
    from .law import with_law

    return with_law(found, law, folder, report)


def _check_walking(robot: RobotModel, options: Options, law: str) -> None:
    """Raises `InvalidInput` for what is not known of robots that stand and walk."""
    for name, given, expected, remedy in (
        ("--law", law != "batch", "batch, as the base moves", "Leave it out."),
        ("--load", options.loads, "none, as the base moves", "Give the weight: --known mass=…"),
        (
            "model",
            robot.followers,
            "joints that move by themselves, as the base moves",
            f"Lock those that follow: `--lock {','.join(robot.followers)}`.",
        ),
    ):
        if given:
            raise InvalidInput(name, expected, law if name == "--law" else given, remedy)


def servos_of(
    model: str | Path | RobotModel,
    logs: Sequence[Path],
    mapping: Map | None = None,
    lock: Sequence[str] = (),
    joints: Sequence[str] | None = None,
    loads: Sequence[Load] = (),
) -> ServoLogs | None:
    """An arm of position servos and its logs of targets; None of any other robot or logs."""
    if mapping is not None and mapping.pd is not None:  # the servos' law is known, torques follow
        return None
    if isinstance(model, str | Path):
        if mjcf_of(str(model)) is None:
            return None
        from ..servos.identify import servo_logs

        return servo_logs(model, logs, mapping, lock, joints, loads)
    if model.servos is None or not logs:
        return None
    from ..logs.tables import read_tables
    from ..servos.identify import read_servos

    return read_servos(model, read_tables(logs, mapping), mapping, loads)


def _load(load: str | Load) -> Load:
    from .loads import load_of

    return load_of(load) if isinstance(load, str) else load


def _robot(
    model: str | RobotModel, lock: Sequence[str], joints: Sequence[str] | None
) -> RobotModel:
    """The model, read unless it is loaded already."""
    from ...robots import RobotModel
    from .models import load_robot_model

    return model if isinstance(model, RobotModel) else load_robot_model(model, lock, joints)


def _listed(files: PathLike | Sequence[PathLike]) -> list[Path]:
    return [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]


def files_of(
    model: str | RobotModel, logs: list[Path], mapping: PathLike | Map | None
) -> tuple[list[Path], Map | None]:
    """The logs and the map, by default a packed robot's; raises `InvalidInput` without a log."""
    if logs:
        return logs, _read_map(mapping)
    if isinstance(model, str) and model == Path(model).name:
        packed = asset(model, "log.csv.gz")
        own = asset(model, "map.toml")
        if packed.is_file():
            return [packed], _read_map(own if mapping is None and own.is_file() else mapping)
    raise InvalidInput("log", "one or more files", "none", "Give `--log FILE`.")


def _read_map(mapping: PathLike | Map | None) -> Map | None:
    from ..logs.mapping import read_map

    return read_map(Path(mapping)) if isinstance(mapping, str | Path) else mapping


def _validation(files: list[Path], mapping: Map | None, robot: RobotModel) -> Recordings | None:
    """The recordings of validation logs, whose findings name these files; None without any."""
    if not files:
        return None
    try:
        return recordings_of(files, mapping, robot)
    except UnreadableLog:  # names its file
        raise
    except UnusableLog as error:
        names = f"validation log {', '.join(file.name for file in files)}"
        found = (
            replace(f, where=", ".join(filter(None, (names, f.where)))) for f in error.findings
        )
        raise UnusableLog(tuple(found)) from error


def recordings_of(files: Sequence[Path], mapping: Map | None, robot: RobotModel) -> Recordings:
    """Prepared and checked logs of a robot."""
    from ..logs.checks import checked
    from ..logs.preparation import prepare
    from ..logs.tables import read_tables

    return checked(prepare(read_tables(files, mapping), mapping, robot), robot)


def coupled(mapping: Map | None) -> tuple[tuple[int, int, int], ...]:
    """Pairs (i, j, ±1) of joints that a map couples: a motor turns by the sum or the difference."""
    if mapping is None:
        return ()
    pairs: dict[tuple[int, int], int] = {}
    torque = mapping.coupling.torque
    position = mapping.coupling.position
    for A in (np.array(torque or ()).T, np.array(position or ())):  # row: a motor's rate
        for row, column in np.argwhere(A).tolist():
            if row != column:
                side = -1 if A[row, column] * A[row, row] < 0 else 1
                pairs[min(row, column), max(row, column)] = side
    return tuple((i, j, side) for (i, j), side in sorted(pairs.items()))


def _options(
    robot: RobotModel,
    columns: Sequence[str] | None,
    coupled: tuple[tuple[int, int, int], ...],
    delay: float | Sequence[float] | None,
    cutoff: float | None,
    loads: Sequence[str | Load],
) -> Options:
    """The options that a user gave.

    Raises:
        UnknownName: there is no such friction column.
        InvalidInput: delays are not 1 or k numbers within ±1 s, the cut-off is out of range, a load
            is stated in another form, or without its place on a vehicle.
    """
    from .choose.columns import BASIC, COLUMNS, EXTRA
    from .result import Options
    from .vehicle_loads import check_place

    k = len(robot.joints)
    names = None
    delays = None
    if columns is not None:
        choices = COLUMNS if robot.jointed else EXTRA
        for name in columns:
            if name not in choices:
                raise UnknownName("column", name, choices)
        names = frozenset(columns) | (BASIC if robot.jointed else frozenset())
    if delay is not None:
        given = np.atleast_1d(np.asarray(delay, dtype=np.float64))
        if given.shape not in ((1,), (k,)) or not (np.abs(given) <= 1.0).all():
            expected = f"1 or {k} numbers within ±1 s"
            raise InvalidInput("delay", expected, given.tolist(), "0.01 is 10 ms.")
        delays = np.broadcast_to(given, (k,)).copy()
    if cutoff is not None and not 0.1 <= cutoff <= 1000.0:
        raise InvalidInput("cutoff", "0.1 to 1000 Hz", cutoff, "Leave it out to have it chosen.")
    carried = tuple(map(_load, loads))
    if not robot.jointed:
        check_place(carried)
    return Options(names, coupled, delays, cutoff, carried)
