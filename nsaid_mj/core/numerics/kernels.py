"""Compiled functions: each is compiled once, by one process at a time, and cached on disk.

A function called from Python is a `kernel`. Those called only from compiled code are either a
kernel, called by its address, or a `helper` or `routine`, compiled into its callers.

Only numba's documented interface is used: `njit` and its options, and `numba.extending`. The types
of a call follow from the called function's signature alone, so numba infers no types through it,
and calls of kernels are calls of an address, so that no kernel is compiled into another.
"""

import gc
import inspect
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from types import FunctionType
from typing import Any, cast

from llvmlite import binding, ir
from numba import NumbaError, config, njit, typeof, types
from numba.extending import lower_builtin, type_callable, typeof_impl

from ...base import Stopwatch
from . import shipped
from .cache import FOLDER, one_process, use_folder
from .errors import DamagedKernelCache, NoKernelCache
from .lanes import has_lanes, laned

f8 = types.f8
i8 = types.i8
void = types.void
boolean = types.boolean
index = types.u4
vector = f8[::1]
matrix = f8[:, ::1]
cube = f8[:, :, ::1]
table = i8[:, ::1]
strided = f8[:, :]

FAST: Any = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True, "nogil": True}
"""Division by 0 gives inf or NaN, as in numpy, and numba compiles no error messages. Without `_nrt`
it counts no references to the arrays of a call, half of a stage's time; nothing is allocated."""
INLINE: Any = {"forceinline": True}

_njit = cast("Any", njit)  # whose type has no dict of options


