"""Trees of rigid bodies by recursions from body to body, compiled, with no array in their loops.

Each body has its own axes. With V_i and W_i its twists [v, ω] under the velocities v and w, and
A_i = X A_parent + S_i a_i + ½ (V_i × S_i w_i + W_i × S_i v_i) its acceleration, body i asks for

    f_i = I_i A_i + ½ (V_i ×* I_i W_i + W_i ×* I_i V_i),

and Σ J_iᵀ f_i = M a + C(v) w, C that of `Multibody`: what is quadratic in v, polarised, and where
the base floats ½[v, w] added to its acceleration. With a* = a + ½ (ω_V × w + ω_W × v),

    f = m a* + α × h + ½ (ω_V × (ω_W × h) + ω_W × (ω_V × h)),
    n = h × a* + Ī α + ½ (ω_V × Ī ω_W + ω_W × Ī ω_V),

no quotient of parameters: masses may be zero or negative. After Featherstone, Rigid Body Dynamics
Algorithms (2008), ch. 5 and 6.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.linalg import solve_positive
from ..numerics.spatial import rotation
from ..numerics.triples import (
    add,
    back,
    cross,
    dot,
    forth,
    nine,
    put,
    rotate,
    scale,
    symmetric,
    three,
    unrotate,
)

BASE, TURN, SLIDE, CIRCLE = 0, 1, 2, 3
"""Kinds of joint: a free flyer, an angle, a travel, and an angle by its cosine and sine."""
FIXED, COSINE, SINE, PLACE, TRAVEL, AXIS, FRICTION_SPEED, WIDTH = 0, 9, 18, 27, 30, 33, 39, 40
"""Columns of `Linkage.joints`."""
AT, TWIST, SLIP, STATE = 9, 12, 18, 19
"""Columns of a state, after the nine of a rotation."""
_W, _A, _F, _MASS, _H, _I, MOTION = 0, 6, 12, 18, 19, 22, 28  # columns of a motion

# -- one body's formulas, on tuples: for a loop over bodies, and for one over SIMD lanes in it ----


@njit(cache=True)
def child_twist(R, p, linear, angular):
    """A parent's twist as seen by a body that is rotated by R at p."""
    return unrotate(R, add(linear, cross(angular, p))), unrotate(R, angular)


@njit(cache=True, inline="always")
def parent_wrench(R, p, force, torque):
    """A body's wrench as seen by its parent."""
    force = rotate(R, force)
    return force, add(rotate(R, torque), cross(p, force))


@njit(cache=True, inline="always")
def parent_inertia(R, p, m, h, inertia):
    """A body's first moment and inertia as seen by its parent; its mass m is the same for both."""
    xx, xy, yy, xz, yz, zz = inertia
    x, y, z = rotate(R, (xx, xy, xz)), rotate(R, (xy, yy, yz)), rotate(R, (xz, yz, zz))
    r = rotate(R, (x[0], y[0], z[0]))
    s = rotate(R, (x[1], y[1], z[1]))
    t = rotate(R, (x[2], y[2], z[2]))
    h = rotate(R, h)
    k = add(h, scale(0.5 * m, p))
    both = 2 * dot(p, k)
    return add(h, scale(m, p)), (
        r[0] + both - 2 * p[0] * k[0],
        r[1] - p[0] * k[1] - p[1] * k[0],
        s[1] + both - 2 * p[1] * k[1],
        r[2] - p[0] * k[2] - p[2] * k[0],
        s[2] - p[1] * k[2] - p[2] * k[1],
        t[2] + both - 2 * p[2] * k[2],
    )


@njit(cache=True, inline="always")
def across_joint(s_l, s_a, v_l, v_a, v, w, a, w_l, w_a, a_l, a_a):
    """W and A of a body behind a joint with axis S = [s_l, s_a] and rates v, w and a.

    [v_l, v_a] is V of the body; [w_l, w_a] and [a_l, a_a] are W and A of its parent, as it sees
    them.
    """
    w_l = add(w_l, scale(w, s_l))
    w_a = add(w_a, scale(w, s_a))
    half_v, half_w = 0.5 * v, 0.5 * w
    u_l = add(scale(half_w, v_l), scale(half_v, w_l))
    u_a = add(scale(half_w, v_a), scale(half_v, w_a))
    a_l = add(add(a_l, scale(a, s_l)), add(cross(u_a, s_l), cross(u_l, s_a)))
    a_a = add(add(a_a, scale(a, s_a)), cross(u_a, s_a))
    return w_l, w_a, a_l, a_a


