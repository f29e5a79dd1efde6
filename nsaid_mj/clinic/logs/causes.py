"""Causes that concern a whole log of a tree of joints, judged against each other.

"dq/dt is twice the velocity on every joint" can be a clock that runs twice too fast, a unit of the
velocities or one of the positions. Each hypothesis changes the motion in its own way, and so the
forces that the model needs for it: a clock and the velocities' unit scale accelerations, the
positions' unit changes the weight. The hypothesis under which the commands explain the motion best
is named, with the lines of map.toml that mend it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy

from ...base import Finding
from ...core import Array, number
from ...robots import RobotModel
from .cleaning import Cleaned
from .evidence import LogMotion, correlation, misfit, multiplied
from .mapping import TIME
from .remedies import remedy_of

DEGREES = 180 / np.pi
AGREES = 0.9  # correlation of a velocity with dq/dt below which they contradict each other
FACTOR = 0.15  # relative error of a velocity's scale that noise and delay do not explain
_OPEN = 2.0  # so many times the relative rms difference of equal sizes at this correlation
_SETTLES = 0.5  # such an error up to which a held target of a PD law may be its cause
_SAME = 0.3  # relative error of a velocity below which it is that of a position
_UNIT = 0.04  # relative difference of a factor and that of a unit that it may be
_ALIKE = 0.06  # spread of factors that one cause explains
CLEAR = 0.8  # ratio of two hypotheses' errors below which the better one is certain
_RATES = (4.0, 10_000.0)  # of robots' logs [Hz]
_GROSS = 80.0  # factor of a clock from which a log cannot be prepared; degrees are 57
_UNITS = (1e3, 1e6, 1e9)  # of time, in one another
_WINDOWS = 200  # windows of a log in which positions are compared with integrals of velocities
_UNLIKELY = 0.2  # handicap [log of the error] of a hypothesis that needs an unusual number
UNITS = {  # positions over velocities, by the unit that was not stated
    DEGREES: ("position", "deg", "the positions are in degrees"),
    1 / DEGREES: ("velocity", "deg/s", "the velocities are in deg/s"),
    2 * np.pi / 60: ("velocity", "rpm", "the velocities are in rpm"),
    1 / (2 * np.pi): ("position", "turns", "the positions are in turns"),
    2 * np.pi: ("velocity", "turns/s", "the velocities are in turns/s"),
}


# -- hypotheses -----------------------------------------------------------------------------------


class Cause(NamedTuple):
    """A hypothesis about the whole log, or some of its joints or files."""

    code: str  # of the finding
    text: str  # what it says is wrong
    changes: dict[str, object]  # values of map.toml that mend it, by table and key
    apply: Callable[[LogMotion], LogMotion]  # the motion as it would have been
    name: str = ""  # the hypothesis in a few words, where it is not the likeliest
    handicap: float = 0.0  # added to the logarithm of its error


class RankedCause(NamedTuple):
    """A hypothesis and what the commands say about it."""

    cause: Cause
    error: float  # geometric mean of the commands' relative errors, NaN without a model


def ranked(causes: Sequence[Cause], motion: LogMotion, robot: RobotModel) -> list[RankedCause]:
    """The hypotheses, the likeliest first."""
    judged = [RankedCause(cause, misfit(robot, cause.apply(motion))) for cause in causes]
    return sorted(judged, key=_surprise)


def _surprise(one: RankedCause) -> float:
    return (0.0 if np.isnan(one.error) else np.log(one.error)) + one.cause.handicap


def finding_of(judged: Sequence[RankedCause], where: str, data: dict[str, object]) -> Finding:
    """The first of ranked hypotheses as a refusal, with the evidence and the runner-up."""
    best = judged[0]
    text = best.cause.text
    others = [one for one in judged[1:] if not np.isnan(one.error)]
    if others and not np.isnan(best.error):
        against = ", ".join(f"{100 * one.error:.2g} % if {one.cause.name}" for one in others[:3])
        text += f" (the commands then fit the model with {100 * best.error:.2g} % error; {against})"
    close = len(judged) > 1 and _surprise(judged[1]) - _surprise(best) < -np.log(CLEAR)
    if close and best.error > CLEAR * judged[1].error:
        text += f"; the log hardly tells it from the next likely cause: {judged[1].cause.name}"
    remedy = remedy_of(best.cause.changes)
    return Finding(
        "refusal", best.cause.code, where, text, remedy, {**data, "map": best.cause.changes}
    )


# -- velocities against positions -----------------------------------------------------------------


def velocity_causes(
    motion: LogMotion, robot: RobotModel, measured: Sequence[int], held: bool = False
) -> tuple[list[Finding], LogMotion]:
    """Contradictions of velocities and dq/dt, one finding for each cause, and the mended motion.

    `measured` are the joints with a velocity of their own that move; `held` is whether they follow
    targets that hold from row to row, by a PD law.
    """
    found, motion = _clocks_of_files(motion, measured)
    measured = [j for j in measured if np.ptp(motion.q[:, j]) > 1e-9 and np.std(motion.v[:, j]) > 0]
    order = _order(motion, measured)
    if moved := [j for j in measured if order[j] != j]:
        judged = ranked(_orders(robot, moved, order), motion, robot)
        names = [robot.joints[j] for j in moved]
        found.append(finding_of(judged, ", ".join(names), {"joints": names}))
        motion = judged[0].cause.apply(motion)
    together, factors = _relation(motion)
    apart = [j for j in measured if abs(together[j]) < AGREES]
    for j in apart if not moved else ():
        level = "refusal" if abs(together[j]) < 0.5 else "warning"
        text = f"the velocity hardly correlates with dq/dt (correlation {together[j]:.2f})"
        remedy = "Check which column is its velocity; leave it out to differentiate the position."
        data = {"factor": float(factors[j]), "correlation": float(together[j])}
        found.append(Finding(level, "velocity_mismatch", robot.joints[j], text, remedy, data))
    measured = [j for j in measured if abs(together[j]) >= AGREES]
    if held and (fast := [j for j in measured if FACTOR < abs(factors[j] - 1) < _SETTLES]):
        found.append(_settling(motion, robot, fast, factors))
        measured = [j for j in measured if j not in fast]
    for _ in measured:
        together, factors = _relation(motion)
        group = _largest_group(factors, together, measured)
        if not group:
            break
        factor = nice(float(np.median(factors[group])))
        shared = len(measured) > 1 and _common(factors, measured, group)
        judged = ranked(_scales(robot, group, factor, shared, motion.rate), motion, robot)
        names = [robot.joints[j] for j in group]
        data = {"factor": float(np.median(factors[group])), "joints": names}
        found.append(finding_of(judged, "" if shared else ", ".join(names), data))
        motion = judged[0].cause.apply(motion)
    return found, motion


def _settling(motion: LogMotion, robot: RobotModel, fast: Sequence[int], factors: Array) -> Finding:
    """The finding of joints that move and settle between two rows, while their targets hold."""
    names = [robot.joints[j] for j in fast]
    ratios = ", ".join(number(factors[j], significant=3) for j in fast)
    text = f"dq/dt is {ratios} times the velocity: the joint reaches its target within the "
    text += f"{1e3 / motion.rate:.3g} ms between two rows, so that velocities at the rows are not "
    text += "those between them"
    remedy = "Record at a higher rate than that of the targets, such as 200 Hz."
    data = {"joints": names, "factors": [float(factors[j]) for j in fast]}
    return Finding("warning", "settles_between_rows", ", ".join(names), text, remedy, data)


def _relation(motion: LogMotion) -> tuple[Array, Array]:
    """(n,) correlations of dq/dt with velocities, and (n,) ratios of their standard deviations."""
    together = np.diag(correlation(motion.slopes, motion.v))
    sizes = [np.std(x, axis=0) for x in (motion.slopes, motion.v)]
    return together, np.sign(together) * sizes[0] / np.maximum(sizes[1], 1e-300)


def nice(factor: float) -> float:
    """A likely number near a factor, else the factor with three digits.

    Noise of the velocities makes an error of one or two per cent: whole numbers and their inverses
    are taken within 2.5 %, other ratios of small numbers and units within 1 %.
    """
    size = abs(factor)
    decade = 10.0 ** np.floor(np.log10(size))
    whole = [decade * 10.0**k * p for k in (0, 1) for p in (1, 2, 3, 4, 5)]
    whole += [10 * decade / p for p in (2, 3, 4, 5, 6, 8)]
    ratios = [decade * p / q for p, q in product(range(1, 11), (1, 2, 3, 4, 5, 10))]
    for options, tolerance in ((whole, 0.025), ([*ratios, *UNITS], 0.01)):
        best = min(options, key=lambda x: abs(np.log(x / size)))
        if abs(np.log(best / size)) < tolerance:
            return float(np.sign(factor) * (best if best in UNITS else float(f"{best:.9g}")))
    return float(np.sign(factor) * float(f"{size:.3g}"))


def _largest_group(factors: Array, together: Array, measured: Sequence[int]) -> list[int]:
    """The most joints whose factors are alike and not 1.

    A joint alone must differ by more than `together`, the correlation of its velocity and dq/dt,
    leaves open: what decorrelates them, such as a short motion at the log's start, scales them too.
    """
    apart = np.abs(factors - 1)
    left_open = _OPEN * np.sqrt(2 * (1 - np.minimum(np.abs(together), 1)))
    wrong = [j for j in measured if apart[j] > FACTOR]
    groups = [[i for i in wrong if abs(factors[i] / factors[j] - 1) < _ALIKE] for j in wrong]
    groups = [group for group in groups if len(group) > 1 or apart[group[0]] > left_open[group[0]]]
    return max(groups, key=len, default=[])


def _common(factors: Array, measured: Sequence[int], group: Sequence[int]) -> bool:
    """Whether a cause of all joints explains a group's factor: no other joint is right."""
    right = [j for j in measured if abs(factors[j] - 1) <= FACTOR]
    return not right and 3 * len(group) >= 2 * len(measured)


