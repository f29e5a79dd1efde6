"""`nsaid identify` and `nsaid inspect`: files in and out; the work is in `calibration`."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..bounds import without_nonfinite
from ..errors import InvalidInput, printable
from ..resources import asset, print_json, reading, write_json
from .folders import check_writable, folder_for_results
from .grammar import Identify, Inspect, names_in, numbers_in
from .process import EXPLAINED, UNUSABLE, code_of

if TYPE_CHECKING:
    from ..calibration.inspection import Inspection
    from ..calibration.result import Identification
    from ..calibration.servos import Replayed, ServoIdentification, ServoLogs
    from ..pages.page import Page
    from ..pages.progress import Progress
    from ..robot.findings import Finding

RESULT = "identification.json"


def identify_log(chosen: Identify) -> int:
    """Executes the command and returns the exit code."""
    model = chosen.model or chosen.packed
    if model is None:
        raise InvalidInput("--model", "a model file or name", "none", "Such as --model arm.urdf.")
    from ..logs import limited_to

    with (
        reading(model, *chosen.log, *chosen.validate, chosen.map, chosen.validate_map),
        folder_for_results(
            f"{Path(model).stem}-identify", chosen.out, chosen.force, RESULT, "results"
        ) as folder,
        limited_to(chosen.limit * 1e9),
    ):
        return _identify(model, chosen, folder)


def _identify(model: str, chosen: Identify, folder: Path) -> int:
    from rich.console import Console

    from ..logs.unusable import UnusableLog
    from ..pages.progress import Progress
    from ..pages.terminal import print_findings, print_page

    quiet, ended = chosen.quiet or chosen.json, False
    with Progress(Path(model).stem, quiet=quiet) as progress:
        progress.say("reading the model and the log")
        try:
            given = servos_of(model, chosen.log, chosen)
            if given is not None:
                page, files = identify_given(model, given, chosen, folder / RESULT, progress)
            else:
                found = _identified(model, chosen, folder, progress)
                page, files = write(found, folder, progress.say, repeated(chosen))
                ended = found.law is not None and not found.law.completed
        except UnusableLog as error:
            if not quiet:  # the error itself reports the refusals
                notes = [finding for finding in error.findings if finding.level != "refusal"]
                print_findings(notes, Console(stderr=True))
            raise
    if chosen.json:
        print((folder / RESULT).read_text(encoding="utf-8"), end="")
    elif not chosen.quiet:
        print_page(page, Console(), files)
    return max(code_of(page.result), int(ended))


def _identified(model: str, chosen: Identify, folder: Path, progress: Progress) -> Identification:
    """The result of logs with commands that are forces."""
    from ..calibration.identify import identify

    delay = chosen.delay
    return identify(
        model,
        chosen.log,
        validate=chosen.validate,
        mapping=chosen.map,
        validate_mapping=chosen.validate_map,
        known=dict(_known(text) for text in chosen.known),
        loads=chosen.load,
        lock=names_in(chosen.lock),
        joints=names_in(chosen.joints) or None,
        columns=None if chosen.columns == "auto" else names_in(chosen.columns),
        delay=None if delay == "auto" else numbers_in("--delay", delay, "Such as 0.01."),
        cutoff=chosen.cutoff,
        law=chosen.law,
        folder=folder / chosen.law,
        report=progress.say,
    )


def repeated(chosen: Identify) -> str:
    """The command line of an identification, without the options that affect only its output."""
    words = ["nsaid", "identify", *([chosen.packed] if chosen.packed else [])]
    for field in fields(Identify):
        value = getattr(chosen, field.name)
        if value == field.default or field.name in {"packed", "out", "force", "json", "quiet"}:
            continue
        flag, several = f"--{field.name.replace('_', '-')}", isinstance(value, tuple)
        if field.name in {"known", "load"}:
            words += [word for each in value for word in (flag, each)]
        else:
            words += [flag, *(map(str, value) if several else [str(value)])]
    return shlex.join(words)


def write(
    result: Identification, folder: Path, report: Callable[[str], None], command: str = ""
) -> tuple[Page, list[Path]]:
    """Writes results, report, recording and calibrated models into a folder.

    `command` is the command line of the identification, for the report; empty if unknown.

    Returns:
        The page, whose result has findings about the exported model, too, and the files.
    """
    from ..calibration.export import write_models

    folder.mkdir(parents=True, exist_ok=True)
    report("writing and trying the calibrated models")
    files, followed = write_models(result, folder)
    result = replace(result, findings=(*result.findings, *followed))
    write_json(folder / RESULT, without_nonfinite(result.summary()))
    report("writing the report")
    from ..pages.identification import report as pages
    from ..pages.page import write_html

    page = pages.page(result, command)
    files.append(write_html(page, folder))
    from .. import recording

    if recording.available():
        report("writing the recording")
        files.append(recording.record(page, folder / recording.FILE))
    if result.law is not None:
        from ..recording.postprocessing import finish

        finish(result.law.run, report)
        files.append(result.law.run.folder / "report.html")
    return page, [folder / RESULT, *files]


def _known(text: str) -> tuple[str, float]:
    name, equals, value = text.rpartition("=")
    try:
        if not equals:
            raise ValueError
        return name.strip(), float(value)
    except ValueError as error:
        raise InvalidInput("--known", "NAME=VALUE", text, "Such as gain_1=0.11.") from error


_NO_TORQUE = (
    "The other laws identify a motion from forces; a servo's log has none, and its velocity is too "
    "coarse between two rows."
)


def servos_of(model: str, logs: tuple[Path, ...], chosen: Identify) -> ServoLogs | None:
    """The arm and its logs if they hold targets and positions, else None."""
    from ..calibration.links import load_of
    from ..calibration.servos import servo_logs

    lock, joints = names_in(chosen.lock), names_in(chosen.joints)
    loads = [load_of(text) for text in chosen.load] if logs == chosen.log else []
    return servo_logs(model, logs, chosen.map, lock, joints or None, loads)


def identify_given(
    model: str, given: ServoLogs, chosen: Identify, path: Path, progress: Progress
) -> tuple[Page, list[Path]]:
    """Identifies servos and writes the results: JSON into the path, and an MJCF beside it.

    Raises:
        InvalidInput: an option has no meaning for logs of targets.
    """
    from ..calibration.servos import identify_servos, write_servo_mjcf

    plain = Identify()
    for name in ("known", "columns", "delay", "cutoff"):
        if getattr(chosen, name) != getattr(plain, name):
            expected = "no such option with logs of targets and positions"
            raise InvalidInput(f"--{name}", expected, getattr(chosen, name), "Leave it out.")
    if chosen.law not in ("batch", "efficient"):
        expected = "batch or efficient with logs of targets and positions"
        raise InvalidInput("--law", expected, chosen.law, _NO_TORQUE)
    own = replace(chosen, map=chosen.validate_map or chosen.map)
    others = servos_of(model, chosen.validate, own) if chosen.validate else None
    result = identify_servos(given, progress.say, chosen.law)
    progress.say("writing and trying the calibrated model")
    path.parent.mkdir(parents=True, exist_ok=True)
    model_file = path.with_name(f"{result.robot.name}.xml")
    write_servo_mjcf(result, model_file)
    followed, replay = _followed(others, given, result, model_file)
    result = replace(result, findings=(*result.findings, followed))
    write_json(path, without_nonfinite(result.summary()))
    from .. import recording
    from ..pages.identification import servos
    from ..pages.page import write_html

    commands, folder, files = [repeated(chosen)], path.parent, [path, model_file]
    if recording.available():
        commands.append(shlex.join(["nsaid", "view", str(folder)]))
    page = servos.page(result, commands, replay)
    if recording.available():
        progress.say("writing the recording")
        files.append(recording.record_servos(page, replay, folder / recording.FILE))
    return page, [*files, write_html(page, folder)]


def _followed(
    others: ServoLogs | None, given: ServoLogs, result: ServoIdentification, path: Path
) -> tuple[Finding, Replayed]:
    """Deviation of MuJoCo from logs with the exported file at a path, and with the user's own.

    The logs are `others`, which took no part in the fit, or else those of the fit.
    """
    from ..calibration.servos import Replayed, rollout
    from ..robot.findings import Finding

    source, joints = result.robot.source, result.robot.joints
    logs = [log for log in (others or given).logs if not log.loaded]  # of the file's own links
    assert source is not None  # a model with servos comes from a file
    simulated, nominal = ([rollout(file, joints, log) for log in logs] for file in (path, source))
    own, before = (
        1e3 * np.mean([np.abs(q - log.position).mean(axis=0) for q, log in pairs], axis=0)
        for pairs in (zip(simulated, logs, strict=True), zip(nominal, logs, strict=True))
    )
    what, unit = ", ".join(dict.fromkeys(log.source for log in logs)), result.robot.small_unit
    text = (
        f"driven by the targets of {what} alone, MuJoCo's mean absolute error is {own.mean():.1f} "
        f"{unit} with the exported file and its delays, and {before.mean():.1f} {unit} with yours"
    )
    data: dict[str, object] = {"exported": own.tolist(), "nominal": before.tolist()}
    level = "note" if own.mean() < before.mean() else "warning"
    rows = sum(len(log.t) for log in logs)
    used = result.used[:rows] if others is None else np.ones(rows)  # logs with a load are the last
    return Finding(level, "replay", "", text, "", data), Replayed(
        tuple(logs), tuple(simulated), used
    )


MAP, PICTURE = "map.toml", "inspection.png"


def inspect_log(chosen: Inspect) -> int:
    """Executes the command and returns the exit code: unusable where `identify` would refuse.

    It writes the plot and, if a model but no map is given, a first map. An existing map may have
    been edited by hand and is kept: a new one that differs gets another name, and so does the
    picture beside one that is not ours.
    """
    if not chosen.logs:
        raise InvalidInput("logs", "one or more files", "none", "Such as `nsaid inspect log.csv`.")
    check_writable(chosen.out)
    from ..calibration.identify import files_of
    from ..calibration.inspection import inspect
    from ..logs import limited_to, read_map, read_tables
    from ..logs.first_map import first_map
    from ..pages.inspection import draw
    from ..pages.plots import is_own
    from ..resources import write_text

    logs, mapping = list(chosen.logs), read_map(chosen.map) if chosen.map else None
    model, name = chosen.model, str(logs[0])
    if len(logs) == 1 and not logs[0].exists() and asset(name, "log.csv.gz").is_file():
        model, (logs, mapping) = model or name, files_of(name, [], mapping)
    robot = None
    if model is not None:
        from ..calibration.models import load_robot_model

        robot = load_robot_model(model, names_in(chosen.lock), names_in(chosen.joints) or None)
    with limited_to(chosen.limit * 1e9):
        tables = read_tables(logs, mapping)
    found = inspect(tables, mapping, robot)
    with reading(*chosen.logs, chosen.map, chosen.model):
        chosen.out.mkdir(parents=True, exist_ok=True)
        names = chain((PICTURE,), map("inspection-{}.png".format, count(2)))
        paths = (chosen.out / name for name in names)
        files = [draw(found, next(p for p in paths if not p.exists() or is_own(p)))]
        if found.robot is not None and mapping is None:
            text = first_map(found.tables, found.robot)
            names = map("map-new-{}.toml".format, count(2))
            paths = (chosen.out / name for name in chain((MAP, "map-new.toml"), names))
            path = next(p for p in paths if not p.exists() or p.read_bytes() == text.encode())
            write_text(path, text)
            files.append(path)
    if chosen.json:
        print_json(document(found))
    else:
        from rich.console import Console

        from ..pages.inspection import print_inspection

        print_inspection(found, Console(highlight=False))
        for path in files:
            print(printable(str(path)))
    refused = any(f.level == "refusal" or f.code == "unmatched" for f in found.findings)
    return UNUSABLE if refused else EXPLAINED


def document(found: Inspection) -> dict[str, object]:
    """Figures and findings as plain data."""
    return {name: [asdict(x) for x in getattr(found, name)] for name in ("channels", "findings")}
