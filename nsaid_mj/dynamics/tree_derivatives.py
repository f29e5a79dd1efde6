"""Derivatives of a tree's inverse dynamics with respect to position and velocity, by recursion.

All quantities are in one frame: the world's axes, about the world's origin or, for a floating tree,
about its base. With v_j, a_j the spatial velocity and acceleration of body j (gravity included in
a), S_j a column of its joint, λ its parent, and

    Ψ̇_j = v_λ × S_j,    Ψ̈_j = a_λ × S_j + v_λ × Ψ̇_j,    Ṡ_j = v_j × S_j,
    B = v ×* I − I (v ×) + (I v) ×̄*,

all of I, B and the wrench f summed over the bodies that j carries, the derivatives are for i ≼ j

    ∂τ_j/∂q_i = S_jᵀ (B Ψ̇_i + I Ψ̈_i),                      ∂τ_j/∂v_i = S_jᵀ (B S_i + I (Ψ̇_i + Ṡ_i)),
    ∂τ_i/∂q_j = S_iᵀ (B Ψ̇_j + I Ψ̈_j + f ×̄* S_j) if i ≺ j,  ∂τ_i/∂v_j = S_iᵀ (B S_j + I (Ψ̇_j + Ṡ_j)),

after Singh, Russell and Wensing, Efficient Analytical Derivatives of Rigid-Body Dynamics using
Spatial Vector Algebra, IEEE Robotics and Automation Letters 7 (2022). Positions change by tangent
steps, those of a base in its own axes. B has the form [[0, −2 p×], [0, N]], with p the momentum and
N = 2 (v·h) 1 − h vᵀ − v hᵀ + ω× Ī − Ī ω× − l×, where l is the angular momentum.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.triples import add, cross, dot, nine, put, rotate, scale, symmetric, three
from .tree import (
    AT,
    AXIS,
    BASE,
    FRICTION_SPEED,
    SLIP,
    joint_columns,
    parent_inertia,
)

_P, _V, _A, BODY = 9, 12, 18, 24  # columns of a body's placement: rotation, position, twists
_H, _I, _MOMENTUM, _N, _SPIN, _F, CARRIED = 1, 4, 10, 13, 19, 22, 28  # columns of what it carries
_RATE, _BEND, _SUM, COLUMN = 6, 12, 18, 24  # columns of a joint's column: S, Ψ̇, Ψ̈, Ψ̇ + Ṡ


@njit(cache=True)
def derivative_work(linkage, n):
    """Allocates the workspace of `write_derivatives`."""
    bodies = linkage[1].shape[0]
    return np.empty((bodies, BODY)), np.empty((bodies, CARRIED)), np.empty((n, COLUMN))


@njit(cache=True, inline="always")
def _product(w_l, w_a, m_l, m_a):
    """The spatial cross product of two twists."""
    return add(cross(w_a, m_l), cross(w_l, m_a)), cross(w_a, m_a)


@njit(cache=True, inline="always")
def _rows(carried, b, m_l, m_a):
    """Bᵀ-free products of what body b carries with a twist: I m as (force, moment)."""
    h = three(carried, b, _H)
    inertia = (
        carried[b, _I], carried[b, _I + 1], carried[b, _I + 2],
        carried[b, _I + 3], carried[b, _I + 4], carried[b, _I + 5],
    )  # fmt: skip
    force = add(scale(carried[b, 0], m_l), cross(m_a, h))
    return force, add(cross(h, m_l), symmetric(inertia, m_a))


@njit(cache=True, inline="always")
def _bent(carried, b, m_a):
    """B m as (force, moment); it depends on the angular part of the twist alone."""
    N = (
        carried[b, _N], carried[b, _N + 1], carried[b, _N + 2],
        carried[b, _N + 3], carried[b, _N + 4], carried[b, _N + 5],
    )  # fmt: skip
    moment = add(symmetric(N, m_a), cross(m_a, three(carried, b, _SPIN)))
    return scale(2.0, cross(m_a, three(carried, b, _MOMENTUM))), moment


@njit(cache=True)
def _place(linkage, state, v, a, bodies, columns):
    """Writes placement and twists of all bodies, and the joints' columns, in the common frame."""
    joints, numbers, gravity, _ = linkage
    for b in range(numbers.shape[0]):
        parent = numbers[b, 0]
        first, last = joint_columns(numbers, b)
        R, p = nine(state, b), three(state, b, AT)
        v_l, v_a = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        a_l, a_a = (-gravity[0], -gravity[1], -gravity[2]), (0.0, 0.0, 0.0)
        if parent >= 0:
            above = nine(bodies, parent)
            x, y, z = (
                rotate(above, (R[0], R[3], R[6])),
                rotate(above, (R[1], R[4], R[7])),
                rotate(above, (R[2], R[5], R[8])),
            )
            R = (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])
            p = add(three(bodies, parent, _P), rotate(above, p))
            v_l, v_a = three(bodies, parent, _V), three(bodies, parent, _V + 3)
            a_l, a_a = three(bodies, parent, _A), three(bodies, parent, _A + 3)
        if numbers[b, 2] == BASE:
            p = (0.0, 0.0, 0.0)
        for i in range(9):
            bodies[b, i] = R[i]
        bodies[b, _P], bodies[b, _P + 1], bodies[b, _P + 2] = p
        own_l, own_a = v_l, v_a
        for j in range(first, last + 1):
            if numbers[b, 2] == BASE:
                k = j % 3
                axis = (R[k], R[3 + k], R[6 + k])
                s_l, s_a = (axis, (0.0, 0.0, 0.0)) if j < 3 else ((0.0, 0.0, 0.0), axis)
            else:
                s_a = rotate(R, three(joints, b, AXIS + 3))
                s_l = add(rotate(R, three(joints, b, AXIS)), cross(p, s_a))
            put(columns, j, 0, s_l, s_a)
            own_l, own_a = add(own_l, scale(v[j], s_l)), add(own_a, scale(v[j], s_a))
        for j in range(first, last + 1):
            s_l, s_a = three(columns, j, 0), three(columns, j, 3)
            r_l, r_a = _product(v_l, v_a, s_l, s_a)
            b_l, b_a = _product(a_l, a_a, s_l, s_a)
            c_l, c_a = _product(v_l, v_a, r_l, r_a)
            t_l, t_a = _product(own_l, own_a, s_l, s_a)
            put(columns, j, _RATE, r_l, r_a)
            put(columns, j, _BEND, add(b_l, c_l), add(b_a, c_a))
            put(columns, j, _SUM, add(r_l, t_l), add(r_a, t_a))
        if numbers[b, 2] != BASE:
            t_l, t_a = _product(own_l, own_a, three(columns, last, 0), three(columns, last, 3))
            a_l, a_a = add(a_l, scale(v[last], t_l)), add(a_a, scale(v[last], t_a))
        for j in range(first, last + 1):
            a_l = add(a_l, scale(a[j], three(columns, j, 0)))
            a_a = add(a_a, scale(a[j], three(columns, j, 3)))
        put(bodies, b, _V, own_l, own_a)
        put(bodies, b, _A, a_l, a_a)