@njit(cache=True)
def base_acceleration(v_l, v_a, w_l, w_a, up, a_l, a_a):
    """A of a floating base: its acceleration a, gravity's, and ½[v, w]."""
    turned = add(cross(v_a, w_l), cross(v_l, w_a))
    return add(add(up, a_l), scale(0.5, turned)), add(a_a, scale(0.5, cross(v_a, w_a)))


@njit(cache=True)
def felt_acceleration(a, v_l, omega, w_l, turning):
    """a* = a + ½ (ω_V × w + ω_W × v)."""
    return add(a, scale(0.5, add(cross(omega, w_l), cross(turning, v_l))))


@njit(cache=True, inline="always")
def wrench(m, h, inertia, a, alpha, omega, turning):
    """f and n of a body with parameters m, h, Ī; `a` is a*, ω = ω_V, `turning` ω_W."""
    swung = add(cross(omega, cross(turning, h)), cross(turning, cross(omega, h)))
    spun = add(cross(omega, symmetric(inertia, turning)), cross(turning, symmetric(inertia, omega)))
    return (
        add(add(scale(m, a), cross(alpha, h)), scale(0.5, swung)),
        add(add(cross(h, a), symmetric(inertia, alpha)), scale(0.5, spun)),
    )


@njit(cache=True)
def axis_wrench(s_l, s_a, m, h, inertia):
    """Wrench under which a body at rest accelerates by the twist S."""
    return add(scale(m, s_l), cross(s_a, h)), add(cross(h, s_l), symmetric(inertia, s_a))


@njit(cache=True, inline="always")
def power(d, delta, a, alpha, omega, turning):
    """The ten columns of dᵀ f + δᵀ n of one body, linear in its parameters."""
    x, y = cross(delta, omega), cross(delta, turning)
    both = dot(omega, turning)
    along, across = 0.5 * dot(turning, d), 0.5 * dot(omega, d)
    h = add(
        add(cross(d, alpha), cross(a, delta)),
        add(add(scale(along, omega), scale(across, turning)), scale(-both, d)),
    )
    x, y = scale(0.5, x), scale(0.5, y)
    return (
        dot(d, a),
        h[0],
        h[1],
        h[2],
        delta[0] * alpha[0] + x[0] * turning[0] + y[0] * omega[0],
        (delta[0] * alpha[1] + delta[1] * alpha[0])
        + (x[0] * turning[1] + x[1] * turning[0])
        + (y[0] * omega[1] + y[1] * omega[0]),
        delta[1] * alpha[1] + x[1] * turning[1] + y[1] * omega[1],
        (delta[0] * alpha[2] + delta[2] * alpha[0])
        + (x[0] * turning[2] + x[2] * turning[0])
        + (y[0] * omega[2] + y[2] * omega[0]),
        (delta[1] * alpha[2] + delta[2] * alpha[1])
        + (x[1] * turning[2] + x[2] * turning[1])
        + (y[1] * omega[2] + y[2] * omega[1]),
        delta[2] * alpha[2] + x[2] * turning[2] + y[2] * omega[2],
    )


# -- what depends on the measured state alone ------------------------------------------------------


@njit(cache=True)
def tree_room(linkage):
    """(b, ·) room for a state."""
    return np.empty((linkage[1].shape[0], STATE))


@njit(cache=True)
def tree_state(linkage, q, v):
    """(b, ·) every body's rotation and place on its parent, its twist, and tanh of its rate."""
    state = tree_room(linkage)
    tree_place(linkage, q, v, state)
    return state


