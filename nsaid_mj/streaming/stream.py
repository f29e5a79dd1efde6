"""Samples that arrive as lines of JSON, from a pipe or over UDP, as the source of a run."""

from __future__ import annotations

import queue
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

from ..errors import InvalidInput
from ..experiment.source import Segment, Source
from ..identifiers import Status
from ..log import Log, Measurement
from ..parameters import Array
from ..system import SecondOrderSystem
from .samples import Cleaner, parsed

_WAIT = 0.1  # longest wait for a sample, before checking for Ctrl-C [s]
_QUEUED = 10_000  # largest number of lines that wait for the law; then a pipe's writer waits
_LARGEST = 65_536  # datagram [bytes]
_PATIENCE = 10  # largest number of unreadable lines before the first sample
LOCAL = "127.0.0.1"


class Stream(Source):
    """Lines of JSON from a file or a socket; see `samples.parsed`.

    A thread reads them, so that none is lost while the law is busy. The stream ends with the file,
    with the line `{"end": true}`, or when the user stops it.

    Args:
        system: whose samples they are.
        cleaner: checks them.
        lines: a binary file, or a bound UDP socket, each of whose datagrams is one or more lines.
    """

    stopped = Status.completed

    def __init__(
        self, system: SecondOrderSystem, cleaner: Cleaner, lines: BinaryIO | socket.socket
    ):
        self._system, self._cleaner, self._lines = system, cleaner, lines
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

    def begin(self) -> Segment:
        """Waits for the first sample.

        Raises:
            InvalidInput: the stream ends before, or its lines are not samples of this robot.
        """
        while not self._over:
            if found := self._next(_WAIT):
                return Segment(Log.unchecked_of([found[0]]))
        remedy = "Is the sender running, and does it send finite numbers?"
        raise InvalidInput("stream", "samples", "none before its end", remedy)

    def segment(self, last: Measurement, k: int, steps: int) -> Segment:
        """All samples that have arrived, at most `steps` of them; waits a moment for the first."""
        rows, resumed = [last], False
        if self._held is not None:
            rows, resumed, self._held = [self._held], True, None
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
        return Segment(Log.unchecked_of(rows), resumed, end)

    def stop(self) -> None:
        """Ends the stream."""
        self._over = True

    def inform(self, k: int, theta_hat: Array) -> None:
        """Does nothing: estimates go to observers."""

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


def bound(port: int) -> socket.socket:
    """A UDP socket that listens on this machine only; `InvalidInput` if the port is not free."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**20)
    try:
        receiver.bind((LOCAL, port))
    except (OSError, OverflowError) as error:
        receiver.close()
        raise InvalidInput("udp", "a free port", port, "Take another, such as 9870.") from error
    return receiver
