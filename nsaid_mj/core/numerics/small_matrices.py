"""Formulas on small matrices, evaluated for several matrices at once: one SIMD lane per matrix.

LLVM vectorises a loop over lanes only if the loop's body has no inner loops. Those over the entries
of a 10 × 10 triangle are therefore unrolled by `over_lanes`: it runs the formula once in Python on
symbols, and writes the recorded operations as the body.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numba.extending import overload

LANES = 8
"""Doubles in the widest vector register of today's processors."""


class Symbol:
    """A number known at run time; each operation on it appends one line of Python to `body`."""

    def __init__(self, body: list[str], expression: str):
        self._body, self.name = body, f"x{len(body)}"
        body.append(f"{self.name} = {expression}")

    def _append(self, *expression: object) -> Symbol:
        return Symbol(self._body, " ".join(map(str, expression)))

    def __str__(self) -> str:
        return self.name

    def __add__(self, other: Symbol | float) -> Symbol:
        return self if _is(other, 0) else self._append(self, "+", other)

    def __sub__(self, other: Symbol | float) -> Symbol:
        return self if _is(other, 0) else self._append(self, "-", other)

    def __neg__(self) -> Symbol:
        return self._append("-", self)

    def __mul__(self, other: Symbol | float) -> Symbol:
        return self if _is(other, 1) else self._append(self, "*", other)

    def __truediv__(self, other: Symbol | float) -> Symbol:
        return self._append(self, "/", other)

    def __rtruediv__(self, other: float) -> Symbol:
        return self._append(other, "/", self)

    __radd__ = __add__
    __rmul__ = __mul__

    def sqrt(self) -> Symbol:
        """√ of it: the method that np.sqrt calls."""
        return self._append("sqrt(", self, ")")


def _is(x: Symbol | float, number: int) -> bool:
    return not isinstance(x, Symbol) and x == number


def over_lanes(formula: Callable[[np.ndarray], Iterable[Symbol]], size: int) -> Any:
    """A function for compiled code that evaluates a formula in every lane.

    The formula maps an array (size,) of symbols to symbols by + − × ÷ and np.sqrt, without any
    decision that depends on them. Number i of lane l is rows[LANES * i + l] of the function's
    argument, which is flat because LLVM must know all offsets when it compiles. The values
    overwrite the numbers from i = 0 on.
    """

    def evaluate(rows: np.ndarray) -> None:
        raise NotImplementedError  # called by compiled code only

    @overload(evaluate, jit_options={"error_model": "numpy"})
    def _evaluate(rows):  # noqa: ARG001, numba's signature
        names: dict[str, Any] = {"sqrt": np.sqrt}
        exec(_loop(formula, size), names)
        return names["loop"]

    return evaluate


def _loop(formula: Callable[[np.ndarray], Iterable[Symbol]], size: int) -> str:
    """Python source of the loop over lanes."""
    body: list[str] = []
    numbers = [Symbol(body, f"rows[{LANES * i} + lane]") for i in range(size)]
    values = formula(np.array(numbers, dtype=object))
    body += [f"rows[{LANES * i} + lane] = {value}" for i, value in enumerate(values)]
    return "\n  ".join(
        ("def loop(rows):", f"for lane in range({LANES}):", *(f" {x}" for x in body))
    )
