"""`nsaid identify`: reads files and writes results; the work is in `calibration`."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..bounds import without_nonfinite
from ..errors import BadRun, InvalidInput
from ..resources import check_own, locked, print_json, reading, write_json
from .exit_codes import code_of
from .folders import FORCE, RUNS, check_writable
from .grammar import Identify

if TYPE_CHECKING:
    from ..calibration.findings import UnusableLog
    from ..calibration.result import Identification

RESULT = "identification.json"


def identify_log(chosen: Identify) -> int:
    """Executes the command and returns the exit code."""
    model = chosen.model or chosen.packed
    if model is None:
        raise InvalidInput("--model", "a model file or name", "none", "Such as --model arm.urdf.")
    folder = _folder(Path(model).stem, chosen.out, chosen.force)
    check_writable(folder)
    from ..calibration.logs import limited_to

    with (
        reading(model, *chosen.log, *chosen.validate, chosen.map, chosen.validate_map),
        locked(folder),
        limited_to(chosen.limit * 1e9),
    ):
        return _identify(model, chosen, folder)


def _identify(model: str, chosen: Identify, folder: Path) -> int:
    from ..reporting.progress import Progress
    from .servos import identify_given, servos_of

    with Progress(Path(model).stem, quiet=chosen.quiet or chosen.json) as progress:
        progress.say("reading the model and the log")
        given = servos_of(model, chosen.log, chosen)
        if given is not None:
            result, files = identify_given(model, given, chosen, folder / RESULT, progress)
    if given is None:
        return _identify_by_force(model, chosen, folder)
    if chosen.json:
        print_json(result.summary())
    elif not chosen.quiet:
        from rich.console import Console

        from ..reporting.identification.servos import print_servos

        print_servos(result, Console(), files)
    return code_of(result.mark)


def _identify_by_force(model: str, chosen: Identify, folder: Path) -> int:
    from ..calibration.findings import UnusableLog
    from ..calibration.identify import identify
    from ..reporting.progress import Progress

    with Progress(Path(model).stem, quiet=chosen.quiet or chosen.json) as progress:
        try:
            result = identify(
                model,
                chosen.log,
                validate=chosen.validate,
                mapping=chosen.map,
                validate_mapping=chosen.validate_map,
                known=dict(_known(text) for text in chosen.known),
                loads=chosen.load,
                lock=_names(chosen.lock),
                joints=_names(chosen.joints) or None,
                columns=None if chosen.columns == "auto" else _names(chosen.columns),
                delay=None if chosen.delay == "auto" else _numbers("--delay", chosen.delay),
                cutoff=chosen.cutoff,
                law=chosen.law,
                folder=folder / chosen.law,
                told=progress.say,
            )
        except UnusableLog as error:
            if not (chosen.quiet or chosen.json):
                _print_notes(error)
            raise
        result, files = write(result, folder, progress.say)
    if chosen.json:
        print_json(result.summary())
    elif not chosen.quiet:
        from rich.console import Console

        from ..reporting.identification import brief
        from ..reporting.terminal import print_page

        print_page(brief(result, files), Console())
    ended = result.law is not None and not result.law.completed
    return max(code_of(result.mark), int(ended))


def write(
    result: Identification, folder: Path, told: Callable[[str], None]
) -> tuple[Identification, list[Path]]:
    """Writes results, report, recording and calibrated models into a folder.

    Returns:
        The result with findings about the exported model, and the files.
    """
    from ..calibration.export import write_models

    folder.mkdir(parents=True, exist_ok=True)
    told("writing and trying the calibrated models")
    files, followed = write_models(result, folder)
    result = replace(result, findings=(*result.findings, *followed))
    write_json(folder / RESULT, without_nonfinite(result.summary()))
    told("writing the report")
    from ..reporting import pages
    from ..reporting.identification import page

    files.append(pages.write(page(result), folder))
    from .. import recording

    if recording.available():
        told("writing the recording")
        files.append(folder / "identification.rrd")
        recording.record(result, files[-1])
    if result.law is not None:
        from ..recording.postprocessing import finish

        finish(result.law.run, told)
        files.append(result.law.run.folder / "report.html")
    return result, [folder / RESULT, *files]


def _print_notes(error: UnusableLog) -> None:
    """Prints warnings and notes; the error itself tells the refusals."""
    from rich.console import Console

    from ..reporting.terminal import print_findings

    notes = [finding for finding in error.findings if finding.level != "refusal"]
    print_findings(notes, Console(stderr=True))


def _folder(name: str, out: Path | None, force: bool) -> Path:
    """The folder of the results: `out`, or runs/NAME-identify, numbered if it holds results."""
    if out is not None:
        if not force:
            check_own(out, (RESULT,), FORCE)
        if not force and (out.resolve() / RESULT).is_file():
            raise BadRun(
                out, "it holds results", "Give --force to overwrite them, or another --out"
            )
        return out
    first = RUNS / f"{name}-identify"
    if force:
        return first
    numbered = (RUNS / f"{name}-identify-{number}" for number in itertools.count(2))
    return next(f for f in itertools.chain([first], numbered) if not (f / RESULT).is_file())


def _known(text: str) -> tuple[str, float]:
    name, equals, value = text.rpartition("=")
    try:
        if not equals:
            raise ValueError
        return name.strip(), float(value)
    except ValueError as error:
        raise InvalidInput("--known", "NAME=VALUE", text, "Such as gain_1=0.11.") from error


def _names(text: str) -> Sequence[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _numbers(flag: str, text: str) -> Sequence[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise InvalidInput(flag, "comma-separated numbers", text, "Such as 0.01.") from error
