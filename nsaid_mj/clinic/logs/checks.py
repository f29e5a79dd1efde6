"""Contradictions within recordings, before any fit: dead channels, units, velocities.

Reversed or swapped commands and delays need a fit and are not checked here.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...base import Finding, pin, refused
from ...core import Array, number, positions, rounded, slides
from ...robots import RobotModel
from . import signals
from .recordings import Recordings
from .unusable import UnusableLog

DEGREES = 180 / np.pi
SHORT = 5.0  # seconds of usable rows below which a log is warned about or refused
TOO_SHORT = 1.0
_AGREES = 0.9  # correlation of a velocity with dq/dt below which they contradict each other
_FACTOR = 0.15  # relative error of a velocity's scale that noise and delay do not explain
_MOVES = 0.05  # share of usable rows below which a joint hardly moves
_ROWS = 2000  # at most, for the model's torques


def checked(recordings: Recordings, robot: RobotModel) -> Recordings:
    """The recordings with the findings of `checks`; raises `UnusableLog` on a refusal."""
    findings = (*recordings.findings, *checks(recordings, robot))
    if refused(findings):
        raise UnusableLog(findings)
    return replace(recordings, findings=findings)


class LogMotion(NamedTuple):
    """All segments in one piece, low-passed alike."""

    q: Array  # (N, n) positions
    slopes: Array  # (N, n) their derivatives
    v: Array  # (N, n) velocities
    u: Array  # (N, n_u) commands


def checks(recordings: Recordings, robot: RobotModel) -> tuple[Finding, ...]:
    """Findings about recordings of a robot; refusals where no fit can be trusted.

    Codes: `dead_channel`, `at_rest`, `short_log`, `degrees`, `beyond_limits`, `velocity_mismatch`,
    `swapped_columns` and `milliamps`.
    """
    motion = _motion(recordings)
    remedy = "Map the column of its torque or current, or leave the joint out with --lock."
    found = _dead("command", motion.u, 0.0, robot, remedy)
    found = [finding for finding in found if finding.where not in robot.passive]
    if not robot.jointed and len(found) < len(robot.joints):  # other actuators tell of its motion
        found = _constant(motion.u, robot)
    usable = np.concatenate([segment.usable for segment in recordings.segments])
    seconds = float(np.sum(usable.any(axis=1)) / recordings.rate)
    if seconds < SHORT:
        text = f"only {seconds:.2g} s of motion can be used"
        remedy = "Record at least 10 s of all joints moving at once, fast and slow."
        level = "refusal" if seconds < TOO_SHORT else "warning"
        found.append(Finding(level, "short_log", "", text, remedy, {"seconds": seconds}))
    if not robot.jointed:
        return tuple(found)
    remedy = "Map the column of its position, or leave the joint out with --lock."
    still = _dead("position", motion.q, 1e-9, robot, remedy)
    found += still
    shares = usable.mean(axis=0).tolist()
    resting = {j for j, share in enumerate(shares) if share < _MOVES}
    remedy = "Record a motion of this joint, or leave it out with --lock."
    for j in sorted(resting):
        if robot.joints[j] not in {finding.where for finding in still}:
            text = "the joint moves faster than its noise in only "
            text += f"{100 * shares[j]:.1f} % of the rows"
            data = {"share": shares[j]}
            found.append(Finding("warning", "at_rest", robot.joints[j], text, remedy, data))
    derived = {  # joints whose velocities are not measured
        joint
        for finding in recordings.findings
        if finding.code == "differentiated"
        for joint in finding.data["joints"]  # pyright: ignore[reportGeneralTypeIssues]
    }
    names = enumerate(robot.joints)
    measured = [j for j, name in names if name not in derived and j not in resting]
    found += _velocities(motion, robot, measured)
    reported = {finding.where for finding in found}
    speeds = np.quantile(np.abs(motion.slopes), 0.95, axis=0)
    found += [f for f in beyond_limits(motion.q, speeds, robot) if f.where not in reported]
    if not robot.weightless and not refused(found):
        found += _large_commands(motion, recordings, robot)
    return tuple(found)


def _motion(recordings: Recordings) -> LogMotion:
    parts = []
    cut = min(10.0, recordings.rate / 5) / (0.5 * recordings.rate)
    for segment in recordings.segments:
        _, q, v, u = segment.log
        poses = q.shape[1] != v.shape[1]
        slopes = v if poses else np.gradient(q, 1 / recordings.rate, axis=0)
        parts.append((q, signals.low_pass(slopes, cut), signals.low_pass(v, cut), u))
    return LogMotion(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _dead(what: str, x: Array, least: float, robot: RobotModel, remedy: str) -> list[Finding]:
    """Refusals of joints whose position or command x (N, n) never changes by more than `least`."""
    text = f"the {what} is {{}} in all rows"
    columns = zip(robot.joints, x.T, strict=False)
    return [
        Finding("refusal", "dead_channel", joint, text.format(number(column[0])), remedy)
        for joint, column in columns
        if np.ptp(column) <= least
    ]


def _constant(u: Array, robot: RobotModel) -> list[Finding]:
    """Notes of the commands u (N, k) of a vehicle that never change: constant forces, or none."""
    found = []
    for name, column in zip(robot.joints, u.T, strict=True):
        if np.ptp(column) > 0:
            continue
        value = number(column[0])
        data = {"value": float(column[0])}
        if column[0] == 0:
            text = (
                "the command is 0 in all rows: its gain is not in this log and remains the sheet's"
            )
            remedy = "If it did act, map the column of its command."
            found.append(Finding("note", "zero_command", name, text, remedy, data))
        else:
            text = (
                f"the command is {value} in all rows: its force is a constant, and its gain cannot "
            )
            text += "be told from another constant force"
            remedy = "Let it change in another log to identify its gain."
            found.append(Finding("note", "constant_command", name, text, remedy, data))
    return found


# -- velocities against positions ----------------------------------------------------------------


def _velocities(motion: LogMotion, robot: RobotModel, measured: list[int]) -> list[Finding]:
    """Contradictions between measured velocities and the derivatives of positions."""
    found: list[Finding] = []
    together = correlation(motion.slopes, motion.v)
    swapped: set[int] = set()
    for j in measured:
        if np.ptp(motion.q[:, j]) < 1e-9 or np.std(motion.v[:, j]) == 0 or j in swapped:
            continue
        others = [i for i in measured if i != j]
        best = max(others, key=lambda i: abs(together[i, j]), default=j)
        if abs(together[j, j]) < 0.7 and abs(together[best, j]) > _AGREES:
            swapped |= {j, best}
            found.append(_swapped(robot.joints[j], robot.joints[best], together[best, j]))
            continue
        finding = _scale(robot.joints[j], motion.slopes[:, j], motion.v[:, j], together[j, j])
        found += [finding] if finding else []
    return found


def correlation(a: Array, b: Array) -> Array:
    """(k, l) correlation of columns of a (N, k) with columns of b (N, l); 0 for constant ones."""
    centred = [x - x.mean(axis=0) for x in (a, b)]
    sizes = [np.linalg.norm(x, axis=0) for x in centred]
    product = centred[0].T @ centred[1]
    scale = np.outer(*sizes)
    return np.divide(product, scale, out=np.zeros_like(product), where=scale > 0)


def _swapped(joint: str, other: str, together: float) -> Finding:
    text = f"the velocity correlates with the position of {other} (correlation {together:.2f})"
    remedy = "Two columns are swapped: correct the order of positions or velocities in map.toml."
    data = {"joints": [joint, other], "correlation": float(together)}
    return Finding("refusal", "swapped_columns", joint, text, remedy, data)


def _scale(joint: str, slope: Array, v: Array, together: float) -> Finding | None:
    """Checks the scale and sign of a velocity."""
    factor = float(slope @ v / (v @ v))
    data = {"factor": factor, "correlation": float(together)}
    if abs(together) < _AGREES:
        level = "refusal" if abs(together) < 0.5 else "warning"
        text = f"the velocity hardly correlates with dq/dt (correlation {together:.2f})"
        remedy = "Check which column is its velocity; leave it out to differentiate the position."
        return Finding(level, "velocity_mismatch", joint, text, remedy, data)
    for ratio, units in (
        (DEGREES, "the position is in degrees and the velocity in rad/s"),
        (1 / DEGREES, "the velocity is in deg/s and the position in rad"),
    ):
        if abs(factor / ratio - 1) < _FACTOR:
            text = f"{units}: dq/dt is {number(factor, significant=3)} times the velocity"
            remedy = "State the unit in map.toml."
            return Finding("refusal", "degrees", joint, text, remedy, data)
    if abs(factor - 1) > _FACTOR:
        sign = abs(factor + 1) < _FACTOR
        text = "the velocity has the opposite sign of dq/dt"
        if not sign:
            text = f"dq/dt is {number(factor, significant=3)} times the velocity"
        remedy = f"Set {'sign' if sign else 'unit or ratio'} of the velocity or position in "
        remedy += "map.toml."
        return Finding("refusal", "velocity_mismatch", joint, text, remedy, data)
    return None


# -- sizes against the model ----------------------------------------------------------------------


def beyond_limits(q: Array, speeds: Array, robot: RobotModel) -> list[Finding]:
    """Positions q (N, n) [rad or m] outside the model's limits, or large and fast without limits.

    speeds (n,) are large speeds of each joint [rad/s or m/s].
    """
    found = []
    for j, name in enumerate(robot.joints):
        low, high, fastest = limits(robot, name)
        least = float(q[:, j].min())
        most = float(q[:, j].max())
        data = {"range": [least, most], "limits": [low, high]}
        slide = slides(robot.model.joints[robot.model.getJointId(name)])
        unit = "m" if slide else "rad"
        reach = f"the position goes from {least:.3g} to {most:.3g} {unit}"
        if not np.isfinite([low, high]).all():
            if not slide and most - least > 4 * np.pi and speeds[j] > 2 * fastest:
                text = f"{reach}, at {speeds[j]:.3g} rad/s, which looks like degrees"
                remedy = 'If it is, state `unit = "deg"` in map.toml.'
                found.append(Finding("warning", "degrees", name, text, remedy, data))
            continue
        excess = max(most - high, low - least)
        width = high - low
        if excess <= 0.05 * width:
            continue
        reach += f", beyond the model's {low:.3g} to {high:.3g} {unit}"
        fits = least / DEGREES >= low - 0.05 * width and most / DEGREES <= high + 0.05 * width
        if most - least > 1.5 * width and fits and not slide:
            remedy = 'If so, state `unit = "deg"` in map.toml; `ratio` if they are motor angles, '
            remedy += "`points` if they are parts of a range, as LeRobot's -100 to 100."
            text = f"{reach}; as degrees it lies within them"
            found.append(Finding("refusal", "degrees", name, text, remedy, data))
        elif most - least > 1.5 * width:
            remedy = "State the unit, the gear ratio or two `points` in map.toml."
            found.append(Finding("refusal", "beyond_limits", name, reach, remedy, data))
        else:
            remedy = "Check offset, sign and the order of joints in map.toml."
            found.append(Finding("warning", "beyond_limits", name, reach, remedy, data))
    return found


def limits(robot: RobotModel, name: str) -> tuple[float, float, float]:
    """Lowest and highest position and largest speed of a joint; infinite without a limit."""
    model = robot.model
    joint = model.joints[model.getJointId(name)]
    if joint.nq != 1:
        return -np.inf, np.inf, 6.0
    low = float(model.lowerPositionLimit[joint.idx_q])
    high = float(model.upperPositionLimit[joint.idx_q])
    fastest = float(model.velocityLimit[joint.idx_v])
    bounded = high > low and high - low < 1e3
    return (
        low if bounded else -np.inf,
        high if bounded else np.inf,
        fastest if 0 < fastest < 1e3 else 6.0,
    )


def _large_commands(motion: LogMotion, recordings: Recordings, robot: RobotModel) -> list[Finding]:
    """Commands far larger than the model's torques make plausible."""
    model = robot.model
    data = robot.model.createData()
    accelerations = np.gradient(motion.v, 1 / recordings.rate, axis=0)
    some = (positions(model, motion.q), motion.v, accelerations)
    rows = zip(*(x[:: len(motion.q) // _ROWS or 1] for x in some), strict=True)
    torques = np.array([pin.rnea(model, data, *row) for row in rows])  # without friction
    size = _rms(motion.u)
    needed = _rms(torques) / np.abs(robot.gain)
    loaded = needed > 0.1 * needed.max()
    ratio = float(np.median(size[loaded] / needed[loaded])) if loaded.any() else 0.0
    most = float(np.max(np.abs(motion.u)))
    if ratio < 10 or most < 100:
        return []
    units = sorted(set(recordings.command_units))
    stated = ", ".join(unit for unit in units if unit)
    data = {"ratio": ratio, "largest": most, "units": units}
    text = f"commands reach {number(most)} {stated or '(no unit stated)'}, "
    text += f"{rounded(ratio)} times what the model's torques make plausible"
    if "A" in units:
        remedy = 'State `unit = "mA"` in map.toml if these are milliamperes.'
        return [Finding("refusal", "milliamps", "", text, remedy, data)]
    if "N·m" in units:
        if ratio < 50:
            return []
        remedy = "State the unit in map.toml: mA, mN·m, % or raw."
        return [Finding("refusal", "milliamps", "", text, remedy, data)]
    remedy = "They may be milliamperes or counts: state the unit in map.toml, or the gains are "
    remedy += "identified per unit of this column."
    return [Finding("warning", "milliamps", "", text, remedy, data)]


def _rms(x: Array) -> Array:
    return np.sqrt(np.mean(np.square(x), axis=0))
