"""Compiled functions: each is compiled once, by one process at a time, and cached on disk.

What Python calls is a `kernel`. What only compiled functions call is either one, too, and they call
it by its address, or a `helper` or `routine`, which becomes part of the kernels that call it.
"""

from __future__ import annotations

import inspect
import threading
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any, cast

from llvmlite import binding as llvm
from llvmlite import ir
from numba import config, njit, typeof, types
from numba.core.errors import NumbaError
from numba.extending import is_jitted, lower_builtin, type_callable, typeof_impl

from ..errors import DamagedKernelCache, NoKernelCache
from .cache import FOLDER, one_process
from .stopwatch import compiling, without_garbage_collection

f8, i8, void, boolean, index = types.f8, types.i8, types.void, types.boolean, types.u4
vector, matrix, cube, table = f8[::1], f8[:, ::1], f8[:, :, ::1], i8[:, ::1]

FAST: Any = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
"""Division by 0 gives inf or NaN, as in numpy, and numba compiles no error messages. Without `_nrt`
it counts no references to the arrays of a call, half of a stage's time; nothing is allocated."""
SIGNATURES: dict[Any, Any] = {}
"""Of helpers and routines: without one, numba compiles one for every literal integer given."""
_LOCK = threading.RLock()
_njit = cast("Any", njit)  # whose type has no dict of options


def helper(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a small function that becomes part of the compiled functions that call it."""
    return _part(signature, forceinline=True)


def routine(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a larger function that only functions of one kernel call."""
    return _part(signature, **options)


def _part(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    def mark(function: Callable[..., Any]) -> Any:
        made: Any = _njit(**(FAST | options), no_cpython_wrapper=True)(function)
        SIGNATURES[made] = signature
        return made

    return mark


def kernel(signature: Any = None, *calls: Any, **options: Any) -> Any:
    """Marks a function that Python calls, or several compiled ones; see `Kernel`."""

    def mark(function: Callable[..., Any]) -> Any:
        return function if config.DISABLE_JIT else Kernel(function, signature, *calls, **options)

    return mark


class Kernel:
    """A function that Python calls, and that compiled functions call by its address.

    Every other function numba compiles again with each function that calls it, directly or not.

    Args:
        function: its text.
        signature: its types; then it is compiled with `FAST`. If None, it is compiled for the types
            that Python calls it with, and is part of every compiled function that calls it.
        calls: compiled functions it calls that its text does not name, as overloads do.
        inner: only compiled functions call it, and Python in tests.
        options: of `numba.njit`.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        signature: Any = None,
        *calls: Any,
        inner: bool = False,
        **options: Any,
    ):
        given: Any = {"nogil": True} | (FAST if signature is not None else {}) | options
        self.function: Any = _njit(cache=True, no_cpython_wrapper=inner, **given)(function)
        self.part = _njit(**given)(function)
        self._called = njit(lambda *x: self(*x)) if inner else self.function  # noqa: PLW0108
        self.signature, self.py_func, self._calls, self._loaded = signature, function, calls, False
        self.symbol = f"{function.__module__}.{function.__name__}"
        self.__name__, self.__doc__ = function.__name__, function.__doc__
        if signature is not None:

            def typed(*_: Any) -> Any:
                return signature

            typed.pysig = inspect.signature(function)  # type: ignore[attr-defined]
            type_callable(self)(lambda _: typed)
            lower_builtin(self, *signature.args)(self._lower)

    def __call__(self, *arguments: Any) -> Any:
        """Calls it from Python; raises TypeError if its signature has other types."""
        if self._loaded:
            try:
                return self._called(*arguments)
            except TypeError:
                if self.signature is not None:
                    raise
        self.load(None if self.signature is not None else tuple(map(typeof, arguments)))
        return self._called(*arguments)

    def load(self, given: Any = None, wait: bool = True) -> bool:
        """Compiles it after all that it calls, or loads it from the cache, for the given types.

        What another process is compiling is left to it until all else is done.

        Args:
            given: types of the arguments of a call; None for those of the signature.
            wait: whether to wait for what another process is compiling.

        Returns:
            Whether it is loaded.
        """
        if self._loaded and given is None:
            return True
        signature = self.signature if given is None else given
        mark = FOLDER / f"{self.symbol}-{zlib.crc32(str(signature).encode()):08x}"
        with _LOCK, without_garbage_collection():
            callees = [*called(self._calls), *named(self.py_func)]
            kernels = [callee for callee in callees if isinstance(callee, Kernel)]
            busy = [callee for callee in kernels if not callee.load(wait=False)]
            if busy and not wait:
                return False
            for callee in busy:
                callee.load()
            with one_process(self.symbol, wait) as free:
                if not free:
                    return False
                for callee in callees if not mark.exists() else ():
                    if callee in SIGNATURES and not callee.signatures:
                        with compiling(callee):
                            callee.compile(SIGNATURES[callee])
                        callee.disable_compile()
                with compiling(self.function):
                    self._compile(signature)
                with suppress(OSError):
                    mark.touch()
            if given is None:
                llvm.add_symbol(self.symbol, self._address("llvm_func_name"))
            self._loaded = True
        return True

    def callback(self) -> int:
        """Address by which C calls it, if it was made with `no_cfunc_wrapper=False`."""
        self.load()
        return self._address("llvm_cfunc_wrapper_name")

    def _address(self, of: str) -> int:
        (made,) = self.function.overloads.values()
        return made.library.get_pointer_to_function(getattr(made.fndesc, of))

    def _compile(self, signature: Any) -> None:
        self.function.disable_compile(False)
        for last in (False, True):
            try:
                self.function.compile(signature)
                break
            except (NumbaError, AssertionError):  # a mistake in a text, or in `calls`
                raise
            except Exception as error:  # unpickling damaged bytes may raise anything
                if last:
                    raise
                kind = NoKernelCache if isinstance(error, OSError) else DamagedKernelCache
                warnings.warn(kind(f"{type(error).__name__}: {error}"), stacklevel=4)
                for path in FOLDER.rglob(f"*.{self.__name__}-*.nb?"):
                    path.unlink(missing_ok=True)  # compiled already if it only could not be saved
        self.function.disable_compile()

    def _lower(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        assert self._loaded, f"{self.symbol} is missing in the `calls` of a kernel"
        convention = context.call_conv
        kind = convention.get_function_type(signature.return_type, signature.args)
        module = builder.module
        found = module.globals.get(self.symbol) or ir.Function(module, kind, self.symbol)
        given = builder, found, signature.return_type, signature.args, arguments
        return convention.call_function(*given)[1]


def named(function: Callable[..., Any]) -> Iterator[Any]:
    """Kernels, and helpers with their own callees before them, that a function's text names."""
    found = inspect.getclosurevars(function)
    yield from called((*found.nonlocals.values(), *found.globals.values()))


def called(values: Iterable[Any]) -> Iterator[Any]:
    """The compiled functions among some values, each after its own callees."""
    for value in values:
        if isinstance(value, Kernel) and value.signature is not None:
            yield value
        elif isinstance(value, Kernel) or is_jitted(value):
            yield from named(value.py_func)
            if value in SIGNATURES:
                yield value


@typeof_impl.register(Kernel)
def _type_of_kernel(kernel: Kernel, _: Any) -> Any:
    return None if kernel.signature is not None else typeof(kernel.part)  # else see `_lower`
