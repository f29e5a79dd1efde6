"""Columns of F that actuators make: one unknown gain for each, geometry and curve known."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..parameters import Array


def wrenches(positions: Array, directions: Array) -> Array:
    """(6, k) unit wrench at the body's origin of forces at `positions` along `directions`.

    Args:
        positions: (k, 3) in the body's axes [m].
        directions: (k, 3) unit vectors in the body's axes.
    """
    return np.ascontiguousarray(np.hstack([directions, np.cross(positions, directions)]).T)


@njit(cache=True)
def thrusters(F, start, allocation, curve, u):
    """Thrust gain·curve(u) of every thruster; k columns.

    Args:
        F: (6, p) to write into.
        start: first column.
        allocation: (6, k) unit wrenches.
        curve: (c,) coefficients of u, u³, u⁵ …, whose sum is 1: thrust at full command is the gain.
        u: (k,) commands in [−1, 1].
    """
    for j in range(u.shape[0]):
        square, power, thrust = u[j] * u[j], u[j], 0.0
        for c in curve:
            thrust += c * power
            power *= square
        for i in range(F.shape[0]):
            F[i, start + j] = allocation[i, j] * thrust
    return start + u.shape[0]


@njit(cache=True)
def fins(F, start, allocation, v, angles):
    """Lift |u| (u δ − eᵀ(v + ω × r)) of every fin at r along e, then its drag (u δ)²; 2 k columns.

    To first order u δ − eᵀ(v + ω × r) is u times the angle at which the fin meets the flow; u is
    the body's v_x.

    Args:
        F: (6, p) to write into.
        start: first column.
        allocation: (2, 6, k) unit wrenches of the lifts, and of the drags.
        v: (6,) velocity.
        angles: (k,) deflections δ [rad], positive where they lift along e.
    """
    k = angles.shape[0]
    u = v[0]
    for j in range(k):
        sideways = 0.0  # eᵀ(v + ω × r), by the same wrench
        for i in range(6):
            sideways += allocation[0, i, j] * v[i]
        lift, drag = abs(u) * (u * angles[j] - sideways), abs(u) * u * angles[j] ** 2
        for i in range(6):
            F[i, start + j] = allocation[0, i, j] * lift
            F[i, start + k + j] = allocation[1, i, j] * drag
    return start + 2 * k


@njit(cache=True)
def propeller(F, start, v, u, slip):
    """Thrust |n| (n − slip v_x) along x, and torque |n| n about −x; 2 columns.

    The first is a propeller's curve over its advance ratio, to first order.

    Args:
        F: (6, p) to write into.
        start: first column.
        v: (6,) velocity.
        u: speed n of the shaft in shares of full speed, in [−1, 1].
        slip: share of full thrust that is lost for each m/s at full speed of the shaft [s/m].
    """
    F[0, start] = abs(u) * (u - slip * v[0])
    F[3, start + 1] = -abs(u) * u
    return start + 2
