"""The identified servos of an arm, and parameters, verdict and findings in words."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...base import Finding
from ...core import Array
from ...report import Explains, Parameter, Result, Status
from ...robots import RobotModel
from ..identify.identifiability import NOTHING
from ..identify.loads import Load
from ..identify.verdict import JudgedPart, graded, with_next
from .estimate import JointEstimate, MassScale
from .fit import ARMATURE, DAMPING, GRAVITY
from .logs import TRAVEL, ServoLog


@dataclass(frozen=True)
class Servo:
    """A joint's servo in MuJoCo's terms: force = kp (u(t − delay) − q) − kv q̇, and friction."""

    name: str  # name of the joint
    kp: float  # stiffness [N·m/rad or N/m]
    kv: float  # damping of servo and joint together [N·m·s/rad or N·s/m]
    armature: float  # reflected rotor inertia [kg·m² or kg]
    friction: float  # Coulomb friction [N·m or N]
    delay: float  # delay of the target [s]
    # whether gravity determines kp; otherwise kp is a convention, and so is the scale of all others
    # except the delay
    gravity: bool
    error: float  # mean absolute error of the open-loop simulation [rad or m]
    # the same without a model: the target at the best delay, or a constant position, whichever is
    # closer
    simple: float
    # largest force, where the servo saturated in the logs [N·m or N]; None elsewhere
    limit: float | None = None


class LeftOut(NamedTuple):
    """A part of a log, and the servos as identified without it, by one step from the fit."""

    log: int  # number of the log
    rows: slice  # the part
    servos: tuple[Servo, ...]


@dataclass(frozen=True, kw_only=True)
class ServoIdentification(Result):
    """Result of `identify_servos`; parameters are T, f/kp, kp, armature/kp, delay, armature."""

    robot: RobotModel
    servos: tuple[Servo, ...]  # servos of every joint, in the order of `robot.joints`
    # the true masses over those of the model file, if a load was weighed; kp, kv, armature and
    # friction are those under the true masses
    scale: tuple[Parameter, ...]
    # (N,) 1 of samples in use, 0 of those excluded because of external forces, of the logs in their
    # order
    used: Array
    seconds: float  # duration of the identification [s]
    joints: tuple[JointEstimate, ...] = ()  # the estimates, for the verdict on further motion
    left_out: tuple[LeftOut, ...] = ()  # the logs in parts; empty if one carries a load

    @property
    def masked(self) -> float:
        """Share of excluded samples."""
        return float(1 - self.used.mean())

    def summary(self) -> dict[str, Any]:
        """Everything, for JSON."""
        return {
            "robot": self.robot.name,
            "law": "output error",
            "explains": self.explains,
            "verdict": self.verdict,
            "servos": [asdict(servo) for servo in self.servos],
            "parameters": [parameter.document() for parameter in (*self.parameters, *self.scale)],
            "masked": self.masked,
            "findings": [asdict(finding) for finding in self.findings],
            "seconds": self.seconds,
        }


class Replayed(NamedTuple):
    """Logs, and simulations of the exported file driven by their targets alone."""

    logs: tuple[ServoLog, ...]  # without loads
    simulated: tuple[Array, ...]  # (N, n) simulated positions of every log [rad or m]
    used: Array  # (N,) 1 of samples in use, 0 of those that the fit left out, of all logs in a row


_FIRM = 0.5  # half-width of the interval of ln θ up to which a number counts as identified
_LABELS = (
    ("T", "damping over kp", ("s", "s")),
    ("f", "friction over kp", ("rad", "m")),
    ("kp", "stiffness kp", ("N·m/rad", "N/m")),
    ("a", "armature over kp", ("s²", "s²")),
    ("d", "delay of the target", ("s", "s")),
    ("armature", "armature", ("kg·m²", "kg")),
)  # units of hinges and slides
_NOTHING = 5e-3  # least error of a simple prediction in the test for divergence [rad or m]
_HEAVIER = "Use a heavier load, or more motions with the arm stretched out."
_UNEXPLAINED = "the model does not explain this joint's motion"
_UNMOVED = "the joint hardly moves"
UNTOLD = "gravity does not determine kp"
"""First words about a number whose scale is that of a kp which the motion does not show."""


def parameters(k: int, joint: JointEstimate, scale: MassScale | None) -> tuple[Parameter, ...]:
    """Six parameters of a joint, numbered k, with 95 % intervals, under the true masses."""
    found = []
    C = joint.covariance
    ln_kp = (0.0 if scale is None else scale.log) - joint.x[GRAVITY]
    rotor = C[ARMATURE, ARMATURE] + C[GRAVITY, GRAVITY] - 2 * C[ARMATURE, GRAVITY]
    values = np.r_[joint.x, joint.x[ARMATURE] + ln_kp]
    deviations = np.sqrt(np.r_[np.diag(C), max(rotor, 0.0)])
    values[GRAVITY] = ln_kp
    halves = np.minimum(joint.quantile * deviations, NOTHING)
    halves[-1] = min(joint.quantile[[GRAVITY, ARMATURE]].max() * deviations[-1], NOTHING)
    doubt = _UNEXPLAINED if joint.poor else _UNMOVED if joint.travel <= TRAVEL else ""
    if not joint.gravity:
        halves[[GRAVITY, -1]] = NOTHING
    if doubt:
        halves[:] = NOTHING
    lag, apart = lag_of(joint)
    longest = lag + apart
    rotor_half = float(halves[ARMATURE])
    # the lag of the rotor below a linear lower end, which a longer delay and less damping replace
    lost = max(1 - rotor_half, 0.0) - _least_rotor(rotor_half)
    traded = float(joint.theta[ARMATURE] / joint.theta[DAMPING]) * lost
    for (short, label, units), x, half in zip(_LABELS, values, halves.tolist(), strict=True):
        status: Status = "identified" if half < _FIRM else "only in combination"
        combination = "" if half < _FIRM or short in {"f", "kp"} else _lag(joint)
        if short in {"kp", "armature"} and not joint.gravity:
            combination = _ratios(joint)
        combination = doubt or combination
        value, low, high = (float(v) for v in np.exp([x, x - half, x + half]))
        if short != "kp":
            low = value * max(1 - half, 0.0)  # the motion is linear in all but kp
        if short in {"a", "armature"}:
            low = value * _least_rotor(half)
        if half >= NOTHING:
            low = 0.0
            high = np.inf
        if short == "T":
            low = max(low - traded, 0.0)
        if short == "d":
            high += traded
        if short in {"T", "d"} and not doubt:
            high = min(high, longest)  # neither of the two is negative
        about = f"{short}_{k}", f"{label} of {joint.name}", "servo", units[joint.slides]
        found.append(Parameter(*about, value, low, high, np.nan, status, combination))
    return tuple(found)


def _least_rotor(half: float) -> float:
    """Lower end of an armature's interval over its value, by the half-width of its logarithm.

    The rotor of an overdamped servo is a lag a/T. A delay of that length, at the same T + d,
    differs from it by the square of the lag alone, so the lower end is linear in that square.
    """
    return float(np.sqrt(max(1 - 2 * half, 0.0)))


def lag_of(joint: JointEstimate) -> tuple[float, float]:
    """T + d of damping and delay [s], which slow motion determines, and its half-width [s]."""
    slope = np.array([joint.theta[0], 0.0, 0.0, 0.0, joint.theta[4]])
    half = joint.quantile[-1] * np.sqrt(slope @ joint.covariance @ slope)
    return float(slope.sum()), float(half)


def _lag(joint: JointEstimate) -> str:
    """The combination of damping, armature and delay that a slow motion determines."""
    lag, half = lag_of(joint)
    return (
        "a slow motion determines only the lag of damping, armature and delay, kv/kp + delay: "
        f"{lag * 1e3:.0f} ms ± {half * 1e3:.0f}"
    )


def _ratios(joint: JointEstimate) -> str:
    """What holds of a joint whose kp gravity does not determine."""
    T, f, _, a, _ = (float(value) for value in joint.theta)
    return (
        f"{UNTOLD}, but kv/kp = {1e3 * T:.3g} ms, f/kp = {1e3 * f:.3g} "
        f"{joint.unit} and armature/kp = {a:.2g} s² do not depend on it"
    )


def servo(joint: JointEstimate, scale: MassScale | None) -> Servo:
    """The joint's servo in MuJoCo's terms, under the true masses."""
    T, f, g, a, d = (float(value) for value in joint.theta)
    g /= 1.0 if scale is None else float(np.exp(scale.log))
    limit = joint.limit if np.isfinite(joint.limit) else None
    numbers = 1 / g, T / g, a / g, f / g, d
    return Servo(joint.name, *numbers, joint.gravity, joint.error, joint.simple, limit)


def masses(scale: MassScale | None) -> tuple[Parameter, ...]:
    """The true masses over those of the model file, if a load was weighed."""
    if scale is None:
        return ()
    half = min(scale.quantile * scale.deviation, NOTHING)
    value, low, high = (float(np.exp(scale.log + x)) for x in (0.0, -half, half))
    status: Status = "identified" if half < _FIRM else "only in combination"
    words = "" if half < _FIRM else "the load has no clear effect; only ratios of kp and masses"
    label = "masses over those of the model file"
    return (Parameter("mass_scale", label, "scale", "1", value, low, high, 1.0, status, words),)


def weighed(load: Load, joint: str, scale: MassScale) -> Finding:
    """Reports the common scale by a load, and the load's place."""
    (one,) = masses(scale)
    place = ", ".join(
        f"{1e3 * x:.0f} ± {1e3 * scale.quantile * d:.0f}"
        for x, d in zip(scale.place, scale.deviations, strict=True)
    )
    text = (
        f"by the load of {load.mass:g} kg, all masses, kp, kv, armatures and frictions are "
        f"{one.value:.3g} (95 %: {one.low:.3g} to {one.high:.3g}) times those under the model "
        f"file's masses; its centre is at ({place}) mm in the frame of joint {joint}"
    )
    level, remedy = ("note", "") if one.status == "identified" else ("warning", _HEAVIER)
    return Finding(level, "weighed", "", text, remedy, {"place": scale.place.tolist()})


