"""`nsaid identify` with logs of targets and positions: servos by output error."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidInput
from ..resources import write_json
from .grammar import Identify

if TYPE_CHECKING:
    from ..calibration.findings import Finding
    from ..calibration.servos import ServoIdentification, ServoLog, ServoLogs
    from ..parameters import Array
    from ..reporting.progress import Progress

_NO_TORQUE = (
    "The other laws identify a motion from forces; a servo's log has none, and its velocity is too "
    "coarse between two rows. "
)


def servos_of(model: str, logs: tuple[Path, ...], chosen: Identify) -> ServoLogs | None:
    """The arm and its logs if they are of targets and positions, else None."""
    from ..calibration.payloads import load_of
    from ..calibration.servos import servo_logs

    lock, joints = (
        [name.strip() for name in text.split(",") if name.strip()]
        for text in (chosen.lock, chosen.joints)
    )
    loads = [load_of(text) for text in chosen.load] if logs == chosen.log else []
    return servo_logs(model, logs, chosen.map, lock, joints or None, loads)


def identify_given(
    model: str, given: ServoLogs, chosen: Identify, path: Path, progress: Progress
) -> tuple[ServoIdentification, list[Path]]:
    """Identifies servos and writes the results.

    Args:
        model: as named on the command line.
        given: the arm and its logs.
        chosen: the command's options.
        path: of the JSON file to write; the MJCF is written beside it.
        progress: told the name of every stage.

    Raises:
        InvalidInput: an option has no meaning for logs of targets.
    """
    from ..calibration.servos import identify_servos, write_servo_mjcf

    plain = Identify()
    for name in ("known", "columns", "delay", "cutoff", "law"):
        if getattr(chosen, name) != getattr(plain, name):
            expected = "no such option with logs of targets and positions"
            why = _NO_TORQUE if name == "law" else ""
            raise InvalidInput(f"--{name}", expected, getattr(chosen, name), f"{why}Leave it out.")
    own = replace(chosen, map=chosen.validate_map or chosen.map)
    others = servos_of(model, chosen.validate, own) if chosen.validate else None
    result = identify_servos(given, progress.say)
    progress.say("writing and trying the calibrated model")
    path.parent.mkdir(parents=True, exist_ok=True)
    model_file = path.with_name(f"{result.robot.name}.xml")
    write_servo_mjcf(result, model_file)
    told, replay = _followed(others or given, result, model_file)
    result = replace(result, findings=(*result.findings, told))
    write_json(path, result.summary())
    from ..reporting.identification.servos import write_servos

    again = ["nsaid", "identify", *(["--model"] if chosen.log else []), model]
    again += ["--log", *map(str, chosen.log)] if chosen.log else []
    return result, [path, model_file, write_servos(result, path.parent, shlex.join(again), replay)]


def _followed(
    given: ServoLogs, result: ServoIdentification, path: Path
) -> tuple[Finding, tuple[ServoLog, Array]]:
    """How far MuJoCo departs from logs with the exported file, and with the user's own.

    Returns:
        The same in words; and the first log, with its positions (N, n) by the exported file.
    """
    from ..calibration.findings import Finding
    from ..calibration.servos import rollout

    source, joints = result.robot.source, result.robot.joints
    logs = [log for log in given.logs if not log.loaded]  # of the model file's own links
    assert source is not None  # a model with servos comes from a file
    delays = [servo.delay for servo in result.servos]
    simulated = [rollout(path, joints, log, delays) for log in logs]
    nominal = [rollout(source, joints, log, 0.0) for log in logs]
    own, before = (
        np.mean([np.abs(q - log.position).mean(axis=0) for q, log in pairs], axis=0) * 1e3
        for pairs in (zip(simulated, logs, strict=True), zip(nominal, logs, strict=True))
    )
    what = ", ".join(dict.fromkeys(log.source for log in logs))
    text = (
        f"MuJoCo, driven by the targets alone, departs from {what} by {own.mean():.1f} mrad in the "
        f"mean with the exported file and the delays, and by {before.mean():.1f} mrad with yours"
    )
    data: dict[str, object] = {"exported": own.tolist(), "nominal": before.tolist()}
    level = "note" if own.mean() < before.mean() else "warning"
    return Finding(level, "replay", "", text, "", data), (logs[0], simulated[0])
