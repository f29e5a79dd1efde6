"""A second thread beside the calling one."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import TypeVar

from ...base import Stopwatch

T = TypeVar("T")

_LONG = 32  # steps that take many times as long as waking a thread


def beside(steps: int, call: Callable[..., T], *given: object) -> Callable[[], T]:
    """Starts a pure call along a log of some steps; returns a function that waits for its result.

    With fewer than `_LONG` steps that function makes the call itself, else another thread does. The
    call must not start others in turn: they could all wait for a thread.
    """
    if steps < _LONG:
        return partial(call, *given)

    def timed() -> tuple[T, float]:
        begin = time.perf_counter()
        watch = Stopwatch()
        value = call(*given)
        return value, time.perf_counter() - begin - watch.seconds

    found = _threads(os.getpid()).submit(timed)

    def result() -> T:
        begin = time.perf_counter()
        value, compiling = found.result()
        Stopwatch.pause(min(compiling, time.perf_counter() - begin))
        return value

    return result


@cache
def _threads(process: int) -> ThreadPoolExecutor:  # noqa: ARG001 (the key of a cache)
    """Threads of a process, which those that it forks do not have.

    Each is started when needed, and kept: a new one takes 0.1 ms, and has no memory at hand.
    """
    return ThreadPoolExecutor(thread_name_prefix="beside")
