"""Trees of bodies with general 6×6 inertias, such as added mass, by recursions as in `tree`.

With V_i and W_i the twists of body i under the velocities v and w, A_i = J_i a + J̇_i w, and I_i its
6×6 inertia, constant in its axes, body i requires the wrench

    f_i = I_i A_i − I_i^w [g, 0] − ad_{W_i}ᵀ I_i V_i,

with I_i^w the part of I_i that has weight and g gravity in its axes; and
Σ J_iᵀ f_i = M a + C(v) w − weight. Ṁ − 2C is skew because for each body J̇ᵀ I J − Jᵀ I J̇ and
w ↦ ad_wᵀ h are (Fossen's form). Even where all I_i are those of rigid
bodies, this C differs from that of `tree`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.linalg import solve_positive
from ..numerics.triples import add, back, cross, dot, forth, put, scale, three
from .tree import AT, AXIS, BASE, SLIP, TWIST, carried

_W, _A, _F, _G, MOTION = 0, 6, 12, 18, 21  # columns of a motion


@njit(cache=True)
def loaded_workspace(loaded, n):
    """Allocates the workspace of a stage: body motions, inertias, powers, M̂ and its factor."""
    bodies = loaded[0][1].shape[0]
    return (
        np.empty((bodies, MOTION)),
        np.empty((bodies, 2, 6, 6)),
        np.empty((bodies, 2, 6, 6)),
        np.zeros((n, n)),
        np.zeros((n, n)),
    )


@njit(cache=True)
def write_twists(linkage, state, v, w, motion):
    """Writes W_i, A_i = J̇_i w and gravity of all bodies, in the bodies' axes."""
    joints, numbers, gravity, _ = linkage
    put(motion, 0, _W, (w[0], w[1], w[2]), (w[3], w[4], w[5]))
    put(motion, 0, _A, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    _put_gravity(motion, 0, back(state, 0, (gravity[0], gravity[1], gravity[2])))
    for b in range(1, numbers.shape[0]):
        parent, rate = numbers[b, 0], v[5 + b]
        s_l, s_a = three(joints, b, AXIS), three(joints, b, AXIS + 3)
        w_l, w_a = carried(state, b, three(motion, parent, _W), three(motion, parent, _W + 3))
        a_l, a_a = carried(state, b, three(motion, parent, _A), three(motion, parent, _A + 3))
        a_l = add(a_l, scale(-rate, add(cross(s_a, w_l), cross(s_l, w_a))))  # Ẋ = −q̇ ad_S X
        a_a = add(a_a, scale(-rate, cross(s_a, w_a)))
        put(
            motion,
            b,
            _W,
            add(w_l, scale(w[5 + b], s_l)),
            add(w_a, scale(w[5 + b], s_a)),
        )
        put(motion, b, _A, a_l, a_a)
        _put_gravity(motion, b, back(state, b, three(motion, parent, _G)))


@njit(cache=True)
def _put_gravity(motion, b, g):
    motion[b, _G], motion[b, _G + 1], motion[b, _G + 2] = g


@njit(cache=True)
def add_accelerations(linkage, state, a, motion):
    """Adds J_i a to A_i of all bodies; overwrites the force columns of `motion`."""
    joints, numbers = linkage[0], linkage[1]
    for b in range(numbers.shape[0]):
        a_l, a_a = (a[0], a[1], a[2]), (a[3], a[4], a[5])
        if numbers[b, 2] != BASE:
            parent, rate = numbers[b, 0], a[5 + b]
            a_l, a_a = carried(state, b, three(motion, parent, _F), three(motion, parent, _F + 3))
            a_l = add(a_l, scale(rate, three(joints, b, AXIS)))
            a_a = add(a_a, scale(rate, three(joints, b, AXIS + 3)))
        put(motion, b, _F, a_l, a_a)
        put(
            motion,
            b,
            _A,
            add(three(motion, b, _A), a_l),
            add(three(motion, b, _A + 3), a_a),
        )


@njit(cache=True)
def _write_forces(loaded, state, theta, motion, inertias):
    """Writes every body's wrench f_i under θ (p,), and its I_i into inertias[:, 0]."""
    _, places, parameters, values = loaded
    inertias[:] = 0.0
    flat = inertias.reshape(-1)
    for e in range(places.shape[0]):
        flat[places[e]] += values[e] * theta[parameters[e]]
    h = np.empty(6)
    for b in range(motion.shape[0]):
        for i in range(6):
            force, momentum = 0.0, 0.0
            for j in range(3):
                force -= inertias[b, 1, i, j] * motion[b, _G + j]
            for j in range(6):
                inertias[b, 0, i, j] += inertias[b, 1, i, j]
                force += inertias[b, 0, i, j] * motion[b, _A + j]
                momentum += inertias[b, 0, i, j] * state[b, TWIST + j]
            motion[b, _F + i], h[i] = force, momentum
        w_l, w_a = three(motion, b, _W), three(motion, b, _W + 3)
        h_l, h_a = (h[0], h[1], h[2]), (h[3], h[4], h[5])
        put(
            motion,
            b,
            _F,
            add(three(motion, b, _F), cross(w_a, h_l)),
            add(three(motion, b, _F + 3), add(cross(w_l, h_l), cross(w_a, h_a))),
        )


@njit(cache=True)
def _add_to_parent(state, b, parent, motion, inertias):
    """Adds the wrench and composite inertia of body b to its parent's, in the parent's axes."""
    p = three(state, b, AT)
    force = forth(state, b, three(motion, b, _F))
    moment = add(forth(state, b, three(motion, b, _F + 3)), cross(p, force))
    put(
        motion,
        parent,
        _F,
        add(three(motion, parent, _F), force),
        add(three(motion, parent, _F + 3), moment),
    )
    own, turned, total = inertias[b, 0], inertias[b, 1], inertias[parent, 0]
    _transform_wrenches(state, b, own, turned)
    _transform_wrenches(state, b, turned, own)  # Xᵀ (Xᵀ I)ᵀ: I is symmetric
    for i in range(6):
        for j in range(6):
            total[i, j] += own[i, j]


@njit(cache=True)
def _transform_wrenches(state, b, wrenches, seen):
    """Writes the columns of `wrenches` (6, 6), transformed from body b to its parent, as rows."""
    p = three(state, b, AT)
    for j in range(6):
        force = forth(state, b, (wrenches[0, j], wrenches[1, j], wrenches[2, j]))
        moment = forth(state, b, (wrenches[3, j], wrenches[4, j], wrenches[5, j]))
        put(seen, j, 0, force, add(moment, cross(p, force)))


@njit(cache=True)
def _gather(linkage, state, motion, inertias, M, force):
    """Writes M's lower triangle and Σ J_iᵀ f_i (n,), without friction, motors and rotors."""
    joints, numbers = linkage[0], linkage[1]
    for b in range(numbers.shape[0] - 1, 0, -1):
        s_l, s_a, row = three(joints, b, AXIS), three(joints, b, AXIS + 3), 5 + b
        force[row] = dot(s_l, three(motion, b, _F)) + dot(s_a, three(motion, b, _F + 3))
        f = _rows(inertias[b, 0], 0, s_l, s_a)
        n = _rows(inertias[b, 0], 3, s_l, s_a)
        M[row, row] = dot(s_l, f) + dot(s_a, n)
        below, ancestor = b, numbers[b, 0]
        while ancestor >= 0:
            f = forth(state, below, f)
            n = add(forth(state, below, n), cross(three(state, below, AT), f))
            if ancestor == 0:
                M[row, 0], M[row, 1], M[row, 2] = f
                M[row, 3], M[row, 4], M[row, 5] = n
            else:
                M[row, 5 + ancestor] = dot(three(joints, ancestor, AXIS), f) + dot(
                    three(joints, ancestor, AXIS + 3), n
                )
            below, ancestor = ancestor, numbers[ancestor, 0]
        _add_to_parent(state, b, numbers[b, 0], motion, inertias)
    for i in range(6):
        force[i] = motion[0, _F + i]
        for j in range(i + 1):
            M[i, j] = inertias[0, 0, i, j]


@njit(cache=True)
def _rows(inertia, i, s_l, s_a):
    return (
        dot(three(inertia, i, 0), s_l) + dot(three(inertia, i, 3), s_a),
        dot(three(inertia, i + 1, 0), s_l) + dot(three(inertia, i + 1, 3), s_a),
        dot(three(inertia, i + 2, 0), s_l) + dot(three(inertia, i + 2, 3), s_a),
    )


@njit(cache=True)
def _powers(state, motion, powers):
    """Writes the power on Δv's twist per unit of every entry of I_i, without and with weight."""
    for b in range(motion.shape[0]):
        w_l, w_a = three(motion, b, _W), three(motion, b, _W + 3)
        d_l = add(w_l, scale(-1.0, three(state, b, TWIST)))
        d_a = add(w_a, scale(-1.0, three(state, b, TWIST + 3)))
        t_l, t_a = add(cross(w_a, d_l), cross(w_l, d_a)), cross(w_a, d_a)
        d = d_l[0], d_l[1], d_l[2], d_a[0], d_a[1], d_a[2]
        t = t_l[0], t_l[1], t_l[2], t_a[0], t_a[1], t_a[2]
        for i in range(6):
            for j in range(6):
                power = motion[b, _A + j] * d[i] - state[b, TWIST + j] * t[i]
                powers[b, 0, i, j], powers[b, 1, i, j] = power, power
            for j in range(3):
                powers[b, 1, i, j] -= motion[b, _G + j] * d[i]


@njit(cache=True)
def accelerate(loaded, state, v, u, F, v_hat, theta, work, a):
    """Writes â of (29) into a (n,); returns M̂'s smallest pivot, > 0 if it succeeded.

    Args:
        loaded: the tree.
        state: (b, ·) of `tree`, at the measured state.
        v: (n,) measured velocity.
        u: commands, the joints' first.
        F: (n, k) the last k columns of F, the other forces on the bodies.
        v_hat: (n,) velocity that C multiplies.
        theta: (p,) estimate.
        work: workspace of `loaded_workspace`.
        a: (n,) written.
    """
    linkage = loaded[0]
    motion, inertias, _, M, L = work
    rotor, viscous, coulomb, gain = linkage[3]
    n, others = F.shape
    rest = theta[theta.shape[0] - others :]
    write_twists(linkage, state, v, v_hat, motion)
    _write_forces(loaded, state, theta, motion, inertias)
    _gather(linkage, state, motion, inertias, M, a)
    for k in range(n - 6):
        i = 6 + k
        friction = theta[viscous + k] * v[i] + theta[coulomb + k] * state[1 + k, SLIP]
        a[i] += friction - theta[gain + k] * u[k]
        if rotor < viscous:
            M[i, i] += theta[rotor + k]
    for i in range(n):
        total = -a[i]
        for k in range(others):
            total += F[i, k] * rest[k]
        a[i] = total
    return solve_positive(M, L, a)


@njit(cache=True)
def loaded_gradient(loaded, state, v, u, F, v_hat, theta, work, a, gradient):
    """Writes â of (29) into a (n,) and Wᵀ Δv into gradient (p,); returns M̂'s smallest pivot.

    W itself is not formed: every entry c θ_k of an I_i at (r, s) contributes to Wᵀ Δv c times
    (A_i − [g, 0])_s (W_i − V_i)_r − (V_i)_s [W_i, W_i − V_i]_r. The other arguments are those of
    `accelerate`.
    """
    linkage, places, parameters, values = loaded
    motion, powers = work[0], work[2]
    rotor, viscous, coulomb, gain = linkage[3]
    pivot = accelerate(loaded, state, v, u, F, v_hat, theta, work, a)
    if not pivot > 0.0:
        return pivot
    add_accelerations(linkage, state, a, motion)
    _powers(state, motion, powers)
    gradient[:] = 0.0
    flat = powers.reshape(-1)
    for e in range(places.shape[0]):
        gradient[parameters[e]] += values[e] * flat[places[e]]
    n, others = F.shape
    for k in range(n - 6):
        dv = v_hat[6 + k] - v[6 + k]
        if rotor < viscous:
            gradient[rotor + k] = dv * a[6 + k]
        gradient[viscous + k] = dv * v[6 + k]
        gradient[coulomb + k] = dv * state[1 + k, SLIP]
        gradient[gain + k] = -dv * u[k]
    rest = gradient[gradient.shape[0] - others :]
    for i in range(n):
        dv = v_hat[i] - v[i]
        for k in range(others):
            rest[k] -= F[i, k] * dv
    return pivot
