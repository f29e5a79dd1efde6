"""Positions of a tree: tangent steps, and the state half-way between two samples.

A tangent step (n,) is the velocity that, held for one second, leads from one position to another:
for a base, the twist of the group's exponential map in its own axes; for a joint, a difference.
"""

import numpy as np

from ..numerics.kernels import (
    boolean,
    f8,
    helper,
    i8,
    index,
    kernel,
    matrix,
    routine,
    table,
    vector,
    void,
)
from .arrays import AT_Q, AT_V, CIRCLE, COUNT, FIXED, FREE, KIND, PLANAR
from .kinematics import write_rotation
from .spatial import add_cross, add_turned, clear, dot3, rotate, unrotate

_SMALL = 1e-2  # angle below which three terms of the series are exact in double precision [rad]


@helper(void(index, vector, index, vector, index, f8, vector, index))
def add_bracket(group, a, i, b, j, factor, c, k):
    """c += factor · [a, b], of base velocities that form a twist of 6 or 3 components, or of 0."""
    if group == 6:
        add_turned(a, i, b, j, factor, c, k)
    elif group == 3:
        c[k] += factor * (a[i + 1] * b[j + 2] - a[i + 2] * b[j + 1])
        c[k + 1] += factor * (a[i + 2] * b[j] - a[i] * b[j + 2])


@routine(void(vector, vector, vector, vector))
def _move_free(q, step, out, x):
    """Writes the pose (7,) reached by a twist (6,); x (30,) is workspace."""
    square = dot3(step, 3, step, 3)
    angle = np.sqrt(square)
    if angle > _SMALL:
        b = 2 * np.sin(angle / 2) ** 2 / square
        c = (angle - np.sin(angle)) / (angle * square)
        half = np.sin(angle / 2) / angle
    else:
        b = 0.5 - square / 24 + square**2 / 720
        c = 1 / 6 - square / 120 + square**2 / 5040
        half = 0.5 - square / 48 + square**2 / 3840
    clear(x, 0, 6)
    add_cross(step, 3, step, 0, 1.0, x, 0)
    add_cross(step, 3, x, 0, 1.0, x, 3)
    for i in range(3):
        x[6 + i] = step[i] + b * x[i] + c * x[3 + i]
    write_rotation(q, 3, x, 12)
    rotate(x, 12, x, 6, x, 9)
    for i in range(3):
        out[i] = q[i] + x[9 + i]
        x[i] = half * step[3 + i]
    x[3] = np.cos(angle / 2)
    for i in range(3):
        x[4 + i] = q[6] * x[i] + x[3] * q[3 + i]
    add_cross(q, 3, x, 0, 1.0, x, 4)
    x[7] = q[6] * x[3] - dot3(q, 3, x, 0)
    size = np.sqrt(dot3(x, 4, x, 4) + x[7] * x[7])
    for i in range(4):
        out[3 + i] = x[4 + i] / size


@routine(void(vector, vector, vector, index, vector))
def _between_free(q0, q1, step, k, x):
    """Writes the twist (6,) from pose q0 (7,) to q1 (7,), with a rotation of at most π."""
    w = q0[6] * q1[6] + dot3(q0, 3, q1, 3)
    sign = -1.0 if w < 0 else 1.0
    for i in range(3):
        x[i] = sign * (q0[6] * q1[3 + i] - q1[6] * q0[3 + i])
    add_cross(q0, 3, q1, 3, -sign, x, 0)
    sine = np.sqrt(dot3(x, 0, x, 0))
    w = sign * w
    if sine > _SMALL:
        scale = 2.0 * np.arctan2(sine, w) / sine
    else:
        tangent = (sine / w) ** 2
        scale = 2.0 / w * (1 - tangent / 3 + tangent**2 / 5 - tangent**3 / 7)
    for i in range(3):
        x[i] *= scale
    square = dot3(x, 0, x, 0)
    angle = np.sqrt(square)
    if angle > _SMALL:
        e = (1 - 0.5 * angle / np.tan(0.5 * angle)) / square
    else:
        e = 1 / 12 + square / 720 + square**2 / 30240
    for i in range(3):
        x[9 + i] = q1[i] - q0[i]
    write_rotation(q0, 3, x, 12)
    unrotate(x, 12, x, 9, x, 3)
    clear(x, 6, 6)
    add_cross(x, 0, x, 3, 1.0, x, 6)
    add_cross(x, 0, x, 6, 1.0, x, 9)
    for i in range(3):
        step[k + i] = x[3 + i] - 0.5 * x[6 + i] + e * x[9 + i]
        step[k + 3 + i] = x[i]


@routine(void(vector, vector, vector))
def _move_planar(q, step, out):
    """Writes the pose (3,) in the plane reached by a twist (3,)."""
    turn = step[2]
    square = step[2] * step[2]
    along = 1 - square / 6 + square**2 / 120
    across = turn * (0.5 - square / 24 + square**2 / 720)
    if abs(turn) > _SMALL:
        along = np.sin(turn) / turn
        across = 2 * np.sin(turn / 2) ** 2 / turn
    x = along * step[0] - across * step[1]
    y = across * step[0] + along * step[1]
    c = np.cos(q[2])
    s = np.sin(q[2])
    out[0] = q[0] + c * x - s * y
    out[1] = q[1] + s * x + c * y
    out[2] = q[2] + turn