_HALF = 0.5  # error over that of a simple prediction, below which the model explains a joint
_STEPS = 3.0  # of the encoder, which are also good: play and quantisation
_DIVERGES = 10.0  # error of MuJoCo over that of a simple prediction, above which it diverges


def verdict(
    joints: Sequence[JointEstimate],
    errors: Array | None = None,
    motion: str = "its own logs",
    loaded: bool = False,
) -> tuple[Explains, str, tuple[Finding, ...]]:
    """Whether the model explains a motion, by its errors against predictions without a model.

    errors (n,) [rad or m] are those of a `motion`; None for those of the fit. `loaded` says whether
    a load was weighed.
    """
    errors = np.array([joint.error for joint in joints]) if errors is None else errors
    pairs = list(zip(joints, errors.tolist(), strict=True))
    still = [joint.name for joint in joints if not joint.judged]
    moving = {joint.name: (joint, error) for joint, error in pairs if joint.judged}
    explains, poor, rough = graded(
        [
            JudgedPart(
                joint.name, error, max(_HALF * joint.simple, _STEPS * joint.zero), joint.nearly
            )
            for joint, error in moving.values()
        ]
    )
    findings = []
    for joint, found in (moving[part.name] for part in poor):
        simple, error = (f"({x * 1e3:.1f} {joint.unit})" for x in (joint.simple, found))
        text = f"the servo's model predicts the motion hardly better {error} than the delayed "
        text += f"target or a constant position {simple}; its parameters are meaningless"
        findings.append(Finding("warning", "no_better_than_simple", joint.name, text, _POOR))
    if still:
        text = "it hardly moves, or follows its target exactly, so its model cannot be validated"
        findings.append(Finding("note", "hardly_moved", ", ".join(still), text))
    ours, late = 1e3 * np.array([errors.mean(), np.mean([joint.simple for joint in joints])])
    unit = " or ".join(sorted({joint.unit for joint in joints}, reverse=True))
    words = {"yes": "explains", "partly": "partly explains", "no": "does not explain"}[explains]
    sentence = (
        f"The servo model {words} the motion: driven by the targets alone, its mean absolute "
        f"error is {ours:.1f} {unit} on {motion}"
    )
    weak = [moving[part.name] for part in (*poor, *rough)]
    worst, largest = max(weak or pairs, key=lambda pair: pair[1])
    if len(joints) > 1:
        sentence += f" (most at {worst.name}: {1e3 * largest:.1f})"
    sentence += f"; that of the delayed target, or a constant, is {late:.1f} {unit}."
    remedy = (
        f"For {worst.name}: {_POOR[0].lower()}{_POOR[1:]}" if weak else _further(joints, loaded)
    )
    return explains, with_next(sentence, remedy), tuple(findings)


