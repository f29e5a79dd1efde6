"""Sketch of a robot: its links as lines, joints labelled, in the first pose of its log."""

from typing import NamedTuple

import numpy as np

from ...core import Array
from ...report import BAD, COLOURS, GRID, INK, Axes, Figure, Side
from . import wording
from .ground.poses import poses
from .result import Identification

_AZIMUTH = np.radians(-52.0)
_ELEVATION = np.radians(24.0)
_RIGHT = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
_UP = np.array(
    [
        -np.sin(_ELEVATION) * np.cos(_AZIMUTH),
        -np.sin(_ELEVATION) * np.sin(_AZIMUTH),
        np.cos(_ELEVATION),
    ]
)
_WIDTH = 310.0  # of the picture, as of a panel [points]
_COLUMN = 9  # names in one column, at most: a second one takes a third of the width
_COLOURS = {"good": COLOURS[3], "fair": COLOURS[5], "poor": BAD}


def picture(result: Identification) -> Figure | None:
    """The robot in the first pose of its log; None if its model has no joints to draw."""
    model = result.robot.model
    segment = result.recordings.segments[0]
    first = segment._replace(
        log=segment.log.part(0, 1), imu=None if segment.imu is None else segment.imu[:1]
    )
    if model is None or model.njoints < 2 or not np.isfinite(segment.log.q[0]).all():
        return None
    segments = result.robot.system.bones(poses(result.robot, result.recordings, first)[0])[0]
    flat = segments @ np.stack([_RIGHT, _UP], axis=1)  # (bones, 2 ends, 2 axes)
    size = float(np.ptp(flat.reshape(-1, 2), axis=0).max())
    if not np.isfinite(size) or size <= 0:
        return None
    names = list(result.robot.joints)
    joints = flat[: len(names), 0]
    marks = {j.name: wording.quality(j.held_out, j.alone).kind for j in result.joints}
    floor = _floor(segments, size)
    shown = np.vstack([flat.reshape(-1, 2), floor])
    low = shown.min(axis=0)
    high = shown.max(axis=0)
    height = _height(high - low, len(names))
    labels = _labels(names, joints, low, high, (_WIDTH, height))
    axes = Axes((0.0, 0.0, _WIDTH, height), *labels.sides, frame=False)
    axes.area(floor[:, 0], floor[:, 1], GRID)
    for line in labels.lines:
        axes.line(line[:, 0], line[:, 1], COLOURS[8], width=0.6)
    for number, ends in enumerate(flat):
        link = number < len(names)
        colour = INK if link else COLOURS[8]
        width = 4.0 if link else 1.4
        opacity = 0.75 if link else 0.6
        axes.line(ends[:, 0], ends[:, 1], colour, width=width, opacity=opacity)
    for name, at in zip(names, joints, strict=True):
        colour = _COLOURS.get(marks.get(name, ""), COLOURS[8])
        axes.marks(at[:1], at[1:], colour, "", "●")
    for words_, at, anchor in labels.texts:
        axes.text(words_, *at, anchor=anchor, size=labels.size)
    legend = [
        (words_, colour, "●")
        for kind, words_, colour in (
            ("good", "held-out NRMSE < 20 %", _COLOURS["good"]),
            ("fair", "< 50 %", _COLOURS["fair"]),
            ("poor", "worse", _COLOURS["poor"]),
        )
        if kind in marks.values()
    ]
    title = "Robot in its first logged pose"
    return axes.figure(title, legend)


def _height(size: Array, names: int) -> float:
    """Height of the picture [points]: less for a robot that is flat, of width and height (2,)."""
    if names > _COLUMN:
        return max(216.0, 6.5 * names + 72)
    flat = 0.6 * _WIDTH * size[1] / max(size[0], 1e-9)
    return float(np.clip(flat, max(101.0, 14.4 * names), 216.0))


def _floor(segments: Array, size: float) -> Array:
    """(4, 2) corners of a square on the floor below the base."""
    half = 0.2 * size
    height = min(0.0, float(segments[..., 2].min()))
    corners = half * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) + [0, 0, height]
    return corners @ np.stack([_RIGHT, _UP], axis=1)


class _Labels(NamedTuple):
    """Where names stand beside a robot."""

    sides: tuple[Side, Side]  # horizontal and vertical axis
    lines: list[Array]  # (2, 2) ends of a line from each joint to its name
    texts: list[tuple[str, tuple[float, float], str]]  # each name, its place and its anchor
    size: float  # of the letters [points]


def _labels(
    names: list[str], joints: Array, low: Array, high: Array, room_: tuple[float, float]
) -> _Labels:
    """Names in one column beside the robot, two if they are many, each with a line to its joint."""
    middle = np.median(joints[:, 0])
    order = np.argsort(joints[:, 0], kind="stable")
    left, right = np.array_split(order, 2)
    if len(names) <= _COLUMN or np.ptp(joints[:, 0]) < 1e-9 * max(1.0, abs(middle)):
        left = np.zeros(0, dtype=int)
        right = np.arange(len(names))
    width, height = room_
    rows = max(len(left), len(right), 1)
    font = min(8.0, 0.92 * height / (1.25 * rows))
    longest = max(len(n) for n in names)
    room = min(0.36, (0.62 * font * min(longest, 22) + 11) / width)  # for a column of names
    sides = (1 if len(left) else 0) + (1 if len(right) else 0)
    scale = min(
        (1 - sides * room - 0.1) * width / max(high[0] - low[0], 1e-9),
        0.86 * height / max(high[1] - low[1], 1e-9),
    )
    centre = (low + high) / 2
    half = np.array(room_) / (2 * scale)
    shift = half[0] * room * ((1 if len(right) else 0) - (1 if len(left) else 0))
    across = (centre[0] - half[0] + shift, centre[0] + half[0] + shift)
    up = (centre[1] - half[1], centre[1] + half[1])
    lines: list[Array] = []
    texts: list[tuple[str, tuple[float, float], str]] = []
    pitch = 1.25 * font / scale
    for side, sign in ((left, -1), (right, 1)):
        if not len(side):
            continue
        ascending = side[np.argsort(joints[side, 1])]
        heights = _spread(
            joints[ascending, 1], pitch, centre[1] - 0.95 * half[1], centre[1] + 0.95 * half[1]
        )
        x = centre[0] + shift + sign * (half[0] * (1 - 2 * room))
        for k, y in zip(ascending, heights, strict=True):
            name = names[k] if len(names[k]) <= 22 else names[k][:21] + "…"
            lines.append(np.array([joints[k], [x, y]]))
            texts.append((name, (x + sign * 0.1 * pitch, y), "start" if sign > 0 else "end"))
    return _Labels((Side(across), Side(up)), lines, texts, font)


def _spread(heights: Array, pitch: float, low: float, high: float) -> Array:
    """Heights in ascending order moved apart to at least a pitch, within bounds if they fit."""
    pitch = min(pitch, (high - low) / max(len(heights) - 1, 1))
    found = heights.copy()
    for k in range(1, len(found)):
        found[k] = max(found[k], found[k - 1] + pitch)
    found += min(0.0, float(np.mean(heights) - np.mean(found)))  # keeps the middle
    found += max(0.0, low - found[0])
    found[-1] = min(found[-1], high)
    for k in range(len(found) - 2, -1, -1):
        found[k] = min(found[k], found[k + 1] - pitch)
    return found
