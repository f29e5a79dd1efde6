"""Axes of a vehicle's log: velocities against the pose's derivative, and both against the commands.

Body rates must follow from the quaternion, and linear velocity from the position. Where they do
not, the axes, signs, order or frame under which they would are searched for, all at once.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from ...base import Finding
from ...core import Array, number
from ...robots import RobotModel
from . import signals
from .actuator_causes import Mask, Wiring, rewired, size_of
from .causes import DEGREES, clock_of_file, nice
from .layout import FRD, NED, pose_velocity
from .mapping import Vehicle
from .recordings import Recordings
from .remedies import remedy_of

_CONTRADICTS = 0.15  # difference of errors (0 to 1) from which other axes are certain
_HALF = 0.5  # ratio of errors below which they are
_UNRELATED = 0.6  # error above which a velocity follows from the pose in no axes
_UNUSUAL = 0.02  # handicap of each axis that is turned
_CHANGED = 0.05  # handicap of another order or direction of the quaternion, or frame
_GOOD = 0.3  # error below which a velocity's scale is that of the pose's derivative
_OFF = 0.3  # what a velocity of another scale than the pose's adds to its error
_FACTOR = 0.15  # relative error of a velocity's scale that noise does not explain
_ALIKE = 0.08  # relative difference of the scales of both velocities that a clock explains
_BLOCKS = 12  # parts of a log that must confirm small differences
_MOST_BLOCKS = 0.8  # share of them
_BAND = 5.0  # cut-off over the frequency of the motion
_LOUD = 3.0  # velocity over its noise below which an axis counts for little
_ROWS = 4000  # at most, for the sheet's forces
_SHORTEST = 0.1  # length of a segment, over that of the longest, that counts beside it
_UNSURE = 2.5  # factor by which a sheet's numbers may be off
_TRUST = 0.03  # error of the forces for which one of them is off by 100 %
_BALANCED = 0.02  # error up to which forces are equally good
_ROUNDING = 1e-16  # mean square of a force over the largest, below which it is 0
_CONFIRMS = 0.9  # the same in either half of the log, of other commands
_DRIVES = 0.6  # ratio of the errors of the sheet's forces below which other axes are certain


class TwistPart(NamedTuple):
    """A measured velocity, and what it might be."""

    name: str  # `linear` or `angular`
    measured: Array  # (N, k)
    bases: dict[str, Array]  # (N, k) velocities from the pose, by the words that name their axes
    weights: Array  # (k,) of the measured axes


class Match(NamedTuple):
    """A base with its axes turned, as a velocity that was measured."""

    part: TwistPart
    base: str
    turn: Array  # (k, k) signed permutation: measured = turn · base
    scale: float  # size of the base over that measured
    error: float  # 0 to 1: squared difference over the sum of squares, mean of the axes
    handicap: float


Motion = tuple[Array, Array, Array]
"""Poses (N, m), velocities (N, n) and commands (N, k) of a segment."""


class Pose(NamedTuple):
    """How to read the pose."""

    words: str
    changes: dict[str, object]
    q: Array
    handicap: float


def frame_causes(recordings: Recordings, robot: RobotModel) -> list[Finding]:
    """Findings about the axes of a vehicle's pose and velocities, and its clock."""
    vehicle = recordings.vehicle
    if vehicle is not None and vehicle.linear is None and vehicle.angular is None:
        return []
    found = _clocks_of_files(recordings, robot)
    accused = {finding.where for finding in found}
    matches, turned = _axes(recordings, robot, accused)
    if not matches:
        return []
    found += turned if accused else _axes_of_files(recordings, robot) or turned
    found += _clock(matches) if not accused else []
    if not found:
        found += _driven(recordings, robot)
    lost = [m for m in matches if m.error > _UNRELATED]
    for match in lost if not found else ():
        text = f"the {match.part.name} velocity does not follow from the pose under any axes"
        text += f" (error {100 * match.error:.2g} %)"
        remedy = "Check its columns, or leave out `linear` and `angular` to differentiate the pose."
        found.append(Finding("warning", "frame", match.part.name, text, remedy))
    return found


