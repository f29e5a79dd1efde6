"""How numba compiles parts of kernels: once for all kernels, and optimised only within them.

By default numba optimises a function again in every function that contains it, translates it to
machine code although only its callers run, and compares all options of a compilation at every
operator. Without these steps a robot's first run compiles in three quarters of the time. The
overridden methods are not in numba's manual; pyproject.toml names the tested versions.
"""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.registry import cpu_target
from numba.extending import lower_builtin, type_callable

FAST: Any = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True, "nogil": True}
"""Division by 0 gives inf or NaN, as in numpy, and numba compiles no error messages. Without `_nrt`
it counts no references to the arrays of a call, half of a stage's time; nothing is allocated."""
INLINE: Any = {"forceinline": True}


class _Options(Flags):
    """Options that are compared by what was set, and not one by one with their defaults."""

    __slots__ = ()

    def __hash__(self) -> int:
        return len(self._values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Options) and self._values == other._values


class FastCompiler(Compiler):
    """Numba's compiler, with options that are compared fast."""

    def __init__(self, *given: Any):
        typing, target, library, arguments, returned, flags, variables = given
        own = _Options(flags)
        super().__init__(typing, target, library, arguments, returned, own, variables)


class _Unoptimised(JITCodeLibrary):
    """Code of a part for its callers, without the steps needed only to run it."""

    def _optimize_final_module(self) -> None: ...

    def _finalize_final_module(self) -> None:
        self._finalized = True


class Compiled(ABC):
    """A function that compiled functions call.

    The types of its calls follow from its signature alone: numba infers no types through it.
    Without a signature, compiled functions cannot call it before it is compiled. `options` are
    those of `numba.njit`, with a signature on top of `FAST`.
    """

    def __init__(self, function: Callable[..., Any], signature: Any, options: Any):
        self.py_func, self.signature = function, signature
        self._options = options if signature is None else FAST | options
        if signature is not None:

            def typed(*_: Any) -> Any:
                return signature

            typed.pysig = inspect.signature(function)  # type: ignore[attr-defined]
            type_callable(self)(lambda _: typed)
            lower_builtin(self, *signature.args)(self._call)

    @abstractmethod
    def __call__(self, *arguments: Any) -> Any:
        """Calls it from Python."""

    @abstractmethod
    def _call(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Code that calls it."""


class Part(Compiled):
    """A helper or routine, which is compiled when the first function that calls it is."""

    def __call__(self, *arguments: Any) -> Any:
        """Its text, run by Python."""
        return self.py_func(*arguments)

    @cached_property
    def _made(self) -> Any:
        """What numba makes of it."""
        flags, library = Flags(), _Unoptimised(cpu_target.target_context.codegen(), "part")
        flags.error_model, flags.nrt = self._options["error_model"], self._options["_nrt"]
        flags.forceinline = self._options.get("forceinline", False)
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        contexts = cpu_target.typing_context, cpu_target.target_context
        kinds = self.signature.args, self.signature.return_type
        return FastCompiler(*contexts, library, *kinds, flags, {}).compile_extra(self.py_func)

    def _call(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Code that calls it."""
        context.active_code_library.add_linking_library(self._made.library)
        made = self._made.fndesc
        return context.call_internal_no_propagate(builder, made, signature, arguments)[1]
