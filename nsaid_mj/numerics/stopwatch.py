"""The time spent compiling."""

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_spent = 0.0
_WATCHERS: list[Callable[[], None]] = []


def compile_seconds() -> float:
    """Time this process has spent compiling kernels so far [s], without loading cached ones."""
    return _spent


def clock() -> float:
    """A clock [s] that stops while kernels are compiled, to measure the cost of a run."""
    return time.perf_counter() - _spent


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
    global _spent  # noqa: PLW0603 (as global as the compiler)
    collecting, begin = gc.isenabled(), time.perf_counter()
    gc.disable()
    try:
        function.compile(signature)
    finally:
        if collecting:
            gc.enable()
    if not function.stats.cache_hits[signature]:
        _spent += time.perf_counter() - begin
        for watcher in _WATCHERS:
            watcher()