@njit(cache=True)
def _load(theta, bodies, carried):
    """Writes what every body itself contributes to I, B and f under θ (p,)."""
    for b in range(bodies.shape[0]):
        k = 10 * b
        m = theta[k]
        h, inertia = parent_inertia(
            nine(bodies, b),
            three(bodies, b, _P),
            m,
            (theta[k + 1], theta[k + 2], theta[k + 3]),
            (theta[k + 4], theta[k + 5], theta[k + 6], theta[k + 7], theta[k + 8], theta[k + 9]),
        )
        v_l, v_a = three(bodies, b, _V), three(bodies, b, _V + 3)
        a_l, a_a = three(bodies, b, _A), three(bodies, b, _A + 3)
        carried[b, 0] = m
        carried[b, _H], carried[b, _H + 1], carried[b, _H + 2] = h
        for i in range(6):
            carried[b, _I + i] = inertia[i]
        p_l, p_a = _rows(carried, b, v_l, v_a)
        carried[b, _MOMENTUM], carried[b, _MOMENTUM + 1], carried[b, _MOMENTUM + 2] = p_l
        carried[b, _SPIN], carried[b, _SPIN + 1], carried[b, _SPIN + 2] = p_a
        both = 2 * dot(v_l, h)
        xx, xy, yy, xz, yz, zz = inertia
        x, y, z = v_a
        # ω× Ī − Ī ω× is symmetric: the sum of ω× Ī and its transpose
        carried[b, _N] = both - 2 * h[0] * v_l[0] + 2 * (y * xz - z * xy)
        carried[b, _N + 1] = -h[0] * v_l[1] - h[1] * v_l[0] + (y * yz - z * yy) + (z * xx - x * xz)
        carried[b, _N + 2] = both - 2 * h[1] * v_l[1] + 2 * (z * xy - x * yz)
        carried[b, _N + 3] = -h[0] * v_l[2] - h[2] * v_l[0] + (y * zz - z * yz) + (x * xy - y * xx)
        carried[b, _N + 4] = -h[1] * v_l[2] - h[2] * v_l[1] + (z * xz - x * zz) + (x * yy - y * xy)
        carried[b, _N + 5] = both - 2 * h[2] * v_l[2] + 2 * (x * yz - y * xz)
        f, n = _rows(carried, b, a_l, a_a)
        put(
            carried, b, _F,
            add(f, cross(v_a, p_l)), add(n, add(cross(v_a, p_a), cross(v_l, p_l))),
        )  # fmt: skip