def _axes(
    recordings: Recordings, robot: RobotModel, but: Container[str] = ()
) -> tuple[list[Match], list[Finding]]:
    """How the velocities follow from the pose in the longest segment, if possible but some files'.

    Under other axes, with the finding about them, if they do so far better; nothing where there
    are no velocities.
    """
    vehicle = recordings.vehicle
    rate = recordings.rate
    q, v = _longest_of(recordings, robot, but)
    judged = []
    for pose in _poses(q, vehicle):
        matches = [best(part) for part in _parts(pose.q, v, rate, vehicle)]
        total = pose.handicap + sum(match.handicap for match in matches)
        judged.append((total + sum(map(_contradiction, matches)), pose, matches))
    own = [as_is(part) for part in _parts(q, v, rate, vehicle)]
    _, pose, matches = min(judged, key=lambda one: one[0])
    before = np.array([_contradiction(match) for match in own])
    after = np.array([_contradiction(match) for match in matches])
    if before.sum() - after.sum() < _CONTRADICTS or (after > _HALF * before).all():
        return own, _other_axes(q, v, rate, vehicle)
    whose = "twist"
    if all(np.array_equal(m.turn, FRD) for m in matches):
        whose = _wrong_one(recordings, robot)
    return matches, _turned(pose, matches, own, vehicle, whose)


def _other_axes(q: Array, v: Array, rate: float, vehicle: Vehicle | None) -> list[Finding]:
    """The finding of a velocity along the world's axes where the body's are stated, or vice versa.

    A vehicle that stays level and heads one way has nearly the same in both: they are told apart
    by small differences, which most parts of the log must confirm.
    """
    if vehicle is None:
        return []
    flat = q.shape[1] == 3
    heading = q[:, 2:3] * [0.0, 0.0, 1.0] if flat else np.zeros((0, 3))
    turns = (Rotation.from_rotvec(heading) if flat else Rotation.from_quat(q[:, 3:])).as_matrix()
    words = []
    changes: dict[str, object] = {}
    ratios = []
    for part in _parts(q, v, rate, vehicle):
        linear = part.name == "linear"
        stated = vehicle.twist if linear else vehicle.angular_axes
        other = "world" if stated == "body" else "body"
        measured = part.measured
        k = measured.shape[1]
        if flat and not linear:  # a yaw rate
            continue
        base = part.bases[other]
        if stated == "world":  # it was turned into the body's axes
            measured = np.einsum("nij,nj->ni", turns[:, :k, :k], measured)
        own_error = _block_errors(part.measured, part.bases["body"], part.weights)
        error = _block_errors(measured, base, part.weights)
        better = np.mean(error < own_error)
        if better >= _MOST_BLOCKS and error.sum() < _HALF * own_error.sum():
            words.append(f"the {part.name} velocity is along the {other}'s axes")
            changes["vehicle.twist" if linear else "vehicle.angular_axes"] = other
            ratios.append(float(np.sqrt(error.sum() / own_error.sum())))
    if not words:
        return []
    text = f"velocities contradict the pose: {'; '.join(words)} (differences fall to "
    text += f"{', '.join(f'{100 * ratio:.2g} %' for ratio in ratios)} of those now, in nearly all "
    text += "parts of the log)"
    return [Finding("refusal", "frame", "", text, remedy_of(changes), {"map": changes})]


def _block_errors(x: Array, y: Array, weights: Array) -> Array:
    """(b,) squared differences of x and y (N, k) in parts of a log, over each axis' size."""
    size = np.maximum(np.mean(x**2, axis=0), 1e-300)
    squares = (x - y) ** 2 / size @ weights
    return np.array([part.sum() for part in np.array_split(squares, _BLOCKS)])


def _axes_of_files(recordings: Recordings, robot: RobotModel) -> list[Finding]:
    """Findings about files whose axes or units are not those of the others; no line mends one."""
    files = list(dict.fromkeys(segment.source for segment in recordings.segments))
    if len(files) < 2:
        return []
    said = {file: _axes(recordings, robot, set(files) - {file})[1] for file in files}
    right = [file for file in files if not said[file]]
    if not right:
        return []
    remedy = f"Convert its columns to what they are in {', '.join(right)}, or leave the file out."
    return [
        replace(f, where=file, text=f"{f.text}, in this file alone", remedy=remedy, data={})
        for file in files
        for f in said[file]
    ]


