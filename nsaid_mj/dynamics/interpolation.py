"""Interpolation half-way between two samples of a tree of joints."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.interpolation import body_half_way
from .tree import BASE, CIRCLE


@njit(cache=True)
def tree_half_way(linkage, q0, v0, q1, v1, dt, hermite, q, v):
    """Writes the state half-way between two samples into q (m,) and v (n,).

    Args:
        linkage: the tree.
        q0: (m,) position at the first sample.
        v0: (n,) velocity at the first sample.
        q1: (m,) position at the second sample.
        v1: (n,) velocity at the second sample.
        dt: time between the samples [s].
        hermite: cubic Hermite interpolation; else the mean of both velocities.
        q: (m,) written.
        v: (n,) written.
    """
    joint = 0
    for at, kind in linkage[1][:, 1:]:
        if kind == BASE:
            q[:7], v[:6] = body_half_way(6, q0[:7], v0[:6], q1[:7], v1[:6], dt, hermite)
            joint = 6
            continue
        if kind == CIRCLE:
            c, s = q0[at], q0[at + 1]
            dq = np.arctan2(c * q1[at + 1] - s * q1[at], c * q1[at] + s * q1[at + 1])
        else:
            dq = q1[at] - q0[at]
        half = 0.5 * dq + 0.125 * dt * (v0[joint] - v1[joint])
        if kind == CIRCLE:
            cosine, sine = np.cos(half), np.sin(half)
            q[at], q[at + 1] = c * cosine - s * sine, s * cosine + c * sine
        else:
            q[at] = q0[at] + half
        if hermite:
            v[joint] = 1.5 / dt * dq - 0.25 * (v0[joint] + v1[joint])
        else:
            v[joint] = 0.5 * (v0[joint] + v1[joint])
        joint += 1


@njit(cache=True)
def tree_midpoints(linkage, t, q, v, hermite):
    """(N−1, m) positions and (N−1, n) velocities half-way between N samples t, q, v of a tree."""
    steps = t.shape[0] - 1
    qm, vm = np.empty((steps, q.shape[1])), np.empty((steps, v.shape[1]))
    for k in range(steps):
        dt = t[k + 1] - t[k]
        tree_half_way(linkage, q[k], v[k], q[k + 1], v[k + 1], dt, hermite, qm[k], vm[k])
    return qm, vm
