"""Contradictions within recordings, before any fit: dead channels, units, velocities.

Reversed or swapped commands and delays need a fit and are not checked here.
"""

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from ...base import Finding, pin
from ...core import Array, number, rounded
from ...robots import RobotModel
from .accelerometer import accelerometer_causes
from .causes import CLEAR, DEGREES, velocity_causes
from .command_causes import command_causes
from .evidence import LogMotion, limits, misfit, motion_of, scaled
from .frames import frame_causes
from .motor_side import motor_side
from .recordings import Recordings
from .remedies import remedy_of
from .unusable import UnusableLog

SHORT = 5.0  # seconds of usable rows below which a log is warned about or refused
TOO_SHORT = 1.0
_DEGREES_APART = 3.0  # range of a position over the model's from which it is in degrees
_STILL = 0.01  # travel of a joint that moves in a file [rad or m]
_MOVES = 0.05  # share of usable rows below which a joint hardly moves
_ROWS = 2000  # at most, for the model's torques


def checked(recordings: Recordings, robot: RobotModel) -> Recordings:
    """The recordings with the findings of `checks`; raises `UnusableLog` on a refusal."""
    findings = (*recordings.findings, *checks(recordings, robot))
    if Finding.refused(findings):
        raise UnusableLog(findings)
    segments = recordings.segments
    if not recordings.turns_only:  # velocities tell accelerations without a bias
        segments = tuple(segment._replace(specific=None) for segment in segments)
    return replace(recordings, segments=segments, findings=findings)


def checks(recordings: Recordings, robot: RobotModel) -> tuple[Finding, ...]:
    """Findings about recordings of a robot; refusals where no fit can be trusted.

    Codes: `dead_channel`, `at_rest`, `short_log`, `degrees`, `beyond_limits`, `velocity_mismatch`,
    `swapped_columns`, `motor_side` and `milliamps`.
    """
    motion = motion_of(recordings)
    remedy = "Map the column of its torque or current, or leave the joint out with --lock."
    commands = np.concatenate([segment.log.u for segment in recordings.segments])
    found = _dead("command", commands, 0.0, robot, remedy)
    found = [finding for finding in found if finding.where not in robot.passive]
    found += _dead_in_files(recordings, robot, {finding.where for finding in found})
    if not robot.jointed and len(found) < len(robot.joints):  # other actuators tell of its motion
        found = _constant(commands, robot)
    usable = np.concatenate([segment.usable for segment in recordings.segments])
    seconds = float(np.sum(usable.any(axis=1)) / recordings.rate)
    if seconds < SHORT:
        text = f"only {seconds:.2g} s of motion can be used"
        remedy = "Record at least 10 s of all joints moving at once, fast and slow."
        level = "refusal" if seconds < TOO_SHORT else "warning"
        found.append(Finding(level, "short_log", "", text, remedy, {"seconds": seconds}))
    if not robot.jointed:
        return _first_clocks([*found, *_axes_of_vehicle(recordings, robot)])
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
    under_pd = recordings.feedback is not None
    said, motion = velocity_causes(motion, robot, measured, held=under_pd)
    found += said
    reported = {name for finding in found for name in finding.where.split(", ")}
    speeds = np.quantile(np.abs(motion.slopes), 0.95, axis=0)
    beyond = beyond_limits(motion.q, speeds, robot)
    beyond = [f for f in beyond if f.where not in reported]
    geared = None if Finding.refused(found) else motor_side(motion, robot, measured)
    found += in_degrees(beyond, robot, measured, motion) if geared is None else [geared]
    if recordings.imu is not None:  # what follows compares commands with motion on a fixed base
        if not Finding.refused([*found, *recordings.findings]):
            from ..identify.ground.conventions import convention_findings
            from ..identify.models import floating

            found += convention_findings(floating(robot), recordings)
        return _first_clocks(found)
    wrong = ("beyond_limits", "degrees", "motor_side")
    if not Finding.refused(f for f in found if f.code in wrong):
        found += command_causes(motion, robot, bool(measured), recordings.timed)
    if not robot.weightless and not Finding.refused(found):
        found += _large_commands(motion, recordings, robot)
    return _first_clocks(found)


def _axes_of_vehicle(recordings: Recordings, robot: RobotModel) -> list[Finding]:
    """Findings about the axes of a vehicle; an accelerometer is judged by velocities that hold."""
    found = frame_causes(recordings, robot)
    return found if Finding.refused(found) else [*found, *accelerometer_causes(recordings)]


