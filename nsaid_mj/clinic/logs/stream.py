"""Samples of a live robot: lines from a pipe or over UDP, checked, as the source of a run."""

import os
import queue
import socket
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import orjson

from ...base import CHOICES, InvalidInput, json_of
from ...core import Array, Log, Measurement, SecondOrderSystem, Status
from ...lab import Source, SourceSegment

"""Axes of world and body: east, north, up and forward, left, up, as in the models; or north, east,
down and forward, right, down."""
_TRIED = 50  # number of intervals whose median is compared with the stated rate
_OFF = 0.2  # relative difference of both from which samples are refused
_MOST = 1e8  # largest position, velocity or command [SI units]; a command may be a count of 24 bits
_EXPECTED = 'a line such as {"t": 0.002, "q": [...], "v": [...], "u": [...]}'


@dataclass
class Counts:
    """Counts of faulty samples."""

    used: int = 0  # samples that the law received
    gaps: int = 0  # stretches without a sample
    missing: int = 0  # number of samples missing in them
    # dropped: a number, or the time since the first sample, was not finite, or beyond `_MOST`
    not_finite: int = 0
    duplicates: int = 0  # dropped because their time equalled that of the sample before
    late: int = 0  # dropped because a later sample had come before
    unreadable: int = 0  # lines that are not samples


class Cleaner:
    """Turns raw samples into measurements in the system's own axes, with time since the first.

    Args:
        system: whose samples they are.
        rate: samples per second [Hz].
        frame: axes of the samples.

    Attributes:
        counts: counts of samples so far.

    Raises:
        UnknownName: there is no such frame.
        InvalidInput: the frame is not the usual one, and the robot neither floats nor drives.
    """

    def __init__(self, system: SecondOrderSystem, rate: float, frame: str = "ENU/FLU"):
        CHOICES.check("frame", frame)
        if frame != "ENU/FLU" and not system.group:
            remedy = "A robot on a fixed base has no axes of its own: leave it out."
            raise InvalidInput("frame", "ENU/FLU", frame, remedy)
        self._system = system
        self._period = 1 / rate
        self._turned = frame == "NED/FRD"
        self._start: float | None = None
        self._last = 0.0
        self._steps = []
        self.counts = Counts()

    def accept(self, t: float, q: Array, v: Array, u: Array) -> tuple[Measurement, bool] | None:
        """A sample as a measurement, and whether a gap precedes it; None if it is dropped.

        t is in s, q (m,), v (n,), and u (n_u,) is held from t on.

        Raises:
            InvalidInput: the samples do not come at the stated rate.
        """
        counts = self.counts
        sizes = (np.abs(part).max(initial=0.0) for part in (q, v, u))
        if not (np.isfinite(t) and all(size <= _MOST for size in sizes)):  # NaN is not
            counts.not_finite += 1
            return None
        if self._start is None:
            self._start = t
        t -= self._start
        if not np.isfinite(t / self._period):  # too far from the first sample
            counts.not_finite += 1
            return None
        if counts.used and t <= self._last:
            counts.duplicates += t == self._last
            counts.late += t < self._last
            return None
        step = t - self._last if counts.used else 0.0
        gap = step > Source.LONGEST_STEP * self._period
        if gap:
            counts.gaps += 1
            counts.missing += max(1, round(step / self._period) - 1)
        if counts.used and len(self._steps) < _TRIED:
            self._check_rate(step)
        counts.used += 1
        self._last = t
        if self._turned:
            q, v = turned(self._system, q, v)
        return Measurement(t, q, v, u), gap

    def _check_rate(self, step: float) -> None:
        self._steps.append(step)
        median = float(np.median(self._steps))
        if len(self._steps) == _TRIED and abs(median / self._period - 1) > _OFF:
            raise InvalidInput(
                "rate",
                f"{1 / self._period:g} samples per second, as stated",
                f"about {1 / median:.3g}",
                "Give the rate at which samples come, and their times in seconds.",
            )


def sample_of(
    system: SecondOrderSystem, t: object, q: object, v: object, u: object
) -> tuple[float, Array, Array, Array]:
    """The parts of a sample as arrays (m,), (n,) and (n_u,), which may hold NaN.

    Raises:
        InvalidInput: a part is not of numbers, or has the wrong length.
    """
    parts = []
    widths = {"t": None, "q": system.m, "v": system.n, "u": system.n_u}
    for (name, width), given in zip(widths.items(), (t, q, v, u), strict=True):
        shape = () if width is None else (width,)
        try:
            part = np.asarray(given, dtype=np.float64, order="C")  # as orjson requires
        except (TypeError, ValueError, OverflowError):  # the last: a whole number of 400 digits
            part = None
        if part is None or part.shape != shape:
            got = f"shape {part.shape}" if part is not None else given
            expected = "a number [s]" if width is None else f"{width} numbers"
            raise InvalidInput(name, expected, got, "See docs/live.md for their order and units.")
        parts.append(part)
    return float(parts[0]), parts[1], parts[2], parts[3]


def parsed(system: SecondOrderSystem, line: bytes) -> tuple[float, Array, Array, Array] | None:
    """The sample in a line of JSON, None for `{"end": true}`; else raises `InvalidInput`."""
    try:
        found = orjson.loads(line)
    except ValueError:
        try:
            found = json_of(line)  # with NaN or Infinity, which JSON lacks
        except ValueError:
            found = None
    if isinstance(found, dict) and found.get("end"):
        return None
    if not isinstance(found, dict) or not {"t", "q", "v", "u"} <= found.keys():
        got = line[:60].decode("utf-8", "replace").strip()
        raise InvalidInput("sample", _EXPECTED, got, "See docs/live.md.")
    return sample_of(system, *(found[key] for key in "tqvu"))


