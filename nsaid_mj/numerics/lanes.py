"""A formula on small matrices, emitted for eight of them at once as straight vector code.

A loop over a 10 × 10 triangle is mostly counting, and the compiler does not vectorise it. Here a
formula written for one matrix runs once in Python, on symbols in place of numbers, and what it does
to them is the code: no loops, each operation on eight doubles. Processors with narrower registers
take it in parts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numba import types
from numba.core.cgutils import get_or_insert_function, ir  # llvmlite's, as numba has it
from numba.extending import intrinsic

LANES = 8
VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class Symbol:
    """Eight numbers that are known when the code runs; a formula may use + − × ÷ and np.sqrt."""

    def __init__(self, builder: ir.IRBuilder, value: Any):
        self._builder, self.value = builder, value

    def _emit(self, operation: str, left: Symbol | float, right: Symbol | float) -> Symbol:
        a, b = (
            x.value if isinstance(x, Symbol) else ir.Constant(VECTOR, [float(x)] * LANES)
            for x in (left, right)
        )
        return Symbol(self._builder, getattr(self._builder, operation)(a, b))

    def __add__(self, other: Symbol | float) -> Symbol:
        return self if _is(other, 0) else self._emit("fadd", self, other)

    def __sub__(self, other: Symbol | float) -> Symbol:
        return self if _is(other, 0) else self._emit("fsub", self, other)

    def __neg__(self) -> Symbol:
        return Symbol(self._builder, self._builder.fneg(self.value))

    def __mul__(self, other: Symbol | float) -> Symbol:
        return self if _is(other, 1) else self._emit("fmul", self, other)

    def __truediv__(self, other: Symbol | float) -> Symbol:
        return self._emit("fdiv", self, other)

    def __rtruediv__(self, other: float) -> Symbol:
        return self._emit("fdiv", other, self)

    __radd__, __rmul__ = __add__, __mul__

    def sqrt(self) -> Symbol:
        """What np.sqrt calls."""
        of_one, name = ir.FunctionType(VECTOR, [VECTOR]), f"llvm.sqrt.v{LANES}f64"
        root = get_or_insert_function(self._builder.module, of_one, name)
        return Symbol(self._builder, self._builder.call(root, [self.value]))


def _is(x: Symbol | float, number: int) -> bool:
    return not isinstance(x, Symbol) and x == number


def abreast(formula: Callable[[np.ndarray], Iterable[Symbol]], rows: int) -> Any:
    """What compiled code calls as f(source, result): row i of result is the formula's i-th value.

    Args:
        formula: of an array (rows,) of numbers, one per row of `source`; without any decision
            that depends on them.
        rows: how many it takes; `source` and `result`, C-contiguous, have 8 columns each.
    """

    @intrinsic
    def emitted(typing, source, result):  # noqa: ARG001, numba's signature
        def emit(context, builder, signature, arguments):
            def place(argument: int, row: int) -> ir.Value:
                array = context.make_array(signature.args[argument])
                first = array(context, builder, arguments[argument]).data
                at = builder.gep(first, [ir.Constant(ir.IntType(64), row * LANES)])
                return builder.bitcast(at, VECTOR.as_pointer())

            numbers = np.empty(rows, dtype=object)
            for row in range(rows):
                numbers[row] = Symbol(builder, builder.load(place(0, row), align=8))
            for row, number in enumerate(formula(numbers)):
                builder.store(number.value, place(1, row), align=8)
            return context.get_dummy_value()

        return types.void(source, result), emit

    return emitted