def _clocks_of_files(motion: LogMotion, measured: Sequence[int]) -> tuple[list[Finding], LogMotion]:
    """Findings about files whose clock differs from that of others, and the mended motion."""
    files = list(dict.fromkeys(motion.file.tolist()))
    if len(files) < 2 or len(measured) < 2:
        return [], motion
    factors = {}
    for file in files:
        together, own = _relation(motion.part(motion.file == file))
        good = [j for j in measured if together[j] > AGREES]
        if not good or np.ptp(np.log(own[good])) >= 2 * _ALIKE:
            return [], motion
        factors[file] = float(np.median(own[good]))
    if max(factors.values()) < (1 + FACTOR) * min(factors.values()):
        return [], motion
    found = []
    for file, factor in factors.items():
        if abs(factor - 1) > FACTOR:
            motion = clock_cause(nice(factor), file).apply(motion)
            found.append(clock_of_file(factor, file, factors))
    return found, motion


def clock_of_file(factor: float, file: str, factors: dict[str, float]) -> Finding:
    """The finding of a file whose clock has another factor than those of the other files."""
    cause = clock_cause(nice(factor), file)
    data = {"factor": factor, "map": cause.changes, "factors": factors}
    text = f"{cause.text}, unlike in other files"
    return Finding("refusal", "clock", file, text, remedy_of(cause.changes), data)