def _longest_of(
    recordings: Recordings, robot: RobotModel, but: Container[str] = ()
) -> tuple[Array, Array]:
    """Pose (N, m) and twist (N, n) of the longest segment, if possible not of some files."""
    segments = [segment for segment in recordings.segments if segment.source not in but]
    log = max((segment.log for segment in segments or recordings.segments), key=lambda x: len(x.t))
    if robot.system.group == 6:  # what a vehicle carries, such as an arm, has its own joints
        return log.q[:, :7], log.v[:, :6]
    return log.q, log.v


def _clocks_of_files(recordings: Recordings, robot: RobotModel) -> list[Finding]:
    """Findings about files whose clock differs from that of others."""
    files = list(dict.fromkeys(segment.source for segment in recordings.segments))
    vehicle = recordings.vehicle
    if len(files) < 2 or (vehicle is not None and vehicle.linear is None):
        return []
    factors = {}
    for file in files:
        q, v = _longest_of(recordings, robot, set(files) - {file})
        good = [m for m in map(best, _parts(q, v, recordings.rate, vehicle)) if m.error < _GOOD]
        scales = [m.scale for m in good]
        if len(good) < 2 or abs(np.log(scales[0] / scales[1])) > _ALIKE:
            return []
        factors[file] = float(np.sqrt(scales[0] * scales[1]))
    if max(factors.values()) < (1 + _FACTOR) * min(factors.values()):
        return []
    return [
        clock_of_file(factor, file, factors)
        for file, factor in factors.items()
        if abs(factor - 1) > _FACTOR
    ]


def _poses(q: Array, vehicle: Vehicle | None) -> Iterator[Pose]:
    """The pose as it is read, and with its attitude in another unit, order or direction."""
    yield Pose("", {}, q, 0.0)
    if q.shape[1] == 3 or vehicle is None:
        return
    if vehicle.quaternion is None:
        yield _other_unit(q, vehicle)
        return
    ned = vehicle.frame == "NED/FRD"
    turn = Rotation.from_quat(q[:, 3:]).as_matrix()
    raw = Rotation.from_matrix(NED.T @ turn @ FRD if ned else turn).as_quat()
    first = vehicle.order == "wxyz"
    # a log's w, x, y, z was taken for x, y, z, w, or the other way round
    other = np.roll(raw, 1, axis=1) if first else np.roll(raw, -1, axis=1)
    order = "xyzw" if first else "wxyz"
    for swapped, inverse in ((False, True), (True, False), (True, True)):
        turns = Rotation.from_quat(other if swapped else raw)
        turns = turns.inv() if inverse else turns
        found = turns.as_matrix()
        found = Rotation.from_matrix(NED @ found @ FRD if ned else found).as_quat()
        changes: dict[str, object] = {}
        words = []
        if swapped:
            changes["vehicle.order"] = order
            words.append(f"the quaternion's order is {order}")
        if inverse:
            changes["vehicle.inverse"] = not vehicle.inverse
            direction = "body to world" if vehicle.inverse else "world to body"
            words.append(f"the quaternion turns from {direction}")
        own = np.hstack([q[:, :3], found])
        yield Pose(" and ".join(words), changes, own, _CHANGED * len(changes))


def _other_unit(q: Array, vehicle: Vehicle) -> Pose:
    """The pose with roll, pitch and yaw in radians where degrees were read, or the other way."""
    ned = vehicle.frame == "NED/FRD"
    turn = Rotation.from_quat(q[:, 3:]).as_matrix()
    raw = Rotation.from_matrix(NED.T @ turn @ FRD if ned else turn)
    unit, factor = ("rad", 180 / np.pi) if vehicle.euler_unit == "deg" else ("deg", np.pi / 180)
    found = Rotation.from_euler("ZYX", factor * raw.as_euler("ZYX")).as_matrix()
    found = Rotation.from_matrix(NED @ found @ FRD if ned else found).as_quat()
    words = f"roll, pitch and yaw are in {unit}, not in {vehicle.euler_unit}"
    changes: dict[str, object] = {"vehicle.euler_unit": unit}
    return Pose(words, changes, np.hstack([q[:, :3], found]), _CHANGED)


