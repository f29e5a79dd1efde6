"""`tree_gradient` for several identifiers that share a motion: one SIMD lane per identifier.

Bodies, joints and measured state are common to all lanes; w, a, θ and what follows from them have
`LANES` values each, side by side: number i of lane l is x[LANES * i + l]. Every loop over lanes
applies one body's formulas of `tree`; what the lanes have in common is read before it, so that its
body is straight-line code, which LLVM vectorises. Operations and their order are those of `tree`:
each lane gets the bits that its identifier gets alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..numerics.triples import add, dot, nine, scale, three, unrotate
from ..parameters import Array
from .tree import (
    AT,
    AXIS,
    BASE,
    SLIP,
    TWIST,
    across_joint,
    axis_wrench,
    base_acceleration,
    child_twist,
    felt_acceleration,
    joint_columns,
    parent_inertia,
    parent_wrench,
    power,
    wrench,
)

LANES = 32
"""Identifiers in a batch. LLVM vectorises loops over arrays that may overlap only from 16 turns on,
and unrolls the shortest, those of `_solve_positive`, into scalar code up to about 25."""

_W, _A, _F, _MASS, _H, _I, _WIDTH = 0, 6, 12, 18, 19, 22, 28  # numbers of a body in one lane
_ZERO = (0.0, 0.0, 0.0)


class LanesWork(NamedTuple):
    """What the stages of a step work with.

    Attributes:
        bodies: (b, 28 LANES) twists, accelerations, wrenches and inertias.
        M: (n, n, LANES) M̂.
        L: (n, n, LANES) its factor.
        carried: (6 LANES,) wrench on its way to the base.
    """

    bodies: Array
    M: Array
    L: Array
    carried: Array


@njit(cache=True)
def lanes_work(linkage, n):
    """Workspace of `lanes_gradient`."""
    bodies = np.empty((linkage[1].shape[0], _WIDTH * LANES))
    shape = n, n, LANES
    return LanesWork(bodies, np.zeros(shape), np.zeros(shape), np.empty(6 * LANES))


@njit(cache=True)
def _get(row, i, lane):
    """Numbers i … i + 2 of a lane."""
    return row[LANES * i + lane], row[LANES * (i + 1) + lane], row[LANES * (i + 2) + lane]


@njit(cache=True)
def _get_six(row, i, lane):
    a, b, c = _get(row, i, lane)
    return (
        a,
        b,
        c,
        row[LANES * (i + 3) + lane],
        row[LANES * (i + 4) + lane],
        row[LANES * (i + 5) + lane],
    )


@njit(cache=True)
def _put(row, i, lane, one, other):
    """Writes two vectors as numbers i … i + 5 of a lane."""
    row[LANES * i + lane], row[LANES * (i + 1) + lane], row[LANES * (i + 2) + lane] = one
    row[LANES * (i + 3) + lane], row[LANES * (i + 4) + lane], row[LANES * (i + 5) + lane] = other


@njit(cache=True)
def _part(x, i, size):
    """Numbers i … i + size − 1 of all lanes."""
    return x[LANES * i : LANES * (i + size)]


# -- from the base outwards ------------------------------------------------------------------------


@njit(cache=True)
def _carry(R, p, above, i, own, j):
    """Writes the twist at i of a body's parent, as the body sees it, at j of its own."""
    for lane in range(LANES):
        linear, angular = child_twist(R, p, _get(above, i, lane), _get(above, i + 3, lane))
        _put(own, j, lane, linear, angular)


@njit(cache=True)
def _start(own, i, linear):
    for lane in range(LANES):
        _put(own, i, lane, linear, _ZERO)


