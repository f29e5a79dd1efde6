"""Packs: the numbers of several runs as one number of compiled code, in one vector register.

Numbers of a loop over runs do not depend on each other. A function compiled for arrays of packs
instead of arrays of float64 computes `LANES` runs at once, each to the bit as alone, from the same
text. A number that all runs share stays a float64. A comparison holds if it holds for every run.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv.rules import default_type_manager
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    register_model,
    type_callable,
)
from numba.np import arrayobj

from ..parameters import Array
from .lanes import LANES


class Pack(types.Type):
    """The type of a pack."""


PACK: Any = Pack("pack")
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_NUMBERS = (types.float64, types.int64, types.uint32)


@register_model(Pack)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any):
        super().__init__(manager, kind, _VECTOR)


def _of_number(context: Any, builder: Any, kind: Any, _: Any, number: Any) -> Any:
    """The pack of a number that all runs share."""
    number = context.cast(builder, number, kind, types.float64)
    first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), number, ir.IntType(32)(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
    return builder.shuffle_vector(first, first, zeros)


for _kind in _NUMBERS:
    default_type_manager.set_safe_convert(_kind, PACK)
for _kind in (*_NUMBERS, types.IntegerLiteral):
    lower_cast(_kind, PACK)(_of_number)


def _define(function: Any, result: Any, instruction: Any, count: int = 2) -> None:
    """Defines a function of packs, of which numbers may take the place, by an LLVM instruction."""

    def one(_: Any) -> Any:
        return lambda x: result if x is PACK else None

    def two(_: Any) -> Any:
        def typed(x: Any, y: Any) -> Any:
            suits = all(kind is PACK or types.unliteral(kind) in _NUMBERS for kind in (x, y))
            return result(PACK, PACK) if suits and PACK in (x, y) else None

        return typed

    type_callable(function)(one if count == 1 else two)
    lower_builtin(function, *(PACK,) * count)(
        lambda _context, builder, _signature, given: instruction(builder, *given)
    )


def _everywhere(comparison: str) -> Any:
    def holds(builder: Any, x: Any, y: Any) -> Any:
        bits = builder.bitcast(builder.fcmp_ordered(comparison, x, y), ir.IntType(LANES))
        return builder.icmp_unsigned("==", bits, ir.IntType(LANES)(2**LANES - 1))

    return holds


def _smaller(builder: Any, x: Any, y: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", y, x), y, x)  # as Python's min


for _operators, _instruction in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _operator in _operators:
        _define(_operator, PACK, getattr(ir.IRBuilder, _instruction))
_define(operator.neg, PACK, ir.IRBuilder.fneg, 1)
_define(operator.gt, types.boolean, _everywhere(">"))
_define(min, PACK, _smaller)


def _packs(_: Any, array: Any) -> Any:
    """In compiled code, an array (..., LANES) as an array (...) of packs."""
    kind = types.Array(PACK, array.ndim - 1, "C")

    def view(context: Any, builder: Any, _: Any, given: Any) -> Any:
        old = arrayobj.make_array(array)(context, builder, given[0])
        new = arrayobj.make_array(kind)(context, builder)
        shape = cgutils.unpack_tuple(builder, old.shape)[:-1]
        strides = cgutils.unpack_tuple(builder, old.strides)[:-1]
        arrayobj.populate_array(
            new,
            data=builder.bitcast(old.data, context.get_data_type(PACK).as_pointer()),
            shape=cgutils.pack_array(builder, shape),
            strides=cgutils.pack_array(builder, strides),
            itemsize=context.get_constant(types.intp, 8 * LANES),
            meminfo=None,
        )
        return new._getvalue()

    return kind(array), view


packs: Any = intrinsic(_packs)


def packed(*shape: int) -> Array:
    """Zeros (*shape, LANES), aligned as packs have to be."""
    count, step = int(np.prod(shape)) * LANES, 8 * LANES
    flat = np.zeros(count + LANES)
    first = (-flat.ctypes.data % step) // 8
    return flat[first : first + count].reshape(*shape, LANES)
