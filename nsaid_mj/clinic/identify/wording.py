"""Numbers and names of an identification in words, for page, terminal and recording."""

import math

from ...core import ABSENT, number
from ...report import Mark, Status, estimate, percent
from .result import AlongLog, Identification, JointStructure

UNKNOWN = math.log(30.0)
"""Half of a gain's interval that says nothing, of its logarithm."""


def nrmse(value: float | None) -> str:
    """An NRMSE in percent; – if there is none."""
    return percent(None if value is None or not math.isfinite(value) else value)


def quality(held_out: float, alone: float = math.nan) -> Mark:
    """A joint's held-out NRMSE with its mark; a weak one without a glyph if it was not judged.

    It is not where the error is small only beside commands of other parts of the log; `alone` is
    that beside the commands of its own rows.
    """
    if not math.isfinite(held_out) or held_out < 0.2 <= alone:
        return Mark("", "weak", nrmse(held_out if math.isfinite(held_out) else None))
    mark = Mark.of("yes" if held_out < 0.2 else "partly" if held_out < 0.5 else "no")
    return mark._replace(text=nrmse(held_out))


def law_gains(along: AlongLog) -> list[list[str]]:
    """Gains of a law over their mean, beside the batch fit's, with intervals, and agreement."""
    lines = []
    for gain in along.gains:
        line = [gain.label.removeprefix("gain of ")]
        for value, half in ((gain.law, gain.half), (gain.batch, gain.batch_half)):
            factor = math.exp(min(half, UNKNOWN))
            own = estimate(value, value / factor, value * factor)
            line += own if half < UNKNOWN else (number(value), ABSENT)
        lines.append([*line, "no" if gain.apart else "yes" if gain.half < UNKNOWN else ABSENT])
    return lines


def quantity(result: Identification, joint: int) -> tuple[str, str]:
    """Symbol and unit of a joint's curves: its command, or forces if not each has an actuator."""
    names = [j.name for j in result.joints]
    system = result.robot.system
    if not result.robot.held and not set(names) <= set(result.robot.joints):
        units = system.velocity_units
        angular = len(units) == len(names) and units[joint].startswith("rad")
        return ("torque", "N·m") if angular else ("force", "N")
    if result.robot.held and len(result.gains) < len(names):
        hinge = not system.slides[joint]
        return ("torque", "N·m") if hinge else ("force", "N")
    units = result.recordings.command_units
    return "u", units[joint] if len(units) == len(names) else ""


def rows_of(result: Identification) -> tuple[str, str]:
    """The names of a row of the fit, singular and plural: joint, or a vehicle's velocity."""
    return ("joint", "joints") if result.robot.held else ("velocity", "velocities")


def title_of(fit: JointStructure, validation: bool = False) -> str:
    """Title of a joint's figure: its name and the NRMSE that matters."""
    if validation:
        return f"{fit.name}: NRMSE {nrmse(fit.validation)} on the validation log"
    words = f"{fit.name}: NRMSE {nrmse(fit.held_out)} held out"
    return words + (f", {nrmse(fit.validation)} validation" if fit.validation is not None else "")


def logs_in_words(result: Identification) -> str:
    """Duration, segments, files and rate of the training logs."""
    segments = result.recordings.segments
    duration = sum(float(s.log.t[-1] - s.log.t[0]) for s in segments)
    files = list(dict.fromkeys(s.source for s in segments))
    named = files[0] if len(files) == 1 else f"{len(files)} files"
    parts = "one segment" if len(segments) == 1 else f"{len(segments)} segments"
    return f"{duration:.4g} s of log in {parts} of {named} at {result.recordings.rate:.4g} Hz"


def unknown_in_words(result: Identification) -> list[tuple[Status, str]]:
    """(status, names by part) of the parameters that the log does not determine."""
    found: list[tuple[Status, str]] = []
    for status in ("not excited", "below the noise"):
        parts: dict[str, list[str]] = {}
        for parameter in result.parameters:
            if parameter.status == status:
                what, _, part = parameter.label.partition(" of ")
                parts.setdefault(part, []).append(what)
        if parts:
            names = (
                f"{part}: {', '.join(w)}" if part else ", ".join(w) for part, w in parts.items()
            )
            found.append((status, "; ".join(names)))
    return found
