"""Compiled MuJoCo callbacks: forces that MJCF cannot say exactly.

MuJoCo's callbacks are global to the process, so they are installed by a context manager only and
removed on every way out. A compiled callback reads its numbers from `mjData.userdata`, whose
place in the C structure is found at run time, never assumed.
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
import numpy as np
from llvmlite import ir
from numba import carray, cfunc, types
from numba.core import cgutils
from numba.extending import intrinsic

WORDS = 1 << 15
"""How many words of mjData are looked at; its pointers lie near word 20,000 in MuJoCo 4.0."""

_LIBRARY = re.compile(r"libmujoco\.so\.[\d.]+|libmujoco\.[\d.]+\.dylib|mujoco\.dll")

_PROBE = """<mujoco><size nuserdata="3"/><worldbody><body><joint name="j"/>
<geom size="1"/></body></worldbody><actuator><general joint="j" dyntype="integrator"/></actuator>
</mujoco>"""  # one activation, so that no two arrays of mjData share an address


@intrinsic
def as_pointer(typing_context: Any, address: Any = None) -> Any:  # noqa: ARG001 (numba's)
    """A word of mjData as a pointer, in compiled code."""

    def generate(context, builder, signature, arguments):  # noqa: ARG001
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.uintp), generate


@cache
def field_offsets() -> dict[str, int]:
    """The place, in 8-byte words, of mjData's pointers to the arrays that callbacks use."""
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
def c_address(name: str) -> int:
    """The address of a function of MuJoCo's own library, as mujoco.h calls it."""
    folder = Path(mujoco.__file__).parent
    library = next(path for path in sorted(folder.iterdir()) if _LIBRARY.fullmatch(path.name))
    function = getattr(ctypes.CDLL(str(library)), name)
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def _calling(kinds: str) -> Any:
    """What an intrinsic returns that calls a C function at an address.

    All addresses are words: compiled code that takes them as arguments can be cached, which code
    with ctypes' functions in it cannot.

    Args:
        kinds: of the arguments, p for a pointer and i for an int.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
        pointer, number = cgutils.voidptr_t, ir.IntType(32)
        function = ir.FunctionType(
            ir.VoidType(), [pointer if kind == "p" else number for kind in kinds]
        )
        address, *words = arguments
        values = [
            builder.inttoptr(word, pointer) if kind == "p" else word
            for kind, word in zip(kinds, words, strict=True)
        ]
        builder.call(builder.inttoptr(address, function.as_pointer()), values)
        return context.get_dummy_value()

    own = [types.uintp if kind == "p" else types.int32 for kind in kinds]
    return types.void(types.uintp, *own), generate


@intrinsic
def call_pp(context, f, a, b=None):  # noqa: ARG001 (numba looks at the names only)
    """Calls f(a, b), both pointers."""
    return _calling("pp")


@intrinsic
def call_ppp(context, f, a, b, c):  # noqa: ARG001
    """Calls f(a, b, c), all pointers."""
    return _calling("ppp")


@intrinsic
def call_ppip(context, f, a, b, c, d):  # noqa: ARG001
    """Calls f(a, b, c, d), all pointers but the int c."""
    return _calling("ppip")


@intrinsic
def call_pppppi(context, f, a, b, c, d, e, g):  # noqa: ARG001
    """Calls f(a, b, c, d, e, g), all pointers but the int g."""
    return _calling("pppppi")


@cache
def coulomb_friction() -> Any:
    """Passive force −c_i tanh(q̇_i/s_i) on every degree of freedom, exact and without creep.

    `userdata` holds [nv, c (nv), 1/s (nv)]. The caller keeps the returned object alive.
    """
    offsets = field_offsets()
    at_qvel, at_force, at_user = (offsets[k] for k in ("qvel", "qfrc_passive", "userdata"))

    @cfunc("void(voidptr, voidptr)", cache=True)
    def passive(model, data):  # noqa: ARG001 (MuJoCo's signature)
        words = carray(data, (WORDS,), np.uintp)
        nv = int(carray(as_pointer(words[at_user]), (1,), np.float64)[0])
        numbers = carray(as_pointer(words[at_user]), (1 + 2 * nv,), np.float64)
        velocity = carray(as_pointer(words[at_qvel]), (nv,), np.float64)
        force = carray(as_pointer(words[at_force]), (nv,), np.float64)
        for i in range(nv):
            force[i] -= numbers[1 + i] * np.tanh(velocity[i] * numbers[1 + nv + i])

    return passive


_in_use = False  # a plant without a callback, too, must not meet another's


@contextmanager
def installed(passive: Any | None) -> Iterator[None]:
    """Holds a compiled passive-force callback in MuJoCo; removes it whatever happens.

    Raises:
        RuntimeError: another plant is running; its callback would act on this one, or this on it.
    """
    global _in_use  # noqa: PLW0603 (as global as MuJoCo's own)
    if _in_use or mujoco.get_mjcb_passive() is not None:
        raise RuntimeError("another plant is running in this process; run plants one after another")
    _in_use = True
    try:
        mujoco.set_mjcb_passive(passive.ctypes if passive is not None else None)
        yield
    finally:
        mujoco.set_mjcb_passive(None)
        _in_use = False
