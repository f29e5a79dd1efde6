"""Blocks of θ that many robots have: a body's inertial parameters, and a full mass matrix."""

from collections.abc import Sequence

import numpy as np

from ..parameters import Array, Block

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
GRAVITY = 9.81
"""Acceleration of gravity [m/s²], known: weight is a column of the mass."""
INERTIAL = ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
INERTIAL_LABELS = ("mass", "m·cx", "m·cy", "m·cz", *INERTIAL[4:])
INERTIAL_UNITS = ("kg",) + ("kg·m",) * 3 + ("kg·m²",) * 6


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


def inertial_block(name: str, mass: float, offset: float, inertia: Array) -> Block:
    """The ten inertial parameters of a body, in the order of `of_a_body`.

    Guesses are the mass [kg], the largest distance `offset` of the centre of mass from the origin
    [m], and moments of inertia (3,) [kg·m²], of which products are a quarter.
    """
    x, y, z = inertia
    products = 0.25 * np.sqrt([x * y, x * z, y * z])
    moments = [x, products[0], y, products[1], products[2], z]
    scale = np.array([mass, *[mass * offset] * 3, *moments])
    return Block(
        name, INERTIAL, INERTIAL_UNITS, scale, "pseudo_inertia", labels=inertial_labels(name)
    )


def inertial_labels(body: str) -> tuple[str, ...]:
    """Labels of a body's ten inertial parameters; m·cx is the first moment of mass along x."""
    return tuple(f"{label} of {body}" for label in INERTIAL_LABELS)


def link_block(number: int, name: str, mass: float, length: float) -> Block:
    """The ten inertial parameters of link `name`, body `number` (0 is a floating base).

    `mass` [kg] and `length` [m] are guesses.
    """
    return Block(
        f"link {number}" if number else "base",
        tuple(f"{name}_{number}" for name in INERTIAL),
        INERTIAL_UNITS,
        mass * np.repeat([1.0, length, length**2], [1, 3, 6]),
        "pseudo_inertia",
        labels=inertial_labels(name),
    )


def mass_block(diagonal: Array, axes: Sequence[int] = range(6)) -> Block:
    """The entries of a symmetric M (n, n), upper triangle row by row.

    diagonal (n,) is a guess of M's diagonal [kg, kg·m²], and off it a quarter of the geometric
    mean; `axes` are those along and about which the body moves, of the six.
    """
    rows, columns = np.triu_indices(len(axes))
    share = np.where(rows == columns, 1.0, 0.25)
    scale = share * np.sqrt(diagonal[rows] * diagonal[columns])
    rows, columns = np.asarray(axes)[rows], np.asarray(axes)[columns]
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
