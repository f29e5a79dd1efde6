"""Linear algebra libraries held at one thread.

With more threads these libraries sum in another order and round differently, so that results would
depend on the machine. Our matrices are too small to gain from that.
"""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator of functions during which BLAS and OpenMP use a single thread."""

    @wraps(function)
    def limited(*given: P.args, **named: P.kwargs) -> T:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(limits=1):
            return function(*given, **named)

    return limited
