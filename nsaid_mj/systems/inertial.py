"""The inertial parameters of a body: their order, names, units and guesses."""

from __future__ import annotations

import numpy as np

from ..parameters import Array, Block

GRAVITY = 9.81
"""Acceleration of gravity [m/s²], known: weight is a column of the mass."""
INERTIAL = ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
INERTIAL_LABELS = ("mass", "m·cx", "m·cy", "m·cz", *INERTIAL[4:])
INERTIAL_UNITS = ("kg",) + ("kg·m",) * 3 + ("kg·m²",) * 6


def symmetric(n: int, start: int, p: int) -> Array:
    """(n, n, p) mass tensor of an `spd` block at `start`: the upper triangle, row by row."""
    tensor = np.zeros((n, n, p))
    for k, (i, j) in enumerate(zip(*np.triu_indices(n), strict=True)):
        tensor[i, j, start + k] = tensor[j, i, start + k] = 1.0
    return tensor


def of_a_body(start: int, p: int) -> Array:
    """(6, 6, p) mass tensor of the ten inertial parameters (m, m c, I about the origin) of a body.

    The order is Pinocchio's: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
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

    Args:
        name: of the block.
        mass: guess [kg].
        offset: guess of how far the centre of mass may lie from the origin [m].
        inertia: (3,) guess of the moments of inertia [kg·m²]; products are a quarter of them.
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
