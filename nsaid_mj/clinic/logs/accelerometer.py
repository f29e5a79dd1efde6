"""A vehicle's accelerometer against its attitude and velocity, or against gravity alone.

The specific force along the body's axes is f = Rᵀ (a − g), of the acceleration a of the origin in
the world; at a distance r from it, dω/dt × r + ω × (ω × r) is added. Where the measured one does
not follow, its axes, signs and unit under which it would are searched for, gravity that was taken
out, and the frame of the whole log.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...base import Finding
from ...core import GRAVITY, Array, number
from . import signals
from .frames import (
    Match,
    TwistPart,
    as_is,
    axes_in_words,
    best,
    columns_of,
    other_axes,
    raw_turn,
    read_as,
    said_axes,
    signed_permutations,
    slow_band,
)
from .layout import FRD, leverage
from .mapping import Vehicle
from .recordings import LogSegment, Recordings
from .remedies import remedy_of

_CONTRADICTS = 0.15  # difference of errors (0 to 1) from which other axes are certain
_FOLLOWS = 0.4  # error up to which a force follows, or that other axes must take away
_LIKE_IT = 0.15  # relative difference of a scale from that of a unit
_BLOCKS = 8  # parts of the log by which a place is judged
_SURE = 4.0  # distance over its deviation between these parts
_LEAST = 0.03  # distance that is told [m]
_MOST = 3.0  # and that of a sensor on a vehicle [m]
_LESS = 0.8  # ratio of the residuals with and without it
_ALONG = 0.8  # share of the force along the vertical, from which it is gravity
_ALIKE = 0.03  # difference of such shares that tells no axes


class _Reading(NamedTuple):
    """A way to read the accelerometer, or the log."""

    match: Match
    words: str
    changes: dict[str, object] | None  # None if no line of the map mends it


def accelerometer_causes(recordings: Recordings) -> list[Finding]:
    """Findings about a vehicle's accelerometer, of a log whose velocities follow from its pose."""
    vehicle = recordings.vehicle
    felt = [segment for segment in recordings.segments if segment.specific is not None]
    if vehicle is None or not felt:
        return []
    segment = max(felt, key=lambda one: len(one.log.t))
    if recordings.turns_only:
        return _by_gravity(segment, vehicle)
    own = _part(segment, recordings.rate)
    before = as_is(own)
    likeliest = min(_readings(own, segment, recordings.rate, vehicle), key=_cost)
    gained = before.error - likeliest.match.error
    found = likeliest if gained > _CONTRADICTS else _Reading(before, "", {})
    unit, changes, scale = _unit(found.match.scale, vehicle)
    words = [part for part in (found.words, unit) if part]
    lost = found.match.error > _FOLLOWS and gained < _FOLLOWS
    if lost or found.changes is None or (scale and not found.words):
        text = "the accelerometer does not follow from attitude and velocity under any axes "
        text += f"(error {100 * found.match.error:.2g} %, size {number(1 / found.match.scale)} "
        text += f"times); likeliest {likeliest.words or 'it is of something else'}"
        remedy = "Map the measured acceleration with gravity, or leave `acceleration` out: the fit "
        remedy += "does without it."
        return [Finding("warning", "accelerometer", "", text, remedy)]
    if not words:
        return _place(segment, recordings.rate, vehicle)
    text = f"the accelerometer contradicts attitude and velocity: {' and '.join(words)} (squared "
    text += f"error {100 * before.error:.2g} % → {100 * found.match.error:.2g} %)"
    changes |= found.changes
    data = {"map": changes, "error": before.error, "turned": found.match.error}
    return [Finding("refusal", "accelerometer", "", text, remedy_of(changes), data)]


def _cost(reading: _Reading) -> float:
    return reading.match.error + reading.match.handicap


def _readings(own: TwistPart, segment: LogSegment, rate: float, vehicle: Vehicle) -> list[_Reading]:
    """The accelerometer in the axes that fit best, with and without gravity; in another frame."""
    assert segment.specific is not None
    bases = {"without gravity": "gravity is taken out", "world": "it is along the world's axes"}
    found = []
    for base in own.bases:
        match = best(own._replace(bases={base: own.bases[base]}))
        plain = np.array_equal(match.turn, np.eye(3))
        words = bases.get(base, "")
        changes: dict[str, object] | None = {}
        if not plain:
            axes = f"it is along {said_axes(match.turn, base == 'world', vehicle)}"
            words = f"{words}, and {axes}" if words else axes
            turn = raw_turn(match.turn, vehicle, base == "world")
            changes = columns_of("acceleration", turn, vehicle)
        found.append(_Reading(match, words, None if base in bases else changes))
    for axes in other_axes(vehicle):
        q, v = read_as(segment.log.q, segment.log.v, vehicle, axes)
        specific = segment.specific @ FRD if "vehicle.frame" in axes else segment.specific
        turned = segment._replace(log=segment.log._replace(q=q, v=v), specific=specific)
        # as many axes are turned as below, so that the error alone decides between both
        match = as_is(_part(turned, rate))._replace(handicap=found[0].match.handicap)
        found.append(_Reading(match, axes_in_words(axes), axes))
    return found