def clock_cause(factor: float, file: str = "") -> Cause:
    """A clock on which time passes too fast or too slowly, of all files or one."""

    def apply(motion: LogMotion) -> LogMotion:
        rows = np.full(len(motion.q), not file) | (motion.file == file)
        scale = np.where(rows, factor, 1.0)[:, None]
        own = {"slopes": motion.slopes / scale, "a": motion.a / scale}
        return replace(motion, **own, rate=motion.rate / (1.0 if file else factor))

    table = f'files."{file}"' if file else "time"
    how = f"{number(factor, significant=3)} times too fast"
    if factor < 1:
        how = f"{number(1 / factor, significant=3)} times too slowly"
    text = f"the clock runs {how}: dq/dt is {number(factor, significant=3)} times the velocity"
    return Cause("clock", text, {f"{table}.scale": factor}, apply, "the clock is wrong")


def of_joints(robot: RobotModel, joints: Sequence[int], value: object) -> object:
    """A value of the map for all joints, or for some by name."""
    if len(joints) == len(robot.joints):
        return value
    return {robot.joints[j]: value for j in joints}


def _scales(
    robot: RobotModel, group: Sequence[int], factor: float, shared: bool, rate: float
) -> list[Cause]:
    """Hypotheses that explain dq/dt = factor · velocity on a group of joints.

    `shared` is whether it may be the clock, on which the log has so many rows per second [Hz].
    """
    ratio = f"dq/dt is {number(factor, significant=3)} times the velocity"
    on = "" if len(group) == 1 else f" on all {len(group)} joints"
    causes = []
    known = ""
    for value, (what, unit, words) in UNITS.items():
        if abs(factor / value - 1) < _UNIT:
            known = what
            code = "degrees" if unit.startswith("deg") else "velocity_mismatch"
            si = "the velocities in rad/s" if what == "position" else "the positions in rad"
            text = f"{words} and {si}: {ratio}{on}"
            apply = multiplied(what, group, 1 / value if what == "position" else value)
            changes = {f"factors.{what}": of_joints(robot, group, unit)}
            causes.append(Cause(code, text, changes, apply, words))
    for what, value in (("velocity", factor), ("position", 1 / factor)):
        if what == known:
            continue
        changes = {f"factors.{what}": of_joints(robot, group, float(f"{value:.6g}"))}
        words = "velocities" if what == "velocity" else "positions"
        text = f"the {words} have the opposite sign{on}: {ratio}"
        if abs(factor + 1) > FACTOR:
            text = f"the {words} have another unit or gear ratio{on}: {ratio}"
        unusual = _UNLIKELY * (2 * bool(known) + (what == "position"))
        apply = multiplied(what, group, value)
        name = f"the {words} have another unit" if factor > 0 else f"the {words} are reversed"
        causes.append(Cause("velocity_mismatch", text, changes, apply, name, unusual))
    if shared and factor > 0:
        clock = clock_cause(factor)
        rare = 4 * bool(known) + 8 * (not plausible(rate / factor)) - 1
        causes.append(clock._replace(text=clock.text + on, handicap=_UNLIKELY * rare))
    return causes


