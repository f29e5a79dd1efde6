"""How this room compiles: one specialisation of every function, in one step.

All arrays of numbers are C-contiguous float64, all arrays of indices C-contiguous int64, so that
every function has one signature, which its decorator states. Without it a helper would be compiled
once for every literal integer it is called with. Division by zero gives inf or NaN, as in numpy:
numba then compiles no error messages.

Nothing is compiled at import; see `compilation.ready`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit, types

from .arrays import Slopes, StructureArrays, Workspace

f8, i8, void, boolean = types.float64, types.int64, types.void, types.boolean
index = types.uint32
vector, matrix, cube = f8[::1], f8[:, ::1], f8[:, :, ::1]
table = i8[:, ::1]

STRUCTURE = types.NamedTuple(
    (table, vector, vector, table, table, vector, table, table, vector, table), StructureArrays
)
"""The type of every robot."""
WORKSPACE = types.NamedTuple((vector, vector, matrix, matrix, matrix, vector), Workspace)
SLOPES = types.NamedTuple((vector, vector, vector, vector, matrix, matrix), Slopes)

MARKED: list[tuple[Any, Any, bool]] = []
"""All functions, callees first, their signatures, and whether they are kernels."""
FAST: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
"""Without `_nrt` numba counts references to the arrays of every call: half of a stage's time. Here
nothing allocates, and Python owns all arrays."""


def helper(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a small function that becomes part of the compiled functions that call it."""
    return _marking(signature, False, forceinline=True, no_cpython_wrapper=True)


def routine(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a larger function that only compiled functions call."""
    return _marking(signature, False, no_cpython_wrapper=True)


def kernel(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a function that Python calls; see `compilation.ready`."""
    return _marking(signature, True, cache=True, nogil=True)


def _marking(signature: Any, called: bool, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    def mark(function: Callable[..., Any]) -> Any:
        made = njit(**FAST, **options)(function)
        MARKED.append((made, signature, called))
        return made

    return mark
