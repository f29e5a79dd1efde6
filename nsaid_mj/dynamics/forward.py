"""Forward dynamics v̇ = f(q, v, u, θ) of a structure with all its derivatives, compiled.

A structure is a tuple whose type selects the code: a `Linkage`, a `Body`, or one registered by a
system's own file. Positions change by tangent steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from ..numerics.linalg import solve_many, solve_positive
from ..numerics.spatial import (
    coadjoint,
    planar_difference,
    planar_integrate,
    pose_difference,
    pose_integrate,
)
from .structures import ConstantInertia, Linkage
from .tree import BASE, CIRCLE, accelerate, tree_place, tree_room, tree_work
from .tree_derivatives import derivative_work, write_derivatives
from .tree_regressor import write_joints, write_links, write_rotors

STEP = 1e-7
"""Step of the differences where there are no analytic derivatives, relative to 1 + |v|."""


class Body(NamedTuple):
    """One body whose M is constant in its own frame.

    Attributes:
        inertia: M(θ).
        group: number of velocities that form a body twist: 6, 3 or 0.
        forces: its forces, whose type selects the code of `force_regressor`.
    """

    inertia: ConstantInertia
    group: int
    forces: Any


Structure = Any
"""A `Linkage`, a `Body`, or another tuple with overloads of the functions below."""


# -- selected by the structure's type -----------------------------------------------------------


def force_regressor(forces, q, v, u, F):
    """Writes F (n, p) of (4) of one body into zeros; it depends on the attitude in q alone."""


def force_law(kind: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Makes a compiled function the `force_regressor` of forces of a kind, a NamedTuple."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        def chosen(forces, q, v, u, F):
            return function.py_func if forces.instance_class is kind else None

        overload(force_regressor)(chosen)
        return function

    return register


@njit(cache=True)
def forces_along(forces, q, v, u, p):
    """(N, n, p) F of one body at N samples q (N, m), v (N, n), u (N, n_u)."""
    F = np.zeros((v.shape[0], v.shape[1], p))
    for k in range(v.shape[0]):
        force_regressor(forces, q[k], v[k], u[k], F[k])
    return F


def forward_work(structure, n, p):
    """Allocates the workspace of `linearise`."""


def write_acceleration(structure, q, v, u, theta, work, a) -> Any:
    """Writes v̇ alone; arguments and result are those of `linearise`."""


def linearise(structure, q, v, u, theta, scale, work, a, A, B) -> Any:
    """Writes v̇ and its derivatives.

    Args:
        structure: the structure.
        q: (m,) position.
        v: (n,) velocity.
        u: (n_u,) command.
        theta: (p,) parameters.
        scale: (p,) their scale.
        work: workspace of `forward_work`.
        a: (n,) v̇ of (29) with C v; written.
        A: (n, 2n) ∂v̇/∂q and ∂v̇/∂v; written.
        B: (n, p) ∂v̇/∂(θ/scale) = −M⁻¹ W diag(scale); written.

    Returns:
        M's smallest pivot, > 0 if it succeeded.
    """


def group_of(structure) -> Any:
    """Number of leading velocities that form a body twist: 6, 3 or 0."""


def integrate_into(structure, q, step, out):
    """Writes the position reached from q (m,) by a tangent step (n,) into out (m,)."""


def difference_into(structure, q0, q1, out):
    """Writes the tangent step from position q0 to q1 into out (n,)."""


# -- a tree of bodies -----------------------------------------------------------------------------


@njit(cache=True)
def tree_integrate(linkage, q, step, out):
    """Writes the position of a tree reached from q (m,) by a tangent step (n,)."""
    joint = 0
    for at, kind in linkage[1][:, 1:]:
        if kind == BASE:
            out[:7] = pose_integrate(q[:7], step[:6])
            joint = 6
            continue
        if kind == CIRCLE:
            c, s = np.cos(step[joint]), np.sin(step[joint])
            x, y = q[at], q[at + 1]
            out[at], out[at + 1] = x * c - y * s, y * c + x * s
        else:
            out[at] = q[at] + step[joint]
        joint += 1


@njit(cache=True)
def tree_difference(linkage, q0, q1, out):
    """Writes the tangent step (n,) of a tree from position q0 to q1."""
    joint = 0
    for at, kind in linkage[1][:, 1:]:
        if kind == BASE:
            out[:6] = pose_difference(q0[:7], q1[:7])
            joint = 6
            continue
        if kind == CIRCLE:
            c, s = q0[at], q0[at + 1]
            out[joint] = np.arctan2(c * q1[at + 1] - s * q1[at], c * q1[at] + s * q1[at + 1])
        else:
            out[joint] = q1[at] - q0[at]
        joint += 1


@njit(cache=True)
def _tree_acceleration(linkage, q, v, u, theta, work, a):
    tree_place(linkage, q, v, work[0])
    return accelerate(linkage, work[0], v, v, u, theta, work[1], a)


@njit(cache=True)
def _tree_linearise(linkage, q, v, u, theta, scale, work, a, A, B):
    state, stage, derivatives, by_q, by_v, W = work
    n, p = W.shape
    pivot = _tree_acceleration(linkage, q, v, u, theta, work, a)
    if not pivot > 0.0:
        return pivot
    write_derivatives(linkage, state, v, a, theta, derivatives, by_q, by_v)
    write_links(linkage, state, v, v, a, 1.0, W)
    write_rotors(linkage, a, W)
    write_joints(linkage, v, u, W)
    for i in range(n):
        for j in range(n):
            A[i, j], A[i, n + j] = -by_q[i, j], -by_v[i, j]
        for k in range(p):
            B[i, k] = -W[i, k] * scale[k]
    solve_many(stage[2], A)
    solve_many(stage[2], B)
    return pivot


# -- one body -------------------------------------------------------------------------------------


@njit(cache=True)
def body_integrate(group, q, step, out):
    """Writes the pose reached from q (m,) by a tangent step (n,)."""
    if group == 6:
        out[:] = pose_integrate(q, step)
    elif group == 3:
        out[:] = planar_integrate(q, step)
    else:
        for i in range(q.shape[0]):
            out[i] = q[i] + step[i]


@njit(cache=True)
def body_difference(group, q0, q1, out):
    """Writes the tangent step (n,) from pose q0 (m,) to q1."""
    if group == 6:
        out[:] = pose_difference(q0, q1)
    elif group == 3:
        out[:] = planar_difference(q0, q1)
    else:
        for i in range(q0.shape[0]):
            out[i] = q1[i] - q0[i]


@njit(cache=True)
def _force(forces, q, v, u, theta, F, force):
    """Writes F (n, p) and F θ (n,)."""
    F[:] = 0.0
    force_regressor(forces, q, v, u, F)
    for i in range(F.shape[0]):
        total = 0.0
        for k in range(F.shape[1]):
            total += F[i, k] * theta[k]
        force[i] = total


@njit(cache=True)
def _body_acceleration(body, q, v, u, theta, work, a):
    (entries, values), group, forces = body
    M, L, _, F, _, _, force, _, h = work
    M[:] = 0.0
    for e in range(values.shape[0]):
        M[entries[e, 0], entries[e, 1]] += values[e] * theta[entries[e, 2]]
    _force(forces, q, v, u, theta, F, force)
    np.dot(M, v, h)
    own = coadjoint(group, v, h)
    for i in range(v.shape[0]):
        a[i] = force[i] + own[i]
    return solve_positive(M, L, a)


@njit(cache=True)
def _body_linearise(body, q, v, u, theta, scale, work, a, A, B):
    (entries, values), group, forces = body
    M, L, push, F, moved, step, force, other, h = work
    n, p = F.shape
    pivot = _body_acceleration(body, q, v, u, theta, work, a)
    if not pivot > 0.0:
        return pivot
    step[:] = 0.0
    for j in range(n):
        step[j] = 1.0
        turned, push[j] = coadjoint(group, step, h), coadjoint(group, v, step)
        for i in range(n):
            A[i, n + j] = turned[i]
        step[j] = 0.0
    for j in range(n):
        for r in range(n):
            for i in range(n):
                A[i, n + j] += M[r, j] * push[r, i]
    for i in range(n):
        for k in range(p):
            B[i, k] = F[i, k]
    for e in range(values.shape[0]):
        i, j, k = entries[e, 0], entries[e, 1], entries[e, 2]
        B[i, k] -= values[e] * a[j]
        for r in range(n):
            B[r, k] += values[e] * v[j] * push[i, r]
    for i in range(n):
        for k in range(p):
            B[i, k] *= scale[k]
    for j in range(n):
        if j < group // 2 or group == 0 or (group == 3 and j < 2):  # forces depend on attitude only
            A[:, j] = 0.0
            continue
        step[j] = STEP
        body_integrate(group, q, step, moved)
        _force(forces, moved, v, u, theta, F, other)
        for i in range(n):
            A[i, j] = (other[i] - force[i]) / STEP
        step[j] = 0.0
    step[:] = v
    for j in range(n):
        width = STEP * (1.0 + abs(v[j]))
        step[j] += width
        _force(forces, q, step, u, theta, F, other)
        for i in range(n):
            A[i, n + j] += (other[i] - force[i]) / width
        step[j] = v[j]
    solve_many(L, A)
    solve_many(L, B)
    return pivot


# -- dispatch -------------------------------------------------------------------------------------


@overload(forward_work)
def _forward_work(structure, n, p):
    def tree(structure, n, p):
        return (
            tree_room(structure),
            tree_work(structure, n),
            derivative_work(structure, n),
            np.empty((n, n)),
            np.empty((n, n)),
            np.zeros((n, p)),
        )

    def body(structure, n, p):
        return (
            np.empty((n, n)),
            np.empty((n, n)),
            np.empty((n, n)),
            np.empty((n, p)),
            np.empty(7 if n == 6 else n),
            np.empty(n),
            np.empty(n),
            np.empty(n),
            np.empty(n),
        )

    return _chosen(structure, tree, body)


@overload(write_acceleration)
def _write_acceleration(structure, q, v, u, theta, work, a):
    def tree(structure, q, v, u, theta, work, a):
        return _tree_acceleration(structure, q, v, u, theta, work, a)

    def body(structure, q, v, u, theta, work, a):
        return _body_acceleration(structure, q, v, u, theta, work, a)

    return _chosen(structure, tree, body)


@overload(linearise)
def _linearise(structure, q, v, u, theta, scale, work, a, A, B):
    def tree(structure, q, v, u, theta, scale, work, a, A, B):
        return _tree_linearise(structure, q, v, u, theta, scale, work, a, A, B)

    def body(structure, q, v, u, theta, scale, work, a, A, B):
        return _body_linearise(structure, q, v, u, theta, scale, work, a, A, B)

    return _chosen(structure, tree, body)


@overload(group_of)
def _group_of(structure):
    def tree(structure):
        return 6 if structure.numbers[0, 2] == BASE else 0

    def body(structure):
        return structure.group

    return _chosen(structure, tree, body)


@overload(integrate_into)
def _integrate_into(structure, q, step, out):
    def tree(structure, q, step, out):
        tree_integrate(structure, q, step, out)

    def body(structure, q, step, out):
        body_integrate(structure.group, q, step, out)

    return _chosen(structure, tree, body)


@overload(difference_into)
def _difference_into(structure, q0, q1, out):
    def tree(structure, q0, q1, out):
        tree_difference(structure, q0, q1, out)

    def body(structure, q0, q1, out):
        body_difference(structure.group, q0, q1, out)

    return _chosen(structure, tree, body)


def _chosen(structure, tree, body):
    return {Linkage: tree, Body: body}.get(structure.instance_class)