def _first_clocks(found: list[Finding]) -> tuple[Finding, ...]:
    """The findings without the length of a log whose clock is wrong."""
    if not any(finding.code == "clock" for finding in found):
        return tuple(found)
    return tuple(finding for finding in found if finding.code != "short_log")


def _dead(what: str, x: Array, least: float, robot: RobotModel, remedy: str) -> list[Finding]:
    """Refusals of joints whose position or command x (N, n) never changes by more than `least`."""
    text = f"the {what} is {{}} in all rows"
    columns = zip(robot.joints, x.T, strict=False)
    return [
        Finding("refusal", "dead_channel", joint, text.format(number(column[0])), remedy)
        for joint, column in columns
        if np.ptp(column) <= least
    ]


def _dead_in_files(
    recordings: Recordings, robot: RobotModel, dead: Container[str]
) -> list[Finding]:
    """Refusals of files in which a command never changes while its joint moves."""
    if not robot.jointed:
        return []
    found = []
    for file in dict.fromkeys(segment.source for segment in recordings.segments):
        logs = [segment.log for segment in recordings.segments if segment.source == file]
        u = np.concatenate([log.u for log in logs])
        moves = np.max([np.ptp(log.q, axis=0) for log in logs], axis=0) > _STILL
        for j, name in enumerate(robot.joints):
            if np.ptp(u[:, j]) > 0 or name in dead or name in robot.passive or not moves[j]:
                continue
            text = f"the command of {name} is {number(float(u[0, j]))} in all rows of this file, "
            text += "while the joint moves"
            remedy = "Leave this file out, or map the column that holds the command in it."
            data = {"joint": name}
            found.append(Finding("refusal", "dead_channel", file, text, remedy, data))
    return found


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
        slide = robot.system.slides[j]
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


def in_degrees(
    found: list[Finding], robot: RobotModel, measured: Sequence[int], motion: LogMotion
) -> list[Finding]:
    """Findings of `beyond_limits`, with one in place of those that take positions for degrees.

    Velocities that are `measured` agree with these positions, and are in degrees, too. Of joints
    without limits, the commands must fit the model better then.
    """
    some = [f for f in found if f.code == "degrees"]
    limited = [f for f in some if f.level == "refusal"]
    sure = [f for f in limited if _widths(f) > _DEGREES_APART]
    if not limited and some:
        small = scaled([robot.joints.index(f.where) for f in some], 1 / DEGREES, motion)
        if misfit(robot, small) < CLEAR * misfit(robot, motion):
            sure = some
    if not sure:
        less = "Check offset, sign and the order of joints in map.toml."
        return [
            replace(f, level="warning", code="beyond_limits", remedy=less) if f in limited else f
            for f in found
        ]
    names = [f.where for f in some]
    turning = [n for n, unit in zip(robot.joints, robot.units, strict=True) if unit == "rad"]
    every = len(turning) == len(robot.joints) and 2 * len(names) >= len(turning)
    joints = turning if 2 * len(names) >= len(turning) else names
    value: object = "deg" if every else dict.fromkeys(joints, "deg")
    changes = {"factors.position": value}
    fast = [n for n in joints if robot.joints.index(n) in measured]
    if fast:
        whole = every and len(fast) == len(robot.joints)
        changes["factors.velocity"] = "deg/s" if whole else dict.fromkeys(fast, "deg/s")
    widest = max(limited or some, key=_widths)
    who = f"the positions of {len(joints)} joints are" if joints[1:] else "the position is"
    text = f"{who} in degrees: {widest.where if joints[1:] else 'it'} {_reach(widest)}"
    data = {"joints": joints, "map": changes}
    remedy = f"{remedy_of(changes)} State `ratio` if they are motor angles, `points` if they are "
    remedy += "parts of a range, as LeRobot's -100 to 100."
    where = "" if len(joints) == len(robot.joints) and joints[1:] else ", ".join(joints)
    rest = [f for f in found if f not in some]
    return [Finding("refusal", "degrees", where, text, remedy, data), *rest]


def _reach(found: Finding) -> str:
    return found.text.removeprefix("the position ")


def _widths(found: Finding) -> float:
    """The range of a position over that of the model."""
    (least, most), (low, high) = (found.data[key] for key in ("range", "limits"))  # type: ignore[misc]
    return float(most - least) / min(high - low, 2 * np.pi)


def _large_commands(motion: LogMotion, recordings: Recordings, robot: RobotModel) -> list[Finding]:
    """Commands far larger than the model's torques make plausible."""
    model = robot.model
    data = robot.model.createData()
    accelerations = np.gradient(motion.v, 1 / recordings.rate, axis=0)
    some = (robot.system.position(motion.q), motion.v, accelerations)
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