def _further(joints: Sequence[JointEstimate], loaded: bool) -> str:
    """What would tell most of the numbers that logs which are explained leave open; "" for none."""
    half = {j.name: j.quantile[DAMPING] * np.sqrt(j.covariance[DAMPING, DAMPING]) for j in joints}
    slow = [joint.name for joint in joints if joint.judged and not half[joint.name] < _FIRM]
    if slow:
        every = len(slow) > 1 and len(slow) == sum(joint.judged for joint in joints)
        who = "all joints" if every else ", ".join(slow)
        return f"{_FASTER} of {who}: slow motion determines only kv/kp + delay."
    return "" if loaded else _WEIGH


_FASTER = "Record fast motion with sudden stops"
_WEIGH = (
    "Log one more motion with a weighed load (`--load`): until then kp, kv, armature and friction "
    "rest on the masses of your file."
)
_POOR = (
    "Record faster motions, stops and reversals; check that targets and positions have the same "
    "zero, unit and sign."
)


def concluded(
    result: ServoIdentification, errors: Array, motion: str, own: Array
) -> ServoIdentification:
    """The result with the verdict on a motion that was left out of the fit.

    errors (n,) [rad or m] are those of MuJoCo on it, by servos that were identified without it,
    own (n,) those of the exported file.
    """
    if not result.joints:
        return result
    simple = np.array([joint.simple for joint in result.joints])
    if not (own < _DIVERGES * np.maximum(simple, _NOTHING)).all():
        sentence = "The exported model diverges in MuJoCo at its own time step: do not use it. "
        sentence += f"{_POOR} Or shorten the time step of the model file."
        return replace(result, explains="no", verdict=sentence)
    explains, sentence, doubts = verdict(result.joints, errors, motion, bool(result.scale))
    known = {finding.where for finding in result.findings}
    new = [finding for finding in doubts if finding.where not in known]
    return replace(result, explains=explains, verdict=sentence, findings=(*new, *result.findings))