@njit(cache=True)
def tree_place(linkage, q, v, state):
    """Writes the state."""
    joints, numbers, _, _ = linkage
    column = 0
    for b in range(numbers.shape[0]):
        parent, at, kind = numbers[b]
        linear, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if kind == BASE:
            R = rotation(q[3:7])
            for i in range(9):
                state[b, i] = R[i // 3, i % 3]
            state[b, AT], state[b, AT + 1], state[b, AT + 2] = q[0], q[1], q[2]
            put(state, b, TWIST, (v[0], v[1], v[2]), (v[3], v[4], v[5]))
            state[b, SLIP] = 0.0
            column = 6
            continue
        cosine, sine, travel = 1.0, 0.0, 0.0
        if kind == TURN:
            cosine, sine = np.cos(q[at]), np.sin(q[at])
        elif kind == CIRCLE:
            cosine, sine = q[at], q[at + 1]
        else:
            travel = q[at]
        for i in range(9):
            state[b, i] = (
                joints[b, FIXED + i] + cosine * joints[b, COSINE + i] + sine * joints[b, SINE + i]
            )
        for i in range(3):
            state[b, AT + i] = joints[b, PLACE + i] + travel * joints[b, TRAVEL + i]
        if parent >= 0:
            linear, angular = carried(
                state, b, three(state, parent, TWIST), three(state, parent, TWIST + 3)
            )
        rate = v[column]
        linear = add(linear, scale(rate, three(joints, b, AXIS)))
        angular = add(angular, scale(rate, three(joints, b, AXIS + 3)))
        put(state, b, TWIST, linear, angular)
        state[b, SLIP] = np.tanh(rate / joints[b, FRICTION_SPEED])
        column += 1


# -- from the base outwards ------------------------------------------------------------------------


@njit(cache=True)
def carried(state, b, linear, angular):
    """A parent's twist, as body b sees it."""
    return child_twist(nine(state, b), three(state, b, AT), linear, angular)


@njit(cache=True)
def move(linkage, state, v, w, a, weight, motion):
    """Writes W_i and A_i of all bodies; `weight` is 1 where A_i has gravity in it, 0 elsewhere."""
    joints, numbers, gravity, _ = linkage
    column = 0
    for b in range(numbers.shape[0]):
        parent, kind = numbers[b, 0], numbers[b, 2]
        if parent < 0:
            w_l, w_a = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
            up = (-weight * gravity[0], -weight * gravity[1], -weight * gravity[2])
            a_l, a_a = back(state, b, up), (0.0, 0.0, 0.0)
        else:
            w_l, w_a = carried(state, b, three(motion, parent, _W), three(motion, parent, _W + 3))
            a_l, a_a = carried(state, b, three(motion, parent, _A), three(motion, parent, _A + 3))
        if kind == BASE:
            v_l, v_a = (v[0], v[1], v[2]), (v[3], v[4], v[5])
            w_l, w_a = (w[0], w[1], w[2]), (w[3], w[4], w[5])
            a_l, a_a = base_acceleration(
                v_l, v_a, w_l, w_a, a_l, (a[0], a[1], a[2]), (a[3], a[4], a[5])
            )
            column = 6
        else:
            w_l, w_a, a_l, a_a = across_joint(
                three(joints, b, AXIS),
                three(joints, b, AXIS + 3),
                three(state, b, TWIST),
                three(state, b, TWIST + 3),
                v[column],
                w[column],
                a[column],
                w_l,
                w_a,
                a_l,
                a_a,
            )
            column += 1
        put(motion, b, _W, w_l, w_a)
        put(motion, b, _A, a_l, a_a)


@njit(cache=True)
def _push(linkage, state, a, motion):
    """Adds to all A_i what the rates a of the velocities do; the bodies' forces are spoilt."""
    joints, numbers, _, _ = linkage
    column = 0
    for b in range(numbers.shape[0]):
        parent = numbers[b, 0]
        a_l, a_a = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if numbers[b, 2] == BASE:
            a_l, a_a = (a[0], a[1], a[2]), (a[3], a[4], a[5])
            column = 6
        else:
            if parent >= 0:
                a_l, a_a = carried(
                    state, b, three(motion, parent, _F), three(motion, parent, _F + 3)
                )
            a_l = add(a_l, scale(a[column], three(joints, b, AXIS)))
            a_a = add(a_a, scale(a[column], three(joints, b, AXIS + 3)))
            column += 1
        put(motion, b, _F, a_l, a_a)
        put(
            motion, b, _A,
            add(three(motion, b, _A), a_l), add(three(motion, b, _A + 3), a_a),
        )  # fmt: skip


@njit(cache=True)
def felt(state, motion, b):
    """a*, α, ω_V and ω_W of a body."""
    omega, turning = three(state, b, TWIST + 3), three(motion, b, _W + 3)
    a = felt_acceleration(
        three(motion, b, _A), three(state, b, TWIST), omega, three(motion, b, _W), turning
    )
    return a, three(motion, b, _A + 3), omega, turning


# -- columns of the regressor ----------------------------------------------------------------------


@njit(cache=True)
def write_power(W, i, k, d, delta, a, alpha, omega, turning):
    """Writes dᵀ f + δᵀ n of one body into W[i, k : k + 10], linear in its parameters."""
    (
        W[i, k], W[i, k + 1], W[i, k + 2], W[i, k + 3], W[i, k + 4],
        W[i, k + 5], W[i, k + 6], W[i, k + 7], W[i, k + 8], W[i, k + 9],
    ) = power(d, delta, a, alpha, omega, turning)  # fmt: skip


@njit(cache=True)
def add_power(W, i, k, d, delta, a, alpha):
    """Adds the same to W[i, k : k + 10] for a body at rest: ω_V = ω_W = 0."""
    h = add(cross(d, alpha), cross(a, delta))
    W[i, k] += dot(d, a)
    W[i, k + 1] += h[0]
    W[i, k + 2] += h[1]
    W[i, k + 3] += h[2]
    W[i, k + 4] += delta[0] * alpha[0]
    W[i, k + 5] += delta[0] * alpha[1] + delta[1] * alpha[0]
    W[i, k + 6] += delta[1] * alpha[1]
    W[i, k + 7] += delta[0] * alpha[2] + delta[2] * alpha[0]
    W[i, k + 8] += delta[1] * alpha[2] + delta[2] * alpha[1]
    W[i, k + 9] += delta[2] * alpha[2]


@njit(cache=True)
def joint_columns(numbers, b):
    """First and last velocity of a body's joint."""
    if numbers[0, 2] == BASE:
        return (0, 5) if b == 0 else (b + 5, b + 5)
    return b, b


# -- from the tips inwards -------------------------------------------------------------------------


@njit(cache=True)
def _load(theta, state, motion):
    """Writes every body's force f_i and inertia under θ."""
    for b in range(motion.shape[0]):
        k = 10 * b
        m, h = theta[k], (theta[k + 1], theta[k + 2], theta[k + 3])
        inertia = (
            theta[k + 4], theta[k + 5], theta[k + 6], theta[k + 7], theta[k + 8], theta[k + 9]
        )  # fmt: skip
        a, alpha, omega, turning = felt(state, motion, b)
        force, torque = wrench(m, h, inertia, a, alpha, omega, turning)
        put(motion, b, _F, force, torque)
        motion[b, _MASS] = m
        for i in range(9):
            motion[b, _H + i] = theta[k + 1 + i]


@njit(cache=True)
def _inertia(motion, b):
    return (
        motion[b, _I], motion[b, _I + 1], motion[b, _I + 2],
        motion[b, _I + 3], motion[b, _I + 4], motion[b, _I + 5],
    )  # fmt: skip


@njit(cache=True)
def _hand_down(state, motion, b, parent):
    """Adds what body b carries, force and inertia, to what its parent carries."""
    R, p, m = nine(state, b), three(state, b, AT), motion[b, _MASS]
    force, torque = parent_wrench(R, p, three(motion, b, _F), three(motion, b, _F + 3))
    h, inertia = parent_inertia(R, p, m, three(motion, b, _H), _inertia(motion, b))
    for i in range(3):
        motion[parent, _F + i] += force[i]
        motion[parent, _F + 3 + i] += torque[i]
        motion[parent, _H + i] += h[i]
    motion[parent, _MASS] += m
    for i in range(6):
        motion[parent, _I + i] += inertia[i]


@njit(cache=True)
def _gather(linkage, state, motion, M, force):
    """Writes M's lower triangle and Σ J_iᵀ f_i, of the links alone."""
    joints, numbers, _, _ = linkage
    for b in range(numbers.shape[0] - 1, -1, -1):
        parent = numbers[b, 0]
        last = joint_columns(numbers, b)[1]
        m, h = motion[b, _MASS], three(motion, b, _H)
        inertia = _inertia(motion, b)
        if numbers[b, 2] == BASE:
            xx, xy, yy, xz, yz, zz = inertia
            for i in range(6):
                force[i] = motion[b, _F + i]
                M[i, i] = m
            M[4, 0], M[5, 0], M[3, 1] = h[2], -h[1], -h[2]
            M[5, 1], M[3, 2], M[4, 2] = h[0], h[1], -h[0]
            M[3, 3], M[4, 3], M[4, 4], M[5, 3], M[5, 4], M[5, 5] = xx, xy, yy, xz, yz, zz
            continue
        s_l, s_a = three(joints, b, AXIS), three(joints, b, AXIS + 3)
        force[last] = dot(s_l, three(motion, b, _F)) + dot(s_a, three(motion, b, _F + 3))
        f, n = axis_wrench(s_l, s_a, m, h, inertia)
        M[last, last] = dot(s_l, f) + dot(s_a, n)
        below, ancestor = b, parent
        while ancestor >= 0:
            f, n = parent_wrench(nine(state, below), three(state, below, AT), f, n)
            column = joint_columns(numbers, ancestor)[1]
            if numbers[ancestor, 2] == BASE:
                M[last, 0], M[last, 1], M[last, 2] = f
                M[last, 3], M[last, 4], M[last, 5] = n
            else:
                M[last, column] = dot(three(joints, ancestor, AXIS), f) + dot(
                    three(joints, ancestor, AXIS + 3), n
                )
            below, ancestor = ancestor, numbers[ancestor, 0]
        if parent >= 0:
            _hand_down(state, motion, b, parent)


@njit(cache=True)
def tree_work(linkage, n):
    """Room for motions of the bodies, M̂ and its Cholesky factor, used again by every stage."""
    return np.empty((linkage[1].shape[0], MOTION)), np.zeros((n, n)), np.zeros((n, n))


@njit(cache=True)
def accelerate(linkage, state, v, w, u, theta, work, a):
    """Writes â of (29) into a; returns M̂'s smallest pivot, > 0 if it succeeded."""
    motion, M, L = work
    rotor, viscous, coulomb, gain = linkage[3]
    first, base = linkage[1].shape[0] - u.shape[0], v.shape[0] - u.shape[0]
    a[:] = 0.0
    move(linkage, state, v, w, a, 1.0, motion)
    _load(theta, state, motion)
    _gather(linkage, state, motion, M, a)
    for k in range(u.shape[0]):
        i = base + k
        friction = theta[viscous + k] * v[i] + theta[coulomb + k] * state[first + k, SLIP]
        a[i] += friction - theta[gain + k] * u[k]
        if rotor < viscous:
            M[i, i] += theta[rotor + k]
    for i in range(v.shape[0]):
        a[i] = -a[i]
    return solve_positive(M, L, a)


@njit(cache=True)
def tree_gradient(linkage, state, v, u, v_hat, theta, work, a, gradient):
    """Writes â of (29) into a and Wᵀ Δv into gradient (1, p); returns M̂'s smallest pivot.

    W itself is not formed: body i's columns of Wᵀ Δv are those of its power on the twist J_i Δv,
    which is W_i − V_i.
    """
    numbers, (rotor, viscous, coulomb, gain) = linkage[1], linkage[3]
    motion = work[0]
    pivot = accelerate(linkage, state, v, v_hat, u, theta, work, a)
    if not pivot > 0.0:
        return pivot
    _push(linkage, state, a, motion)
    for b in range(numbers.shape[0]):
        d = add(three(motion, b, _W), scale(-1.0, three(state, b, TWIST)))
        delta = add(three(motion, b, _W + 3), scale(-1.0, three(state, b, TWIST + 3)))
        a_felt, alpha, omega, turning = felt(state, motion, b)
        write_power(gradient, 0, 10 * b, d, delta, a_felt, alpha, omega, turning)
    first, base = numbers.shape[0] - u.shape[0], v.shape[0] - u.shape[0]
    for k in range(u.shape[0]):
        dv = v_hat[base + k] - v[base + k]
        if rotor < viscous:
            gradient[0, rotor + k] = dv * a[base + k]
        gradient[0, viscous + k] = dv * v[base + k]
        gradient[0, coulomb + k] = dv * state[first + k, SLIP]
        gradient[0, gain + k] = -dv * u[k]
    return pivot


@njit(cache=True)
def tree_torque(linkage, state, v, a, theta, work, torque):
    """Writes M a + C v + g + f, all the motors must make, into torque (n,): inverse dynamics.

    `work` is room for every body's acceleration and force (b, 12). The base, if it floats, gets the
    force that is missing there.
    """
    joints, numbers, gravity, (rotor, viscous, coulomb, _) = linkage
    column = 0
    for b in range(numbers.shape[0]):
        parent = numbers[b, 0]
        v_l, omega = three(state, b, TWIST), three(state, b, TWIST + 3)
        if parent < 0:
            a_l, alpha = back(state, b, (-gravity[0], -gravity[1], -gravity[2])), (0.0, 0.0, 0.0)
        else:
            a_l, alpha = carried(state, b, three(work, parent, 0), three(work, parent, 3))
        if numbers[b, 2] == BASE:
            a_l, alpha = add(a_l, (a[0], a[1], a[2])), (a[3], a[4], a[5])
            column = 6
        else:
            s_l, s_a = three(joints, b, AXIS), three(joints, b, AXIS + 3)
            swung = add(cross(omega, s_l), cross(v_l, s_a))
            a_l = add(a_l, add(scale(a[column], s_l), scale(v[column], swung)))
            alpha = add(
                alpha, add(scale(a[column], s_a), scale(v[column], cross(omega, s_a)))
            )  # fmt: skip
            column += 1
        put(work, b, 0, a_l, alpha)
        k = 10 * b
        h = (theta[k + 1], theta[k + 2], theta[k + 3])
        inertia = (
            theta[k + 4], theta[k + 5], theta[k + 6], theta[k + 7], theta[k + 8], theta[k + 9]
        )  # fmt: skip
        star = add(a_l, cross(omega, v_l))
        turned = add(cross(alpha, h), cross(omega, cross(omega, h)))
        spun = add(symmetric(inertia, alpha), cross(omega, symmetric(inertia, omega)))
        put(work, b, 6, add(scale(theta[k], star), turned), add(cross(h, star), spun))
    for b in range(numbers.shape[0] - 1, -1, -1):
        parent, force, moment = numbers[b, 0], three(work, b, 6), three(work, b, 9)
        last = joint_columns(numbers, b)[1]
        if numbers[b, 2] == BASE:
            for i in range(6):
                torque[i] = work[b, 6 + i]
        else:
            torque[last] = dot(three(joints, b, AXIS), force) + dot(
                three(joints, b, AXIS + 3), moment
            )
        if parent >= 0:
            force = forth(state, b, force)
            moment = add(forth(state, b, moment), cross(three(state, b, AT), force))
            for i in range(3):
                work[parent, 6 + i] += force[i]
                work[parent, 9 + i] += moment[i]
    motors = numbers.shape[0] - (1 if numbers[0, 2] == BASE else 0)
    first, base = numbers.shape[0] - motors, v.shape[0] - motors
    for k in range(motors):
        i = base + k
        torque[i] += theta[viscous + k] * v[i] + theta[coulomb + k] * state[first + k, SLIP]
        if rotor < viscous:
            torque[i] += theta[rotor + k] * a[i]
