"""Vectors of three numbers and rotations of nine, compiled: no array, so all stay in registers.

A vector is a tuple of three floats, a rotation (body to parent) a tuple of nine, row by row.
"""

from __future__ import annotations

from numba import njit


@njit(cache=True)
def three(x, b, i):
    """x[b, i : i + 3]."""
    return x[b, i], x[b, i + 1], x[b, i + 2]


@njit(cache=True)
def put(x, b, i, one, other):
    """Writes two vectors into x[b, i : i + 6]."""
    x[b, i], x[b, i + 1], x[b, i + 2] = one
    x[b, i + 3], x[b, i + 4], x[b, i + 5] = other


@njit(cache=True)
def add(a, b):
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True)
def scale(s, a):
    """A number s times a."""
    return s * a[0], s * a[1], s * a[2]


@njit(cache=True)
def dot(a, b):
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def cross(a, b):
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def nine(x, b):
    """x[b, :9], a rotation."""
    return x[b, 0], x[b, 1], x[b, 2], x[b, 3], x[b, 4], x[b, 5], x[b, 6], x[b, 7], x[b, 8]


@njit(cache=True)
def rotate(R, a):
    """R a, from a body's axes to its parent's."""
    return (
        R[0] * a[0] + R[1] * a[1] + R[2] * a[2],
        R[3] * a[0] + R[4] * a[1] + R[5] * a[2],
        R[6] * a[0] + R[7] * a[1] + R[8] * a[2],
    )


@njit(cache=True)
def unrotate(R, a):
    """Rᵀ a, from a parent's axes to its body's."""
    return (
        R[0] * a[0] + R[3] * a[1] + R[6] * a[2],
        R[1] * a[0] + R[4] * a[1] + R[7] * a[2],
        R[2] * a[0] + R[5] * a[1] + R[8] * a[2],
    )


@njit(cache=True)
def forth(x, b, a):
    """R a with the rotation R = x[b, :9], from a body's axes to its parent's."""
    return rotate(nine(x, b), a)


@njit(cache=True)
def back(x, b, a):
    """Rᵀ a with the rotation R = x[b, :9], from a parent's axes to its body's."""
    return unrotate(nine(x, b), a)


@njit(cache=True)
def symmetric(inertia, a):
    """I a of I = (xx, xy, yy, xz, yz, zz)."""
    xx, xy, yy, xz, yz, zz = inertia
    return (
        xx * a[0] + xy * a[1] + xz * a[2],
        xy * a[0] + yy * a[1] + yz * a[2],
        xz * a[0] + yz * a[1] + zz * a[2],
    )
