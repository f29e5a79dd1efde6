"""Eight numbers in place of one: a loop that was written for one identifier follows eight abreast.

`eights` sees an array (…, 8) of floats as an array (…) of `Eight`s. Given such arrays, a compiled
function is compiled once more, for vectors: the same operations in the same order, each rounded as
IEEE 754 asks, so that each of the eight comes out as it would alone, to the bit. What is the same
for all of them stays one float.

There is what loops of trees need, no more: + − × ÷, min, and `x > 0.0`, which asks whether all are.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np
from numba import njit, types
from numba.core.cgutils import ir, unpack_tuple
from numba.core.imputils import impl_ret_borrowed
from numba.core.typeconv import Conversion
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    overload,
    register_model,
    type_callable,
)
from numba.np.arrayobj import populate_array

from .lanes import LANES

VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class Eight(types.Type):
    """Numba's type of eight floats."""

    def __init__(self) -> None:
        super().__init__("Eight")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """A number stands for eight of the same."""
        return Conversion.safe if isinstance(other, types.Number) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """A variable that is a number here and eight there is eight."""
        return self if isinstance(other, types.Number) else None


EIGHT = Eight()


@register_model(Eight)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any):
        super().__init__(manager, kind, VECTOR)


@lower_cast(types.Number, Eight)
def _spread(context, builder, kind, _, number):
    """Eight of the same."""
    number, index = context.cast(builder, number, kind, types.float64), ir.IntType(32)
    nothing, first = VECTOR(ir.Undefined), ir.VectorType(index, LANES)([0] * LANES)
    return builder.shuffle_vector(builder.insert_element(nothing, number, index(0)), nothing, first)


# -- arithmetic ------------------------------------------------------------------------------------


def _define(function: Callable[..., Any], result: Any, emit: Callable[..., Any]) -> None:
    """Defines a function of two numbers of which at least one is eight."""

    @type_callable(function)
    def _type(context):
        def of(a, b):
            if EIGHT in (a, b) and all(isinstance(x, Eight | types.Number) for x in (a, b)):
                return result
            return None

        return of

    def lower(context, builder, signature, values):
        return emit(
            builder,
            *(
                context.cast(builder, value, kind, EIGHT)
                for kind, value in zip(signature.args, values, strict=True)
            ),
        )

    for kinds in ((Eight, Eight), (Eight, types.Number), (types.Number, Eight)):
        lower_builtin(function, *kinds)(lower)


def _smaller(builder: ir.IRBuilder, a: ir.Value, b: ir.Value) -> ir.Value:
    return builder.select(builder.fcmp_ordered("<", b, a), b, a)


def _all_above(builder: ir.IRBuilder, a: ir.Value, b: ir.Value) -> Any:
    above = builder.fcmp_ordered(">", a, b)
    each = [builder.extract_element(above, ir.IntType(32)(i)) for i in range(LANES)]
    return reduce(builder.and_, each)


for _functions, _instruction in (
    ((operator.add, operator.iadd), ir.IRBuilder.fadd),
    ((operator.sub, operator.isub), ir.IRBuilder.fsub),
    ((operator.mul, operator.imul), ir.IRBuilder.fmul),
    ((operator.truediv, operator.itruediv), ir.IRBuilder.fdiv),
):
    for _function in _functions:
        _define(_function, EIGHT, _instruction)
_define(min, EIGHT, _smaller)
_define(operator.gt, types.boolean, _all_above)


@type_callable(operator.neg)
def _type_negative(context):
    return lambda a: EIGHT if a == EIGHT else None


@lower_builtin(operator.neg, Eight)
def _negative(context, builder, signature, values):
    return builder.fneg(values[0])


# -- arrays ----------------------------------------------------------------------------------------


def _eights(typing, array):
    """An array (…, 8), C-contiguous, as an array (…) of `Eight`s in the same memory."""
    seen = types.Array(EIGHT, array.ndim - 1, "C", aligned=False)  # as floats are, to 8 bytes

    def emit(context, builder, signature, values):
        source = context.make_array(array)(context, builder, values[0])
        result = context.make_array(seen)(context, builder)
        populate_array(
            result,
            data=builder.bitcast(source.data, VECTOR.as_pointer()),
            shape=unpack_tuple(builder, source.shape, array.ndim)[:-1],
            strides=unpack_tuple(builder, source.strides, array.ndim)[:-1],
            itemsize=context.get_constant(types.intp, 8 * LANES),
            meminfo=source.meminfo,
        )
        return impl_ret_borrowed(context, builder, signature.return_type, result._getvalue())

    return seen(array), emit


eights: Any = intrinsic(_eights)


def zeros(shape, like) -> Any:
    """Zeros of a shape (a tuple), of the kind that the array `like` has: floats, or `Eight`s."""


@overload(zeros)
def _zeros(shape, like):
    if like.dtype == EIGHT:
        return lambda shape, like: eights(np.zeros((*shape, LANES)))
    return lambda shape, like: np.zeros(shape)


@njit(cache=True)
def copy_into(source, target):
    """Writes what is in an array (k,) of either kind into another: slices of `Eight`s cannot."""
    for i in range(source.shape[0]):
        target[i] = source[i]