def turned(system: SecondOrderSystem, q: Array, v: Array) -> tuple[Array, Array]:
    """A pose q (m,) and twist v (n,) in NED/FRD as ones in ENU/FLU; joints stay as they are.

    The base floats, q = [p, (x, y, z, w), joints], or drives, q = [x, y, heading]; v is along the
    body's axes.
    """
    q = q.copy()
    v = v.copy()
    if system.group == 6:
        north, east, down, x, y, z, w = q[:7]
        q[:3] = east, north, -down
        q[3:7] = np.array([x + y, x - y, w - z, w + z]) * np.sqrt(0.5)
        v[[1, 2, 4, 5]] *= -1.0
    else:
        north, east, heading = q[:3]
        q[:3] = east, north, 0.5 * np.pi - heading
        v[[1, 2]] *= -1.0
    return q, v


_WAIT = 0.1  # longest wait for a sample, before checking for Ctrl-C [s]
_QUEUED = 10_000  # largest number of lines that wait for the law; then a pipe's writer waits
_LARGEST = 65_536  # datagram [bytes]
_PATIENCE = 10  # largest number of unreadable lines before the first sample
LOCAL = "127.0.0.1"


class Stream(Source):
    """Lines of JSON, as from a binary file, or from datagrams of a bound UDP socket.

    A thread reads them, so that none is lost while the law is busy. The stream ends with the file,
    with the line `{"end": true}`, or when the user stops it. See `parsed`.
    """

    stopped = Status.completed

    def __init__(
        self, system: SecondOrderSystem, cleaner: Cleaner, lines: Iterable[bytes] | socket.socket
    ):
        self._system = system
        self._cleaner = cleaner
        self._lines = lines
        self._queue: queue.Queue[bytes | None] = queue.Queue(_QUEUED)
        self._held: Measurement | None = None
        self._over = self._stop = False

    @contextmanager
    def running(self) -> Iterator[None]:
        """Reads lines in another thread within the context."""
        reads = self._datagrams if isinstance(self._lines, socket.socket) else self._file
        threading.Thread(target=reads, daemon=True).start()
        try:
            yield
        finally:
            self._stop = True

    def begin(self) -> SourceSegment:
        """Waits for the first sample.

        Raises:
            InvalidInput: the stream ends before, or its lines are not samples of this robot.
        """
        while not self._over:
            if found := self._next(_WAIT):
                return SourceSegment(Log.unchecked_of([found[0]]))
        remedy = "Is the sender running, and does it send finite numbers?"
        raise InvalidInput("stream", "samples", "none before its end", remedy)

    def segment(self, last: Measurement, k: int, steps: int, theta_hat: Array) -> SourceSegment:
        """All samples that have arrived, at most `steps` of them; waits a moment for the first."""
        rows = [last]
        resumed = False
        if self._held is not None:
            rows = [self._held]
            resumed = True
            self._held = None
        while len(rows) <= steps and not self._over:
            found = self._next(0.0 if resumed or len(rows) > 1 else _WAIT)
            if found is None:
                if self._queue.empty():
                    break
                continue
            if found[1]:
                self._held = found[0]
                break
            rows.append(found[0])
        over = self._over and self._held is None
        end = (Status.completed, "") if over else None
        return SourceSegment(Log.unchecked_of(rows), resumed, end)

    def stop(self) -> None:
        """Ends the stream."""
        self._over = True

    def _next(self, wait: float) -> tuple[Measurement, bool] | None:
        """The next measurement, and whether a gap precedes it; None if none has come."""
        try:
            line = self._queue.get(timeout=wait) if wait else self._queue.get_nowait()
        except queue.Empty:
            return None
        counts = self._cleaner.counts
        if line is None:
            self._over = True
            return None
        try:
            sample = parsed(self._system, line)
        except InvalidInput:
            counts.unreadable += 1
            if not counts.used and counts.unreadable >= _PATIENCE:
                raise
            return None
        if sample is None:
            self._over = True
            return None
        return self._cleaner.accept(*sample)

    def _file(self) -> None:
        assert not isinstance(self._lines, socket.socket)
        for line in self._lines:
            if self._stop:
                return
            if line.strip():
                self._queue.put(line)
        self._queue.put(None)

    def _datagrams(self) -> None:
        assert isinstance(self._lines, socket.socket)
        self._lines.settimeout(_WAIT)
        while not self._stop:
            try:
                datagram = self._lines.recv(_LARGEST)
            except TimeoutError:
                continue
            except OSError:  # closed
                break
            for line in datagram.splitlines():
                if line.strip():
                    self._queue.put(line)
        self._queue.put(None)


def standard_input() -> Iterator[bytes]:
    """The lines of the standard input.

    They are read without its buffer, in which a thread that waits for a silent sender would keep
    Python from ending. A line of more than 65 536 bytes is cut.
    """
    left = b""
    while block := os.read(sys.stdin.fileno(), _LARGEST):
        *whole, left = (left + block).split(b"\n")
        yield from whole
        if len(left) > _LARGEST:
            yield left
            left = b""
    yield left


def bound(port: int) -> socket.socket:
    """A UDP socket that listens on this machine only; `InvalidInput` if the port is not free."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**20)
    try:
        receiver.bind((LOCAL, port))
    except (OSError, OverflowError) as error:
        receiver.close()
        raise InvalidInput("udp", "a free port", port, "Use another, such as 9870.") from error
    return receiver
