"""A source whose measurements are recorded logs."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext

from ...core import Array, Log, Measurement, Status
from ...lab import Source, SourceSegment


class Logs(Source):
    """Recorded logs, one after another, with gaps between them.

    They have one rate and one clock, and two rows or more each.
    """

    def __init__(self, logs: Sequence[Log]):
        self._logs = logs
        self._log = 0
        self._row = 0

    def running(self) -> AbstractContextManager[None]:
        """Opens nothing."""
        return nullcontext()

    def begin(self) -> SourceSegment:
        """The first row."""
        self._log = self._row = 0
        return SourceSegment(self._logs[0].first(1))

    def segment(self, last: Measurement, k: int, steps: int, theta_hat: Array) -> SourceSegment:
        """The next rows of a log, or the first ones of the next log."""
        resumed = self._row == len(self._logs[self._log].t) - 1
        if resumed:
            self._log = self._log + 1
            self._row = 0
        log = self._logs[self._log]
        first = self._row
        self._row = min(first + steps - resumed, len(log.t) - 1)
        over = self._row == len(log.t) - 1 and self._log == len(self._logs) - 1
        end = (Status.completed, "") if over else None
        return SourceSegment(log.part(first, self._row + 1), resumed, end)

    def stop(self) -> None:
        """Does nothing: logs do not wait."""
