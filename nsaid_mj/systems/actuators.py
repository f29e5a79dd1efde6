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


@njit(cache=True)
def fins(F, start, allocation, v, angles):
    """Lift |u| (u δ − eᵀ(v + ω × r)) of every fin at r along e, then its drag (u δ)²; 2 k columns.

    To first order u δ − eᵀ(v + ω × r) is u times the fin's angle of attack; u is the body's v_x.

    Args:
        F: (6, p) force regressor; written.
        start: first column.
        allocation: (2, 6, k) unit wrenches of the lifts, and of the drags.
        v: (6,) body twist.
        angles: (k,) deflections δ [rad]; a positive one lifts along e.

    Returns:
        The column after the last one written.
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

    The thrust is a propeller's curve over its advance ratio, to first order.

    Args:
        F: (6, p) force regressor; written.
        start: first column.
        v: (6,) body twist.
        u: speed n of the shaft relative to full speed, in [−1, 1].
        slip: relative loss of full thrust per m/s of advance at full shaft speed [s/m].

    Returns:
        The column after the last one written.
    """
    F[0, start] = abs(u) * (u - slip * v[0])
    F[3, start + 1] = -abs(u) * u
    return start + 2
