"""`nsaid live` of a robot that stands and walks: its log grows, and is identified again and again.

The filter of `nsaid live` follows a base whose motion is measured; of a robot that walks only the
IMU is. So the samples make a log, as `nsaid identify` reads it, and each time it has grown by half
all of it is fitted, without the forces on the feet. What is wrong with the samples (legs in another
order, an IMU that is turned) is said at the first of these fits.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
import orjson

from ..base import InvalidInput
from ..robots import RobotModel
from .identify.identify import identify_forces
from .identify.result import Identification
from .logs.unusable import UnusableLog
from .session import LiveEstimate, LiveGain

LOG = "walk.csv"
"""The samples, in the folder of the results."""

IMU = ("imu_qw", "imu_qx", "imu_qy", "imu_qz", "gyro_x", "gyro_y", "gyro_z")
FORCE = ("acc_x", "acc_y", "acc_z")
"""Columns of a sample's `imu`: orientation, angular velocity and, if measured, specific force."""

_FIRST = 8.0  # duration of the first log that is fitted [s]
_GROWN = 1.5  # over the log of the fit before
_POLL = 0.02  # [s]
_LARGEST = 65_536  # datagram [bytes]
_PATIENCE = 10  # largest number of unreadable lines before the first sample
_MISFITS = {"yes": "none", "partly": "some", "no": "contradicts"}

Lines = Iterable[bytes] | socket.socket


def first_of(lines: Lines) -> tuple[bytes, Lines]:
    """The first line that is not empty, b"" without one, and all lines, this one included."""
    if isinstance(lines, socket.socket):
        while not select.select([lines], [], [], 0.1)[0]:
            pass
        return lines.recv(_LARGEST, socket.MSG_PEEK).split(b"\n")[0], lines
    left = iter(lines)
    first = next((line for line in left if line.strip()), b"")
    return first, chain([first], left)


def walks(robot: RobotModel, line: bytes) -> bool:
    """Whether a first sample is of a robot that walks: it holds the readings of an IMU."""
    return robot.walks and b'"imu"' in line


class WalkingSamples:
    """Samples of a robot that walks, read by a thread: `t`, `q`, `v`, `u` of its joints, `imu`.

    Attributes:
        unreadable: lines that are not samples.
        over: whether the stream has ended.
    """

    def __init__(self, joints: tuple[str, ...], lines: Lines):
        self._joints = joints
        self._lines = lines
        self._rows: list[list[float]] = []
        self._width = 0  # of the IMU
        self._error: InvalidInput | None = None
        self.unreadable = 0
        self.over = False
        threading.Thread(target=self._read, daemon=True).start()

    @property
    def seconds(self) -> float:
        """Duration so far [s]; raises `InvalidInput` if the lines are not samples."""
        if self._error is not None:
            raise self._error
        return self._rows[-1][0] - self._rows[0][0] if len(self._rows) > 1 else 0.0

    def write(self, path: Path) -> int:
        """Writes all samples so far as CSV, and returns their number."""
        rows = np.array(self._rows[:])
        names = [f"{kind}_{joint}" for kind in ("q", "dq", "u") for joint in self._joints]
        names = ["time", *names, *(IMU + FORCE)[: self._width]]
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
        return len(rows)

    def _read(self) -> None:
        for line in self._each():
            try:
                row = self._sample(line)
            except InvalidInput as error:
                self.unreadable += 1
                if not self._rows and self.unreadable >= _PATIENCE:
                    self._error = error
                    break
                continue
            if row is None:
                break
            if np.isfinite(row).all() and (not self._rows or row[0] > self._rows[-1][0]):
                self._rows.append(row)
        self.over = True

    def _each(self) -> Iterator[bytes]:
        if not isinstance(self._lines, socket.socket):
            yield from (line for line in self._lines if line.strip())
            return
        self._lines.setblocking(True)
        while True:
            try:
                datagram = self._lines.recv(_LARGEST)
            except OSError:  # closed
                return
            yield from (line for line in datagram.splitlines() if line.strip())

    def _sample(self, line: bytes) -> list[float] | None:
        """The numbers of a line; None at the end."""
        try:
            found = orjson.loads(line)
        except ValueError:
            found = None
        if isinstance(found, dict) and found.get("end"):
            return None
        parts = found if isinstance(found, dict) else {}
        row = walking_sample(len(self._joints), *map(parts.get, SAMPLE))
        width = len(row) - 1 - 3 * len(self._joints)
        if self._width not in (0, width):
            got = f"{width} numbers"
            raise InvalidInput("imu", f"{self._width} numbers, as before", got, _SEE)
        self._width = width
        return row


SAMPLE = ("t", "q", "v", "u", "imu")
"""Keys of a sample."""
_SEE = "See docs/live.md."


def walking_sample(
    joints: int, t: object, q: object, v: object, u: object, imu: object
) -> list[float]:
    """The numbers of a sample of k `joints`: t, q (k,), v (k,), u (k,), imu (7,) or (10,).

    Raises:
        InvalidInput: a part is not of numbers, or has another length.
    """
    expected = f"t, q, v and u of {joints} joints, and imu of 7 or 10 numbers"
    given = (t, q, v, u, imu)
    try:
        parts = [np.atleast_1d(np.asarray(part, dtype=np.float64)) for part in given]
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInput("sample", expected, given, _SEE) from error
    sizes = [part.shape for part in parts]
    if sizes[:4] != [(1,), *[(joints,)] * 3] or sizes[4] not in ((7,), (10,)):
        names = zip(SAMPLE, sizes, strict=True)
        got = ", ".join(f"{name} of shape {size}" for name, size in names)
        raise InvalidInput("sample", expected, got, _SEE)
    return np.concatenate(parts).tolist()


def identified_along(
    model: str,
    options: dict[str, tuple[str, ...] | None],
    samples: WalkingSamples,
    folder: Path,
    show: Callable[[LiveEstimate], None],
    say: Callable[[str], None],
) -> Identification:
    """Identifies a robot from its samples while they come, and again from all at their end.

    `options` are `lock` and `joints`; `show` receives each estimate, `say` why there is none yet.

    Raises:
        UnusableLog: the whole log cannot be used, with all findings.
        InvalidInput: there are no samples, or their lines are of another robot.
    """
    used = 0.0
    found: Identification | None = None
    while True:
        over = samples.over
        seconds = samples.seconds
        if not over and seconds < max(_FIRST, _GROWN * used):
            time.sleep(_POLL)
            continue
        if over and seconds == 0:
            remedy = "Is the sender running, and does it send finite numbers?"
            raise InvalidInput("stream", "samples", "none before its end", remedy)
        if found is not None and seconds == used:
            return found
        count = samples.write(folder / LOG)
        used = seconds
        try:
            found = identify_forces(model, [folder / LOG], **options)  # pyright: ignore[reportArgumentType]
        except UnusableLog as error:
            if over:
                raise
            say(f"{seconds:.0f} s: {error}")
            found = None
            continue
        show(_estimate(found, seconds, count))
        if over:
            return found


def _estimate(found: Identification, t: float, count: int) -> LiveEstimate:
    gains = []
    for p in found.gains:
        half = (p.relative if p.relative is not None else np.inf) * p.value
        gains.append(LiveGain(p.name, p.unit, p.value, p.value - half, p.value + half))
    names = tuple(p.name for p in found.parameters)
    units = tuple(p.unit for p in found.parameters)
    theta = np.array([p.value for p in found.parameters])
    return LiveEstimate(
        t, count, names, units, theta, tuple(gains), _MISFITS.get(found.explains or "", ""), ()
    )
