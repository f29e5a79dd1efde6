"""How this room compiles: one specialisation of every function, in one step.

All arrays of numbers are C-contiguous float64, all arrays of indices C-contiguous int64, so that
every function has one signature, which its decorator states. Without it a helper would be compiled
once for every literal integer it is called with. Division by zero gives inf or NaN, as in numpy:
numba then compiles no error messages.

Nothing is compiled at import; see `compilation.ready`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from llvmlite import binding as llvm
from numba import njit, types
from numba.core import cgutils
from numba.extending import lower_builtin, overload, type_callable

from ..numerics.packs import PACK
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

MARKED: list[Any] = []
"""All kernels, and the other functions with their signatures; callees first."""
FAST: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
"""Without `_nrt` numba counts references to the arrays of every call: half of a stage's time. Here
nothing allocates, and Python owns all arrays."""


def helper(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a small function that becomes part of the compiled functions that call it."""
    return _marking(signature, forceinline=True, no_cpython_wrapper=True)


def routine(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a larger function that only functions of one kernel call."""
    return _marking(signature, no_cpython_wrapper=True)


def kernel(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a function that Python calls, or several compiled ones; see `Kernel`."""

    def mark(function: Callable[..., Any]) -> Any:
        made = Kernel(function, signature)
        MARKED.append(made)
        return made

    return mark


def _marking(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    def mark(function: Callable[..., Any]) -> Any:
        made = njit(**FAST, **options)(function)
        MARKED.append((made, signature))
        return made

    return mark


def in_packs(given: tuple[Any, ...]) -> bool:
    """Whether a call computes several runs at once, see `numerics.packs`."""
    return any(getattr(kind, "dtype", None) is PACK for kind in given)


class Kernel:
    """A function that Python calls, and that compiled functions call by its address.

    Every other function numba compiles again with each function that calls it, directly or not:
    without this, three quarters of all compiling.

    Args:
        function: its text.
        signature: its types.
    """

    def __init__(self, function: Callable[..., Any], signature: Any):
        self.function = njit(**FAST, cache=True, nogil=True)(function)
        self.signature = signature
        self.symbol = f"{function.__module__}.{function.__name__}"
        self.__name__, self.__doc__ = function.__name__, function.__doc__

        def typed(*given: Any) -> Any:
            return None if in_packs(given) else signature

        typed.pysig = inspect.signature(function)  # type: ignore[attr-defined]
        type_callable(self)(lambda _: typed)
        lower_builtin(self, *signature.args)(self._lower)
        packed: Any = overload
        packed(self, jit_options=FAST, strict=False)(
            lambda *given: function if in_packs(given) else None
        )

    def __call__(self, *arguments: Any) -> Any:
        """Calls it from Python."""
        return self.function(*arguments)

    def load(self) -> None:
        """Compiles it, or loads it from the cache; from then on compiled functions find it."""
        self.function.compile(self.signature)
        self.function.disable_compile()
        (made,) = self.function.overloads.values()
        address = made.library.get_pointer_to_function(made.fndesc.llvm_func_name)
        llvm.add_symbol(self.symbol, address)

    def _lower(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        convention = context.call_conv
        kind = convention.get_function_type(signature.return_type, signature.args)
        called = cgutils.get_or_insert_function(builder.module, kind, self.symbol)
        given = builder, called, signature.return_type, signature.args, arguments
        return convention.call_function(*given)[1]