def _parts(q: Array, v: Array, rate: float, vehicle: Vehicle | None) -> list[TwistPart]:
    """Measured velocities and those from the pose, all low-passed alike."""
    flat = q.shape[1] == 3
    count = 2 if flat else 3
    body = pose_velocity(q, rate)
    world = np.gradient(q[:, :count], 1 / rate, axis=0)
    cut = slow_band(body, rate)
    soft = signals.low_pass(body, cut)
    slow = signals.low_pass(v, cut)
    noise = np.array([signals.noise(x) for x in v.T]) * np.sqrt(cut)
    loud = np.std(slow, axis=0) > _LOUD * noise
    weights = np.where(loud, 1.0, 0.1)
    parts = []
    if vehicle is None or (vehicle.position is not None and vehicle.linear is not None):
        around = signals.low_pass(world, cut)
        bases = {"body": soft[:, :count], "world": around}
        if not flat:
            turns = Rotation.from_quat(q[:, 3:]).inv()
            bases["other world"] = turns.apply(around @ NED.T)
        parts.append(TwistPart("linear", slow[:, :count], bases, weights[:count]))
    if vehicle is not None and not flat and vehicle.angular is None:
        return parts
    bases = {"body": soft[:, count:]}
    if not flat:
        bases["world"] = Rotation.from_quat(q[:, 3:]).apply(soft[:, count:])
    parts.append(TwistPart("angular", slow[:, count:], bases, weights[count:]))
    return parts


def slow_band(v: Array, rate: float) -> float:
    """Cut-off of a low-pass that keeps the motion of velocities v (N, k), over half the rate."""
    return min(_BAND * _frequency(v, rate), rate / 5) / (0.5 * rate)


def _frequency(x: Array, rate: float) -> float:
    """The frequency below which most of the integrals' power lies [Hz]."""
    path = np.cumsum(x - x.mean(axis=0), axis=0)
    power = np.abs(np.fft.rfft(path * np.hanning(len(x))[:, None], axis=0)) ** 2
    share = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
    bins = np.array([np.searchsorted(column, 0.98) for column in share.T])
    return float(max(np.median(bins), 1) * rate / len(x))


def as_is(part: TwistPart) -> Match:
    """A velocity along the axes that the map states."""
    return _match(part, "body", np.eye(part.measured.shape[1]))


def _match(part: TwistPart, base: str, turn: Array) -> Match:
    measured = part.measured
    other = part.bases[base]
    # sums of squares and of products, of each velocity along the axes of the measured ones
    own = np.diag(measured.T @ measured)
    theirs = np.diag(turn @ (other.T @ other) @ turn.T)
    both = np.diag(measured.T @ other @ turn.T)
    scale = float(np.sqrt(theirs.sum()) / max(np.sqrt(own.sum()), 1e-300))
    whole = scale**2 * own + theirs
    difference = np.maximum(whole - 2 * scale * both, 0.0)
    error = 0.5 * np.where(whole > 0, difference / np.maximum(whole, 1e-300), 1.0)  # 1: one is 0
    turned = int(np.sum(np.diag(turn) != 1))
    handicap = _UNUSUAL * turned + _CHANGED * (base != "body") + _CHANGED * (base == "other world")
    return Match(
        part, base, turn, scale, float(error @ part.weights / part.weights.sum()), handicap
    )


def best(part: TwistPart) -> Match:
    """The axes in which a velocity follows best from the pose."""
    turns = signed_permutations(part.measured.shape[1])
    matches = [_match(part, base, turn) for base in part.bases for turn in turns]
    return min(matches, key=lambda match: match.error + match.handicap)


def signed_permutations(k: int) -> list[Array]:
    """All orders and signs of k axes, (k, k) each."""
    found = []
    for order, signs in product(permutations(range(k)), product((1.0, -1.0), repeat=k)):
        turn = np.zeros((k, k))
        turn[np.arange(k), order] = signs
        found.append(turn)
    return found


