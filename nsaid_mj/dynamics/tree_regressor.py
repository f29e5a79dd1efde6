"""Regressors of trees of rigid bodies, compiled: W_M, W_C and F of the links, joints and motors.

Row j of a body's columns is the power of the wrench that the body requires on J_i e_j, the twist
that joint j gives it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.triples import add, back, cross, put, scale, three
from .tree import (
    AXIS,
    BASE,
    FRICTION_SPEED,
    MOTION,
    SLIP,
    TWIST,
    accelerate,
    add_power,
    carried,
    felt,
    joint_columns,
    move,
    tree_place,
    tree_room,
    tree_state,
    tree_work,
    write_power,
)


@njit(cache=True)
def _reach(linkage, state, n, rates):
    """(b·n, 6) the columns of J_i, body by body; with `rates`, of dJ_i/dt in an inertial frame."""
    reach = np.empty((linkage[1].shape[0] * n, 6))
    write_reach(linkage, state, n, rates, reach)
    return reach


@njit(cache=True)
def write_reach(linkage, state, n, rates, reach):
    """Writes the columns of J_i, or of dJ_i/dt in an inertial frame, of every body.

    Only the columns of the body's own joint and of its ancestors' are written.

    Args:
        linkage: the tree.
        state: (b, STATE) of `dynamics.tree`.
        n: number of velocities.
        rates: whether to write dJ_i/dt.
        reach: (b·n, 6) row n·i + j is column j of body i; written.
    """
    joints, numbers, _, _ = linkage
    for b in range(numbers.shape[0]):
        first, last = joint_columns(numbers, b)
        v_l, v_a = three(state, b, TWIST), three(state, b, TWIST + 3)
        for j in range(first, last + 1):
            row = b * n + j
            if numbers[b, 2] == BASE:
                for i in range(6):
                    reach[row, i] = 1.0 if i == j else 0.0
            else:
                for i in range(6):
                    reach[row, i] = joints[b, AXIS + i]
            if rates:  # S turns with its body
                s_l, s_a = three(reach, row, 0), three(reach, row, 3)
                put(reach, row, 0, add(cross(v_a, s_l), cross(v_l, s_a)), cross(v_a, s_a))
        parent = numbers[b, 0]
        ancestor = parent
        while ancestor >= 0:
            first, last = joint_columns(numbers, ancestor)
            for j in range(first, last + 1):
                held = parent * n + j
                linear, angular = carried(state, b, three(reach, held, 0), three(reach, held, 3))
                put(reach, b * n + j, 0, linear, angular)
            ancestor = numbers[ancestor, 0]


@njit(cache=True)
def write_links(linkage, state, v, w, a, weight, W):
    """Writes the links' columns of the regressor of M a + C w, plus `weight` times gravity's."""
    numbers, n = linkage[1], v.shape[0]
    motion, J = np.empty((numbers.shape[0], MOTION)), _reach(linkage, state, n, False)
    move(linkage, state, v, w, a, weight, motion)
    for b in range(numbers.shape[0]):
        a_felt, alpha, omega, turning = felt(state, motion, b)
        ancestor = b
        while ancestor >= 0:
            first, last = joint_columns(numbers, ancestor)
            for j in range(first, last + 1):
                row = b * n + j
                d, delta = three(J, row, 0), three(J, row, 3)
                write_power(W, j, 10 * b, d, delta, a_felt, alpha, omega, turning)
            ancestor = numbers[ancestor, 0]


@njit(cache=True)
def write_joints(linkage, v, u, W):
    """Writes the columns of friction and motors of W (n, p), which are −F."""
    joints, _, _, (_, viscous, coulomb, gain) = linkage
    bodies, base, count = joints.shape[0], v.shape[0] - u.shape[0], u.shape[0]
    for k in range(count):
        rate = v[base + k]
        W[base + k, viscous + k] = rate
        W[base + k, coulomb + k] = np.tanh(rate / joints[bodies - count + k, FRICTION_SPEED])
        W[base + k, gain + k] = -u[k]


@njit(cache=True)
def write_rotors(linkage, a, W):
    """Writes the columns of the rotors' inertias, of W (n, p)."""
    rotor, viscous = linkage[3][0], linkage[3][1]
    for k in range(viscous - rotor):
        W[a.shape[0] - (viscous - rotor) + k, rotor + k] = a[a.shape[0] - (viscous - rotor) + k]


