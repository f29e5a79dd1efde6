"""`nsaid identify` and `nsaid inspect`: files in and out; the work is in `clinic.identify`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields, replace
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...base import InvalidInput, OutputFile, numbers_in, print_json, printable
from ...lab import ResultsFolder
from ...report import ExitCode
from ...robots import asset
from .checks import check_identify, check_inspect, check_logs, known_number, names_in

if TYPE_CHECKING:
    from ...lab import Progress
    from ...report import Page
    from ..identify.fixing import Fix
    from ..identify.inspection import Inspection
    from ..identify.result import Identification
    from ..servos.logs import ServoLogs
    from .given import ToIdentify, ToInspect

RESULT = "identification.json"
FIXED = "map-fixed.toml"


def files_of_results(model: str) -> tuple[str, ...]:
    """Files that `nsaid identify` writes for a model; the first marks a folder of results."""
    name = Path(model).stem
    own = (RESULT, "report.html", "run.rrd", "calibrated.yaml", "sysid.yaml", FIXED)
    return (*own, f"{name}.urdf", f"{name}.xml")


def identify_log(chosen: ToIdentify) -> int:
    """Executes `nsaid identify` and returns the exit code."""
    model = chosen.model
    if model is None:
        check_logs(chosen.log)
        raise InvalidInput("--model", "a model file or name", "none", "Such as --model arm.urdf.")
    check_identify(chosen, model)
    from ..logs.formats import limited_to

    name = f"{Path(model).stem}-identify"
    files = files_of_results(model)
    with (
        ResultsFolder(chosen.out, chosen.force).of_results(name, files, "results") as folder,
        limited_to(chosen.limit * 1e9),
    ):
        return _identify(model, chosen, folder)


def _identify(model: str, chosen: ToIdentify, folder: Path) -> int:
    from rich.console import Console

    from ...lab import Progress
    from ...report import Page, Result, print_page
    from ..logs.unusable import UnusableLog

    quiet = chosen.quiet or chosen.json
    ended = False
    with Progress(Path(model).stem, quiet=quiet) as progress:
        progress.say("reading the model and the log")
        try:
            if chosen.fix:
                chosen = _mended(model, chosen, folder, quiet)
            given = servos_of(model, chosen.log, chosen, chosen.map)
            if given is not None:
                page, files = identify_given(model, given, chosen, folder / RESULT, progress)
            else:
                found = _identified(model, chosen, folder, progress)
                page, files = write(found, folder, progress.say, repeated(chosen))
                ended = found.law is not None and not found.law.completed
        except UnusableLog as error:
            if not quiet:  # the error itself reports the refusals
                notes = [finding for finding in error.findings if finding.level != "refusal"]
                print_page(Page("", Result(findings=tuple(notes))), Console(stderr=True))
            raise
    if chosen.json:
        print((folder / RESULT).read_text(encoding="utf-8"), end="")
    elif not chosen.quiet:
        print_page(page, Console(), files)
    return max(ExitCode.of(page.result), int(ended))


def _mended(model: str, chosen: ToIdentify, folder: Path, quiet: bool) -> ToIdentify:
    """The arguments with the map that the log's findings ask for, which is written to a folder."""
    from ..identify.fixing import fix
    from ..identify.identify import files_of
    from ..identify.models import load_robot_model

    files, _ = files_of(model, list(chosen.log), None)
    own = chosen.map or asset(model, "map.toml")
    text = own.read_text("utf-8") if own.is_file() and (chosen.map or not chosen.log) else ""
    robot = load_robot_model(model, names_in(chosen.lock), names_in(chosen.joints) or None)
    found = fix(files, text, robot)
    if not quiet:
        print("\n".join(map(printable, found.lines)), file=sys.stderr)
    if not found.kept:
        return chosen
    folder.mkdir(parents=True, exist_ok=True)
    OutputFile(folder / FIXED).write_text(found.text)
    if not quiet:
        print(printable(str(folder / FIXED)), file=sys.stderr)
    return replace(chosen, map=folder / FIXED)  # pyright: ignore[reportArgumentType]


def _identified(model: str, chosen: ToIdentify, folder: Path, progress: Progress) -> Identification:
    """The result of logs with commands that are forces."""
    from ..identify.identify import identify_forces

    return identify_forces(
        model,
        chosen.log,
        validate=chosen.validate,
        mapping=chosen.map,
        validate_mapping=chosen.validate_map,
        loads=chosen.load,
        lock=names_in(chosen.lock),
        joints=names_in(chosen.joints) or None,
        law=chosen.law,
        folder=folder / chosen.law,
        report=progress.say,
        **_options(chosen),
    )


_OF_OUTPUT = {"out", "force", "fix", "json", "quiet"}


