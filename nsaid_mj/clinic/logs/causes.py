"""Causes that concern a whole log of a tree of joints, judged against each other.

"dq/dt is twice the velocity on every joint" can be a clock that runs twice too fast, a unit of the
velocities or one of the positions. Each hypothesis changes the motion in its own way, and so the
forces that the model needs for it: a clock and the velocities' unit scale accelerations, the
positions' unit changes the weight. The hypothesis under which the commands explain the motion best
is named, with the lines of map.toml that mend it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import scipy

from ...base import Finding, pin
from ...core import Array, number, positions
from ...robots import RobotModel
from . import signals
from .cleaning import Cleaned
from .mapping import TIME
from .recordings import Recordings
from .remedies import remedy_of

DEGREES = 180 / np.pi
AGREES = 0.9  # correlation of a velocity with dq/dt below which they contradict each other
FACTOR = 0.15  # relative error of a velocity's scale that noise and delay do not explain
_SAME = 0.3  # relative error of a velocity below which it is that of a position
_UNIT = 0.04  # relative difference of a factor and that of a unit that it may be
_ALIKE = 0.06  # spread of factors that one cause explains
_ROWS = 800  # at most, for the model's forces
_BAND = 4.0  # cut-off over the frequency below which 99 % of the positions' power lies
_DELAYS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16)  # of commands, common to all joints [s]
_EXACT = 0.005  # relative error of forces below which hypotheses are equally good
CLEAR = 0.8  # ratio of two hypotheses' errors below which the better one is certain
_CLEARLY = 0.5  # ratio of the errors of two signs of a command below which one is certain
_EXPLAINED = 0.6  # share of a command left unexplained above which its sign is not certain
_DISSIPATES = 0.97  # such a ratio where weight may have any sign
_LIKELY = 0.9  # such a ratio of a joint beside joints whose sign is certain
_SWAPPED = 0.5  # ratio of errors below which another joint's command fits better
_FITS = 0.05  # error of the commands up to which axes and base are not doubted
_BETTER = 0.7  # product of the joints' ratios of errors below which one more axis is turned
_TURNED = 0.2  # such a product below which a turned axis or base is certain
_OUTSIDE = 2.0  # factor of the error of a joint that leaves the model's limits
_RETIMED = 0.1  # such a product below which a clock is wrong that no velocity contradicts
_TIMES = (0.07, 0.1, 0.2, 0.33, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 10.0, 14.0)  # clocks to try
_USUAL = (0.1, 0.2, 0.25, 0.4, 0.5, 1.0, 2.0, 2.5, 4.0, 5.0, 10.0)  # those that are likely
_NEAR = 0.1  # relative difference from a likely one that masses of the model may make
_RATES = (4.0, 10_000.0)  # of robots' logs [Hz]
_GROSS = 80.0  # factor of a clock from which a log cannot be prepared; degrees are 57
_WINDOWS = 200  # windows of a log in which positions are compared with integrals of velocities
_PARSIMONY = 0.4  # handicap [log of the error] of a command of the other sign
_NEVER = 20.0  # such a handicap that excludes the other sign
_OTHER_BASES = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1.0]])
_UNLIKELY = 0.2  # handicap [log of the error] of a hypothesis that needs an unusual number
UNITS = {  # positions over velocities, by the unit that was not stated
    DEGREES: ("position", "deg", "the positions are in degrees"),
    1 / DEGREES: ("velocity", "deg/s", "the velocities are in deg/s"),
    2 * np.pi / 60: ("velocity", "rpm", "the velocities are in rpm"),
    1 / (2 * np.pi): ("position", "turns", "the positions are in turns"),
    2 * np.pi: ("velocity", "turns/s", "the velocities are in turns/s"),
}


@dataclass(frozen=True)
class Motion:
    """All segments in one piece, low-passed alike.

    Attributes:
        q: (N, n) positions.
        slopes: (N, n) their derivatives.
        v: (N, n) velocities.
        a: (N, n) derivatives of the velocities.
        u: (N, n_u) commands.
        usable: (N, n) whether a row may be used.
        file: (N,) name of the file of each row.
        segment: (N,) number of the segment of each row.
        rate: rows per second [Hz].
    """

    q: Array
    slopes: Array
    v: Array
    a: Array
    u: Array
    usable: np.ndarray
    file: np.ndarray
    segment: np.ndarray
    rate: float

    def part(self, rows: np.ndarray) -> Motion:
        """The motion of some rows, as a mask or a slice."""
        own = {k: x[rows] for k, x in vars(self).items() if k != "rate"}
        return replace(self, **own)


def motion_of(recordings: Recordings, scale: float = 4.0) -> Motion:
    """The motion, filtered at a multiple of the frequency of the positions themselves.

    The band follows the log's own clock, right or wrong. `scale` is the multiple.
    """
    rate = recordings.rate
    logs = [segment.log for segment in recordings.segments]
    cut = min(max(scale * _frequency([log.q for log in logs], rate), 20 / _longest(logs)), rate / 5)
    parts = []
    for number_, segment in enumerate(recordings.segments):
        _, q, v, u = segment.log
        slopes = v if q.shape[1] != v.shape[1] else np.gradient(q, 1 / rate, axis=0)
        soft = [signals.low_pass(x, cut / (0.5 * rate)) for x in (slopes, v, u)]
        a = np.gradient(soft[1], 1 / rate, axis=0)
        of = np.full(len(q), segment.source), np.full(len(q), number_)
        parts.append((q, *soft[:2], a, soft[2], segment.usable, *of))
    return Motion(*(np.concatenate(part) for part in zip(*parts, strict=True)), rate)


def _longest(logs: Sequence[Any]) -> float:
    return max(float(log.t[-1] - log.t[0]) for log in logs)


def _frequency(paths: Sequence[Array], rate: float) -> float:
    """The largest frequency, over the coordinates, below which 99 % of their power lies [Hz]."""
    q = max(paths, key=len)
    window = np.hanning(len(q))[:, None]
    power = np.abs(np.fft.rfft(scipy.signal.detrend(q, axis=0) * window, axis=0)) ** 2
    share = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
    bins = np.array([np.searchsorted(column, 0.99) for column in share.T])
    return float(np.median(bins) * rate / len(q))


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


# -- hypotheses -----------------------------------------------------------------------------------


class Cause(NamedTuple):
    """A hypothesis about the whole log, or some of its joints or files."""

    code: str  # of the finding
    text: str  # what it says is wrong
    changes: dict[str, object]  # values of map.toml that mend it, by table and key
    apply: Callable[[Motion], Motion]  # the motion as it would have been
    name: str = ""  # the hypothesis in a few words, where it is not the likeliest
    handicap: float = 0.0  # added to the logarithm of its error


class Judged(NamedTuple):
    """A hypothesis and what the commands say about it."""

    cause: Cause
    error: float  # geometric mean of the commands' relative errors, NaN without a model


def ranked(causes: Sequence[Cause], motion: Motion, robot: RobotModel) -> list[Judged]:
    """The hypotheses, the likeliest first."""
    judged = [Judged(cause, misfit(robot, cause.apply(motion))) for cause in causes]
    return sorted(judged, key=lambda one: _surprise(one))


def _surprise(one: Judged) -> float:
    return (0.0 if np.isnan(one.error) else np.log(one.error)) + one.cause.handicap


def finding_of(judged: Sequence[Judged], where: str, data: dict[str, object]) -> Finding:
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


# -- commands against the model -------------------------------------------------------------------


def forces_of(
    robot: RobotModel, motion: Motion, gravity: Array | None = None
) -> tuple[Array, Array]:
    """(N, n) weight and (N, n) inertial forces of the model's links along a motion."""
    model = robot.model
    if gravity is not None:
        model = pin.Model(model)
        model.gravity = pin.Motion(gravity, np.zeros(3))
    data = model.createData()
    whole = np.empty(motion.v.shape)
    weight = np.empty(motion.v.shape)
    rows = zip(positions(model, motion.q), motion.v, motion.a, strict=True)
    for k, (q, v, a) in enumerate(rows):
        whole[k] = pin.rnea(model, data, q, v, a)
        weight[k] = pin.computeGeneralizedGravity(model, data, q)
    return weight, whole - weight