def _turned(
    pose: Pose,
    matches: Sequence[Match],
    own: Sequence[Match],
    vehicle: Vehicle | None,
    whose: str,
) -> list[Finding]:
    """The finding of axes other than stated, if any.

    `whose` is `pose` or `twist`, whichever the sheet's forces contradict.
    """
    words = [pose.words] if pose.words else []
    changes = dict(pose.changes)
    frames = [np.array_equal(m.turn, FRD) and m.base == "body" for m in matches]
    together = len(frames) == 2 and all(frames)
    if together:
        other = "NED/FRD"
        if vehicle is not None and vehicle.frame == other:
            other = "ENU/FLU"
        if whose == "pose":
            words.append(f"the pose is in {other} axes, which both velocities are not")
            changes["vehicle.frame"] = other
        else:
            words.append(f"both velocities are in {other[4:]} axes, which the pose is not")
    for match in matches:
        name = match.part.name
        turn = match.turn
        plain = np.array_equal(turn, np.eye(len(turn)))
        if match.base == "other world":
            words.append("the position is in other world axes than the quaternion (NED and ENU)")
            changes |= columns_of("position", raw_turn(NED, vehicle, True), vehicle)
        elif match.base == "world" and name == "linear":
            words.append("the linear velocity is along the world's axes")
            changes["vehicle.twist"] = "world"
        elif match.base == "world":
            words.append("the angular velocity is along the world's axes")
            changes["vehicle.angular_axes"] = "world"
        if plain:
            continue
        world = match.base == "world"
        if not together:
            words.append(f"the {name} velocity is along {said_axes(turn, world, vehicle)}")
        changes |= columns_of(name, raw_turn(turn, vehicle, world), vehicle)
    if not words:
        return []
    before, after = (100 * float(np.mean([m.error for m in some])) for some in (own, matches))
    text = f"velocities contradict the pose: {'; '.join(words)}"
    text += f" (squared error {before:.2g} % → {after:.2g} %)"
    if vehicle is None:
        changes = {}
    data = {"map": changes, "error": before, "turned": after}
    return [Finding("refusal", "frame", "", text, remedy_of(changes), data)]


_BODY = (("forward", "backward"), ("left", "right"), ("up", "down"))
_WORLD = (("east", "west"), ("north", "south"), ("up", "down"))


def said_axes(turn: Array, world: bool, vehicle: Vehicle | None) -> str:
    """The measured axes in words, such as `backward-left-down in place of forward-left-up`."""
    given = np.eye(len(turn))
    if vehicle is not None and vehicle.frame == "NED/FRD" and len(turn) == 3:
        given = NED.T if world else FRD
    directions = _WORLD if world else _BODY
    names = []
    for axes in (given @ turn, given):
        places = [int(np.argmax(np.abs(row))) for row in axes]
        signs = [row[k] < 0 for row, k in zip(axes, places, strict=True)]
        if len(turn) == 1:
            names.append("clockwise" if signs[0] else "counterclockwise")
        else:
            names.append(
                "-".join(directions[k][int(s)] for k, s in zip(places, signs, strict=True))
            )
    return f"{names[0]} in place of {names[1]}"


def raw_turn(turn: Array, vehicle: Vehicle | None, world: bool) -> Array:
    """A turn of our axes as one of the log's own."""
    if vehicle is None or vehicle.frame == "ENU/FLU" or len(turn) < 3:
        return turn
    axes = NED if world else FRD
    return axes.T @ turn @ axes


def columns_of(name: str, turn: Array, vehicle: Vehicle | None) -> dict[str, object]:
    """The line of the map with a quantity's columns in the order and signs that undo a turn."""
    given = getattr(vehicle, name, None) if vehicle is not None else None
    if given is None or len(given) < len(turn):
        return {}
    names = list(given)
    for k in range(len(turn)):
        source = int(np.argmax(np.abs(turn[:, k])))
        bare = given[source].removeprefix("-")
        sign = (-1 if given[source].startswith("-") else 1) * turn[source, k]
        names[k] = f"-{bare}" if sign < 0 else bare
    return {f"vehicle.{name}": names}


def _contradiction(match: Match) -> float:
    """How far a velocity is from one that follows from the pose: its error, and another scale."""
    return match.error + _OFF * _off(match)


def _off(match: Match) -> bool:
    """Whether a velocity has another scale than the pose, whichever of both has the noise."""
    together = max(1 - 2 * match.error, 0.0)  # their correlation
    low = together * match.scale
    high = match.scale / max(together, 1e-3)
    return low > 1 + _FACTOR or high < 1 - _FACTOR


