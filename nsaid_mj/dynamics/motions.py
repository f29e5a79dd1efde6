"""What a measured motion decides of every stage, for compiled loops: â of (29) and Wᵀ Δv.

Any number of identifiers may share a motion. Which kind it is, a tree, a body or a tree that
carries more than bodies, is chosen when a loop is compiled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from ..numerics.linalg import solve_positive
from ..numerics.spatial import bracket, coadjoint
from ..parameters import Array
from ..system import ConstantInertia, Linkage, LoadedTree
from .interpolation import tree_half_way
from .loaded import loaded_gradient, loaded_work
from .tree import STATE, tree_gradient, tree_place, tree_work
from .tree_lanes import LANES, lanes_gradient, lanes_work


class TreeMotion(NamedTuple):
    """What N samples of a tree alone decide in every stage; any number of identifiers share it.

    Attributes:
        linkage: of the tree.
        t: (N,) times [s].
        u: (N, n_u) commands.
        v: (N, n) velocities.
        vm: (N−1, n) velocities half-way between samples.
        states: (N, b, ·) of `recursion`.
        middles: (N−1, b, ·) likewise, half-way.
    """

    linkage: Linkage
    t: Array
    u: Array
    v: Array
    vm: Array
    states: Array
    middles: Array


class BodyMotion(NamedTuple):
    """The same of a body with M constant in its frame.

    Attributes:
        inertia: of the body.
        group: its velocities are a body twist of.
        t: (N,) times [s].
        v: (N, n) velocities.
        vm: (N−1, n) velocities half-way between samples.
        F: (3, N−1, n, p) at start, middle and end of every step.
    """

    inertia: ConstantInertia
    group: int
    t: Array
    v: Array
    vm: Array
    F: Array


class LoadedMotion(NamedTuple):
    """The same of a tree whose bodies carry inertias of any kind.

    Attributes:
        loaded: the tree.
        t: (N,) times [s].
        u: (N, n_u) commands.
        v: (N, n) velocities.
        vm: (N−1, n) velocities half-way between samples.
        states: (N, b, ·) of `recursion`.
        middles: (N−1, b, ·) likewise, half-way.
        F: (3, N−1, n, k) the last columns of F at start, middle and end of every step.
    """

    loaded: LoadedTree
    t: Array
    u: Array
    v: Array
    vm: Array
    states: Array
    middles: Array
    F: Array


class TreeBatch(NamedTuple):
    """A tree's motion for a batch of `LANES` identifiers, one SIMD lane each.

    RK4 sees one identifier of LANES n velocities and LANES p parameters: number i of lane l is at
    LANES i + l of every vector, gains by their diagonals.

    Attributes:
        tree: what all lanes share.
        t: (N,) times [s].
        v: (N, LANES n) velocities, every one LANES times.
        vm: (N−1, LANES n) velocities half-way between samples.
        pivots: (N, LANES) smallest pivot of each lane's M̂ in the step up to there; written by the
            stages from row 1 on.
    """

    tree: TreeMotion
    t: Array
    v: Array
    vm: Array
    pivots: Array


Motion = TreeMotion | BodyMotion | LoadedMotion


def tree_batch(tree: TreeMotion) -> TreeBatch:
    """A tree's motion for `LANES` identifiers."""
    v, vm = (np.repeat(x, LANES, axis=1) for x in (tree.v, tree.vm))
    return TreeBatch(tree, tree.t, v, vm, np.empty((len(tree.t), LANES)))


@njit(cache=True, nogil=True)
def tree_motion(linkage, hermite, t, q, v, u):
    """The motion of a tree; `hermite` says how the state between samples is had."""
    steps, bodies = t.shape[0] - 1, linkage[1].shape[0]
    qm, vm = np.empty(q.shape[1]), np.empty((steps, v.shape[1]))
    states, middles = np.empty((steps + 1, bodies, STATE)), np.empty((steps, bodies, STATE))
    tree_place(linkage, q[0], v[0], states[0])
    for k in range(steps):
        dt = t[k + 1] - t[k]
        tree_half_way(linkage, q[k], v[k], q[k + 1], v[k + 1], dt, hermite, qm, vm[k])
        tree_place(linkage, qm, vm[k], middles[k])
        tree_place(linkage, q[k + 1], v[k + 1], states[k + 1])
    return TreeMotion(linkage, t, u, v, vm, states, middles)


def stage_room(motion):
    """Workspace of `stage`."""


