"""The time spent compiling."""

import gc
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_spent = 0.0
_own = threading.local()  # `seconds`: spent by this thread
_WATCHERS: list[Callable[[], None]] = []


def compile_seconds() -> float:
    """Time this process has spent compiling kernels so far [s], without loading cached ones."""
    return _spent


def clock() -> float:
    """A clock [s] that stops while this thread compiles, to measure the cost of a run."""
    return time.perf_counter() - excluded()


def excluded() -> float:
    """Time for which this thread's clock has stopped [s]."""
    return getattr(_own, "seconds", 0.0)


def exclude(seconds: float) -> None:
    """Stops this thread's clock for a time that has passed [s]."""
    _own.seconds = excluded() + seconds


@contextmanager
def on_compiling(call: Callable[[], None]) -> Iterator[None]:
    """Context that calls `call` whenever a function has been compiled, in any thread."""
    _WATCHERS.append(call)
    try:
        yield
    finally:
        _WATCHERS.remove(call)


def timed(function: Any, signature: Any) -> None:
    """Has numba compile a function; its time counts, unless it is loaded from the cache.

    Python's search for cycles is off meanwhile: it takes a tenth of the time of compiling.
    """
    global _spent
    collecting = gc.isenabled()
    begin = time.perf_counter()
    gc.disable()
    try:
        function.compile(signature)
    finally:
        if collecting:
            gc.enable()
    if not function.stats.cache_hits[signature]:
        took = time.perf_counter() - begin
        _spent, _own.seconds = _spent + took, excluded() + took
        for watcher in _WATCHERS:
            watcher()