@njit(cache=True)
def _load(linkage, state, v, w, theta, bodies):
    """Writes W_i, A_i under â = 0, wrench f_i and inertia of all bodies."""
    joints, numbers, gravity, _ = linkage
    column = 0
    for b in range(numbers.shape[0]):
        parent = numbers[b, 0]
        R, own = nine(state, b), bodies[b]
        v_l, v_a = three(state, b, TWIST), three(state, b, TWIST + 3)
        if parent < 0:
            _start(own, _W, _ZERO)
            _start(own, _A, unrotate(R, (-gravity[0], -gravity[1], -gravity[2])))
        else:
            p, above = three(state, b, AT), bodies[parent]
            _carry(R, p, above, _W, own, _W)
            _carry(R, p, above, _A, own, _A)
        if numbers[b, 2] == BASE:
            for lane in range(LANES):
                w_l, w_a = _get(w, 0, lane), _get(w, 3, lane)
                a_l, a_a = base_acceleration(v_l, v_a, w_l, w_a, _get(own, _A, lane), _ZERO, _ZERO)
                _put(own, _W, lane, w_l, w_a)
                _put(own, _A, lane, a_l, a_a)
            column = 6
        else:
            s_l, s_a = three(joints, b, AXIS), three(joints, b, AXIS + 3)
            rate, rates = v[column], _part(w, column, 1)
            for lane in range(LANES):
                w_l, w_a, a_l, a_a = across_joint(
                    s_l,
                    s_a,
                    v_l,
                    v_a,
                    rate,
                    rates[lane],
                    0.0,
                    _get(own, _W, lane),
                    _get(own, _W + 3, lane),
                    _get(own, _A, lane),
                    _get(own, _A + 3, lane),
                )
                _put(own, _W, lane, w_l, w_a)
                _put(own, _A, lane, a_l, a_a)
            column += 1
        parameters = _part(theta, 10 * b, 10)
        for lane in range(LANES):
            m, h = parameters[lane], _get(parameters, 1, lane)
            a = felt_acceleration(
                _get(own, _A, lane), v_l, v_a, _get(own, _W, lane), _get(own, _W + 3, lane)
            )
            force, torque = wrench(
                m,
                h,
                _get_six(parameters, 4, lane),
                a,
                _get(own, _A + 3, lane),
                v_a,
                _get(own, _W + 3, lane),
            )
            _put(own, _F, lane, force, torque)
        own[LANES * _MASS :] = parameters


@njit(cache=True)
def _power(linkage, state, a, bodies, gradient):
    """Adds to all A_i what â does, and writes the bodies' parts of Wᵀ Δv; overwrites wrenches."""
    joints, numbers, _, _ = linkage
    column = 0
    for b in range(numbers.shape[0]):
        parent, own = numbers[b, 0], bodies[b]
        if numbers[b, 2] == BASE:
            own[LANES * _F : LANES * (_F + 6)] = a[: 6 * LANES]
            column = 6
        else:
            if parent < 0:
                _start(own, _F, _ZERO)
            else:
                _carry(nine(state, b), three(state, b, AT), bodies[parent], _F, own, _F)
            s_l, s_a = three(joints, b, AXIS), three(joints, b, AXIS + 3)
            rates = _part(a, column, 1)
            for lane in range(LANES):
                a_l = add(_get(own, _F, lane), scale(rates[lane], s_l))
                a_a = add(_get(own, _F + 3, lane), scale(rates[lane], s_a))
                _put(own, _F, lane, a_l, a_a)
            column += 1
        v_l, v_a = three(state, b, TWIST), three(state, b, TWIST + 3)
        minus_l, minus_a = scale(-1.0, v_l), scale(-1.0, v_a)
        columns = _part(gradient, 10 * b, 10)
        for lane in range(LANES):
            w_l, w_a = _get(own, _W, lane), _get(own, _W + 3, lane)
            a_l = add(_get(own, _A, lane), _get(own, _F, lane))
            a_a = add(_get(own, _A + 3, lane), _get(own, _F + 3, lane))
            d, delta = add(w_l, minus_l), add(w_a, minus_a)
            found = power(d, delta, felt_acceleration(a_l, v_l, v_a, w_l, w_a), a_a, v_a, w_a)
            columns[LANES * 0 + lane] = found[0]
            columns[LANES * 1 + lane] = found[1]
            columns[LANES * 2 + lane] = found[2]
            columns[LANES * 3 + lane] = found[3]
            columns[LANES * 4 + lane] = found[4]
            columns[LANES * 5 + lane] = found[5]
            columns[LANES * 6 + lane] = found[6]
            columns[LANES * 7 + lane] = found[7]
            columns[LANES * 8 + lane] = found[8]
            columns[LANES * 9 + lane] = found[9]


