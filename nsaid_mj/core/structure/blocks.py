"""Forces: blocks of θ with the columns that they scale."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..parameters import Array, Block, Geometry, ParameterSpace
from .parts import Column

GRAVITY = 9.81
"""Acceleration of gravity [m/s²], known: weight is a column of the mass."""


class Term(NamedTuple):
    """A block of θ, and the columns of F that it scales."""

    block: Block  # names, units and guesses of the parameters
    columns: Sequence[Column]  # their parameters count from the block's first
    nominal: Array  # (k,) published values of the parameters
    spread: float = 1.0  # relative deviation of true values over the vehicle's assumed spread

    @classmethod
    def of(
        cls,
        what: str | Sequence[Column],
        labels: Mapping[str, str],
        nominal: ArrayLike,
        scale: ArrayLike | None = None,
        block: str = "",
        geometry: Geometry | None = None,
        spread: float = 1.0,
        sliding: Sequence[bool] = (),
        **rows: Any,
    ) -> Term:
        """A block of columns; the columns' kinds determine its parameters.

        Args:
            what: the columns, whose parameters count from 0; or a kind, with one column for each
                label, by default on the first body.
            labels: name of every parameter, with its readable description.
            nominal: (k,) or a number, the published values.
            scale: (k,) or a number, guesses of their magnitudes; by default `Block.guessed` from
                them.
            block: name of the block; that of the first column's kind if left out.
            geometry: which values are physical; that of the first column's kind if left out.
            spread: see `Term`.
            sliding: (k,) whether the joint slides on which a parameter acts; for columns of joints.
            rows: (k,) an argument of `Column` for each column of a kind: `body`, `dof`, `input`, or
                a constant of the kind.
        """
        from .columns import KINDS  # compiled

        columns = what if not isinstance(what, str) else _columns(what, len(labels), rows)
        first = [next(c for c in columns if c.parameter == k) for k in range(len(labels))]
        kind = KINDS[first[0].kind]
        known = np.broadcast_to(np.asarray(nominal, dtype=np.float64), len(labels))
        return cls(
            Block(
                block or kind.block,
                tuple(labels),
                tuple(map(_unit, first, sliding or [False] * len(first))),
                Block.guessed(known) if scale is None else np.broadcast_to(scale, len(labels)),
                geometry or kind.geometry,
                kind.actuator,
                labels=tuple(labels.values()),
            ),
            columns,
            known,
            spread,
        )

    @staticmethod
    def named(letter: str, label: str, parts: Iterable[Any]) -> dict[str, str]:
        """Labels of like parameters: {"thrust_1": "thrust of rotor 1" …} from "thrust of rotor"."""
        return {f"{letter}_{part}": f"{label} {part}" for part in parts}

    @classmethod
    def actuators(cls, kind: str, letter: str, label: str, nominal: ArrayLike, **rows: Any) -> Term:
        """A block of like actuators, the first of which reads the first command, and so on.

        There are as many as rows; the arguments are those of `named` and `of`.
        """
        count = len(next(iter(rows.values())))
        own = cls.named(letter, label, range(1, count + 1))
        return cls.of(kind, own, nominal, input=range(count), **rows)


def placed(space: ParameterSpace, terms: Sequence[Term], command: int = 0) -> list[Column]:
    """The columns of terms at the places of their blocks, their commands counted from `command`."""
    return [
        column.shifted(space[term.block.name].start, command)
        for term in terms
        for column in term.columns
    ]


def mounts_of(space: ParameterSpace, columns: Sequence[Column], none: float = np.nan) -> Array:
    """(k, 3) point of application of every actuator parameter's force [m], `none` if it has none.

    They are those of the first of its columns, in the body's axes.
    """
    first = {column.parameter: column.constants for column in reversed(columns)}
    nowhere = np.full(3, none)  # a torque acts at no point
    mounts = [first[k].get("point", nowhere) for k in space.actuators.tolist()]
    return np.array(mounts, dtype=np.float64).reshape(-1, 3)


def _unit(column: Column, slides: bool) -> str:
    """The unit of a column's parameter: of a moment on a hinge, or if it acts about an axis."""
    from .columns import KINDS  # compiled

    unit = KINDS[column.kind].unit
    if isinstance(unit, str):
        return unit
    axes = column.constants.get("axes")
    turns = not slides if axes is None else np.any(np.ravel(axes)[3:])
    return unit[0 if turns else 1]


def _columns(kind: str, count: int, rows: dict[str, Any]) -> list[Column]:
    """`count` columns of a kind, each with its own parameter; see `Term.of`."""
    if "dof" not in rows:
        rows = {"body": [0] * count} | rows
    return [Column(kind, k, **{name: row[k] for name, row in rows.items()}) for k in range(count)]