@njit(cache=True)
def tree_inertial(linkage, q, v, w, a, p):
    """(n, p) W_M(q, a) + W_C(q, v, w)."""
    W = np.zeros((v.shape[0], p))
    write_links(linkage, tree_state(linkage, q, v), v, w, a, 0.0, W)
    write_rotors(linkage, a, W)
    return W


@njit(cache=True)
def tree_forces(linkage, q, v, u, p):
    """(n, p) F of (4): weight, friction and motors."""
    W, still = np.zeros((v.shape[0], p)), np.zeros(v.shape[0])
    write_links(linkage, tree_state(linkage, q, still), still, still, still, 1.0, W)
    write_joints(linkage, v, u, W)
    return -W


@njit(cache=True)
def tree_regressor(linkage, q, v, w, a, u, p):
    """(n, p) W of (10)."""
    W, state = np.zeros((v.shape[0], p)), tree_state(linkage, q, v)
    write_links(linkage, state, v, w, a, 1.0, W)
    write_rotors(linkage, a, W)
    write_joints(linkage, v, u, W)
    return W


@njit(cache=True)
def tree_transport(linkage, q, v, p):
    """(n, p) regressor of Cᵀ v = Ṁ v − C v: row j is Σ (dJ_ij/dt)ᵀ I_i V_i in an inertial frame."""
    numbers, n = linkage[1], v.shape[0]
    W, state, still = np.zeros((n, p)), tree_state(linkage, q, v), (0.0, 0.0, 0.0)
    J_dot = _reach(linkage, state, n, True)
    for b in range(numbers.shape[0]):
        v_l, v_a, ancestor = three(state, b, TWIST), three(state, b, TWIST + 3), b
        while ancestor >= 0:
            first, last = joint_columns(numbers, ancestor)
            for j in range(first, last + 1):
                row = b * n + j
                d, delta = three(J_dot, row, 0), three(J_dot, row, 3)
                write_power(W, j, 10 * b, d, delta, v_l, v_a, still, still)
            ancestor = numbers[ancestor, 0]
    return W


@njit(cache=True)
def tree_balance(linkage, leak, q, v, u, qm, vm, p):
    """The four arrays of `SecondOrderSystem.momentum_balance`, for a tree.

    Args:
        linkage: the tree.
        leak: rate a of the filter [1/s].
        q: (N, m) positions at the samples.
        v: (N, n) velocities at the samples.
        u: (N, n_u) commands.
        qm: (N−1, m) positions half-way between samples.
        vm: (N−1, n) velocities half-way between samples.
        p: number of parameters.
    """
    samples, n = v.shape
    workspace = np.empty((linkage[1].shape[0] * n, 6)), np.empty((linkage[1].shape[0] * n, 6))
    state, drive, unused = tree_room(linkage), np.zeros((n, p)), np.zeros((n, p))
    momenta, half = np.zeros((samples, n, p)), np.zeros((samples - 1, n, p))
    start, end = np.empty(half.shape), np.empty(half.shape)
    for k in range(samples):
        drive[:] = 0.0
        tree_place(linkage, q[k], v[k], state)
        _write_balance(linkage, leak, state, v[k], workspace, momenta[k], drive)
        if k > 0:
            end[k - 1] = drive
            _write_command(linkage, u[k - 1], end[k - 1])
            tree_place(linkage, qm[k - 1], vm[k - 1], state)
            _write_balance(linkage, leak, state, vm[k - 1], workspace, unused, half[k - 1])
            _write_command(linkage, u[k - 1], half[k - 1])
        if k < samples - 1:
            start[k] = drive
            _write_command(linkage, u[k], start[k])
    return momenta, start, half, end