# -- from the tips inwards -------------------------------------------------------------------------


@njit(cache=True)
def _hand_down(R, p, own, above):
    """Adds what a body carries, wrench and inertia, to what its parent carries."""
    for lane in range(LANES):
        force, torque = parent_wrench(R, p, _get(own, _F, lane), _get(own, _F + 3, lane))
        _put(
            above,
            _F,
            lane,
            add(_get(above, _F, lane), force),
            add(_get(above, _F + 3, lane), torque),
        )
    for lane in range(LANES):
        m = own[LANES * _MASS + lane]
        h, inertia = parent_inertia(R, p, m, _get(own, _H, lane), _get_six(own, _I, lane))
        above[LANES * _MASS + lane] += m
        above[LANES * _H + lane] += h[0]
        above[LANES * (_H + 1) + lane] += h[1]
        above[LANES * (_H + 2) + lane] += h[2]
        above[LANES * (_I + 0) + lane] += inertia[0]
        above[LANES * (_I + 1) + lane] += inertia[1]
        above[LANES * (_I + 2) + lane] += inertia[2]
        above[LANES * (_I + 3) + lane] += inertia[3]
        above[LANES * (_I + 4) + lane] += inertia[4]
        above[LANES * (_I + 5) + lane] += inertia[5]


@njit(cache=True)
def _write_base(own, M, force):
    """Writes the base's rows of M's lower triangle, and of the forces."""
    force[: 6 * LANES] = own[LANES * _F : LANES * (_F + 6)]
    for lane in range(LANES):
        m, h = own[LANES * _MASS + lane], _get(own, _H, lane)
        M[0, 0, lane] = M[1, 1, lane] = M[2, 2, lane] = m
        M[4, 0, lane], M[5, 0, lane], M[3, 1, lane] = h[2], -h[1], -h[2]
        M[5, 1, lane], M[3, 2, lane], M[4, 2, lane] = h[0], h[1], -h[0]
        (
            M[3, 3, lane],
            M[4, 3, lane],
            M[4, 4, lane],
            M[5, 3, lane],
            M[5, 4, lane],
            M[5, 5, lane],
        ) = _get_six(own, _I, lane)


@njit(cache=True)
def _gather(linkage, state, work, force):
    """Writes M's lower triangle and Σ J_iᵀ f_i, of the links alone."""
    joints, numbers, _, _ = linkage
    bodies, M, _, carried = work
    for b in range(numbers.shape[0] - 1, -1, -1):
        parent, own = numbers[b, 0], bodies[b]
        if numbers[b, 2] == BASE:
            _write_base(own, M, force)
            continue
        last = joint_columns(numbers, b)[1]
        s_l, s_a = three(joints, b, AXIS), three(joints, b, AXIS + 3)
        total, entry = _part(force, last, 1), M[last, last]
        for lane in range(LANES):
            total[lane] = dot(s_l, _get(own, _F, lane)) + dot(s_a, _get(own, _F + 3, lane))
            f, n = axis_wrench(
                s_l, s_a, own[LANES * _MASS + lane], _get(own, _H, lane), _get_six(own, _I, lane)
            )
            entry[lane] = dot(s_l, f) + dot(s_a, n)
            _put(carried, 0, lane, f, n)
        below, ancestor = b, parent
        while ancestor >= 0:
            R, p = nine(state, below), three(state, below, AT)
            s_l, s_a = three(joints, ancestor, AXIS), three(joints, ancestor, AXIS + 3)
            entry = M[last, joint_columns(numbers, ancestor)[1]]
            for lane in range(LANES):
                f, n = parent_wrench(R, p, _get(carried, 0, lane), _get(carried, 3, lane))
                _put(carried, 0, lane, f, n)
                entry[lane] = dot(s_l, f) + dot(s_a, n)
            if numbers[ancestor, 2] == BASE:
                for i in range(6):
                    M[last, i] = _part(carried, i, 1)
            below, ancestor = ancestor, numbers[ancestor, 0]
        if parent >= 0:
            _hand_down(nine(state, b), three(state, b, AT), own, bodies[parent])


