"""Commands, axes, base and clock of a tree of joints against the model's weight and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from ...base import Finding
from ...core import Array
from ...robots import RobotModel
from .causes import clock_cause, cycles_of, of_joints
from .evidence import (
    DELAYS,
    EXACT,
    Explained,
    LogMotion,
    columns_of,
    driven_joints,
    forces_of,
    late,
    limits,
    misfit,
    scaled,
    thinned,
)
from .remedies import remedy_of
from .retiming import BentLinks, Retimed, retimed

_CLEARLY = 0.5  # ratio of the errors of two signs of a command below which one is certain
_EXPLAINED = 0.6  # share of a command left unexplained above which its sign is not certain
_DISSIPATES = 0.97  # such a ratio where weight may have any sign
_LIKELY = 0.9  # such a ratio of a joint beside joints whose sign is certain
_SWAPPED = 0.5  # ratio of errors below which another joint's command fits better
_FITS = 0.05  # error of the commands up to which axes and base are not doubted
_BETTER = 0.7  # product of the joints' ratios of errors below which one more axis is turned
_TURNED = 0.2  # such a product below which a turned axis or base is certain
_OUTSIDE = 2.0  # factor of the error of a joint that leaves the model's limits
_USUAL = (0.1, 0.2, 0.25, 0.4, 0.5, 1.0, 2.0, 2.5, 4.0, 5.0, 10.0)  # those that are likely
_NEAR = 0.03  # relative difference from a likely one at which it is taken
UNCHECKED = "clock_unchecked"
"""Code of the finding of a clock that nothing in a log checks, with the range of its factor."""

_NEVER = 20.0  # such a handicap that excludes the other sign
_OTHER_BASES = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1.0]])


def command_causes(
    motion: LogMotion, robot: RobotModel, timed: bool, stated: bool = False
) -> list[Finding]:
    """Commands in another order, axes or commands of the wrong sign, a base in another pose.

    All joints are judged at once; each cause is one finding. `timed` is whether measured velocities
    agree with the clock; without any it may be wrong, too. `stated` is whether the map states it.
    """
    if not driven_joints(robot, motion):
        return []
    found = []
    order = _order_of_commands(motion, robot)
    if moved := [j for j in order if order[j] != j]:
        finding, motion = _swapped(motion, robot, moved, order)
        found.append(finding)
    turned, mended = _turned(motion, robot)
    if not timed and not robot.weightless:
        clock = retimed(BentLinks(robot, motion))
        if clock.told and not _explained(clock, mended, robot, turned):
            return [*found, _wrong_clock(clock)]
        found += [_unchecked(clock)] if clock.loose and not stated else []
    found += turned
    motion = mended
    if not turned:
        found += _reversed(motion, robot)
    return found


def _errors(motion: LogMotion, j: int, forces: tuple[Array, Array], u: Sequence[Array]):
    """Errors of commands u of a joint and of −u, three times (3, 2).

    Weight, inertia and friction act with the signs of the model; weight has any sign; weight and
    inertia have the model's ratio.
    """
    use = motion.usable[:, j]
    weight, inertia = (x[use, j] for x in forces)
    own = [x[use] for x in columns_of(motion, j)]
    models = (
        Explained([weight, inertia, *own]),
        Explained([inertia, *own], [weight]),
        Explained([weight + inertia, *own]),
    )
    return np.array([[min(m.error(x, sign) for x in u) for sign in (1, -1)] for m in models])


def _order_of_commands(motion: LogMotion, robot: RobotModel) -> dict[int, int]:
    """The joint to whose column each driven joint's command belongs: mostly its own."""
    joints = driven_joints(robot, motion)
    rows, few = thinned(motion)
    forces = forces_of(robot, few)
    errors = np.ones((len(joints), len(joints)))
    for a, j in enumerate(joints):
        use = few.usable[:, j]
        own = [x[use] for x in (forces[0][:, j], forces[1][:, j], *columns_of(few, j))]
        model = Explained(own)
        for b, c in enumerate(joints):
            u = [late(motion, c, delay, rows[use]) for delay in DELAYS]
            errors[a, b] = max(min(min(model.error(x, s) for x in u) for s in (1, -1)), EXACT)
    errors[np.isnan(errors)] = 1.0  # of a command that does not change in these rows
    _, best = scipy.optimize.linear_sum_assignment(np.log(errors))
    order = dict(zip(joints, joints, strict=True))
    for cycle in cycles_of(best.tolist()):
        gain = np.log([errors[a, best[a]] / errors[a, a] for a in cycle])
        if gain.mean() < np.log(_SWAPPED) and gain.max() < 0:
            order |= {joints[a]: joints[best[a]] for a in cycle}
    return order


