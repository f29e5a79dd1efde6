"""Blocks of θ with the columns that they scale, of which a family's forces consist."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..parameters import Array, Block, Geometry, ParameterSpace
from .columns import KINDS
from .parts import Column


class Term(NamedTuple):
    """A block of θ, and the columns of F that it scales."""

    block: Block  # names, units and guesses of the parameters
    columns: Sequence[Column]  # their parameters count from the block's first
    nominal: Array  # (k,) published values of the parameters
    spread: float = 1.0  # relative deviation of true values over the vehicle's assumed spread


def placed(space: ParameterSpace, terms: Sequence[Term], command: int = 0) -> list[Column]:
    """The columns of terms at the places of their blocks, their commands counted from `command`."""
    return [
        column.shifted(space[term.block.name].start, command)
        for term in terms
        for column in term.columns
    ]


def guessed(value: ArrayLike) -> Array:
    """The nearest powers of two of |value|: a guess by order of magnitude."""
    exponent = np.round(np.log2(np.abs(np.asarray(value, dtype=np.float64))))
    return np.exp2(exponent).astype(np.float64)


def term(
    columns: Sequence[Column],
    labels: Mapping[str, str],
    nominal: ArrayLike,
    scale: ArrayLike | None = None,
    block: str = "",
    geometry: Geometry | None = None,
    spread: float = 1.0,
    sliding: Sequence[bool] = (),
) -> Term:
    """A block of columns; the columns' kinds determine its parameters.

    Args:
        columns: their parameters count from 0.
        labels: name of every parameter, with its readable description.
        nominal: (k,) or a number, the published values.
        scale: (k,) or a number, guesses of their magnitudes; `guessed` from them if left out.
        block: name of the block; that of the first column's kind if left out.
        geometry: which values are physical; that of the first column's kind if left out.
        spread: see `Term`.
        sliding: (k,) whether the joint slides on which a parameter acts; for columns of joints.
    """
    first = [next(c for c in columns if c.parameter == k) for k in range(len(labels))]
    kind = KINDS[first[0].kind]
    known = np.broadcast_to(np.asarray(nominal, dtype=np.float64), len(labels))
    return Term(
        Block(
            block or kind.block,
            tuple(labels),
            tuple(map(_unit, first, sliding or [False] * len(first))),
            guessed(known) if scale is None else np.broadcast_to(scale, len(labels)),
            geometry or kind.geometry,
            kind.actuator,
            labels=tuple(labels.values()),
        ),
        columns,
        known,
        spread,
    )


def alike(
    kind: str,
    labels: Mapping[str, str],
    nominal: ArrayLike,
    scale: ArrayLike | None = None,
    block: str = "",
    geometry: Geometry | None = None,
    spread: float = 1.0,
    sliding: Sequence[bool] = (),
    **rows: Any,
) -> Term:
    """A block of columns of one kind, one for each label, by default on the first body.

    `rows` hold an argument of `Column` for each of them: `body`, `dof`, `input`, or a constant of
    the kind. The others are those of `term`.
    """
    if "dof" not in rows:
        rows.setdefault("body", [0] * len(labels))
    each = [{name: row[k] for name, row in rows.items()} for k in range(len(labels))]
    columns = [Column(kind, k, **row) for k, row in enumerate(each)]
    return term(columns, labels, nominal, scale, block, geometry, spread, sliding)


def _unit(column: Column, slides: bool) -> str:
    """The unit of a column's parameter: of a moment on a hinge, or if it acts about an axis."""
    unit = KINDS[column.kind].unit
    if isinstance(unit, str):
        return unit
    axes = column.constants.get("axes")
    turns = not slides if axes is None else np.any(np.ravel(axes)[3:])
    return unit[0 if turns else 1]


def numbered(letter: str, label: str, count: int) -> dict[str, str]:
    """Labels of like parameters: {"thrust_1": "thrust of rotor 1", …} from "thrust of rotor"."""
    return {f"{letter}_{i}": f"{label} {i}" for i in range(1, count + 1)}