def repeated(chosen: ToIdentify) -> str:
    """The command line of an identification, without the options that affect only its output."""
    words = ["nsaid", "identify"]
    for field in fields(chosen):
        value = getattr(chosen, field.name)
        if value == field.default or field.name in _OF_OUTPUT:
            continue
        flag = f"--{field.name.replace('_', '-')}"
        several = isinstance(value, tuple)
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
    from ...base import without_nonfinite
    from ..identify.export import with_trial, write_models

    folder.mkdir(parents=True, exist_ok=True)
    report("writing and trying the calibrated models")
    files, followed = write_models(result, folder)
    result = with_trial(result, followed)
    OutputFile(folder / RESULT).write_json(without_nonfinite(result.summary()))
    report("writing the report")
    from ..identify.page import identification_page as pages_page

    page = pages_page(result, command)
    files.append(page.write_html(folder))
    from ...base import OutputFolder, installed

    if installed("rerun"):
        from ..identify.recording import record

        report("writing the recording")
        files.append(record(page, folder / OutputFolder.RECORDING))
    if result.law is not None:
        from ...lab import finish

        finish(result.law.run, report)
        files.append(result.law.run.folder / "report.html")
    return page, [folder / RESULT, *files]


def _options(chosen: ToIdentify) -> dict[str, Any]:
    """The options of a fit to forces that differ from their defaults."""
    delay = chosen.delay
    return {
        "known": dict(known_number(text) for text in chosen.known),
        "columns": None if chosen.columns == "auto" else names_in(chosen.columns),
        "delay": None if delay == "auto" else numbers_in("--delay", delay, "Such as 0.01."),
        "cutoff": chosen.cutoff,
    }


def servos_of(
    model: str, logs: tuple[Path, ...], chosen: ToIdentify, map_file: Path | None
) -> ServoLogs | None:
    """The arm and its logs if they hold targets and positions, else None."""
    from ..identify.identify import servos_of as given
    from ..identify.loads import load_of
    from ..logs.mapping import read_map

    mapping = None if map_file is None else read_map(map_file)
    lock = names_in(chosen.lock)
    joints = names_in(chosen.joints) or None
    loads = [load_of(text) for text in chosen.load] if logs == chosen.log else []
    return given(model, logs, mapping, lock, joints, loads)


def identify_given(
    model: str, given: ServoLogs, chosen: ToIdentify, path: Path, progress: Progress
) -> tuple[Page, list[Path]]:
    """Identifies servos and writes the results: JSON into the path, and an MJCF beside it.

    Raises:
        InvalidInput: an option has no meaning for logs of targets.
    """
    from ...base import without_nonfinite
    from ..servos.export import replayed, write_servo_mjcf
    from ..servos.identify import check_servo_options, identify_servos

    check_servo_options(chosen.law, **_options(chosen))
    others = None
    if chosen.validate:
        others = servos_of(model, chosen.validate, chosen, chosen.validate_map or chosen.map)
    result = identify_servos(given, progress.say)
    progress.say("writing and trying the calibrated model")
    path.parent.mkdir(parents=True, exist_ok=True)
    model_file = path.with_name(f"{result.robot.name}.xml")
    write_servo_mjcf(result, model_file)
    result, replay = replayed(result, model_file, given, others)
    write_servo_mjcf(result, model_file)
    OutputFile(path).write_json(without_nonfinite(result.summary()))
    from ...base import OutputFolder, installed
    from ..servos.page import servo_page as servos_page

    commands = [repeated(chosen)]
    folder = path.parent
    files = [path, model_file]
    if installed("rerun"):
        commands.append(shlex.join(["nsaid", "view", str(folder)]))
    page = servos_page(result, commands, replay)
    if installed("rerun"):
        from ..identify.recording import record_servos

        progress.say("writing the recording")
        files.append(record_servos(page, replay, folder / OutputFolder.RECORDING))
    return page, [*files, page.write_html(folder)]


MAP = "map.toml"
INSPECTION = "inspection.html"


def inspect_log(chosen: ToInspect) -> int:
    """Executes `nsaid inspect` and returns the exit code: unusable where `identify` would refuse.

    It writes a page and, if a model but no map is given, a first map. An existing map may have
    been edited by hand and is kept: a new one that differs gets another name, and so does the
    page beside one that is not ours.
    """
    if not chosen.logs:
        raise InvalidInput("logs", "one or more files", "none", "Such as `nsaid inspect log.csv`.")
    ResultsFolder(chosen.out).check_writable()
    check_inspect(chosen)
    from ...base import NotWritten
    from ..logs.formats import limited_to

    with limited_to(chosen.limit * 1e9):
        found, fixed = _inspected(chosen)
    with NotWritten.on_failure(chosen.out):
        chosen.out.mkdir(parents=True, exist_ok=True)
    from ..identify.inspection_page import inspection_page

    page = inspection_page(found)
    files = [_written(page, chosen.out), *_maps(chosen, found, fixed)]
    if chosen.json:
        print_json(document(found) | ({"fix": fixed.document()} if fixed else {}))
    else:
        from rich.console import Console

        from ...report import print_page

        last = [*files, *_next(chosen, found, files)]
        print_page(page, Console(highlight=False), [*(fixed.lines if fixed else ()), *last])
    return ExitCode.UNUSABLE if _unusable(found) else ExitCode.EXPLAINED