def stage(motion, at, k, v_hat, theta, work, a_hat, gradient) -> Any:
    """Writes â (n,) of (29) and Wᵀ Δv (p,) at start, middle or end (0, 1, 2) of step k − 1 → k.

    Returns M̂'s smallest pivot, > 0 if it succeeded.
    """


@overload(stage_room)
def _stage_room(motion):
    def tree(motion):
        return tree_work(motion.linkage, motion.v.shape[1])

    def batch(motion):
        return lanes_work(motion.tree.linkage, motion.tree.v.shape[1]), np.empty(LANES)

    def body(motion):
        n = motion.v.shape[1]
        return np.zeros((n, n)), np.zeros((n, n))

    def loaded(motion):
        return loaded_work(motion.loaded, motion.v.shape[1])

    rooms = {TreeMotion: tree, BodyMotion: body, LoadedMotion: loaded, TreeBatch: batch}
    return rooms[motion.instance_class]


@overload(stage)
def _stage(motion, at, k, v_hat, theta, work, a_hat, gradient):
    def tree(motion, at, k, v_hat, theta, work, a_hat, gradient):
        state = motion.middles[k - 1] if at == 1 else motion.states[k - 1 + at // 2]
        v = motion.vm[k - 1] if at == 1 else motion.v[k - 1 + at // 2]
        return tree_gradient(
            motion.linkage, state, v, motion.u[k - 1], v_hat, theta, work, a_hat, gradient
        )

    def body(motion, at, k, v_hat, theta, work, a_hat, gradient):
        entries, values = motion.inertia
        M, L = work
        v = motion.vm[k - 1] if at == 1 else motion.v[k - 1 + at // 2]
        return body_gradient(
            entries, values, motion.group, motion.F[at, k - 1], v, v_hat, theta, M, L, a_hat,
            gradient[0],
        )  # fmt: skip

    def loaded(motion, at, k, v_hat, theta, work, a_hat, gradient):
        state = motion.middles[k - 1] if at == 1 else motion.states[k - 1 + at // 2]
        v = motion.vm[k - 1] if at == 1 else motion.v[k - 1 + at // 2]
        return loaded_gradient(
            motion.loaded, state, v, motion.u[k - 1], motion.F[at, k - 1], v_hat, theta, work,
            a_hat, gradient[0],
        )  # fmt: skip

    def batch(motion, at, k, v_hat, theta, work, a_hat, gradient):
        tree, row, (room, pivots) = motion.tree, motion.pivots[k], work
        state = tree.middles[k - 1] if at == 1 else tree.states[k - 1 + at // 2]
        v = tree.vm[k - 1] if at == 1 else tree.v[k - 1 + at // 2]
        pivot = lanes_gradient(
            tree.linkage, state, v, tree.u[k - 1], v_hat, theta, room, a_hat, gradient[0], pivots
        )
        for lane in range(LANES):
            row[lane] = pivots[lane] if at == 0 else min(row[lane], pivots[lane])
        return pivot

    stages = {TreeMotion: tree, BodyMotion: body, LoadedMotion: loaded, TreeBatch: batch}
    return stages[motion.instance_class]


@njit(cache=True)
def body_gradient(entries, values, group, F, v, v_hat, theta, M, L, a_hat, gradient):
    """Writes â (n,) of (29) and Wᵀ Δv (p,); returns M̂'s smallest pivot, > 0 if it succeeded.

    With h = M̂ v and C w = −ad_wᵀ h, W need not be formed: Wᵀ Δv gathers, for every entry
    M_ij = c θ_k, c (a_j Δv_i − v_j [v̂, Δv]_i).
    """
    n, p = F.shape
    M[:] = 0.0
    for e in range(values.shape[0]):
        M[entries[e, 0], entries[e, 1]] += values[e] * theta[entries[e, 2]]
    dv = v_hat - v  # (37)
    a_hat[:] = coadjoint(group, v_hat, np.dot(M, v))
    gradient[:] = 0.0
    for i in range(n):
        total = 0.0
        for k in range(p):
            total += F[i, k] * theta[k]
            gradient[k] -= F[i, k] * dv[i]
        a_hat[i] += total
    pivot = solve_positive(M, L, a_hat)  # (29)
    if not pivot > 0.0:
        return pivot
    turned = bracket(group, v_hat, dv)
    for e in range(values.shape[0]):
        i, j, k = entries[e]
        gradient[k] += values[e] * (a_hat[j] * dv[i] - v[j] * turned[i])
    return pivot