def thinned(motion: Motion) -> tuple[np.ndarray, Motion]:
    """At most so many rows that the model's forces take little time, and their motion."""
    rows = np.arange(0, len(motion.q), max(1, len(motion.q) // _ROWS))
    return rows, motion.part(rows)


def late(motion: Motion, joint: int, delay: float, rows: np.ndarray) -> Array:
    """Commands (k,) of a joint that act after a delay [s], at some rows (k,)."""
    before = np.maximum(rows - round(delay * motion.rate), 0)
    before = np.where(motion.segment[before] == motion.segment[rows], before, rows)
    return np.asarray(motion.u[before, joint])


def columns_of(motion: Motion, joint: int) -> list[Array]:
    """Acceleration, velocity and direction (N,) of a joint: rotor and friction."""
    v = motion.v[:, joint]
    size = max(float(np.sqrt(np.mean(v**2))), 1e-12)
    return [motion.a[:, joint], v, np.tanh(v / (0.1 * size))]


class Explained:
    """Least squares of commands by a constant, columns times positive numbers, and free columns."""

    def __init__(self, columns: Sequence[Array], free: Sequence[Array] = ()):
        X = np.column_stack([*columns, *free, *(-x for x in free)])
        X = X - X.mean(axis=0)
        size = np.sqrt(np.mean(X**2, axis=0))
        self._Q, self._R = np.linalg.qr(X[:, size > 0] / size[size > 0])

    def error(self, u: Array, sign: int) -> float:
        """What is left of sign · u (N,), as a share of its deviation."""
        y = u - u.mean()
        total = float(np.sqrt(np.sum(y**2)))
        if total <= 0:
            return np.nan
        along = self._Q.T @ (y / total)
        left = scipy.optimize.nnls(self._R, sign * along)[1]
        return float(np.sqrt(max(1 - along @ along + left**2, 0.0)))


def driven_joints(robot: RobotModel, motion: Motion) -> list[int]:
    """Joints with a motor, a command that changes, and enough rows."""
    return [
        j
        for j, name in enumerate(robot.joints)
        if name not in robot.passive
        and motion.usable[:, j].sum() > 50
        and np.ptp(motion.u[:, j]) > 0
    ]


def misfit(
    robot: RobotModel,
    motion: Motion,
    handicap: float = _PARSIMONY,
    gravity: Array | None = None,
) -> float:
    """Geometric mean, over the joints, of the commands' errors under the model's links.

    A command may have any gain and constant, its joint friction and a rotor. The ratio of weight
    and inertia is the model's. A command of the other sign has a `handicap` [log of the error].
    NaN of a robot without masses, or if nothing moves.
    """
    if robot.weightless:
        return np.nan
    joints = driven_joints(robot, motion)
    if not joints:
        return np.nan
    rows, few = thinned(motion)
    weight, inertia = forces_of(robot, few, gravity)
    force = weight + inertia
    turned = np.exp(handicap)
    errors = np.full((len(_DELAYS), len(joints)), np.nan)
    for k, j in enumerate(joints):
        use = few.usable[:, j]
        model = Explained([x[use] for x in (force[:, j], *columns_of(few, j))])
        for d, delay in enumerate(_DELAYS):
            u = late(motion, j, delay, rows[use])
            errors[d, k] = min(model.error(u, 1), turned * model.error(u, -1))
    if np.isnan(errors).all():
        return np.nan
    return float(np.exp(np.nanmean(np.log(np.maximum(errors, _EXACT)), axis=1).min()))


# -- velocities against positions -----------------------------------------------------------------


def velocity_causes(
    motion: Motion, robot: RobotModel, measured: Sequence[int]
) -> tuple[list[Finding], Motion]:
    """Contradictions of velocities and dq/dt, one finding for each cause, and the mended motion.

    `measured` are the joints with a velocity of their own that move.
    """
    found = []
    for finding, motion in _clocks_of_files(motion, robot, measured):  # noqa: B020
        found.append(finding)
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
    for _ in measured:
        _, factors = _relation(motion)
        group = _largest_group(factors, measured)
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


def _relation(motion: Motion) -> tuple[Array, Array]:
    """(n,) correlations of dq/dt with the velocities, and (n,) their ratios, noise in both alike."""
    together = np.diag(correlation(motion.slopes, motion.v))
    sizes = [np.std(x, axis=0) for x in (motion.slopes, motion.v)]
    return together, np.sign(together) * sizes[0] / np.maximum(sizes[1], 1e-300)


def correlation(a: Array, b: Array) -> Array:
    """(k, l) correlation of columns of a (N, k) with columns of b (N, l); 0 for constant ones."""
    centred = [x - x.mean(axis=0) for x in (a, b)]
    sizes = [np.linalg.norm(x, axis=0) for x in centred]
    dot = centred[0].T @ centred[1]
    scale = np.outer(*sizes)
    return np.divide(dot, scale, out=np.zeros_like(dot), where=scale > 0)


def nice(factor: float) -> float:
    """A factor, or the number of two digits or the ratio of small numbers that is within 1 %."""
    size = abs(factor)
    decade = 10.0 ** np.floor(np.log10(size))
    options = [decade * p / q for p, q in product(range(1, 11), (1, 2, 3, 4, 5, 10))]
    options += [unit for unit in UNITS]
    best = min(options, key=lambda x: abs(np.log(x / size)))
    if abs(np.log(best / size)) > 0.01:
        best = float(f"{size:.3g}")
    return float(np.sign(factor) * (best if best in UNITS else float(f"{best:.9g}")))


def _largest_group(factors: Array, measured: Sequence[int]) -> list[int]:
    """The most joints whose factors are alike and not 1."""
    wrong = [j for j in measured if abs(factors[j] - 1) > FACTOR]
    groups = [[i for i in wrong if abs(factors[i] / factors[j] - 1) < _ALIKE] for j in wrong]
    return max(groups, key=len, default=[])


def _common(factors: Array, measured: Sequence[int], group: Sequence[int]) -> bool:
    """Whether a cause of all joints explains a group's factor: no other joint is right."""
    right = [j for j in measured if abs(factors[j] - 1) <= FACTOR]
    return not right and 3 * len(group) >= 2 * len(measured)


def _clocks_of_files(motion: Motion, robot: RobotModel, measured: Sequence[int]):
    """Findings about files whose clock differs from that of others, each with the mended motion."""
    files = list(dict.fromkeys(motion.file.tolist()))
    if len(files) < 2 or len(measured) < 2:
        return
    factors = {}
    for file in files:
        together, own = _relation(motion.part(motion.file == file))
        good = [j for j in measured if together[j] > AGREES]
        alike = good and np.ptp(np.log(own[good])) < 2 * _ALIKE
        if not alike:
            return
        factors[file] = float(np.median(own[good]))
    if max(factors.values()) < (1 + FACTOR) * min(factors.values()):
        return
    for file, factor in factors.items():
        if abs(factor - 1) > FACTOR:
            cause = _clock(nice(factor), file)
            motion = cause.apply(motion)
            data = {"factor": factor, "map": cause.changes, "factors": factors}
            text = f"{cause.text}; those of other files do not"
            remedy = remedy_of(cause.changes)
            yield Finding("refusal", "clock", file, text, remedy, data), motion


def _clock(factor: float, file: str = "") -> Cause:
    """A clock on which time passes too fast or too slowly, of all files or one."""

    def apply(motion: Motion) -> Motion:
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


def _scaled(what: str, joints: Sequence[int], factor: float) -> Callable[[Motion], Motion]:
    """The motion with positions or velocities of some joints multiplied by a factor."""

    def apply(motion: Motion) -> Motion:
        scale = np.ones(motion.v.shape[1])
        scale[list(joints)] = factor
        if what == "position":
            return replace(motion, q=motion.q * scale, slopes=motion.slopes * scale)
        return replace(motion, v=motion.v * scale, a=motion.a * scale)

    return apply


def _of(robot: RobotModel, joints: Sequence[int], value: object) -> object:
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
            apply = _scaled(what, group, 1 / value if what == "position" else value)
            changes = {f"factors.{what}": _of(robot, group, unit)}
            causes.append(Cause(code, text, changes, apply, words))
    for what, value in (("velocity", factor), ("position", 1 / factor)):
        if what == known:
            continue
        changes = {f"factors.{what}": _of(robot, group, float(f"{value:.6g}"))}
        words = "velocities" if what == "velocity" else "positions"
        text = f"the {words} have the opposite sign{on}: {ratio}"
        if abs(factor + 1) > FACTOR:
            text = f"the {words} have another unit or gear ratio{on}: {ratio}"
        unusual = _UNLIKELY * (2 * bool(known) + (what == "position"))
        apply = _scaled(what, group, value)
        name = f"the {words} have another unit" if factor > 0 else f"the {words} are reversed"
        causes.append(Cause("velocity_mismatch", text, changes, apply, name, unusual))
    if shared and factor > 0:
        clock = _clock(factor)
        rare = 4 * bool(known) + 8 * (not plausible(rate / factor)) - 1
        causes.append(clock._replace(text=clock.text + on, handicap=_UNLIKELY * rare))
    return causes


def _order(motion: Motion, measured: Sequence[int]) -> dict[int, int]:
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
    for cycle in _cycles(by_size):
        new, old = np.array([(error[a, by_size[a]], error[a, a]) for a in cycle]).T
        if new.min() < _SAME and (new < 0.5 * old).all():
            own |= {joints[a]: joints[by_size[a]] for a in cycle}
    for cycle in _cycles(by_shape):
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

        def apply(motion: Motion, what: str = what, pairs: dict[int, int] = pairs) -> Motion:
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


# -- commands, axes and base against the model ----------------------------------------------------


def command_causes(motion: Motion, robot: RobotModel) -> list[Finding]:
    """Commands in another order, axes or commands of the wrong sign, a base in another pose.

    All joints are judged at once; each cause is one finding.
    """
    if not driven_joints(robot, motion):
        return []
    found = []
    order = _order_of_commands(motion, robot)
    if moved := [j for j in order if order[j] != j]:
        finding, motion = _swapped(motion, robot, moved, order)
        found.append(finding)
    turned, motion = _turned(motion, robot)
    found += turned
    if not turned:
        found += _reversed(motion, robot)
    return found


def _errors(
    robot: RobotModel, motion: Motion, j: int, forces: tuple[Array, Array], u: Sequence[Array]
):
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


def _order_of_commands(motion: Motion, robot: RobotModel) -> dict[int, int]:
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
            u = [late(motion, c, delay, rows[use]) for delay in _DELAYS]
            errors[a, b] = max(min(min(model.error(x, s) for x in u) for s in (1, -1)), _EXACT)
    _, best = scipy.optimize.linear_sum_assignment(np.log(errors))
    order = dict(zip(joints, joints, strict=True))
    for cycle in _cycles(best.tolist()):
        gain = np.log([errors[a, best[a]] / errors[a, a] for a in cycle])
        if gain.mean() < np.log(_SWAPPED) and gain.max() < 0:
            order |= {joints[a]: joints[best[a]] for a in cycle}
    return order


def _cycles(order: list[int]) -> list[list[int]]:
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


def _swapped(
    motion: Motion, robot: RobotModel, moved: Sequence[int], order: dict[int, int]
) -> tuple[Finding, Motion]:
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


def _turned(motion: Motion, robot: RobotModel) -> tuple[list[Finding], Motion]:
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
    slow, scale = _best_clock(robot, motion)
    if slow < min(best, error) and (slow / plain) ** n < _RETIMED:
        cause = _clock(scale)
        how = cause.text.split(":")[0]
        text = (
            f"{how}: the model's weight and inertia fit the commands with {100 * slow:.2g} % error "
        )
        text += f"on that clock, and with {100 * plain:.2g} % on the log's own"
        data: dict[str, object] = {"factor": scale}
        remedy = "Find the true rate of the log, and set `[time]` `scale` in map.toml."
        if scale in _USUAL:
            data["map"] = cause.changes
            remedy = remedy_of(cause.changes)
        return [Finding("refusal", "clock", "", text, remedy, data)], motion
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
        changes["factors.command"] = _of(robot, sorted(wrong), -1)
    data = {"joints": names, "map": changes}
    remedy = remedy_of(changes)
    finding = Finding("refusal", "reversed_sign", ", ".join(names), text, remedy, data)
    return [finding], own


def _best_clock(robot: RobotModel, motion: Motion) -> tuple[float, float]:
    """The least error of the commands with all times multiplied, and this number.

    Weight does not depend on the clock, inertia does by its square.
    """

    def error(logarithm: float) -> float:
        k = float(np.exp(logarithm))
        own = {"slopes": motion.slopes / k, "v": motion.v / k, "a": motion.a / k**2}
        return misfit(robot, replace(motion, **own, rate=motion.rate / k), 0.0)

    grid = np.log(_TIMES)
    errors = [error(x) for x in grid]
    best = int(np.argmin(errors))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = scipy.optimize.minimize_scalar(error, bounds=around, options={"maxiter": 12})
    scale = float(np.exp(found.x))
    whole = min(_USUAL, key=lambda k: abs(np.log(k / scale)))
    if abs(np.log(whole / scale)) < _NEAR:
        scale = whole
    return float(found.fun), scale


def _starts(robot: RobotModel, motion: Motion) -> list[list[int]]:
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
    robot: RobotModel, motion: Motion, start: list[int], n: int
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


def _outside(robot: RobotModel, motion: Motion) -> int:
    """Number of joints that leave their limits by more than a twentieth of their range."""
    found = 0
    for j, name in enumerate(robot.joints):
        least, most, _ = limits(robot, name)
        slack = 0.05 * (most - least) if np.isfinite(most - least) else 0.0
        found += bool(
            (motion.q[:, j] < least - slack).any() or (motion.q[:, j] > most + slack).any()
        )
    return found


def scaled(joints: Sequence[int], factor: float, motion: Motion) -> Motion:
    """The motion with positions and velocities of some joints multiplied by a factor."""
    return _scaled("position", joints, factor)(_scaled("velocity", joints, factor)(motion))


def _mirrored(motion: Motion, joints: Sequence[int]) -> Motion:
    """The motion with the axes of some joints reversed."""
    return scaled(joints, -1.0, motion)


def _weight(robot: RobotModel) -> float:
    return float(np.linalg.norm(robot.model.gravity.linear))


def _wrong_signs(motion: Motion, robot: RobotModel) -> list[int]:
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
        u = [late(motion, j, delay, rows[use]) for delay in _DELAYS]
        (own, turned), (drives, brakes), (whole, wrong) = _errors(robot, few, j, forces, u).tolist()
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


def _reversed(motion: Motion, robot: RobotModel) -> list[Finding]:
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
    value = -1 if every else _of(robot, wrong, -1)
    changes: dict[str, object] = {"factors.command": value}
    data = {"joints": names, "map": changes}
    where = "" if every and len(joints) > 1 else ", ".join(names)
    return [Finding("refusal", "reversed_sign", where, text, remedy_of(changes), data)]


def _reversed_in_files(motion: Motion, robot: RobotModel) -> list[Finding]:
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


# -- a clock too wrong to make a log of -----------------------------------------------------------


def plausible(rate: float) -> bool:
    """Whether a robot may be recorded at this rate [Hz]."""
    return _RATES[0] <= rate <= _RATES[1]


def gross_clock(cleaned: Sequence[Cleaned], findings: Sequence[Finding]) -> Finding | None:
    """The finding of a clock that is wrong by orders of magnitude, such as ms taken for seconds.

    Changes of the positions are compared with integrals of the velocities over windows of rows, on
    the log's own clock: such a log may have no half second.
    """
    factors = []
    for log in cleaned:
        for position, velocity in zip(log.made.positions, log.made.velocities, strict=False):
            if position is None or velocity is None or log.made.vehicle is not None:
                continue
            q, v = log.of(position), log.of(velocity)
            path = scipy.integrate.cumulative_trapezoid(np.interp(q.t, v.t, v.x), q.t, initial=0.0)
            step = max(5, len(q.t) // _WINDOWS)
            moved = np.column_stack([x[step:] - x[:-step] for x in (q.x, path)])
            together = correlation(moved[:, :1], moved[:, 1:])[0, 0]
            if together > AGREES:
                factors.append(float(np.std(moved[:, 0]) / np.std(moved[:, 1])))
    if not factors or max(factors) > (1 + FACTOR) * min(factors):
        return None
    factor = nice(float(np.median(factors)))
    rate = float(np.median([log.reference.rate for log in cleaned]))
    if 1 / _GROSS < factor < _GROSS or plausible(rate) or not plausible(rate / factor):
        return None
    cause = _clock(factor)
    changes = cause.changes
    for unit, size in TIME.items():
        for finding in findings:
            taken = finding.data.get("unit") if finding.code == "time_unit" else None
            if taken in TIME and abs(size / (TIME[str(taken)] * factor) - 1) < 0.02:
                changes = {"time.unit": unit}
    return Finding("refusal", "clock", "", cause.text, remedy_of(changes), {"map": changes})
