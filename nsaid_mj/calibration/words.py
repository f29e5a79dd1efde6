"""Numbers, statuses and names of an identification in words, for page, terminal and recording."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

from ..evaluation.words import ABSENT, STATUSES, Mark, estimate, number
from .law_result import AlongLog
from .result import Identification, JointFit, Parameter

EXPLAINS = {
    "yes": Mark("✔", "good"),
    "partly": Mark("◐", "fair"),
    "no": Mark("✘", "poor"),
}
LEVELS = {
    "refusal": Mark("✘", "poor"),
    "warning": Mark("▲", "fair"),
    "note": Mark("·", "weak"),
}


def nrmse(value: float | None) -> str:
    """An NRMSE with three decimals; – if there is none."""
    return ABSENT if value is None or not math.isfinite(value) else f"{value:.3f}"


def delay(seconds: float) -> str:
    """A delay in milliseconds, with one decimal."""
    return f"{number(1e3 * seconds, 0.1)} ms"


def quality(held_out: float) -> Mark:
    """Mark of a joint by its held-out NRMSE."""
    return EXPLAINS["yes" if held_out < 0.2 else "partly" if held_out < 0.5 else "no"]


def relative(parameter: Parameter) -> str:
    """The half-width of a gain's interval relative to the other gains, such as "±1.2 %"."""
    if parameter.relative is None:
        return ABSENT
    return f"±{number(float(f'{100 * parameter.relative:.2g}'))} %"


def law_gains(along: AlongLog) -> list[list[str]]:
    """Gains of a law over their mean, beside the batch fit's, with intervals, and agreement."""
    lines = []
    for gain in along.gains:
        line = [gain.label]
        for value, half in ((gain.law, gain.half), (gain.batch, gain.batch_half)):
            known = math.isfinite(half)
            factor = math.exp(min(half, 20.0))
            own = (
                estimate(value, value / factor, value * factor)
                if known
                else (number(value), ABSENT)
            )
            line += own
        lines.append([*line, "no" if gain.apart else "yes" if math.isfinite(gain.half) else ABSENT])
    return lines


def is_gain(parameter: Parameter) -> bool:
    """Whether a parameter is the gain of an actuator."""
    return "gain" in parameter.block


def links(parameters: Iterable[Parameter]) -> set[str]:
    """Names of the blocks that hold inertial parameters of a body."""
    return {p.block for p in parameters if p.unit == "kg" and p.label.startswith("mass")}


def of_joint(parameter: Parameter) -> str:
    """The part that a parameter belongs to: "elbow" of "gain of elbow"."""
    return parameter.label.partition(" of ")[2] or parameter.label


def counts(parameters: Iterable[Parameter]) -> list[tuple[str, int]]:
    """Number of parameters of each status that occurs, best first."""
    found = Counter(p.status for p in parameters)
    return [(status, found[status]) for status in STATUSES if found[status]]


def quantity(result: Identification, joint: int) -> tuple[str, str]:
    """Symbol and unit of a joint's curves: its command, or the force on a vehicle's velocity."""
    names, system = [j.name for j in result.joints], result.robot.system
    if system is not None and not set(names) <= set(result.robot.joints):
        units = system.velocity_units
        angular = len(units) == len(names) and units[joint].startswith("rad")
        return ("torque", "N·m") if angular else ("force", "N")
    units = result.recordings.command_units
    return "u", units[joint] if len(units) == len(names) else ""


def rows_of(result: Identification) -> tuple[str, str]:
    """What rows of the fit belong to, singular and plural: joints, or a vehicle's velocities."""
    return ("joint", "joints") if result.robot.system is None else ("velocity", "velocities")


def title_of(fit: JointFit, validation: bool = False) -> str:
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


def unknown_in_words(result: Identification) -> list[tuple[str, str]]:
    """(status, names by part) of what the log does not tell."""
    found = []
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
