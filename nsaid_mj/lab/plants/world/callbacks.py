"""Compiled MuJoCo callbacks for forces that MJCF cannot express exactly.

MuJoCo's callbacks are global to the process, so a context manager installs and removes them. A
compiled callback reads its parameters from `mjData.userdata`, whose offset in the C structure is
found at run time.

Two documented features of numba reach MuJoCo's C side. A callback gets the address of mjData, whose
entries are addresses of arrays (`carray`). A C function is called by its name (`c_function`).
Neither embeds an address in the compiled code, so it can be cached on disk for later processes.
"""

import ctypes
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
from llvmlite import binding as llvm
from numba import boolean, carray, f8, i8, types
from numba.extending import intrinsic

from ....core import kernel, routine

WORDS = 1 << 15
"""Number of 8-byte words of mjData to search; its pointers are near word 20,000 in MuJoCo 4.0."""

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
    """A void function of MuJoCo's C library, as named in mujoco.h, for compiled code.

    Parameters are numba types; a pointer is a `types.uintp`, like `ndarray.ctypes.data`.
    """
    address = ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value
    llvm.add_symbol(name, address)
    return types.ExternalFunction(name, types.void(*parameters))


def _pointer(_: Any, address: Any, kind: Any) -> Any:
    """In compiled code, an address as a pointer of a type, for `numba.carray`."""

    def made(context: Any, builder: Any, _: Any, given: Any) -> Any:
        return builder.inttoptr(given[0], context.get_value_type(kind.instance_type))

    return kind.instance_type(address, kind), made


pointer: Any = intrinsic(_pointer)
array_at: Any = carray  # as numba's stub does not allow a number as shape
NUMBERS = types.CPointer(f8)
INDICES = types.CPointer(i8)


@routine(f8[::1](types.uintp, i8, i8), _nrt=True)
def vector_of(user, layout, k):
    """Part k of float64 userdata at an address, as an array of numbers.

    From word `layout` on, the userdata hold three numbers for every part: the word at which it
    begins, and its numbers of rows and columns.
    """
    parts = array_at(pointer(user, NUMBERS), WORDS)
    own = layout + 3 * k
    at = user + types.uintp(8 * parts[own])
    return array_at(pointer(at, NUMBERS), i8(parts[own + 1]))


@routine(f8[:, ::1](types.uintp, i8, i8), _nrt=True)
def matrix_of(user, layout, k):
    """Part k of float64 userdata at an address, as a matrix; see `vector_of` for `layout`."""
    parts = array_at(pointer(user, NUMBERS), WORDS)
    own = layout + 3 * k
    at = user + types.uintp(8 * parts[own])
    return array_at(pointer(at, NUMBERS), (i8(parts[own + 1]), i8(parts[own + 2])))


@routine(i8[:, ::1](types.uintp, i8, i8), _nrt=True)
def table_of(user, layout, k):
    """Part k of userdata at an address, as a table of indices; see `vector_of` for `layout`."""
    parts = array_at(pointer(user, NUMBERS), WORDS)
    own = layout + 3 * k
    at = user + types.uintp(8 * parts[own])
    return array_at(pointer(at, INDICES), (i8(parts[own + 1]), i8(parts[own + 2])))


_LARGEST = float(mujoco.mjMAXVAL)
"""Magnitude of a control from which MuJoCo applies none."""


@routine(boolean(f8[::1]))
def accepted(u):
    """Whether MuJoCo applies the controls: it checks them next, warns of them and zeroes them."""
    for i in range(u.shape[0]):  # noqa: SIM110 (compiled)
        if not abs(u[i]) <= _LARGEST:
            return False
    return True


@kernel(f8(), inner=True, no_cfunc_wrapper=False)
def _clock():
    """A clock that stands still."""
    return 0.0


@cache
def _stopped_clock() -> Any:
    """A stopped clock for MuJoCo's timers, which are unused here and take a quarter of a step."""
    return ctypes.CFUNCTYPE(ctypes.c_double)(_clock.callback)


_in_use = False  # also set by plants without a callback: another plant's would act on them


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
        mujoco.set_mjcb_time(_stopped_clock())
        yield
    finally:
        mujoco.set_mjcb_passive(None)
        mujoco.set_mjcb_time(None)
        _in_use = False
