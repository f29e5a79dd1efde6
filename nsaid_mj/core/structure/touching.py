"""Accelerations of a robot whose contacts move as measured, under forces that nobody knows.

With J (c, n) the contacts' Jacobian and w (c,) their measured acceleration J v̇,

    v̇ = v̇₀ + Y (w − J v̇₀),    Y = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹,    J Y = 1,

with v̇₀ of (29). The contacts' forces are (J M⁻¹ Jᵀ)⁻¹ (w − J v̇₀).
"""

from typing import NamedTuple

import numpy as np
from numba import types

from ..numerics.kernels import kernel, matrix, vector, void
from ..numerics.linalg import solve_many, solve_positive
from ..parameters import Array
from .compiled import WORKSPACE

_RIDGE = 1e-9  # share of the mean diagonal of J M⁻¹ Jᵀ: legs may be stretched


class Touch(NamedTuple):
    """The contacts in a step, c components in all, none if nothing touches; and workspace."""

    J: Array  # (c, n) Jacobian
    w: Array  # (c,) measured acceleration
    shift: Array  # (c, n) change of J where the forces act elsewhere, times √s
    Y: Array  # (n, c) acceleration of the robot by that of its contacts; written
    force: Array  # (c,) forces of the contacts; written
    S: Array  # (c, c) workspace
    L: Array  # (c, c) workspace
    x: Array  # (c,) workspace

    @staticmethod
    def of(c: int, n: int) -> "Touch":
        """For c components of contacts and n velocities."""
        square = (c, c)
        sizes = (c, n), c, (c, n), (n, c), c, square, square, c
        return Touch(*(np.zeros(size) for size in sizes))


TOUCH = types.NamedTuple((matrix, vector, matrix, matrix, vector, matrix, matrix, vector), Touch)


@kernel(void(TOUCH, WORKSPACE, vector), inner=True)
def move_contacts(touch, work, a):
    """Overwrites v̇₀ in a (n,) with v̇, and writes Y; `work` holds M's factor."""
    J = touch.J
    Y = touch.Y
    S = touch.S
    x = touch.x
    c = J.shape[0]
    n = J.shape[1]
    for i in range(n):
        for k in range(c):
            Y[i, k] = J[k, i]
    solve_many(work.L, Y)
    mean = 0.0
    for i in range(c):
        x[i] = touch.w[i]
        for j in range(n):
            x[i] -= J[i, j] * a[j]
        for k in range(i + 1):
            S[i, k] = 0.0
            for j in range(n):
                S[i, k] += J[i, j] * Y[j, k]
            S[k, i] = S[i, k]
        mean += S[i, i] / c
    for i in range(c):
        S[i, i] += _RIDGE * mean
    if not solve_positive(S, touch.L, x) > 0.0:
        return
    for i in range(n):
        for k in range(c):
            a[i] += Y[i, k] * x[k]
    for i in range(c):
        touch.force[i] = x[i]
        for k in range(c):
            S[i, k] = 1.0 if i == k else 0.0
    solve_many(touch.L, S)
    for i in range(n):
        for k in range(c):
            x[k] = 0.0
            for j in range(c):
                x[k] += Y[i, j] * S[j, k]
        for k in range(c):
            Y[i, k] = x[k]