def _clock(matches: Sequence[Match]) -> list[Finding]:
    """The finding of a clock, or of one velocity in another unit."""
    good = [m for m in matches if m.error < _GOOD]
    off = [m for m in good if _off(m)]
    if not off:
        return []
    scales = [m.scale for m in good]
    if len(good) == 2 and abs(np.log(scales[0] / scales[1])) < _ALIKE:
        factor = nice(float(np.sqrt(scales[0] * scales[1])))
        how = f"{number(factor, significant=3)} times too fast"
        if factor < 1:
            how = f"{number(1 / factor, significant=3)} times too slowly"
        text = f"the clock runs {how}: the pose changes {number(factor, significant=3)} times as "
        text += "fast as both velocities say"
        changes: dict[str, object] = {"time.scale": factor}
        return [Finding("refusal", "clock", "", text, remedy_of(changes), {"map": changes})]
    found = []
    for match in off:
        name = match.part.name
        text = f"the pose changes {number(match.scale, significant=3)} times as fast as the {name} "
        text += "velocity says"
        changes = {}
        if name == "angular" and abs(match.scale * DEGREES - 1) < _FACTOR:
            text = f"the angular velocity is in deg/s: {text}"
            changes = {"vehicle.angular_unit": "deg/s"}
        data = {"factor": match.scale, "map": changes}
        found.append(Finding("refusal", "velocity_mismatch", name, text, remedy_of(changes), data))
    return found


def _driven(recordings: Recordings, robot: RobotModel) -> list[Finding]:
    """The finding of a frame, or of commands, under which the sheet's forces fit far better.

    Pose and velocities may agree and yet be in north-east-down axes throughout.
    """
    vehicle = recordings.vehicle
    motions = _longest(recordings)
    balance = SheetBalance(robot, motions, recordings)
    own = balance.errors()
    driven = balance.driven
    found: list[tuple[Array, str, str, dict[str, object]]] = []
    ratio = _DRIVES
    stated = vehicle if robot.system.group == 6 else None
    for axes in other_axes(stated) if stated else ():
        assert stated is not None
        turned = [(*read_as(q, v, stated, axes), u) for q, v, u in motions]
        error = SheetBalance(robot, turned, recordings).errors()
        if _ratio(error, own) < ratio:
            found.append((error, "frame", axes_in_words(axes), axes))
            ratio = _DRIVES * _ratio(error, own)  # of two changes, each must be needed
    signed = np.any([(u < 0).any(axis=0) for _, _, u in motions], axis=0)
    other = rewired(balance.errors, signed, driven)
    if other is not None and _confirmed(other[0], robot, motions, recordings):
        wiring, error = other
        names = list(robot.joints)
        changes = wiring.changes(names)
        code = "order" if "order.command" in changes else "reversed_sign"
        found.append((error, code, wiring.in_words(names), changes))
    if not found:
        return []
    error, code, text, changes = min(found, key=lambda one: size_of(one[0], driven))
    text += f": the sheet's forces then fit with {100 * error[driven].mean():.2g} % error instead "
    text += f"of {100 * own[driven].mean():.2g} %"
    return [Finding("refusal", code, "", text, remedy_of(changes), {"map": changes})]


def _confirmed(
    wiring: Wiring, robot: RobotModel, motions: Sequence[Motion], recordings: Recordings
) -> bool:
    """Whether either half of a log fits better under a wiring.

    Only changes of forces count, as constant ones may be anything: a robot that lies still while a
    command differs from zero fits any wiring.
    """
    halves = zip(
        *([(q[a], v[a], u[a]) for a in _halves(len(q))] for q, v, u in motions), strict=True
    )
    for half in halves:
        balance = SheetBalance(robot, half, recordings, changes=True)
        driven = balance.driven
        if not driven.any():
            return False
        if not size_of(balance.errors(wiring), driven) < _CONFIRMS * size_of(
            balance.errors(), driven
        ):
            return False
    return True


