"""The time spent compiling."""

from __future__ import annotations

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
    """Within the context, calls `call` whenever a function has been compiled, in any thread."""
    _WATCHERS.append(call)
    try:
        yield
    finally:
        _WATCHERS.remove(call)


@contextmanager
def compiling(function: Any) -> Iterator[None]:
    """Counts the body's time if it compiles a function of numba's, instead of loading it."""
    global _spent  # noqa: PLW0603 (as global as the compiler)
    hits, begin = sum(function.stats.cache_hits.values()), time.perf_counter()
    try:
        yield
    finally:
        if sum(function.stats.cache_hits.values()) == hits:
            _spent += time.perf_counter() - begin
            for watcher in _WATCHERS:
                watcher()


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Within the context, Python does not search for cycles: a tenth of the time of compiling."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