def _swapped(
    motion: LogMotion, robot: RobotModel, moved: Sequence[int], order: dict[int, int]
) -> tuple[Finding, LogMotion]:
    """The finding of commands that explain another joint's motion, and the motion with them."""
    names = {robot.joints[j]: robot.joints[order[j]] for j in moved}
    words = ", ".join(f"{joint} the command of {other}" for joint, other in names.items())
    index = np.arange(motion.u.shape[1])
    index[list(moved)] = [order[j] for j in moved]
    mended = replace(motion, u=motion.u[:, index])
    before = misfit(robot, motion)
    after = misfit(robot, mended)
    text = f"the commands are swapped: the model gives {words}"
    if not np.isnan(after):
        text += f" (their error falls from {100 * before:.2g} to {100 * after:.2g} %)"
    changes: dict[str, object] = {"order.command": names}
    data = {"columns": names, "joints": list(names), "map": changes}
    remedy = remedy_of(changes)
    return Finding("refusal", "swapped", ", ".join(names), text, remedy, data), mended


def _turned(motion: LogMotion, robot: RobotModel) -> tuple[list[Finding], LogMotion]:
    """Axes that count against the model's, or a base in another pose, where the model does not fit.

    The axes are turned one after another, while the commands, of any sign, fit far better.
    """
    before = misfit(robot, motion, 0.0)
    if np.isnan(before) or before < _FITS:
        return [], motion
    n = len(driven_joints(robot, motion))
    plain = before
    before = best = before * _OUTSIDE ** (_outside(robot, motion) / n)
    own_pull = robot.model.gravity.linear
    others = [g for g in _OTHER_BASES * _weight(robot) if not np.allclose(g, own_pull)]
    bases = [(misfit(robot, motion, 0.0, g), g) for g in others]
    turned: list[int] = []
    for start in _starts(robot, motion):
        error, trial = _with_axes(robot, motion, start, n)
        if (error / best) ** n < _BETTER:
            best = error
            turned = trial
    own = _mirrored(motion, turned)
    error, gravity = min(bases, key=lambda one: one[0])
    if (error / plain) ** n < _TURNED and error < best:
        pull = ", ".join(f"{x:.3g}" for x in gravity)
        text = (
            f"the base is mounted in another pose than in the model: with gravity ({pull}) m/s² in "
        )
        text += f"its axes the commands' error falls from {100 * plain:.2g} to {100 * error:.2g} %"
        remedy = "Turn the base, or state gravity, in the model file."
        data = {"gravity": gravity.tolist()}
        return [Finding("refusal", "mount", "", text, remedy, data)], motion
    if not turned or (best / before) ** n > _TURNED:
        return [], motion
    names = [robot.joints[j] for j in sorted(turned)]
    wrong = _wrong_signs(own, robot)
    text = f"the axes of {', '.join(names)} count against the model's: with them reversed the "
    best = misfit(robot, own, 0.0)
    text += f"commands' error falls from {100 * plain:.2g} to {100 * best:.2g} %"
    value = {name: -1 for name in names}
    changes: dict[str, object] = {"factors.position": value, "factors.velocity": value}
    if wrong:
        changes["factors.command"] = of_joints(robot, sorted(wrong), -1)
    data = {"joints": names, "map": changes}
    remedy = remedy_of(changes)
    finding = Finding("refusal", "reversed_sign", ", ".join(names), text, remedy, data)
    return [finding], own


def _unchecked(clock: Retimed) -> Finding:
    """The finding of a clock that may be another one, by which factors.

    It is a warning where one of these fits better, and widens intervals.
    """
    low, high = clock.alike
    text = "nothing in the log checks its clock: it has no velocities, and inertia acts so little "
    text += f"that times multiplied by any number from {low:g} to {high:g} explain the commands as "
    text += "well"
    if clock.doubted:
        text += ", one of them better; intervals of inertias, of friction and of gains without "
        text += "weight allow for that"
    remedy = (
        "Check the log's rate: if it is right, set `[time]` `scale = 1` in map.toml. Or record "
    )
    remedy += "faster motion, or velocities."
    data = {"low": low, "high": high}
    return Finding("warning" if clock.doubted else "note", UNCHECKED, "", text, remedy, data)


def _explained(
    clock: Retimed, mended: LogMotion, robot: RobotModel, turned: Sequence[Finding]
) -> bool:
    """Whether turned axes or another base, if any is found, explain more than a clock."""
    for finding in turned:
        gravity = finding.data.get("gravity")
        other = BentLinks(robot, mended, None if gravity is None else np.asarray(gravity))
        if other.error() < clock.error:
            return True
    return False


def _wrong_clock(clock: Retimed) -> Finding:
    """The finding of a clock that no velocity contradicts; a likely one has a line of the map."""
    scale = min(_USUAL, key=lambda k: abs(np.log(k / clock.scale)))
    usual = abs(np.log(scale / clock.scale)) < _NEAR
    cause = clock_cause(scale if usual else clock.scale)
    how = cause.text.split(":")[0]
    text = f"{how}: the model's weight and inertia fit the commands with {100 * clock.error:.2g} % "
    text += f"error on that clock, and with {100 * clock.plain:.2g} % on the log's own"
    data: dict[str, object] = {"factor": scale if usual else clock.scale}
    remedy = "Find the true rate of the log, and set `[time]` `scale` in map.toml."
    if usual:
        data["map"] = cause.changes
        remedy = remedy_of(cause.changes)
    return Finding("refusal", "clock", "", text, remedy, data)