# -- one stage -------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def _solve_positive(M, L, x, pivots):
    """Overwrites b in x by M⁻¹ b and writes the smallest pivots (LANES,); see `solve_positive`."""
    n = M.shape[0]
    pivots[:] = np.inf
    for i in range(n):
        pivot, y = M[i, i], _part(x, i, 1)
        for j in range(i):
            z, up, low, d = _part(x, j, 1), L[j, i], L[i, j], L[j, j]
            up[:] = M[i, j]
            for k in range(j):
                one, other = L[k, i], L[j, k]
                for lane in range(LANES):
                    up[lane] -= one[lane] * other[lane]
            for lane in range(LANES):
                share = up[lane] * d[lane]
                low[lane] = share
                pivot[lane] -= up[lane] * share
                y[lane] -= share * z[lane]
        for lane in range(LANES):
            if not pivot[lane] > 0.0:
                pivots[lane] = pivot[lane]
                return pivot[lane]
        d = L[i, i]
        for lane in range(LANES):
            pivots[lane] = min(pivots[lane], pivot[lane])
            d[lane] = 1.0 / pivot[lane]
    for i in range(n - 1, -1, -1):
        y = _part(x, i, 1)
        for lane in range(LANES):
            y[lane] *= L[i, i, lane]
        for k in range(i + 1, n):
            z = _part(x, k, 1)
            one = L[k, i]
            for lane in range(LANES):
                y[lane] -= one[lane] * z[lane]
    return pivots.min()


@njit(cache=True)
def lanes_gradient(linkage, state, v, u, v_hat, theta, work, a, gradient, pivots):
    """Writes â of (29) and Wᵀ Δv of every lane; returns the smallest pivot of all their M̂.

    Args:
        linkage: of the tree.
        state: (b, ·) of `tree_place`.
        v: (n,) measured velocities.
        u: (n_u,) commands.
        v_hat: (LANES n,) w of every lane.
        theta: (LANES p,).
        work: of `lanes_work`.
        a: (LANES n,) written.
        gradient: (LANES p,) written.
        pivots: (LANES,) written: M̂'s smallest pivots.
    """
    rotor, viscous, coulomb, gain = linkage[3]
    joints, n = u.shape[0], v.shape[0]
    first, base = linkage[1].shape[0] - joints, n - joints
    _load(linkage, state, v, v_hat, theta, work.bodies)
    _gather(linkage, state, work, a)
    for k in range(joints):
        i = base + k
        rate, slip, command = v[i], state[first + k, SLIP], u[k]
        drag, dry = _part(theta, viscous + k, 1), _part(theta, coulomb + k, 1)
        gains, total = _part(theta, gain + k, 1), _part(a, i, 1)
        for lane in range(LANES):
            total[lane] += drag[lane] * rate + dry[lane] * slip - gains[lane] * command
    for k in range(viscous - rotor):
        entry, inertias = work.M[base + k, base + k], _part(theta, rotor + k, 1)
        for lane in range(LANES):
            entry[lane] += inertias[lane]
    for i in range(a.shape[0]):
        a[i] = -a[i]
    pivot = _solve_positive(work.M, work.L, a, pivots)
    if not pivot > 0.0:
        return pivot
    _power(linkage, state, a, work.bodies, gradient)
    for k in range(joints):
        i = base + k
        rate, slip, command = v[i], state[first + k, SLIP], u[k]
        w = _part(v_hat, i, 1)
        drag, dry = _part(gradient, viscous + k, 1), _part(gradient, coulomb + k, 1)
        gains = _part(gradient, gain + k, 1)
        for lane in range(LANES):
            dv = w[lane] - rate
            drag[lane], dry[lane], gains[lane] = dv * rate, dv * slip, -dv * command
    for k in range(viscous - rotor):
        i = base + k
        inertias, w, own = _part(gradient, rotor + k, 1), _part(v_hat, i, 1), _part(a, i, 1)
        for lane in range(LANES):
            inertias[lane] = (w[lane] - v[i]) * own[lane]
    return pivot
