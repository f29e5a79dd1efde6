"""Compiled MuJoCo callbacks for forces that MJCF cannot express exactly.

MuJoCo's callbacks are global to the process, so a context manager installs and removes them. A
compiled callback reads its parameters from `mjData.userdata`, whose offset in the C structure is
found at run time.

Two documented features of numba reach MuJoCo's C side. A callback declares mjData as a pointer to
pointers (`ARRAYS`), so that each of its entries is the typed address of an array. A C function is
called by its name (`c_function`). Neither embeds an address in the compiled code, so it can be
cached on disk for later processes.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
from llvmlite import binding as llvm
from llvmlite import ir
from numba import cfunc, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

WORDS = 1 << 15
"""How many 8-byte words of mjData are searched; its pointers are near word 20,000 in MuJoCo 4.0."""

ARRAYS = types.CPointer(types.CPointer(types.float64))
"""A C structure viewed as an array of pointers to arrays of float64."""

_LIBRARY = re.compile(r"libmujoco\.so\.[\d.]+|libmujoco\.[\d.]+\.dylib|mujoco\.dll")

_PROBE = """<mujoco><size nuserdata="3"/><worldbody><body><joint name="j"/>
<geom size="1"/></body></worldbody><actuator><general joint="j" dyntype="integrator"/></actuator>
</mujoco>"""  # one activation, so that no two arrays of mjData share an address


@cache
def field_offsets() -> dict[str, int]:
    """Offsets in mjData, in 8-byte words, of the pointers to the arrays that callbacks use.

    Raises:
        RuntimeError: the layout of mjData is not the expected one.
    """
    model = mujoco.MjModel.from_xml_string(_PROBE)
    data: Any = mujoco.MjData(model)
    words = (ctypes.c_uint64 * WORDS).from_address(data._address)
    offsets = {}
    for name in ("qpos", "qvel", "ctrl", "act", "xpos", "xmat", "qfrc_passive", "userdata"):
        address = getattr(data, name).ctypes.data
        found = next((i for i in range(WORDS) if words[i] == address), None)
        if found is None:
            raise RuntimeError(f"mjData.{name} not found: this MuJoCo lays out mjData differently")
        offsets[name] = found
    return offsets


@cache
def _library() -> Any:
    folder = Path(mujoco.__file__).parent
    return ctypes.CDLL(
        str(next(path for path in sorted(folder.iterdir()) if _LIBRARY.fullmatch(path.name)))
    )


def c_function(name: str, *parameters: Any) -> Any:
    """A void function of MuJoCo's C library, for compiled code.

    Args:
        name: as in mujoco.h.
        parameters: numba types of its arguments; a pointer is a `types.uintp`, like
            `ndarray.ctypes.data`.
    """
    address = ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value
    llvm.add_symbol(name, address)
    return types.ExternalFunction(name, types.void(*parameters))


def _made(context: Any, builder: Any, kind: Any, address: Any, sizes: Any) -> Any:
    """Code that makes a C-contiguous array of a type at an address.

    It is `carray` for functions that count no references to arrays, as `carray` does.
    """
    array = arrayobj.make_array(kind)(context, builder)
    step = context.get_constant(types.intp, 8)
    strides = [step]
    for size in sizes[:0:-1]:
        strides.insert(0, builder.mul(strides[0], size))
    arrayobj.populate_array(
        array,
        data=builder.inttoptr(address, context.get_data_type(kind.dtype).as_pointer()),
        shape=sizes,
        strides=strides,
        itemsize=step,
        meminfo=None,
    )
    return array._getvalue()


def _array_at(_: Any, kind: Any, address: Any, shape: Any) -> Any:
    """In compiled code, the array of a type and shape at an address."""

    def view(context: Any, builder: Any, _: Any, given: Any) -> Any:
        sizes = cgutils.unpack_tuple(builder, given[2])
        return _made(context, builder, kind.instance_type, given[1], sizes)

    return kind.instance_type(kind, address, shape), view


def _part(_: Any, kind: Any, user: Any, layout: Any, k: Any) -> Any:  # noqa: ARG001, as called
    """In compiled code, part k of float64 userdata at an address, as an array of a type.

    From word `layout` on, the userdata hold three numbers of every part: the word at which it
    begins, and its numbers of rows and columns.
    """
    word, made = ir.IntType(64), kind.instance_type

    def view(context: Any, builder: Any, _: Any, given: Any) -> Any:
        numbers = builder.inttoptr(given[1], ir.DoubleType().as_pointer())
        first = builder.add(given[2], builder.mul(given[3], word(3)))
        places = [builder.gep(numbers, [builder.add(first, word(i))]) for i in range(3)]
        at, *sizes = (builder.fptosi(builder.load(place), word) for place in places)
        address = builder.add(given[1], builder.mul(at, word(8)))
        return _made(context, builder, made, address, sizes[: made.ndim])

    return made(kind, types.uintp, types.int64, types.int64), view


array_at: Any = intrinsic(_array_at)
part: Any = intrinsic(_part)


@cache
def _stopped_clock() -> Any:
    """A clock for MuJoCo's timers, which nobody reads here and which take a quarter of a step."""

    @cfunc(types.float64(), cache=True)
    def clock():
        return 0.0

    return clock


_in_use = False  # set also by plants without a callback: another plant's would act on them


@contextmanager
def installed(passive: Any | None) -> Iterator[None]:
    """Context in which MuJoCo calls a compiled passive-force callback.

    Raises:
        RuntimeError: another plant is running; a callback would act on both.
    """
    global _in_use  # noqa: PLW0603 (as global as MuJoCo's own)
    if _in_use or mujoco.get_mjcb_passive() is not None:
        raise RuntimeError("another plant is running in this process; run plants one after another")
    _in_use = True
    try:
        mujoco.set_mjcb_passive(passive)
        mujoco.set_mjcb_time(_stopped_clock().ctypes)
        yield
    finally:
        mujoco.set_mjcb_passive(None)
        mujoco.set_mjcb_time(None)
        _in_use = False