def _order(motion: LogMotion, measured: Sequence[int]) -> dict[int, int]:
    """The joint whose velocity is that of each position: itself unless others fit far better."""
    joints = list(measured)
    own = {j: j for j in joints}
    if len(joints) < 2:
        return own
    slopes = motion.slopes[:, joints]
    v = motion.v[:, joints]
    together = np.abs(correlation(slopes, v))
    own_factors = _relation(motion)[1][joints][np.diag(together) > AGREES]
    if 2 * len(own_factors) >= len(joints):  # a cause of all joints leaves their order to be seen
        v = v * np.median(own_factors)
    both = np.sqrt(np.mean(slopes**2, axis=0))[:, None] + np.sqrt(np.mean(v**2, axis=0))
    apart = [np.sqrt(np.mean((slopes[:, [k]] - v) ** 2, axis=0)) for k in range(len(joints))]
    error = 2 * np.array(apart) / np.maximum(both, 1e-300)
    by_size = scipy.optimize.linear_sum_assignment(np.log(np.maximum(error, 1e-3)))[1].tolist()
    by_shape = scipy.optimize.linear_sum_assignment(-together)[1].tolist()
    for cycle in cycles_of(by_size):
        new, old = np.array([(error[a, by_size[a]], error[a, a]) for a in cycle]).T
        if new.min() < _SAME and (new < 0.5 * old).all():
            own |= {joints[a]: joints[by_size[a]] for a in cycle}
    for cycle in cycles_of(by_shape):
        new, old = np.array([(together[a, by_shape[a]], together[a, a]) for a in cycle]).T
        untouched = all(own[joints[a]] == joints[a] for a in cycle)
        if untouched and new.max() > AGREES and (old < 0.7).all() and (new > old).all():
            own |= {joints[a]: joints[by_shape[a]] for a in cycle}
    return own


