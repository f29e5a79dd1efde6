"""The verdict of an identification: whether the structure explains the log, and what to do next.

The least favourable of five judgements counts: how well held-out parts and a validation log are
predicted, what the residuals correlate with, what the user told, whether the feet are where the
model file says, and what the overall scale rests on. The sentence gives the figures and one remedy,
that of the gravest; findings have all others.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...base import Finding
from ...core import Array
from ...report import Explains
from .identifiability import Scale
from .result import JointStructure

CONTRADICTED = "contradicted"
"""Code of findings that a log contradicts what the user told."""
FOOT_ELSEWHERE = "offset_foot"
"""Code of findings that a foot touches the ground elsewhere than the model file says."""
UNPHYSICAL = "unphysical"
"""Code of findings that no possible masses and frictions explain a joint's motion."""
_CONFIRM = "Confirm it on a log of another motion: --validate."
GOOD = 0.2
"""Held-out NRMSE up to which a structure explains a motion."""
_ROUGH = 0.1  # error above which it is compared with that of least squares without bounds
_UNBOUNDED = 3.0  # their ratio from which no possible masses and frictions explain the motion
_FAIR = 0.5  # above which it does not
_NOISE = 1.5  # error over that of the command's own noise, which no structure can predict
_OF_MOTOR = 0.3  # error over a motor's largest force, above which it explains nothing of use


def only_unbounded(joint: JointStructure) -> bool:
    """Whether least squares without physical bounds predict a joint far better than the fit."""
    return joint.held_out > _ROUGH and joint.held_out > _UNBOUNDED * joint.least_squares


class JudgedPart(NamedTuple):
    """The error of the prediction of one joint or velocity, and what it is compared with."""

    name: str
    error: float  # of motion that took no part in the fit
    good: float  # in the same unit, up to which the structure explains the motion
    fair: float  # above which it does not


def graded(parts: Sequence[JudgedPart]) -> tuple[Explains, list[JudgedPart], list[JudgedPart]]:
    """Whether a structure explains a motion, and the parts that it does not, or only roughly.

    It does not if it fails for more than half of the parts. An error that is not finite is poor.
    """
    poor = [part for part in parts if not part.error <= part.fair]
    rough = [part for part in parts if part not in poor and part.error > part.good]
    if len(poor) > len(parts) / 2 or not parts:
        return "no", poor, rough
    return ("partly" if poor or rough else "yes"), poor, rough


def with_next(sentence: str, remedy: str) -> str:
    """A verdict with the one thing to do next, if there is any."""
    return f"{sentence} Next: {_lower(remedy)}" if remedy else sentence


def verdict(
    joints: Sequence[JointStructure],
    findings: Sequence[Finding] = (),
    scale: Scale | None = None,
    arm: bool = True,
) -> tuple[Explains, str]:
    """Whether the structure explains the log, and the verdict: one sentence, and one remedy.

    What the user told and the log contradicts stands in place of the figures. With `arm` the parts
    are joints; a vehicle has velocities.
    """
    explains, sentence = _of_predictions(joints, arm)
    told = [f for f in findings if f.code == CONTRADICTED]
    doubts = [f for f in findings if f.code == "residuals" and f.level == "warning"]
    elsewhere = [f for f in findings if f.code == FOOT_ELSEWHERE]
    foreign = [f for f in findings if f.code == UNPHYSICAL]
    unfixed = scale is not None and not scale.fixed
    clauses = [_capital(told[0]) if told else sentence.removesuffix(".")]
    if doubts and not told and explains != "no":
        worst = max(doubts, key=lambda f: float(str(f.data.get("share", 0.0))))
        more = f" (and {len(doubts) - 1} more)" if len(doubts) > 1 else ""
        clauses.append(f"{worst.where or 'all joints'}: {worst.text.partition(' (')[0]}{more}")
    if elsewhere and not told and explains != "no":
        names = ", ".join(dict.fromkeys(f.where for f in elsewhere))
        clauses.append(f"the ground is touched elsewhere than the model file says, by {names}")
    if foreign and not told and explains != "no":
        clauses.append(f"{foreign[0].where}: {foreign[0].text.partition(', ')[0]}")
    if unfixed and not told and explains != "no":
        assert scale is not None
        each = f" within each of the {scale.limbs} limbs" if scale.limbs > 1 else ""
        clauses.append(f"ratios of parameters hold{each}, {scale.bounds}")
    sentence = f"{'; '.join(clauses)}."
    if told or doubts or elsewhere or foreign or unfixed:
        explains = "no" if explains == "no" else "partly"
    remedy = next(_remedies(told, [*doubts, *elsewhere], findings, scale), "")
    if explains == "yes" and all(joint.validation is None for joint in joints):
        remedy = _CONFIRM
    return explains, with_next(sentence, remedy)