def helper(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a small function that becomes part of the compiled functions that call it."""
    return routine(signature, **INLINE, **options)


def routine(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Marks a larger function, which need not become part of every function that calls it."""
    return lambda f: f if config.DISABLE_JIT else Part(f, signature, options)


def kernel(signature: Any = None, **options: Any) -> Any:
    """Marks a function that Python calls, or several compiled ones; see `Kernel`."""
    return lambda f: f if config.DISABLE_JIT else Kernel(f, signature, **options)


def kernel_for(kind: type, signature: Any, text: Callable[..., Any], **meanings: Any) -> Any:
    """A kernel with a function's text, in which some global names have the meanings for a class.

    Numba's cache does not see when one of the meanings changes, so it is used for our classes only.
    """
    ours = kind.__module__.partition(".")[0] == __name__.partition(".")[0]
    return kernel(signature, cache=ours)(composed(kind, text, **meanings))


def composed(kind: type, text: Callable[..., Any], **meanings: Any) -> FunctionType:
    """A function with another's text, in which some global names have the meanings for a class."""
    name = f"{text.__name__}_{kind.__module__}.{kind.__qualname__}".replace(".", "_")
    made = FunctionType(text.__code__, text.__globals__ | meanings, name)
    made.__qualname__ = name
    made.__doc__ = text.__doc__
    return made


def inlined(kernel: Any) -> Any:
    """A kernel with a signature as a part of its callers: a call passes every array's size, too.

    This saves a tenth of the time of a small step, and is compiled again with every caller.
    """
    return kernel if config.DISABLE_JIT else Part(kernel.py_func, kernel.signature, INLINE)


class Compiled(ABC):
    """A function that compiled functions call.

    The types of its calls follow from its signature alone: numba infers no types through it.
    Without a signature, compiled functions cannot call it before it is compiled. `options` are
    those of `numba.njit`, with a signature on top of `FAST`.
    """

    def __init__(self, function: Callable[..., Any], signature: Any, options: Any):
        self.py_func = function
        self.signature = signature
        self._options = options if signature is None else FAST | options
        self._parts: dict[Any, Any] = {}  # what numba made of it, by types of arguments
        if signature is not None:

            def typed(*given: Any) -> Any:
                return laned(signature, given) if any(map(has_lanes, given)) else signature

            typed.pysig = inspect.signature(function)  # type: ignore[attr-defined]
            type_callable(self)(lambda _: typed)
            lower_builtin(self, types.VarArg(types.Any))(self._lower)

    @abstractmethod
    def __call__(self, *arguments: Any) -> Any:
        """Calls it from Python."""

    def _lower(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Code that calls it; of several runs at once, it becomes part of its caller."""
        call = self._call if signature.args == self.signature.args else self._call_part
        return call(context, builder, signature, arguments)

    def _call_part(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Code that calls it as a part of its caller."""
        made = self._parts.get(signature.args)
        if made is None:
            function = _njit(no_cpython_wrapper=True, **self._options)(self.py_func)
            function.compile(signature)
            (made,) = function.overloads.values()
            self._parts[signature.args] = made
        context.add_linking_libs([made.library])
        return context.call_internal_no_propagate(builder, made.fndesc, signature, arguments)[1]

    @abstractmethod
    def _call(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Code that calls it."""


class Part(Compiled):
    """A helper or routine, which is compiled when the first function that calls it is."""

    def __call__(self, *arguments: Any) -> Any:
        """Its text, run by Python."""
        return self.py_func(*arguments)

    def _call(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Code that calls it."""
        return self._call_part(context, builder, signature, arguments)


class Kernel(Compiled):
    """A function that Python calls, and that compiled functions call by its address.

    Numba recompiles every other function with each of its direct and indirect callers. With a
    signature, it is compiled with `FAST`; without, for the types that Python calls it with, and as
    part of every compiled function that calls it. Only compiled functions call an `inner` one, and
    Python in tests; `options` are those of `numba.njit`.

    If the package brings its code (`numerics.shipped`), its text is not compiled: Python then calls
    a thin function, which calls it by its address.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        signature: Any = None,
        inner: bool = False,
        **options: Any,
    ):
        super().__init__(function, signature, {"nogil": True} | options)
        self.symbol = f"{function.__module__}.{function.__name__}"
        self.__name__ = function.__name__
        self.__doc__ = function.__doc__
        self.inner = inner
        self._called: Callable[..., Any] | None = None  # once it is loaded, what Python calls
        if signature is not None:
            KERNELS[self.symbol] = self

    def __call__(self, *arguments: Any) -> Any:
        """Calls it from Python; raises TypeError if its signature has other types."""
        if self._called is not None:
            try:
                return self._called(*arguments)
            except TypeError:
                if self.signature is not None:
                    raise
        return self.load(*map(typeof, arguments))(*arguments)

    def load(self, *given: Any) -> Callable[..., Any]:
        """Makes it ready for calls from Python; returns what they call.

        If it has no signature, the types of the arguments are given.
        """
        if self.inner or (self.signature is not None and self._shipped is not None):
            caller = self._caller()
            _compile(caller, self.signature, f"{self.symbol} from Python")
        else:
            self._compile(*given)
            caller = self.function
        self._called = caller  # last: other threads may be calling it
        return caller

    @cached_property
    def function(self) -> Any:
        """Numba's function of its text."""
        use_folder()
        own = {"cache": True, "no_cpython_wrapper": self.inner} | self._options
        return _njit(**own)(self.py_func)

    def _compile(self, *given: Any) -> None:
        """Has numba compile it after all that it calls, or loads it from numba's cache."""
        for callee in callees(named(self.py_func)):
            assert callee.address  # by its name it is found from code that comes from the cache
        _compile(self.function, self.signature or given, self.symbol)

    def _caller(self) -> Any:
        """A function for Python that calls it by its address."""
        assert self.address
        names = ", ".join(inspect.signature(self.py_func).parameters)
        name = self.symbol.replace(".", "_")
        made: dict[str, Any] = {"kernel": self, "__name__": __name__}
        exec(compile(f"def {name}({names}): return kernel({names})", __file__, "exec"), made)
        use_folder()
        return _njit(**{"cache": True} | self._options)(made[name])

    @cached_property
    def part(self) -> Any:
        """The part of a kernel without a signature that is compiled into its callers."""
        return _njit(no_cpython_wrapper=True, **self._options)(self.py_func)

    @cached_property
    def _shipped(self) -> tuple[int, int] | None:
        """Its addresses in code that the package brings, for compiled code and for C."""
        for callee in callees(named(self.py_func)):
            assert callee.address
        return None if self.py_func.__closure__ else shipped.load(self.symbol)

    @cached_property
    def address(self) -> int:
        """Address by which compiled functions call it."""
        if self._shipped is not None:
            address = self._shipped[0]
        else:
            self._compile()
            address = self._address("llvm_func_name")
        binding.add_symbol(self.symbol, address)
        return address

    @cached_property
    def callback(self) -> int:
        """Address by which C calls it, if it was made with `no_cfunc_wrapper=False`."""
        assert self.address
        if self._shipped is not None:
            return self._shipped[1]
        return self._address("llvm_cfunc_wrapper_name")

    def _address(self, of: str) -> int:
        (made,) = self.function.overloads.values()
        return made.library.get_pointer_to_function(getattr(made.fndesc, of))

    def renew(self) -> None:
        """Forgets numba's cache: before `translated`, of this kernel and all that it calls."""
        own = self._options | {"no_cpython_wrapper": True, "cache": False}
        self.function = _njit(**own)(self.py_func)

    def translated(self) -> shipped.Shipped:
        """Its code for `shipped.write`, newly translated from its text."""
        assert self.address
        (text,) = self.function.inspect_llvm().values()
        (made,) = self.function.overloads.values()
        own = made.fndesc
        callback = "" if self._options["no_cfunc_wrapper"] else own.llvm_cfunc_wrapper_name
        names = [name for name in (own.llvm_func_name, callback) if name]
        return shipped.Shipped(own.llvm_func_name, callback, shipped.stripped(text, *names))

    def _call(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Code that calls the function at `address`."""
        missing = f"{self.symbol} is not named in the text of a kernel that calls it"
        assert "address" in self.__dict__, missing
        convention = context.call_conv
        given = (signature.return_type, signature.args)
        kind = convention.get_function_type(*given)
        module = builder.module
        found = module.globals.get(self.symbol) or ir.Function(module, kind, self.symbol)
        return convention.call_function(builder, found, *given, arguments)[1]


KERNELS: dict[str, Kernel] = {}
"""All kernels with a signature, by their symbols."""


def _compile(function: Any, signature: Any, name: str) -> None:
    """Has numba compile a function, in one process at a time, or load it from its cache."""
    with one_process(name):
        function.disable_compile(False)
        try:
            _timed(function, signature)
        except (NumbaError, AssertionError):  # a mistake in a text
            raise
        except Exception as error:  # unpickling damaged bytes may raise anything
            kind = NoKernelCache if isinstance(error, OSError) else DamagedKernelCache
            warnings.warn(kind(f"{type(error).__name__}: {error}"), stacklevel=3)
            for path in FOLDER.rglob(f"*.{function.__name__}-*.nb?"):
                path.unlink(missing_ok=True)  # compiled already if it only could not be saved
            _timed(function, signature)
        function.disable_compile()


def _timed(function: Any, signature: Any) -> None:
    """Has numba compile a function; its time counts, unless it is loaded from the cache.

    Python's search for cycles is off meanwhile: it takes a tenth of the time of compiling.
    """
    collecting = gc.isenabled()
    begin = time.perf_counter()
    gc.disable()
    try:
        function.compile(signature)
    finally:
        if collecting:
            gc.enable()
    if not function.stats.cache_hits[signature]:
        Stopwatch.count(time.perf_counter() - begin)


def named(function: Callable[..., Any]) -> Iterator[Any]:
    """The values of the names in a function's text."""
    found = inspect.getclosurevars(function)
    yield from (*found.nonlocals.values(), *found.globals.values())


def callees(values: Iterable[Any]) -> Iterator[Kernel]:
    """The kernels with a signature among some values, and those that the others' texts name."""
    for value in values:
        if isinstance(value, Kernel) and value.signature is not None:
            yield value
        elif hasattr(value, "py_func"):
            yield from callees(named(value.py_func))


@typeof_impl.register(Kernel)
def _type_of(kernel: Kernel, _: Any) -> Any:
    return typeof(kernel.part) if kernel.signature is None else None
