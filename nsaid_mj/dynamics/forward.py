"""Forward dynamics v̇ = f(q, v, u, θ) of a structure with all its derivatives, compiled.

A structure is a tuple whose type selects the code: a `StructureArrays`, a `Linkage`, or one
registered by a system's own file. Positions change by tangent steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload

from ..numerics.linalg import solve_many
from ..numerics.spatial import pose_difference, pose_integrate
from ..structure.arrays import (
    FRAME,
    INERTIA,
    MOTION,
    ROWS,
    SCRATCH,
    SLOPE,
    Slopes,
    StructureArrays,
    Workspace,
)
from ..structure.forces import write_forces
from ..structure.kinematics import place
from ..structure.poses import difference as structure_difference
from ..structure.poses import group_of as structure_group
from ..structure.poses import integrate as structure_integrate
from ..structure.slopes import linearise as structure_linearise
from ..structure.stage import accelerate as structure_accelerate
from .structures import Linkage
from .tree import BASE, CIRCLE, accelerate, tree_place, tree_room, tree_work
from .tree_derivatives import derivative_work, write_derivatives
from .tree_regressor import write_joints, write_links, write_rotors

STEP = 1e-7
"""Step of the differences where there are no analytic derivatives, relative to 1 + |v|."""


Structure = Any
"""A `StructureArrays`, a `Linkage`, or another tuple with overloads of the functions below."""


# -- selected by the structure's type -----------------------------------------------------------


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


# -- a structure ---------------------------------------------------------------------------------


@njit(cache=True)
def structure_work(structure, n):
    """Allocates the workspace of a stage."""
    bodies = structure.bodies.shape[0]
    return Workspace(
        np.zeros(bodies * MOTION),
        np.zeros(bodies * INERTIA),
        np.zeros((n, n)),
        np.zeros((n, n)),
        np.zeros((ROWS, n)),
        np.zeros(SCRATCH),
    )


@njit(cache=True)
def slopes_work(structure, n):
    """Allocates the workspace of derivatives."""
    bodies, terms = structure.bodies.shape[0], structure.terms.shape[0]
    return Slopes(
        np.zeros((bodies + n + 1 + 2 * terms) * FRAME),
        np.zeros(bodies * SLOPE),
        np.zeros(n * FRAME),
        np.zeros(structure.nonzeros.shape[0]),
        np.zeros((n, 2 * n)),
        np.zeros((4 * n, 3 * n)),
    )


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

    def data(structure, n, p):
        return structure_work(structure, n), slopes_work(structure, n)

    return _chosen(structure, tree, data)


@overload(write_acceleration)
def _write_acceleration(structure, q, v, u, theta, work, a):
    def tree(structure, q, v, u, theta, work, a):
        return _tree_acceleration(structure, q, v, u, theta, work, a)

    def data(structure, q, v, u, theta, work, a):
        stage, slopes = work
        place(structure, q, v, slopes.state)
        write_forces(structure, slopes.state, q, v, u, True, stage.scratch, slopes.F)
        return structure_accelerate(structure, slopes.state, slopes.F, v, theta.copy(), stage, a)

    return _chosen(structure, tree, data)


@overload(linearise)
def _linearise(structure, q, v, u, theta, scale, work, a, A, B):
    def tree(structure, q, v, u, theta, scale, work, a, A, B):
        return _tree_linearise(structure, q, v, u, theta, scale, work, a, A, B)

    def data(structure, q, v, u, theta, scale, work, a, A, B):
        stage, slopes = work
        own, size = theta.copy(), scale.copy()  # kernels take no array that is read-only
        pivot = structure_linearise(structure, q, v, u, own, size, stage, slopes, a, B)
        A[:] = slopes.by_state
        return pivot

    return _chosen(structure, tree, data)


@overload(group_of)
def _group_of(structure):
    def tree(structure):
        return 6 if structure.numbers[0, 2] == BASE else 0

    def data(structure):
        return structure_group(structure.bodies)

    return _chosen(structure, tree, data)


@overload(integrate_into)
def _integrate_into(structure, q, step, out):
    def tree(structure, q, step, out):
        tree_integrate(structure, q, step, out)

    def data(structure, q, step, out):
        structure_integrate(structure.bodies, q, step, out, np.empty(SCRATCH))

    return _chosen(structure, tree, data)


@overload(difference_into)
def _difference_into(structure, q0, q1, out):
    def tree(structure, q0, q1, out):
        tree_difference(structure, q0, q1, out)

    def data(structure, q0, q1, out):
        structure_difference(structure.bodies, q0, q1, out, np.empty(SCRATCH))

    return _chosen(structure, tree, data)


def _chosen(structure, tree, data):
    return {Linkage: tree, StructureArrays: data}.get(structure.instance_class)
