"""Blocks of θ: inertias that many robots have, and forces with the columns that a block scales."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..parameters import AXES, Array, Block, Geometry, ParameterSpace
from .parts import Column

GRAVITY = 9.81
"""Acceleration of gravity [m/s²], known: weight is a column of the mass."""
INERTIAL = ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_LABELS = ("mass", "m·cx", "m·cy", "m·cz", *INERTIAL[4:])
_UNITS = ("kg",) + ("kg·m",) * 3 + ("kg·m²",) * 6


def of_a_body(start: int, p: int) -> Array:
    """(6, 6, p) mass tensor of the ten inertial parameters of a body, which start at `start`.

    They are about the origin, in Pinocchio's order: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    """
    tensor = np.zeros((6, 6, p))
    for i in range(3):
        tensor[i, i, start] = 1.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        # M = [[m, −S(h)], [S(h), I]], with S(h)_ij = −h_k for cyclic i, j, k
        tensor[i, 3 + j, start + 1 + k] = tensor[3 + j, i, start + 1 + k] = 1.0
        tensor[j, 3 + i, start + 1 + k] = tensor[3 + i, j, start + 1 + k] = -1.0
    for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        tensor[3 + i, 3 + j, start + 4 + k] = tensor[3 + j, 3 + i, start + 4 + k] = 1.0
    return tensor


def inertial_block(mass: float, offset: float, inertia: Array) -> Block:
    """The ten inertial parameters of the body of a vehicle, in the order of `of_a_body`.

    Guesses are the mass [kg], the largest distance `offset` of the centre of mass from the origin
    [m], and moments of inertia (3,) [kg·m²], of which products are a quarter.
    """
    x, y, z = inertia
    products = 0.25 * np.sqrt([x * y, x * z, y * z])
    moments = [x, products[0], y, products[1], products[2], z]
    return _inertial("body", "body", "", np.array([mass, *[mass * offset] * 3, *moments]))


def link_block(number: int, name: str, mass: float, length: float) -> Block:
    """The ten inertial parameters of link `name`, body `number` (0 is a floating base).

    `mass` [kg] and `length` [m] are guesses.
    """
    scale = mass * np.repeat([1.0, length, length**2], [1, 3, 6])
    return _inertial(f"link {number}" if number else "base", name, f"_{number}", scale)


def _inertial(block: str, body: str, end: str, scale: Array) -> Block:
    names = (f"{x}{end}" for x in INERTIAL)
    labels = (f"{x} of {body}" for x in _LABELS)
    return Block(block, tuple(names), _UNITS, scale, "pseudo_inertia", labels=tuple(labels))


def mass_block(diagonal: Array, axes: Sequence[int] = range(6)) -> Block:
    """The entries of a symmetric M (n, n), upper triangle row by row.

    diagonal (n,) is a guess of M's diagonal [kg, kg·m²], and off it a quarter of the geometric
    mean; `axes` are those along and about which the body moves, of the six.
    """
    rows, columns = np.triu_indices(len(axes))
    share = np.where(rows == columns, 1.0, 0.25)
    scale = share * np.sqrt(diagonal[rows] * diagonal[columns])
    rows = np.asarray(axes)[rows]
    columns = np.asarray(axes)[columns]
    pairs = list(zip(rows.tolist(), columns.tolist(), strict=True))
    units = np.array(["kg", "kg·m", "kg·m²"])[(rows >= 3).astype(int) + (columns >= 3)]
    return Block(
        "mass matrix",
        tuple(f"M_{i + 1}{j + 1}" for i, j in pairs),
        tuple(units.tolist()),
        scale,
        "spd",
        labels=tuple(_mass_label(i, j) for i, j in pairs),
    )


def _mass_label(i: int, j: int) -> str:
    """The label of entry (i, j) of M; "effective" because it includes added mass."""
    if i == j:
        return f"effective {AXES[i]} {'mass' if i < 3 else 'inertia'}"
    return f"{AXES[i]}–{AXES[j]} coupling of M"


# -- forces ----------------------------------------------------------------------------------------


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


def mounts_of(space: ParameterSpace, columns: Sequence[Column], none: float = np.nan) -> Array:
    """(k, 3) point of application of every actuator parameter's force [m], `none` if it has none.

    They are those of the first of its columns, in the body's axes.
    """
    first = {column.parameter: column.constants for column in reversed(columns)}
    nowhere = np.full(3, none)  # a torque acts at no point
    mounts = [first[k].get("point", nowhere) for k in space.actuators.tolist()]
    return np.array(mounts, dtype=np.float64).reshape(-1, 3)


def guessed(value: ArrayLike) -> Array:
    """The nearest powers of two of |value|: a guess by order of magnitude."""
    exponent = np.round(np.log2(np.abs(np.asarray(value, dtype=np.float64))))
    return np.exp2(exponent).astype(np.float64)


def term(
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
        what: the columns, whose parameters count from 0; or a kind, with one column for each label,
            by default on the first body.
        labels: name of every parameter, with its readable description.
        nominal: (k,) or a number, the published values.
        scale: (k,) or a number, guesses of their magnitudes; `guessed` from them if left out.
        block: name of the block; that of the first column's kind if left out.
        geometry: which values are physical; that of the first column's kind if left out.
        spread: see `Term`.
        sliding: (k,) whether the joint slides on which a parameter acts; for columns of joints.
        rows: (k,) an argument of `Column` for each column of a kind: `body`, `dof`, `input`, or a
            constant of the kind.
    """
    from .columns import KINDS  # compiled

    columns = what if not isinstance(what, str) else _columns(what, len(labels), rows)
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


def _columns(kind: str, count: int, rows: dict[str, Any]) -> list[Column]:
    """`count` columns of a kind, each with its own parameter; see `term`."""
    if "dof" not in rows:
        rows = {"body": [0] * count} | rows
    return [Column(kind, k, **{name: row[k] for name, row in rows.items()}) for k in range(count)]


def _unit(column: Column, slides: bool) -> str:
    """The unit of a column's parameter: of a moment on a hinge, or if it acts about an axis."""
    from .columns import KINDS  # compiled

    unit = KINDS[column.kind].unit
    if isinstance(unit, str):
        return unit
    axes = column.constants.get("axes")
    turns = not slides if axes is None else np.any(np.ravel(axes)[3:])
    return unit[0 if turns else 1]


def named(letter: str, label: str, parts: Iterable[Any]) -> dict[str, str]:
    """Labels of like parameters: {"thrust_1": "thrust of rotor 1", …} from "thrust of rotor"."""
    return {f"{letter}_{part}": f"{label} {part}" for part in parts}


def actuators(kind: str, letter: str, label: str, nominal: ArrayLike, **rows: Any) -> Term:
    """A block of like actuators, the first of which reads the first command, and so on.

    There are as many as rows; the arguments are those of `named` and `term`.
    """
    count = len(next(iter(rows.values())))
    own = named(letter, label, range(1, count + 1))
    return term(kind, own, nominal, input=range(count), **rows)