@routine(void(vector, vector, vector, index))
def _between_planar(q0, q1, step, k):
    """Writes the twist (3,) between poses in the plane, with a rotation of at most π."""
    turn = (q1[2] - q0[2] + np.pi) % (2 * np.pi) - np.pi
    square = turn * turn
    f = 1 - square / 12 - square**2 / 720
    if abs(turn) > _SMALL:
        f = 0.5 * turn / np.tan(0.5 * turn)
    c = np.cos(q0[2])
    s = np.sin(q0[2])
    dx = q1[0] - q0[0]
    dy = q1[1] - q0[1]
    x = c * dx + s * dy
    y = c * dy - s * dx
    step[k] = f * x + 0.5 * turn * y
    step[k + 1] = f * y - 0.5 * turn * x
    step[k + 2] = turn


@kernel(void(table, vector, vector, vector, vector))
def integrate(bodies, q, step, out, x):
    """Writes the position out (m,), not q itself, reached from q (m,) by a tangent step (n,).

    x (SCRATCH,) is workspace.
    """
    for b in range(bodies.shape[0]):
        kind = bodies[b, KIND]
        at = bodies[b, AT_Q]
        j = bodies[b, AT_V]
        if kind == FREE:
            _move_free(q, step, out, x)
        elif kind == PLANAR:
            _move_planar(q, step, out)
        elif kind == CIRCLE:
            c = np.cos(step[j])
            s = np.sin(step[j])
            out[at] = q[at] * c - q[at + 1] * s
            out[at + 1] = q[at + 1] * c + q[at] * s
        elif kind != FIXED:
            out[at] = q[at] + step[j]


@kernel(void(table, vector, vector, vector, vector))
def difference(bodies, q0, q1, step, x):
    """Writes the tangent step (n,) that leads from position q0 (m,) to q1 (m,).

    Rotations are the shorter ones. x (SCRATCH,) is workspace.
    """
    for b in range(bodies.shape[0]):
        kind = bodies[b, KIND]
        at = bodies[b, AT_Q]
        j = bodies[b, AT_V]
        if kind == FREE:
            _between_free(q0, q1, step, j, x)
        elif kind == PLANAR:
            _between_planar(q0, q1, step, j)
        elif kind == CIRCLE:
            c = q0[at]
            s = q0[at + 1]
            step[j] = np.arctan2(c * q1[at + 1] - s * q1[at], c * q1[at] + s * q1[at + 1])
        elif kind != FIXED:
            step[j] = q1[at] - q0[at]


@helper(i8(table))
def group_of(bodies):
    """Number of leading velocities that form a body twist: 6, 3 or 0."""
    kind = bodies[0, KIND]
    return bodies[0, COUNT] if kind in (FREE, PLANAR) else 0


@routine(void(table, vector, vector, vector, vector, f8, boolean, matrix, vector, vector, vector))
def half_way(bodies, q0, v0, q1, v1, dt, hermite, rows, x, q, v):
    """Writes the state half-way between two samples, dt [s] apart, into q (m,) and v (n,).

    The samples are q0, q1 (m,) and v0, v1 (n,). The velocity is the slope of the cubic through both
    positions and velocities, or without `hermite` the mean of both. This is Simpson's rule solved
    for the middle, exact to dt⁴. Where velocities are a body twist, the cubic interpolates the
    tangent step ξ, with v = ξ̇ − ½[ξ, ξ̇] + ⅙[ξ, [ξ, ξ̇]] … rows (ROWS, n) and x (SCRATCH,) are
    workspace.
    """
    group = group_of(bodies)
    way = rows[0]
    half = rows[1]
    slope = rows[2]
    difference(bodies, q0, q1, way, x)
    clear(x, 0, 12)
    add_bracket(group, way, 0, v1, 0, 1.0, x, 0)
    add_bracket(group, way, 0, x, 0, 1.0, x, 6)
    for i in range(v.shape[0]):
        slope[i] = v1[i]
        if i < group:
            slope[i] += 0.5 * x[i] + x[6 + i] / 12
        half[i] = 0.5 * way[i] + 0.125 * dt * (v0[i] - slope[i])
        v[i] = 1.5 / dt * way[i] - 0.25 * (v0[i] + slope[i])
    integrate(bodies, q0, half, q, x)
    clear(x, 0, 12)
    add_bracket(group, half, 0, v, 0, 1.0, x, 0)
    add_bracket(group, half, 0, x, 0, 1.0, x, 6)
    for i in range(v.shape[0]):
        if not hermite:
            v[i] = 0.5 * (v0[i] + v1[i])
        elif i < group:
            v[i] += -0.5 * x[i] + x[6 + i] / 6


@kernel(void(table, matrix, matrix, vector))
def write_moves(bodies, q, steps, x):
    """Writes the tangent steps (N−1, n) between consecutive positions of (N, m)."""
    for k in range(steps.shape[0]):
        difference(bodies, q[k], q[k + 1], steps[k], x)
