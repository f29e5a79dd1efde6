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
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

WORDS = 1 << 15
"""How many 8-byte words of mjData are searched; its pointers are near word 20,000 in MuJoCo 4.0."""

ARRAYS = types.CPointer(types.CPointer(types.float64))
"""A C structure viewed as an array of pointers to arrays of float64."""

CALLBACK = types.void(types.voidptr, ARRAYS)
"""The signature of MuJoCo's callbacks, f(mjModel*, mjData*)."""

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


def _pointer(_: Any, address: Any) -> Any:
    """An address as the pointer that `carray` takes, in compiled code."""

    def convert(_: Any, builder: Any, __: Any, given: Any) -> Any:
        return builder.inttoptr(given[0], cgutils.voidptr_t)

    return types.voidptr(address), convert


pointer: Any = intrinsic(_pointer)

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
        yield
    finally:
        mujoco.set_mjcb_passive(None)
        _in_use = False