def _part(segment: LogSegment, rate: float) -> TwistPart:
    """The measured specific force, and what attitude and velocity say, all low-passed alike."""
    assert segment.specific is not None
    q, v = segment.log.q, segment.log.v
    cut = slow_band(v, rate)
    turns = Rotation.from_quat(q[:, 3:7])
    speed = turns.apply(signals.low_pass(v[:, :3], cut))
    motion = np.gradient(speed, 1 / rate, axis=0)
    force = motion + GRAVITY * np.array([0.0, 0.0, 1.0])
    slow = signals.low_pass(segment.specific, cut)
    noise = np.array([signals.noise(x) for x in segment.specific.T]) * np.sqrt(cut)
    loud = np.sqrt(np.mean(slow**2, axis=0)) > 3 * noise
    bases = {
        "body": turns.inv().apply(force),
        "without gravity": turns.inv().apply(motion),
        "world": force,
    }
    bases = {name: signals.low_pass(base, cut) for name, base in bases.items()}
    return TwistPart("acceleration", slow, bases, np.where(loud, 1.0, 0.1))


def _unit(scale: float, vehicle: Vehicle) -> tuple[str, dict[str, object], bool]:
    """The unit that a scale tells, in words and as a change; and whether it is that of none."""
    given, other, factor = "m/s²", "g", GRAVITY
    if vehicle.acceleration_unit == "g":
        given, other, factor = "g", "m/s²", 1 / GRAVITY
    if abs(np.log(scale / factor)) < _LIKE_IT:
        return f"it is in {other}, not in {given}", {"vehicle.acceleration_unit": other}, False
    return "", {}, abs(np.log(scale)) > _LIKE_IT


def _by_gravity(segment: LogSegment, vehicle: Vehicle) -> list[Finding]:
    """Findings where no velocity is measured: on average the force along the vertical is gravity.

    Axes that the vehicle never turns up are not told; those of usual frames come first.
    """
    assert segment.specific is not None
    up = Rotation.from_quat(segment.log.q[:, 3:7]).inv().apply([0.0, 0.0, 1.0])
    size = float(np.mean(np.linalg.norm(segment.specific, axis=1)))
    if not size > 0:
        return []
    both = segment.specific.T @ up / (len(up) * size)  # (3, 3) means of products
    turns = sorted(signed_permutations(3), key=lambda turn: float(np.sum(np.diag(turn) != 1)))
    turns = [np.eye(3), FRD, -np.eye(3), *turns]
    along = np.array([np.sum(turn * both) for turn in turns])
    k = int(np.argmax(along > along.max() - _ALIKE))
    if along[k] < _ALONG:
        return []
    if along[0] > along[k] - _CONTRADICTS:
        k = 0
    words, changes, other = _unit(GRAVITY / (size * float(along[k])), vehicle)
    if other:
        text = f"the accelerometer measures {number(size)} {vehicle.acceleration_unit} on average, "
        text += "which is not gravity"
        remedy = "Map the measured acceleration with gravity, or leave `acceleration` out."
        return [Finding("refusal", "accelerometer", "", text, remedy)]
    said = [words] if words else []
    if k:
        said.append(f"it is along {said_axes(turns[k], False, vehicle)}")
        changes |= columns_of("acceleration", raw_turn(turns[k], vehicle, False), vehicle)
    if not said:
        return []
    text = f"the accelerometer contradicts the attitude: {' and '.join(said)}"
    return [Finding("refusal", "accelerometer", "", text, remedy_of(changes), {"map": changes})]


def _place(segment: LogSegment, rate: float, vehicle: Vehicle) -> list[Finding]:
    """The note of an accelerometer at a distance from the origin, where its rotation tells it."""
    part = _part(segment, rate)
    arms = leverage(segment.log.v[:, 3:6], rate)
    cut = slow_band(segment.log.v, rate)
    arms = signals.low_pass(arms.reshape(len(arms), -1), cut).reshape(arms.shape)
    residual = part.measured - part.bases["body"]
    blocks = np.array_split(np.arange(len(residual)), _BLOCKS)
    whole = _fitted(residual, arms)
    each = np.array([_fitted(residual[rows], arms[rows])[0] for rows in blocks])
    place, left, without = whole
    deviation = np.std(each, axis=0) / np.sqrt(_BLOCKS)
    size = float(np.linalg.norm(place))
    sure = size > _SURE * float(np.linalg.norm(deviation))
    if not sure or not _LEAST < size < _MOST or left > _LESS * without:
        return []
    ned = vehicle.frame == "NED/FRD"
    own = np.array(vehicle.acceleration_at) + (FRD @ place if ned else place)
    at = [float(np.round(x, 3)) for x in own]
    words = ", ".join(number(x, significant=2) for x in at)
    ways = "forward, right, down" if ned else "forward, left, up"
    text = f"the accelerometer sits about ({words}) m {ways} of the origin: with it, rotation "
    text += (
        f"explains {100 * (1 - (left / without) ** 2):.0f} % of what attitude and velocity leave"
    )
    remedy = f"State `acceleration_at = {at}` in [vehicle]; or the log's origin is not the sheet's."
    data = {"place": at, "deviation": [float(x) for x in deviation]}
    return [Finding("note", "accelerometer_place", "", text, remedy, data)]


def _fitted(residual: Array, arms: Array) -> tuple[Array, float, float]:
    """(3,) the place that explains residuals (N, 3) best; their rms with and without it.

    arms (N, 3, 3) are accelerations per metre; both have their means taken out.
    """
    arms = arms - arms.mean(axis=0)
    residual = residual - residual.mean(axis=0)
    A = arms.reshape(-1, 3)
    b = residual.reshape(-1)
    found = np.linalg.lstsq(A, b, rcond=None)[0]
    left = float(np.sqrt(np.mean((b - A @ found) ** 2)))
    return np.asarray(found, np.float64), left, float(np.sqrt(np.mean(b**2)))