def _orders(robot: RobotModel, moved: Sequence[int], order: dict[int, int]) -> list[Cause]:
    """Hypotheses about positions and velocities in different orders."""
    names = ", ".join(f"{robot.joints[j]} the velocity of {robot.joints[order[j]]}" for j in moved)
    text = f"columns are swapped: dq/dt of one joint correlates with another's velocity ({names})"
    causes = []
    for what in ("velocity", "position"):
        pairs = {j: order[j] for j in moved}
        if what == "position":
            pairs = {i: j for j, i in pairs.items()}

        def apply(motion: LogMotion, what: str = what, pairs: dict[int, int] = pairs) -> LogMotion:
            index = np.array([pairs.get(j, j) for j in range(motion.v.shape[1])])
            if what == "position":
                return replace(motion, q=motion.q[:, index], slopes=motion.slopes[:, index])
            return replace(motion, v=motion.v[:, index], a=motion.a[:, index])

        value = {robot.joints[j]: robot.joints[i] for j, i in pairs.items()}
        whose = {"velocity": "those of the velocities", "position": "those of the positions"}[what]
        text_ = f"{text}, {whose}"
        causes.append(
            Cause("swapped_columns", text_, {f"order.{what}": value}, apply, f"they are {whose}")
        )
    return causes


def cycles_of(order: list[int]) -> list[list[int]]:
    """The cycles of a permutation that move something."""
    left = {k for k, to in enumerate(order) if to != k}
    found = []
    while left:
        cycle = [min(left)]
        while order[cycle[-1]] != cycle[0]:
            cycle.append(order[cycle[-1]])
        found.append(cycle)
        left -= set(cycle)
    return found


# -- a clock too wrong to make a log of -----------------------------------------------------------


def plausible(rate: float) -> bool:
    """Whether a robot may be recorded at this rate [Hz]."""
    return _RATES[0] <= rate <= _RATES[1]


def gross_clock(cleaned: Sequence[Cleaned], findings: Sequence[Finding]) -> Finding | None:
    """The finding of a clock that is wrong by orders of magnitude, such as ms taken for seconds.

    Changes of the positions are compared with integrals of the velocities over windows of rows, on
    the log's own clock: such a log may have no half second. Without velocities, only a clock on
    which no robot is recorded is told.
    """
    factors = []
    for log in cleaned:
        for position, velocity in zip(log.made.positions, log.made.velocities, strict=False):
            if position is None or velocity is None or log.made.vehicle is not None:
                continue
            q = log.of(position)
            v = log.of(velocity)
            path = scipy.integrate.cumulative_trapezoid(np.interp(q.t, v.t, v.x), q.t, initial=0.0)
            step = max(5, len(q.t) // _WINDOWS)
            moved = np.column_stack([x[step:] - x[:-step] for x in (q.x, path)])
            together = correlation(moved[:, :1], moved[:, 1:])[0, 0]
            if together > AGREES:
                factors.append(float(np.std(moved[:, 0]) / np.std(moved[:, 1])))
    rate = float(np.median([log.reference.rate for log in cleaned]))
    if not factors:
        unit = next((k for k in _UNITS if rate > _RATES[1] and plausible(rate / k)), None)
        return None if unit is None else _too_fast(rate, unit)
    if max(factors) > (1 + FACTOR) * min(factors):
        return None
    factor = nice(float(np.median(factors)))
    if 1 / _GROSS < factor < _GROSS or plausible(rate) or not plausible(rate / factor):
        return None
    cause = clock_cause(factor)
    changes = cause.changes
    for unit, size in TIME.items():
        for finding in findings:
            taken = finding.data.get("unit") if finding.code == "time_unit" else None
            if taken in TIME and abs(size / (TIME[str(taken)] * factor) - 1) < 0.02:
                changes = {"time.unit": unit}
    return Finding("refusal", "clock", "", cause.text, remedy_of(changes), {"map": changes})


def _too_fast(rate: float, factor: float) -> Finding:
    """The finding of a log with so many rows per second that its time must be in a smaller unit."""
    text = f"the log has {number(rate, significant=3)} rows per second, at which no robot is "
    text += f"recorded: its clock runs {number(factor, significant=3)} times too fast, as where "
    text += "times in a smaller unit are read as seconds"
    changes: dict[str, object] = {"time.scale": factor}
    return Finding("refusal", "clock", "", text, remedy_of(changes), {"map": changes})
