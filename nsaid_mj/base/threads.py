"""A second thread beside the calling one, and linear algebra libraries held at one thread.

With more threads these libraries sum in another order and round differently, so that results would
depend on the machine. Our matrices are too small to gain from that.
"""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial, wraps
from typing import ParamSpec, TypeVar

from .stopwatch import exclude, excluded

P = ParamSpec("P")
T = TypeVar("T")

_LONG = 32  # steps that take many times as long as waking a thread


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator of functions during which BLAS and OpenMP use a single thread."""

    @wraps(function)
    def limited(*given: P.args, **named: P.kwargs) -> T:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(limits=1):
            return function(*given, **named)

    return limited


def beside(steps: int, call: Callable[..., T], *given: object) -> Callable[[], T]:
    """Starts a pure call along a log of some steps; returns a function that waits for its result.

    With fewer than `_LONG` steps that function makes the call itself, else another thread does. The
    call must not start others in turn: they could all wait for a thread.
    """
    if steps < _LONG:
        return partial(call, *given)

    def timed() -> tuple[T, float]:
        before = excluded()
        return call(*given), excluded() - before

    found = _threads(os.getpid()).submit(timed)

    def result() -> T:
        begin = time.perf_counter()
        value, compiling = found.result()
        exclude(min(compiling, time.perf_counter() - begin))
        return value

    return result


@cache
def _threads(process: int) -> ThreadPoolExecutor:  # noqa: ARG001 (the key of a cache)
    """Threads of a process, which those that it forks do not have.

    Each is started when needed, and kept: a new one takes 0.1 ms, and has no memory at hand.
    """
    return ThreadPoolExecutor(thread_name_prefix="beside")
