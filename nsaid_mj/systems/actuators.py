"""Columns of F of actuators: one unknown gain each, with known geometry and command curve."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..parameters import Array


def wrenches(positions: Array, directions: Array) -> Array:
    """(6, k) wrenches about the body's origin of unit forces at `positions` along `directions`.

    Args:
        positions: (k, 3) in the body's axes [m].
        directions: (k, 3) unit vectors in the body's axes.
    """
    return np.ascontiguousarray(np.hstack([directions, np.cross(positions, directions)]).T)


@njit(cache=True)
def thrusters(F, start, allocation, curve, u):
    """Thrust gain·curve(u) of every thruster; k columns.

    Args:
        F: (6, p) force regressor; written.
        start: first column.
        allocation: (6, k) unit wrenches.
        curve: (c,) coefficients of u, u³, u⁵ … with sum 1, so that the gain is the thrust at full
            command.
        u: (k,) commands in [−1, 1].

    Returns:
        The column after the last one written.
    """
    for j in range(u.shape[0]):
        square, power, thrust = u[j] * u[j], u[j], 0.0
        for c in curve:
            thrust += c * power
            power *= square
        for i in range(F.shape[0]):
            F[i, start + j] = allocation[i, j] * thrust
    return start + u.shape[0]
