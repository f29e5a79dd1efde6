"""Kernels translated ahead of time, so that a first run need not translate their Python text.

Numba spends most of its time on a kernel's Python text, and little on LLVM's code for it. So the
package brings LLVM's code of all kernels, optimised, one file for each platform; what is left is
to make machine code of the few that a run calls, for the processor at hand. The file is made from
the Python text by `scripts/kernels.py`, names the sources and the numba that it was made from, and
is not used with any other: after an edit of a kernel, numba compiles as if there were no file.
"""

import hashlib
import json
import lzma
import os
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

import llvmlite
import numba
from llvmlite import binding

from .cache import FOLDER, PACKAGE, sources_digest

_FILES = PACKAGE / "_kernels"


class Shipped(NamedTuple):
    """A kernel's code."""

    function: str  # name of the function that compiled functions call
    callback: str  # name of that which C calls, or ""
    code: str  # LLVM's


def origin() -> list[str]:
    """What a file must have been made from: all sources of kernels, numba and llvmlite."""
    return [sources_digest(), numba.__version__, llvmlite.__version__]


def path() -> Path:
    """The file for this platform."""
    return _FILES / f"{binding.get_process_triple()}.json.xz"


def write(kernels: dict[str, Shipped]) -> None:
    """Writes the file for this platform, from kernels by their symbols."""
    _FILES.mkdir(exist_ok=True)
    text = json.dumps({"origin": origin(), "kernels": dict(sorted(kernels.items()))})
    path().write_bytes(lzma.compress(text.encode(), preset=9))


@cache
def _kernels() -> dict[str, list[str]]:
    """Those of the file; none if it is missing, damaged, or made from something else."""
    try:
        content = json.loads(lzma.decompress(path().read_bytes()))
    except (OSError, lzma.LZMAError, ValueError):
        return {}
    return content["kernels"] if content["origin"] == origin() else {}


def stripped(text: str, *kept: str) -> str:
    """A module's text with only those functions whose names are given, and what they need."""
    module = binding.parse_assembly(text)
    defined = {function.name for function in module.functions if not function.is_declaration}
    assert defined.issuperset(kept), "numba gives no code of what it has loaded from its cache"
    for function in module.functions:
        if not function.is_declaration and function.name not in kept:
            function.linkage = "internal"
    passes = binding.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, binding.create_pass_builder(_machine(), binding.PipelineTuningOptions()))
    return str(module)


_engines: list[binding.ExecutionEngine] = []  # they own the machine code


def load(symbol: str) -> tuple[int, int] | None:
    """Addresses of a kernel's functions for compiled code and for C; None if it is not shipped.

    The addresses of all kernels that it calls must be known to LLVM. Machine code is cached in the
    folder of compiled kernels.
    """
    cached = FOLDER / f"{symbol}.o"
    found = _saved(cached)
    if found is None and symbol not in _kernels():
        return None
    _start_runtime()
    if found is None:
        function, callback, text = _kernels()[symbol]
        module = binding.parse_assembly(text)
        if not _resolvable(module):
            return None
        code = _machine().emit_object(module)
        _save(cached, function, callback, code)
    else:
        function, callback, code = found
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), _machine())
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    address = engine.get_function_address(function)
    return address, engine.get_function_address(callback) if callback else 0


def _save(file: Path, function: str, callback: str, code: bytes) -> None:
    """Writes machine code with its names, and a digest before; nothing if that is not possible."""
    content = json.dumps([function, callback]).encode() + b"\n" + code
    part = file.with_suffix(f".{os.getpid()}")
    with suppress(OSError):
        part.write_bytes(hashlib.sha256(content).digest() + content)
        part.replace(file)


def _saved(file: Path) -> tuple[str, str, bytes] | None:
    """The names and the machine code in a file; None if there is none, or it is damaged."""
    with suppress(OSError):
        content = file.read_bytes()
        if content[:32] == hashlib.sha256(content[32:]).digest():
            names, _, code = content[32:].partition(b"\n")
            function, callback = json.loads(names)
            return function, callback, code
    return None


def _resolvable(module: binding.ModuleRef) -> bool:
    """Whether LLVM knows all functions that a module calls; else it would end the process."""
    outside = [f.name for f in module.functions if f.is_declaration]
    return all(
        name.startswith("llvm.") or binding.address_of_symbol(name) is not None for name in outside
    )


@numba.njit(cache=True)
def _nothing() -> None:
    """Does nothing."""


@cache
def _start_runtime() -> None:
    """Has numba tell LLVM of its functions that allocate arrays, as it does with its first one."""
    try:
        _nothing()
    except Exception:  # unpickling damaged bytes may raise anything
        numba.njit(_nothing.py_func).compile(())


@cache
def _machine() -> binding.TargetMachine:
    """The processor at hand."""
    features = binding.get_host_cpu_features().flatten()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(
        cpu=binding.get_host_cpu_name(), features=features, opt=3, codemodel="jitdefault"
    )
