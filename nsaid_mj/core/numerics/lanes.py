"""Several runs at once: a compiled type of number that is one number for each of several runs.

What is compiled for arrays of f8 is compiled from the same text for arrays of `lanes`: each is a
vector register, in which every operation acts on all runs, with the bits that it has on one.
Conditions on numbers hold if they do for all runs. Python stores them as the last axis of arrays.

Of numba this needs, besides its documented interface, the fields of an array (`numba.np.arrayobj`,
`numba.core.cgutils`) and the name of a conversion (`numba.core.typeconv`): no documented call makes
an array of one type from the memory of another. `tests/core/numerics/test_lanes.py` fails where a
version of numba moves them.
"""

import operator
from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.core.typeconv import Conversion
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    register_model,
    type_callable,
)
from numba.np.arrayobj import make_array, populate_array

WIDTH = 8
"""Doubles in the widest vector register of today's processors."""
COMPILED = not config.DISABLE_JIT
"""Whether kernels are compiled: as plain Python they cannot serve several runs at once."""


class Lanes(types.Type):
    """Numba's type of one number for each of `WIDTH` runs; a plain number is that of all runs."""

    def can_convert_from(self, _: Any, other: Any) -> Any:
        """Plain numbers become one for each run."""
        return Conversion.safe if isinstance(other, types.Number) else None

    def unify(self, _: Any, other: Any) -> Any:
        """With a plain number, lanes."""
        return self if isinstance(other, types.Number) else None


lanes = Lanes("lanes")


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any):
        super().__init__(manager, kind, ir.VectorType(ir.DoubleType(), WIDTH))


@lower_cast(types.Number, lanes)
def _spread(context: Any, builder: Any, kind: Any, _: Any, number: Any) -> Any:
    number = context.cast(builder, number, kind, types.f8)
    vector = ir.Constant(ir.VectorType(number.type, WIDTH), ir.Undefined)
    zero = ir.IntType(32)(0)
    vector = builder.insert_element(vector, number, zero)
    return builder.shuffle_vector(
        vector, vector, ir.Constant(ir.VectorType(zero.type, WIDTH), None)
    )


def _is_lanes(*kinds: Any) -> bool:
    return any(kind == lanes for kind in kinds) and all(
        kind == lanes or isinstance(kind, types.Number) for kind in kinds
    )


def _define(function: Any, result: Any, count: int, write: Callable[..., Any]) -> None:
    """Defines a function of lanes and numbers, by what writes its code for lanes."""
    if count == 1:
        type_callable(function)(lambda _: lambda x: result if _is_lanes(x) else None)
    else:
        type_callable(function)(lambda _: lambda x, y: result if _is_lanes(x, y) else None)

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        pairs = zip(given, signature.args, strict=True)
        return write(builder, *(context.cast(builder, one, kind, lanes) for one, kind in pairs))

    kinds = (lanes, types.Number)
    for first in kinds:
        for second in kinds if count == 2 else (None,):
            chosen = [kind for kind in (first, second) if kind]
            if lanes in chosen:
                lower_builtin(function, *chosen)(made)


def _all(order: str) -> Callable[..., Any]:
    def write(builder: Any, x: Any, y: Any) -> Any:
        true = builder.fcmp_ordered(order, x, y)
        bits = builder.bitcast(true, ir.IntType(WIDTH))
        return builder.icmp_unsigned("==", bits, bits.type(2**WIDTH - 1))

    return write


def _smaller(builder: Any, x: Any, y: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", y, x), y, x)


for _functions, _name in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _function in _functions:
        _define(_function, lanes, 2, lambda builder, x, y, name=_name: getattr(builder, name)(x, y))
_define(operator.neg, lanes, 1, lambda builder, x: builder.fneg(x))
_define(operator.gt, types.boolean, 2, _all(">"))
_define(min, lanes, 2, _smaller)


# -- arrays ----------------------------------------------------------------------------------------


def has_lanes(kind: Any) -> bool:
    """Whether a type is lanes, an array of lanes, or a tuple with any."""
    if isinstance(kind, types.BaseTuple):
        return any(has_lanes(part) for part in _parts(kind))
    return kind == lanes or (isinstance(kind, types.Array) and kind.dtype == lanes)


def _parts(kind: Any) -> list[Any]:
    """The types of a tuple's parts."""
    return list(kind)


def _mapped(kind: Any, array: Callable[[Any], Any]) -> Any:
    """The type of an array or of a tuple of arrays, each array's type mapped by a function."""
    if not isinstance(kind, types.BaseNamedTuple):
        return array(kind)
    parts = [_mapped(part, array) for part in _parts(kind)]
    if len(set(parts)) == 1:  # as numba calls the type of such a tuple
        return types.NamedUniTuple(parts[0], len(parts), kind.instance_class)
    return types.NamedTuple(parts, kind.instance_class)


def widened(kind: Any) -> Any:
    """The type, in Python, of an array of f8, or of a tuple of such arrays, for several runs."""
    return _mapped(kind, lambda one: types.Array(types.f8, one.ndim + 1, "C"))


def _in_lanes(kind: Any) -> Any:
    """The type of arrays (…, WIDTH) of f8 as arrays of lanes, which numpy aligns by 16 bytes."""
    return _mapped(kind, lambda one: types.Array(lanes, one.ndim - 1, "C", aligned=False))


def laned(signature: Any, given: Any) -> Any:
    """A function's signature with arguments of which some are lanes: then its result is lanes."""
    args = [
        kind if has_lanes(kind) else own for kind, own in zip(given, signature.args, strict=True)
    ]
    result = lanes if signature.return_type == types.f8 else signature.return_type
    return result(*args)


def _viewed(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Code of `as_lanes`."""
    if isinstance(kind, types.BaseTuple):
        parts = enumerate(_parts(kind))
        found = [_viewed(context, builder, t, builder.extract_value(value, i)) for i, t in parts]
        return context.make_tuple(builder, _in_lanes(kind), found)
    source = make_array(kind)(context, builder, value)
    target = make_array(_in_lanes(kind))(context, builder)
    shape = cgutils.unpack_tuple(builder, source.shape)[:-1]
    strides = cgutils.unpack_tuple(builder, source.strides)[:-1]
    pointer = context.get_value_type(lanes).as_pointer()
    populate_array(
        target,
        data=builder.bitcast(source.data, pointer),
        shape=shape,
        strides=strides,
        itemsize=context.get_constant(types.intp, 8 * WIDTH),
        meminfo=source.meminfo,
        parent=source.parent,
    )
    return target._getvalue()


def _as_lanes(_: Any, value: Any) -> Any:
    """In compiled code, an array (…, WIDTH) of f8, or a tuple of such arrays, as lanes."""

    def made(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return _viewed(context, builder, signature.args[0], given[0])

    return _in_lanes(value)(value), made


as_lanes: Any = cast("Any", intrinsic(_as_lanes))