def _starts(robot: RobotModel, motion: LogMotion) -> list[list[int]]:
    """Sets of axes from which a search for those that are turned begins."""
    low = motion.q.min(axis=0)
    high = motion.q.max(axis=0)
    beyond = []
    for j, name in enumerate(robot.joints):
        least, most, _ = limits(robot, name)
        inside = least <= -high[j] and -low[j] <= most
        if inside and not (least <= low[j] and high[j] <= most):
            beyond.append(j)
    return [[], list(range(len(robot.joints))), *([beyond] if beyond else [])]


def _with_axes(
    robot: RobotModel, motion: LogMotion, start: list[int], n: int
) -> tuple[float, list[int]]:
    """The least error with axes turned, one more or less at a time, and these axes."""
    turned = list(start)

    def error(axes: list[int]) -> float:
        own = _mirrored(motion, axes)
        return misfit(robot, own, 0.0) * _OUTSIDE ** (_outside(robot, own) / n)

    best = error(turned)
    for _ in robot.joints:
        sets = [sorted(set(turned) ^ {j}) for j in range(len(robot.joints))]
        least, trial = min((error(axes), axes) for axes in sets)
        if (least / best) ** n > _BETTER:
            break
        best = least
        turned = trial
    return best, turned


def _outside(robot: RobotModel, motion: LogMotion) -> int:
    """Number of joints that leave their limits by more than a twentieth of their range."""
    found = 0
    for j, name in enumerate(robot.joints):
        least, most, _ = limits(robot, name)
        slack = 0.05 * (most - least) if np.isfinite(most - least) else 0.0
        found += bool(
            (motion.q[:, j] < least - slack).any() or (motion.q[:, j] > most + slack).any()
        )
    return found


def _mirrored(motion: LogMotion, joints: Sequence[int]) -> LogMotion:
    """The motion with the axes of some joints reversed."""
    return scaled(joints, -1.0, motion)


def _weight(robot: RobotModel) -> float:
    return float(np.linalg.norm(robot.model.gravity.linear))


def _wrong_signs(motion: LogMotion, robot: RobotModel) -> list[int]:
    """Joints whose command has the wrong sign.

    A sign is clear where the model explains one and not the other, and where friction and inertia
    agree, which a wrong mass or pose of the base does not reverse. Where some are clear, a joint
    of whose command less is explained follows what speaks for it, or all others.
    """
    rows, few = thinned(motion)
    forces = forces_of(robot, few)
    clear = []
    right = []
    likely = []
    joints = driven_joints(robot, motion)
    for j in joints:
        use = few.usable[:, j]
        u = [late(motion, j, delay, rows[use]) for delay in DELAYS]
        (own, turned), (drives, brakes), (whole, wrong) = _errors(few, j, forces, u).tolist()
        if turned < min(_CLEARLY * own, _EXPLAINED) and brakes < _DISSIPATES * drives:
            clear.append(j)
        elif own < min(_CLEARLY * turned, _EXPLAINED):
            right.append(j)
        elif wrong < _LIKELY * whole:
            likely.append(j)
    if not clear:
        return []
    if not right and 2 * len(clear) >= len(joints):
        return joints
    return sorted(clear + likely)


def _reversed(motion: LogMotion, robot: RobotModel) -> list[Finding]:
    """One finding about all commands of the wrong sign."""
    joints = driven_joints(robot, motion)
    if differing := _reversed_in_files(motion, robot):
        return differing
    wrong = _wrong_signs(motion, robot)
    if not wrong:
        return []
    names = [robot.joints[j] for j in wrong]
    every = len(wrong) == len(joints)
    who = f"all {len(joints)} joints" if every and len(joints) > 1 else ", ".join(names)
    text = f"the commands of {who} are reversed: weight, inertia and friction would have to drive "
    text += "the motion; −u fits the model"
    u = motion.u.copy()
    u[:, wrong] *= -1
    before = misfit(robot, motion, _NEVER)
    after = misfit(robot, replace(motion, u=u), _NEVER)
    if not np.isnan(after):
        text += f" with {100 * after:.2g} % error instead of {100 * before:.2g} %"
    value = -1 if every else of_joints(robot, wrong, -1)
    changes: dict[str, object] = {"factors.command": value}
    data = {"joints": names, "map": changes}
    where = "" if every and len(joints) > 1 else ", ".join(names)
    return [Finding("refusal", "reversed_sign", where, text, remedy_of(changes), data)]


def _reversed_in_files(motion: LogMotion, robot: RobotModel) -> list[Finding]:
    """Findings about files in which commands have another sign than in the others."""
    files = list(dict.fromkeys(motion.file.tolist()))
    if len(files) < 2:
        return []
    wrong = {file: _wrong_signs(motion.part(motion.file == file), robot) for file in files}
    if len({tuple(joints) for joints in wrong.values()}) == 1:
        return []
    found = []
    for file, joints in wrong.items():
        if joints:
            names = [robot.joints[j] for j in joints]
            text = f"the commands of {', '.join(names)} are reversed in this file, not in all files"
            remedy = "Leave the file out, or negate these columns in it."
            data = {"joints": names}
            found.append(Finding("refusal", "reversed_sign", file, text, remedy, data))
    return found