def _halves(count: int) -> tuple[slice, slice]:
    return slice(None, count // 2), slice(count // 2, None)


def other_axes(vehicle: Vehicle) -> list[dict[str, object]]:
    """Changes of the map to other axes of a log in space, those of one value first.

    Which axes the linear velocity has is open where no position tells it.
    """
    frame = "NED/FRD" if vehicle.frame == "ENU/FLU" else "ENU/FLU"
    whole: dict[str, object] = {"vehicle.frame": frame}
    if vehicle.linear is None or vehicle.position is not None:
        return [whole]
    alone: dict[str, object] = {"vehicle.twist": "world" if vehicle.twist == "body" else "body"}
    return [whole, alone, whole | alone]


def axes_in_words(axes: dict[str, object]) -> str:
    """Such changes in words."""
    words = []
    if "vehicle.frame" in axes:
        words.append(f"pose and velocities are in {axes['vehicle.frame']} axes")
    if "vehicle.twist" in axes:
        words.append(f"the linear velocity is along the {axes['vehicle.twist']}'s axes")
    return " and ".join(words)


def read_as(q: Array, v: Array, vehicle: Vehicle, axes: dict[str, object]) -> tuple[Array, Array]:
    """Poses (N, m) and twists (N, n) in our axes, had the map stated other axes."""
    turned = "vehicle.frame" in axes
    if "vehicle.twist" not in axes:
        return (other_pose(q), other_twist(v)) if turned else (q, v)
    ned = vehicle.frame == "NED/FRD"
    linear = v[:, :3]  # as the log has it
    if vehicle.twist == "world":
        linear = Rotation.from_quat(q[:, 3:7]).apply(linear)
        linear = linear @ NED if ned else linear
    elif ned:
        linear = linear @ FRD
    ned = ned != turned
    if turned:
        q, v = other_pose(q), other_twist(v)
    if vehicle.twist == "body":
        world = linear @ NED.T if ned else linear
        linear = Rotation.from_quat(q[:, 3:7]).inv().apply(world)
    elif ned:
        linear = linear @ FRD
    return q, np.hstack([linear, v[:, 3:]])


def _wrong_one(recordings: Recordings, robot: RobotModel) -> str:
    """Whether the sheet's forces contradict the frame of the `pose` or that of the `twist`."""
    motions = _longest(recordings)
    twisted = [(q, other_twist(v), u) for q, v, u in motions]
    posed = [(other_pose(q), v, u) for q, v, u in motions]
    by_twist = SheetBalance(robot, twisted, recordings).errors()
    by_pose = SheetBalance(robot, posed, recordings).errors()
    return "pose" if _ratio(by_pose, by_twist) < 1 else "twist"


def _ratio(errors: Array, others: Array) -> float:
    """Geometric mean of the velocities' (n,) errors over others."""
    return float(np.exp(np.mean(np.log(errors / others))))


def _longest(recordings: Recordings) -> list[Motion]:
    """Poses, velocities and commands of the longest segments, of so many rows at most."""
    found: list[Motion] = []
    left = _ROWS
    for segment in sorted(recordings.segments, key=lambda one: -len(one.log.t)):
        _, q, v, u = (x[:left] for x in segment.log)
        if found and len(q) < _SHORTEST * len(found[0][0]):
            break
        found.append((q, v, u))
        left -= len(q)
    return found


def other_pose(q: Array) -> Array:
    """Poses (N, m) in ENU/FLU axes of numbers that are in NED/FRD axes, or the other way round."""
    turn = NED @ Rotation.from_quat(q[:, 3:7]).as_matrix() @ FRD
    return np.hstack([q[:, :3] @ NED.T, Rotation.from_matrix(turn).as_quat(), q[:, 7:]])


def other_twist(v: Array) -> Array:
    """Twists (N, n) likewise."""
    return np.hstack([v[:, :3] @ FRD, v[:, 3:6] @ FRD, v[:, 6:]])


class SheetBalance:
    """The forces of a vehicle's sheet along a motion, of which commands may be exchanged.

    Its numbers are as uncertain as sheets are, none of another sign. Without the linear velocities
    where these are not measured. With `changes`, mean forces do not count.

    Attributes:
        driven: (n,) velocities on which actuators act.
    """

    def __init__(
        self,
        robot: RobotModel,
        motions: Sequence[Motion],
        recordings: Recordings,
        changes: bool = False,
    ):
        assert robot.prior is not None  # every vehicle has one
        system = robot.system
        rate = recordings.rate
        cut = slow_band(motions[0][1], rate)
        moving = []
        for q, v, _ in motions:
            slow = signals.low_pass(v, cut)
            a = np.gradient(slow, 1 / rate, axis=0)
            moving.append((np.arange(len(q)) / rate, np.hstack([q, slow]), slow, a))
        self._acting = np.zeros(len(system.space), bool)
        self._acting[system.space.actuators] = True
        self._measured = slice(3 if recordings.turns_only else 0, None)
        units = np.array(system.velocity_units[self._measured])
        self._alike = (units[:, None] == units).astype(float)  # velocities of one unit share a size
        self._prior = robot.prior
        columns = system.structure.columns
        self._input = {c.parameter: c.input for c in columns if self._acting[c.parameter]}

        def parts(commands: Sequence[Array], wanted: Mask) -> Array:
            found = []
            for motion, u in zip(moving, commands, strict=True):
                W = system.regressor(*motion, u)[:, self._measured]
                # a tyre at rest has no slip
                W = (np.where(np.isfinite(W), W, 0.0) * self._prior)[:, :, wanted]
                forces = signals.low_pass(W.reshape(len(W), -1), cut).reshape(W.shape)
                found.append(forces - forces.mean(axis=0) if changes else forces)
            return np.concatenate(found)

        self._parts = parts
        self._u = [u for _, _, u in motions]
        self._own = parts(self._u, np.ones(len(self._acting), bool))
        sizes = np.mean(self._own**2, axis=0)
        self.driven = sizes[:, self._acting].mean(axis=1) > _ROUNDING * sizes.max(axis=1)

    def errors(self, wiring: Wiring | None = None) -> Array:
        """(n,) errors of the forces over the size of all, with the commands of a wiring."""
        products = _products(self._own) if wiring is None else self._rewired(wiring)
        acting = self._acting.astype(float)

        def sizes(*shares: Array) -> Array:
            """(n,) of the sum of forces, each of parts times shares (p,)."""
            squares = sum(np.einsum("nij,i,j->n", products, x, x) for x in shares)
            return np.sqrt(self._alike @ np.maximum(squares, 0.0))

        driven = sizes(acting)
        whole = sizes(np.ones(len(acting)))
        size = np.where(driven > 0, driven, np.where(whole > 0, whole, 1.0))  # 0 without actuators
        share = _shares(np.mean(products / (size**2)[:, None, None], axis=0))
        size = np.maximum(sizes(share * acting, share * (1 - acting)), 1e-300)
        left = np.einsum("nij,i,j->n", products, share, share)
        return np.maximum(np.sqrt(np.maximum(left, 0.0)) / size, _BALANCED)

    def _rewired(self, wiring: Wiring) -> Array:
        """(n, p, p) mean products of two parts with the commands of a wiring."""
        products, place = self._of_all_commands
        commands = zip(wiring.source, wiring.sign, strict=True)
        followed = dict(enumerate(commands))
        used = [place[i, followed.get(self._input.get(i, -1))] for i in range(len(self._acting))]
        return products[:, used][:, :, used]

    @cached_property
    def _of_all_commands(self) -> tuple[Array, dict[tuple[int, tuple[int, int] | None], int]]:
        """(n, P, P) mean products of all parts that there may be, and the place of each.

        Those of actuators are there with every command of either sign.
        """
        fixed = [i for i in range(len(self._acting)) if i not in self._input]
        place: dict[tuple[int, tuple[int, int] | None], int] = {}
        place |= {(i, None): k for k, i in enumerate(fixed)}
        parts = [self._own[:, :, fixed]]
        acting = sorted(self._input)
        wanted = np.isin(np.arange(len(self._acting)), acting)
        for command in product(range(self._u[0].shape[1]), (1, -1)):
            k, sign = command
            place |= {(i, command): len(place) + at for at, i in enumerate(acting)}
            own = [sign * np.repeat(u[:, [k]], u.shape[1], axis=1) for u in self._u]
            parts.append(self._parts(own, wanted))
        return _products(np.concatenate(parts, axis=2)), place


def _products(parts: Array) -> Array:
    """(n, p, p) means over the rows of the products of any two of forces (N, n, p)."""
    by_velocity = np.moveaxis(parts, 1, 0)
    return np.matmul(by_velocity.transpose(0, 2, 1), by_velocity) / len(parts)


def _shares(products: Array) -> Array:
    """(p,) parameters over those of the sheet with which forces balance best.

    `products` (p, p) are the means of the products of two parameters' forces.
    """
    p = len(products)
    rounding = p * np.finfo(float).eps * np.trace(products)  # of forces that commands hardly make
    trust = _TRUST**2 + rounding
    factor = np.linalg.cholesky(products + trust * np.eye(p))
    b = np.linalg.solve(factor, trust * np.ones(p))
    return np.asarray(
        scipy.optimize.lsq_linear(factor.T, b, bounds=(1 / _UNSURE, _UNSURE), method="bvls").x
    )