@njit(cache=True)
def _write_balance(linkage, leak, state, v, workspace, momentum, drive):
    """Adds W_M v to `momentum` and a W_M v + F + (the regressor of Cᵀ v) to `drive`, (n, p) each.

    The motors' columns of F are left out; see `_write_command`.
    """
    _, numbers, gravity, (rotor, viscous, coulomb, _) = linkage
    n, bodies, (J, J_dot) = v.shape[0], numbers.shape[0], workspace
    write_reach(linkage, state, n, False, J)
    write_reach(linkage, state, n, True, J_dot)
    falls = np.empty((bodies, 3))
    for b in range(bodies):
        v_l, v_a, ancestor = three(state, b, TWIST), three(state, b, TWIST + 3), b
        weight = gravity[0], gravity[1], gravity[2]
        if numbers[b, 0] >= 0:
            weight = three(falls, numbers[b, 0], 0)
        weight = back(state, b, weight)
        falls[b, 0], falls[b, 1], falls[b, 2] = weight
        a_l, a_a = add(scale(leak, v_l), weight), scale(leak, v_a)
        while ancestor >= 0:
            first, last = joint_columns(numbers, ancestor)
            for j in range(first, last + 1):
                row = b * n + j
                d, delta = three(J, row, 0), three(J, row, 3)
                add_power(momentum, j, 10 * b, d, delta, v_l, v_a)
                add_power(drive, j, 10 * b, d, delta, a_l, a_a)
                add_power(drive, j, 10 * b, three(J_dot, row, 0), three(J_dot, row, 3), v_l, v_a)
            ancestor = numbers[ancestor, 0]
    joints = coulomb - viscous
    for k in range(joints):
        i = n - joints + k
        drive[i, viscous + k] = -v[i]
        drive[i, coulomb + k] = -state[bodies - joints + k, SLIP]
        if rotor < viscous:
            momentum[i, rotor + k] = v[i]
            drive[i, rotor + k] = leak * v[i]


@njit(cache=True)
def _write_command(linkage, u, F):
    """Writes the motors' columns of F."""
    gain, base = linkage[3][3], F.shape[0] - u.shape[0]
    for k in range(u.shape[0]):
        F[base + k, gain + k] = u[k]


@njit(cache=True)
def tree_mass_tensor(linkage, q, n, p):
    """(n, n, p) with M(q, θ) = tensor · θ."""
    numbers, still = linkage[1], (0.0, 0.0, 0.0)
    tensor = np.zeros((n * n, p))
    J = _reach(linkage, tree_state(linkage, q, np.zeros(n)), n, False)
    for b in range(numbers.shape[0]):
        one = b
        while one >= 0:
            first, last = joint_columns(numbers, one)
            for j in range(first, last + 1):
                d, delta = three(J, b * n + j, 0), three(J, b * n + j, 3)
                other = b
                while other >= 0:
                    low, high = joint_columns(numbers, other)
                    for k in range(low, high + 1):
                        a, alpha = three(J, b * n + k, 0), three(J, b * n + k, 3)
                        write_power(tensor, j * n + k, 10 * b, d, delta, a, alpha, still, still)
                    other = numbers[other, 0]
            one = numbers[one, 0]
    rotor, viscous = linkage[3][0], linkage[3][1]
    for k in range(viscous - rotor):
        i = n - (viscous - rotor) + k
        tensor[i * n + i, rotor + k] = 1.0
    return tensor.reshape(n, n, p)


@njit(cache=True)
def tree_evaluate(linkage, q, v, u, w, theta):
    """â of (29), W of (10, 31) and M̂'s smallest pivot."""
    n = v.shape[0]
    state, a, W = tree_state(linkage, q, v), np.empty(n), np.zeros((n, theta.shape[0]))
    pivot = accelerate(linkage, state, v, w, u, theta, tree_work(linkage, n), a)
    if not pivot > 0.0:
        a[:] = 0.0
    write_links(linkage, state, v, w, a, 1.0, W)
    write_rotors(linkage, a, W)
    write_joints(linkage, v, u, W)
    if not pivot > 0.0:
        a[:] = np.nan
    return a, W, pivot