@njit(cache=True)
def write_derivatives(linkage, state, v, a, theta, work, by_q, by_v):
    """Writes the derivatives of the inverse dynamics M a + C v + g + friction at fixed a.

    Args:
        linkage: the tree.
        state: (b, STATE) of `dynamics.tree`.
        v: (n,) velocity.
        a: (n,) acceleration.
        theta: (p,) parameters.
        work: workspace of `derivative_work`.
        by_q: (n, n) ∂τ/∂q; written.
        by_v: (n, n) ∂τ/∂v; written.
    """
    joints, numbers, _, (_, viscous, coulomb, _) = linkage
    bodies, carried, columns = work
    _place(linkage, state, v, a, bodies, columns)
    _load(theta, bodies, carried)
    by_q[:], by_v[:] = 0.0, 0.0
    for b in range(numbers.shape[0] - 1, -1, -1):
        first, last = joint_columns(numbers, b)
        f_l, f_a = three(carried, b, _F), three(carried, b, _F + 3)
        for j in range(first, last + 1):
            s_l, s_a = three(columns, j, 0), three(columns, j, 3)
            x, y = _rows(carried, b, three(columns, j, _BEND), three(columns, j, _BEND + 3))
            bx, by = _bent(carried, b, three(columns, j, _RATE + 3))
            x, y = add(x, bx), add(y, by)
            z, w = _rows(carried, b, three(columns, j, _SUM), three(columns, j, _SUM + 3))
            bz, bw = _bent(carried, b, s_a)
            z, w = add(z, bz), add(w, bw)
            g, o = _rows(carried, b, s_l, s_a)
            # Bᵀ S_j = (0, Nᵀ s_a + 2 p × s_l); N without its antisymmetric part −l× is symmetric
            spun = symmetric(
                (
                    carried[b, _N], carried[b, _N + 1], carried[b, _N + 2],
                    carried[b, _N + 3], carried[b, _N + 4], carried[b, _N + 5],
                ),
                s_a,
            )  # fmt: skip
            lean = add(spun, cross(three(carried, b, _SPIN), s_a))
            lean = add(lean, scale(2.0, cross(three(carried, b, _MOMENTUM), s_l)))
            turned_l, turned_a = cross(s_a, f_l), add(cross(s_a, f_a), cross(s_l, f_l))
            ancestor = b
            while ancestor >= 0:
                low, high = joint_columns(numbers, ancestor)
                for i in range(low, high + 1):
                    d_l, d_a = three(columns, i, 0), three(columns, i, 3)
                    by_q[i, j] = dot(d_l, x) + dot(d_a, y)
                    by_v[i, j] = dot(d_l, z) + dot(d_a, w)
                    if ancestor != b:
                        by_q[j, i] = (
                            dot(lean, three(columns, i, _RATE + 3))
                            + dot(g, three(columns, i, _BEND))
                            + dot(o, three(columns, i, _BEND + 3))
                        )
                        by_q[i, j] += dot(turned_l, d_l) + dot(turned_a, d_a)
                        by_v[j, i] = (
                            dot(lean, d_a)
                            + dot(g, three(columns, i, _SUM))
                            + dot(o, three(columns, i, _SUM + 3))
                        )
                ancestor = numbers[ancestor, 0]
        parent = numbers[b, 0]
        if parent >= 0:
            for i in range(CARRIED):
                carried[parent, i] += carried[b, i]
    count = coulomb - viscous
    for k in range(count):
        i, slip = v.shape[0] - count + k, state[numbers.shape[0] - count + k, SLIP]
        steep = (1 - slip * slip) / joints[numbers.shape[0] - count + k, FRICTION_SPEED]
        by_v[i, i] += theta[viscous + k] + theta[coulomb + k] * steep
