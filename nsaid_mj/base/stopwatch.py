"""The time a run takes, apart from the time spent compiling."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_spent = [0.0]  # by all threads
_own = threading.local()  # `seconds`: spent by this thread
_WATCHERS: list[Callable[[], None]] = []


class Stopwatch:
    """The time since it was made. It stops while the thread that reads it compiles kernels."""

    def __init__(self) -> None:
        self._begin = time.perf_counter() - _excluded()
        self._spent = _spent[0]

    @property
    def seconds(self) -> float:
        """Time without compiling in this thread [s]."""
        return time.perf_counter() - _excluded() - self._begin

    @property
    def compiling(self) -> float:
        """Time that all threads have spent compiling [s], without loading cached kernels."""
        return _spent[0] - self._spent

    @staticmethod
    def count(seconds: float) -> None:
        """Counts a time that this thread has just spent compiling a function [s]."""
        _spent[0] += seconds
        Stopwatch.pause(seconds)
        for watcher in _WATCHERS:
            watcher()

    @staticmethod
    def pause(seconds: float) -> None:
        """Stops this thread's stopwatches for a time that has passed [s]."""
        _own.seconds = _excluded() + seconds

    @staticmethod
    @contextmanager
    def on_compiling(call: Callable[[], None]) -> Iterator[None]:
        """Context that calls `call` whenever a function has been compiled, in any thread."""
        _WATCHERS.append(call)
        try:
            yield
        finally:
            _WATCHERS.remove(call)


def _excluded() -> float:
    """Time for which this thread's stopwatches have stopped [s]."""
    return getattr(_own, "seconds", 0.0)