def _unusable(found: Inspection) -> bool:
    """Whether `nsaid identify` would refuse the log before it fits anything."""
    return any(f.level == "refusal" or f.code == "unmatched" for f in found.findings)


def _next(chosen: ToInspect, found: Inspection, files: Sequence[Path]) -> list[str]:
    """The command to give next, if there is a model."""
    if found.robot is None or chosen.model is None:
        return []
    refused = _unusable(found)
    if refused and not any("map.toml" in finding.remedy for finding in found.findings):
        return []  # another log is needed
    made = next((path for path in files if path.suffix == ".toml"), None)
    own = made if chosen.fix or refused else None
    own = own or chosen.map
    word = "inspect" if refused else "identify"
    words = ["nsaid", word, *map(str, chosen.logs), "--model", chosen.model]
    words += ["--map", str(own)] if own else []
    words += ["--lock", chosen.lock] if chosen.lock else []
    words += ["--joints", chosen.joints] if chosen.joints else []
    first = f"complete {own}, then " if refused and own else ""
    return ["", f"Next: {first}{shlex.join(words)}"]


def _inspected(chosen: ToInspect) -> tuple[Inspection, Fix | None]:
    """The inspection of the logs, and the remedies tried on their map, if asked for."""
    from ..identify.fixing import fix
    from ..identify.identify import files_of
    from ..identify.inspection import inspect
    from ..logs.mapping import read_map
    from ..logs.tables import read_tables

    logs = list(chosen.logs)
    mapping = read_map(chosen.map) if chosen.map else None
    model = chosen.model
    name = str(logs[0])
    if len(logs) == 1 and not logs[0].exists() and asset(name, "log.csv.gz").is_file():
        model = model or name
        logs, mapping = files_of(name, [], mapping)
    robot = None
    if model is not None:
        from ..identify.models import load_robot_model

        robot = load_robot_model(model, names_in(chosen.lock), names_in(chosen.joints) or None)
    if not chosen.fix:
        return inspect(read_tables(logs, mapping), mapping, robot), None
    if robot is None:
        raise InvalidInput("--fix", "a model to judge the log by", "none", "Give --model.")
    own = chosen.map or asset(name, "map.toml")
    text = own.read_text("utf-8") if mapping is not None and own.is_file() else ""
    fixed = fix(logs, text, robot)
    return fixed.after, fixed


def _written(page: Page, folder: Path) -> Path:
    """Writes the page of an inspection, under a new name beside one that is not ours."""
    names = chain((INSPECTION,), map("inspection-{}.html".format, count(2)))
    paths = (folder / name for name in names)
    own = next(path for path in paths if not path.exists() or OutputFile(path).is_ours)
    return page.write_html(folder, own.name)


def _maps(chosen: ToInspect, found: Inspection, fixed: Fix | None) -> list[Path]:
    """Writes a map: the mended one, or a first one if columns lack in it."""
    from ..logs.first_map import first_map

    files = []
    if fixed is not None and fixed.kept:
        names = chain((FIXED,), map("map-fixed-{}.toml".format, count(2)))
        files.append(_write_map(chosen.out, names, fixed.text))
    elif found.robot is not None and _without_columns(chosen.map) and not _packed(chosen.logs):
        names = chain((MAP, "map-new.toml"), map("map-new-{}.toml".format, count(2)))
        times = chosen.map.read_text("utf-8") if chosen.map else ""
        files.append(_write_map(chosen.out, names, first_map(found.tables, found.robot, times)))
    return files


def _without_columns(mapping: Path | None) -> bool:
    """Whether there is no map, or one that states nothing but the times of the files."""
    from ..logs.mapping import Map, read_map

    if mapping is None:
        return True
    own = read_map(mapping)
    return own == Map(time=own.time, files=own.files)


def _packed(logs: tuple[Path, ...]) -> bool:
    """Whether a packed robot's log was named, which has a map."""
    return len(logs) == 1 and not logs[0].exists() and asset(str(logs[0]), "map.toml").is_file()


def _write_map(folder: Path, names: Iterable[str], text: str) -> Path:
    """Writes a map under the first name that is free, or has this text already."""
    from ...base import NotWritten, OutputFile

    content = text.encode("utf-8", "replace")
    paths = (folder / name for name in names)
    path = next(p for p in paths if not p.exists() or _holds(p, content))
    if not path.exists():
        with NotWritten.on_failure(path):
            OutputFile(path).create()
            path.write_bytes(content)
    return path


def _holds(path: Path, text: bytes) -> bool:
    """Whether a file has just this content."""
    from ...base import OutputFile

    try:
        return OutputFile(path).read() == text
    except OSError:
        return False


def document(found: Inspection) -> dict[str, object]:
    """Figures and findings as plain data."""
    return {name: [asdict(x) for x in getattr(found, name)] for name in ("channels", "findings")}
