"""Columns of F of a fluid: drag along each axis, net weight, righting moments.

Every function writes into F (n, p) from column `start` on and returns the column after the last one
it writes.
"""

from __future__ import annotations

from numba import njit


@njit(cache=True)
def linear_drag(F, start, v):
    """−d_i v_i on every axis; n columns."""
    for i in range(v.shape[0]):
        F[i, start + i] = -v[i]
    return start + v.shape[0]


@njit(cache=True)
def quadratic_drag(F, start, v):
    """−d_i |v_i| v_i on every axis; n columns."""
    for i in range(v.shape[0]):
        F[i, start + i] = -abs(v[i]) * v[i]
    return start + v.shape[0]


@njit(cache=True)
def restoring(F, start, z):
    """Net weight W − B [N] along −z of the world, and moments (r_B B − r_G W) [N·m]; 4 columns.

    Args:
        F: (6, p) force regressor; written.
        start: first column.
        z: (3,) upward unit vector in the body's axes.
    """
    F[0, start], F[1, start], F[2, start] = -z[0], -z[1], -z[2]
    at = start + 1  # the moment e_j × z of each component of r_B B − r_G W
    F[4, at], F[5, at] = -z[2], z[1]
    F[3, at + 1], F[5, at + 1] = z[2], -z[0]
    F[3, at + 2], F[4, at + 2] = -z[1], z[0]
    return start + 4