def gravity_notes(joints: Sequence[JointEstimate]) -> tuple[Finding, ...]:
    """Reports the source of kp, and its sensitivity to an offset."""
    others = [joint.name for joint in joints if not joint.gravity]
    found = []
    if others:
        source = "the other joints' mean" if len(others) < len(joints) else "the model file's"
        source += ", unless the motion contradicts it,"
        text = f"kp is not identifiable, since gravity does not load the joint: {source} is used; "
        text += "kv/kp, f/kp and armature/kp are identified"
        found.append(Finding("note", "kp_convention", ", ".join(others), text))
    for joint in joints:
        size = abs(joint.offset)
        if joint.gravity and size > 0.02:
            zero = f"{1e3 * joint.zero:.2g} {joint.unit}"
            text = f"kp cannot be separated from an offset of target against position: {zero} "
            text += f"would change kp by {100 * size:.0f} %; the interval includes this"
            found.append(Finding("note", "offset_trade", joint.name, text, data={"relative": size}))
    return tuple(found)


def saturation_notes(joints: Sequence[JointEstimate]) -> tuple[Finding, ...]:
    """Reports servos that reached the largest force stated by the model file."""
    found = [f"{joint.name} {joint.limit:g}" for joint in joints if np.isfinite(joint.limit)]
    if not found:
        return ()
    text = "these servos saturated, at the largest forces of the model file: " + ", ".join(found)
    return (Finding("note", "saturation", "", text),)