def _remedies(
    told: Sequence[Finding],
    doubts: Sequence[Finding],
    findings: Sequence[Finding],
    scale: Scale | None,
) -> Iterator[str]:
    """What to do, the most urgent first."""
    unexplained = [f for f in findings if f.code in (UNPHYSICAL, "unexplained")]
    by_share = sorted(doubts, key=lambda f: -float(str(f.data.get("share", 0.0))))
    own = {f.where for f in unexplained}
    causes = [f for f in by_share if f.where in own]
    yield from (f.remedy for f in (*told, *causes, *unexplained, *by_share) if f.remedy)
    if scale is not None and not scale.fixed:
        yield scale.remedy


def _capital(finding: Finding) -> str:
    text = f"{finding.where}: {finding.text}" if finding.where else finding.text
    return text[0].upper() + text[1:]


def _lower(remedy: str) -> str:
    return remedy[0].lower() + remedy[1:]


def _of_predictions(joints: Sequence[JointStructure], arm: bool) -> tuple[Explains, str]:
    """Whether held-out parts and the validation log are predicted, with the figures."""
    of = "joints" if arm else "velocities"
    joints = [j for j in joints if np.isfinite(j.held_out)]
    # errors small only beside commands of other parts of the log show nothing
    joints = [j for j in joints if not j.held_out < GOOD <= j.alone] or joints
    if not joints:
        return "no", "No part of the log could be predicted from the others: it is too short."
    held_out = np.array([j.held_out for j in joints])
    parts = [_judged(joint) for joint in joints]
    explains, poor, rough = graded(parts)
    values = np.array([part.error for part in parts])
    worst = joints[int(np.argmax(values))]
    figures = (
        f"held-out error {_range(held_out)} of each command's standard deviation "
        f"(predicting its mean: 100 %){_in_forces(worst)}"
    )
    checked = [j.validation for j in joints if j.validation is not None]
    if np.isfinite(checked).any():
        figures += f"; on the validation log {_range(np.array(checked))}"
    noisy = [
        j.name
        for j, x in zip(joints, values, strict=True)
        if GOOD < x <= min(_NOISE * j.noise, _FAIR)
    ]
    if noisy:
        figures += f"; of {', '.join(noisy)} that is the noise of the command itself"
    if poor:
        names = ", ".join(part.name for part in poor)
        if len(poor) == len(parts) > 1:
            names = f"any of the {len(parts)} {of}"
        return explains, (
            f"The structure does not explain the motion of {names}: {figures}. "
            f"Do not trust parameters of these {of}."
        )
    if not rough:
        return explains, f"The structure explains the log: {figures}."
    n = len(joints)
    return explains, (
        f"The structure explains {n - len(rough)} of {n} {of} well and the others roughly, "
        f"worst {worst.name}: {figures}."
    )


def _judged(joint: JointStructure) -> JudgedPart:
    """A joint's NRMSE beside what can be expected of its sensors, and asked for its motor."""
    checked = np.nan if joint.validation is None else joint.validation
    error = float(np.fmax(joint.held_out, checked))
    motor = _OF_MOTOR * joint.limit / joint.force if joint.force > 0 else np.inf
    good = min(max(GOOD, _NOISE * joint.noise), motor, _FAIR)
    good = _ROUGH if only_unbounded(joint) else good
    return JudgedPart(joint.name, error, good, _FAIR)


def _in_forces(worst: JointStructure) -> str:
    """The largest error in the unit of a force."""
    if not worst.force > 0:
        return ""
    return f", largest at {worst.name}: {worst.held_out * worst.force:.2g} {worst.unit}"


def _range(nrmse: Array) -> str:
    """The least and the largest error, in percent."""
    each = [100 * float(end) for end in (np.nanmin(nrmse), np.nanmax(nrmse))]
    ends = dict.fromkeys(f"{x:.2g}" if x < 99.5 else f"{x:.0f}" for x in each)
    return f"{' to '.join(ends)} %"
