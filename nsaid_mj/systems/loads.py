"""Compiled regressors of trees of bodies with general 6×6 inertias; see `dynamics.loaded`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from ..dynamics.forward import (
    STEP,
    difference_into,
    forward_work,
    group_of,
    integrate_into,
    linearise,
    tree_difference,
    tree_integrate,
    write_acceleration,
)
from ..dynamics.loaded import MOTION, accelerate, add_accelerations, loaded_workspace, write_twists
from ..dynamics.structures import LoadedTree
from ..dynamics.tree import SLIP, STATE, TWIST, tree_place
from ..dynamics.tree_regressor import write_reach
from ..numerics.linalg import solve_many
from ..numerics.spatial import bracket


class Carrier(NamedTuple):
    """A tree of bodies with general 6×6 inertias and further forces, for `dynamics.forward`.

    Attributes:
        loaded: the tree.
        forces: the further forces, whose type selects the code of `carried_forces`.
    """

    loaded: LoadedTree
    forces: Any


def carried_forces(forces, linkage, states, u) -> Any:
    """(N, n, k) the last k columns of F at N states (N, b, STATE) and commands u (N, ·)."""


def carried_force_law(kind: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Makes a compiled function the `carried_forces` of forces of a kind, a NamedTuple."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        def chosen(forces, linkage, states, u):
            return function.py_func if forces.instance_class is kind else None

        overload(carried_forces)(chosen)
        return function

    return register


@njit(cache=True)
def applied_along(carrier, states, u):
    """(N, n, k) the last k columns of F at N states (N, b, STATE) and commands u (N, n_u)."""
    linkage = carrier.loaded.linkage
    return carried_forces(carrier.forces, linkage, states, u[:, linkage[1].shape[0] - 1 :])


@njit(cache=True)
def states_of(linkage, q, v):
    """(N, b, STATE) states of `dynamics.tree` at N samples q (N, m), v (N, n)."""
    states = np.empty((v.shape[0], linkage[1].shape[0], STATE))
    for k in range(v.shape[0]):
        tree_place(linkage, q[k], v[k], states[k])
    return states


@njit(cache=True)
def _reach(linkage, state, n, rates):
    """(b, 6, n) J_i, or with `rates` dJ_i/dt in an inertial frame."""
    bodies = linkage[1].shape[0]
    rows = np.zeros((bodies * n, 6))
    write_reach(linkage, state, n, rates, rows)
    return np.ascontiguousarray(rows.reshape(bodies, n, 6).transpose(0, 2, 1))


@njit(cache=True)
def _add(loaded, reach, x, W):
    """Adds the regressor of Σ J_iᵀ I_i x_i to W (p, n), transposed so that memory is contiguous.

    x (b, 2, 6) has two twists per body: [:, 0] multiplies inertias without weight, [:, 1] those
    with weight.
    """
    _, places, parameters, values = loaded
    n = reach.shape[2]
    for e in range(places.shape[0]):
        at, k = places[e], parameters[e]
        b, weighs, i, j = at // 72, at // 36 % 2, at // 6 % 6, at % 6
        push = values[e] * x[b, weighs, j]
        for row in range(n):
            W[k, row] += push * reach[b, i, row]


@njit(cache=True)
def _for_both_kinds(twists):
    """(b, 2, 6) twists (b, 6), the same for inertias without and with weight."""
    x = np.empty((twists.shape[0], 2, 6))
    x[:, 0], x[:, 1] = twists, twists
    return x


@njit(cache=True)
def inertial(loaded, state, v, w, a, p):
    """(n, p) W_M(q, a) + W_C(q, v, w)."""
    linkage, n = loaded[0], v.shape[0]
    rotor, viscous = linkage[3][:2]
    W, motion = np.zeros((p, n)), np.empty((state.shape[0], MOTION))
    write_twists(linkage, state, v, w, motion)
    add_accelerations(linkage, state, a, motion)
    reach = _reach(linkage, state, n, False)
    _add(loaded, reach, _for_both_kinds(motion[:, 6:12]), W)
    for b in range(state.shape[0]):
        for j in range(n):
            reach[b, :, j] = -bracket(6, motion[b, :6], reach[b, :, j])
    _add(loaded, reach, _for_both_kinds(state[:, TWIST : TWIST + 6]), W)
    for k in range(viscous - rotor):
        W[rotor + k, 6 + k] = a[6 + k]
    return np.ascontiguousarray(W.T)


@njit(cache=True)
def transport(loaded, state, n, p):
    """(n, p) regressor of C(x)ᵀ v = Ṁ v − C v = Σ (dJ_i/dt)ᵀ I_i V_i in an inertial frame."""
    W = np.zeros((p, n))
    reach = _reach(loaded[0], state, n, True)
    _add(loaded, reach, _for_both_kinds(state[:, TWIST : TWIST + 6]), W)
    return np.ascontiguousarray(W.T)


@njit(cache=True)
def mass_tensor(loaded, state, n, p):
    """(n, n, p) with M(q, θ) = tensor · θ."""
    rotor, viscous = loaded[0][3][:2]
    tensor, reach = np.empty((n, n, p)), _reach(loaded[0], state, n, False)
    for j in range(n):
        W = np.zeros((p, n))
        _add(loaded, reach, _for_both_kinds(reach[:, :, j]), W)
        tensor[j] = W.T
    for k in range(viscous - rotor):
        tensor[6 + k, 6 + k, rotor + k] = 1.0
    return tensor


@njit(cache=True)
def _gravity_in_bodies(linkage, state):
    """(b, 3) gravity in the bodies' axes [m/s²]."""
    _, numbers, gravity, _ = linkage
    falls = np.empty((state.shape[0], 3))
    for b in range(state.shape[0]):
        above = gravity if b == 0 else falls[numbers[b, 0]]
        falls[b] = np.dot(above, state[b, :9].reshape(3, 3))
    return falls


@njit(cache=True)
def _add_joints(linkage, state, v, u, F):
    """Writes the columns of friction and motors into F (n, p)."""
    _, viscous, coulomb, gain = linkage[3]
    for k in range(v.shape[0] - 6):
        F[6 + k, viscous + k] = -v[6 + k]
        F[6 + k, coulomb + k] = -state[1 + k, SLIP]
        F[6 + k, gain + k] = u[k]


@njit(cache=True)
def forces_along_states(loaded, states, v, u, p):
    """(N, n, p) F's columns of weight, friction and motors at N samples; the others are 0."""
    samples, n = v.shape
    F, x = np.empty((samples, n, p)), np.zeros((states.shape[1], 2, 6))
    for s in range(samples):
        W = np.zeros((p, n))
        x[:, 1, :3] = _gravity_in_bodies(loaded[0], states[s])
        _add(loaded, _reach(loaded[0], states[s], n, False), x, W)
        F[s] = W.T
        _add_joints(loaded[0], states[s], v[s], u[s], F[s])
    return F


@njit(cache=True)
def evaluate(loaded, state, v, u, F, w, theta):
    """â (n,) of (29), W (n, p) of (10, 31) and M̂'s smallest pivot; â is NaN if M̂ is not ≻ 0.

    Args:
        loaded: the tree.
        state: (b, STATE) of `dynamics.tree`.
        v: (n,) velocity.
        u: (n_u,) command.
        F: (n, p) force regressor of (4), all columns.
        w: (n,) velocity that C multiplies.
        theta: (p,) estimate.
    """
    n, p = F.shape
    joints_end = loaded[0][3][3] + n - 6
    rest, a = np.ascontiguousarray(F[:, joints_end:]), np.empty(n)
    pivot = accelerate(loaded, state, v, u, rest, w, theta, loaded_workspace(loaded, n), a)
    if not pivot > 0.0:
        a[:] = 0.0
    W = inertial(loaded, state, v, w, a, p) - F
    if not pivot > 0.0:
        a[:] = np.nan
    return a, W, pivot


@njit(cache=True)
def balance(loaded, leak, states, middles, v, vm, u, p):
    """The four arrays of `SecondOrderSystem.momentum_balance`, without fluid and thrusters.

    Args:
        loaded: the tree.
        leak: rate a of the filter [1/s].
        states: (N, b, STATE) at the samples.
        middles: (N−1, b, STATE) half-way between samples.
        v: (N, n) velocities at the samples.
        vm: (N−1, n) velocities half-way between samples.
        u: (N−1, n_u) commands of the steps.
        p: number of parameters.
    """
    samples, n = v.shape
    momenta, half = np.zeros((samples, n, p)), np.zeros((samples - 1, n, p))
    start, end = np.zeros(half.shape), np.zeros(half.shape)
    carried = loaded[0][3][1]  # number of inertial parameters: bodies and rotors precede friction
    momentum, drive = np.empty((carried, n)), np.empty((carried, n))
    for k in range(samples):
        _write_balance(loaded, leak, states[k], v[k], momentum, drive)
        momenta[k, :, :carried] = momentum.T
        for F, at in ((end, k - 1), (start, k)):
            if 0 <= at < samples - 1:
                F[at, :, :carried] = drive.T
                _add_joints(loaded[0], states[k], v[k], u[at], F[at])
        if k < samples - 1:
            _write_balance(loaded, leak, middles[k], vm[k], momentum, drive)
            half[k, :, :carried] = drive.T
            _add_joints(loaded[0], middles[k], vm[k], u[k], half[k])
    return momenta, start, half, end


@njit(cache=True)
def _write_balance(loaded, leak, state, v, momentum, drive):
    """Writes W_M v and a W_M v + weight + (the regressor of Cᵀ v), transposed, (p, n) each."""
    linkage, places, parameters, values = loaded
    n = v.shape[0]
    rotor, viscous = linkage[3][:2]
    J, J_dot = _reach(linkage, state, n, False), _reach(linkage, state, n, True)
    x = _for_both_kinds(state[:, TWIST : TWIST + 6])
    y = leak * x
    y[:, 1, :3] += _gravity_in_bodies(linkage, state)
    momentum[:], drive[:] = 0.0, 0.0
    for e in range(places.shape[0]):
        at, k = places[e], parameters[e]
        b, weighs, i, j = at // 72, at // 36 % 2, at // 6 % 6, at % 6
        own, push = values[e] * x[b, 0, j], values[e] * y[b, weighs, j]
        for row in range(n):
            momentum[k, row] += own * J[b, i, row]
            drive[k, row] += push * J[b, i, row] + own * J_dot[b, i, row]
    for k in range(viscous - rotor):
        momentum[rotor + k, 6 + k] = v[6 + k]
        drive[rotor + k, 6 + k] = leak * v[6 + k]


@njit(cache=True)
def _carrier_acceleration(carrier, q, v, u, theta, work, a):
    loaded, forces = carrier
    states, stage = work[:2]
    tree_place(loaded.linkage, q, v, states[0])
    thrusters = u[loaded.linkage[1].shape[0] - 1 :].reshape(1, -1)
    work[2][:] = carried_forces(forces, loaded.linkage, states, thrusters)[0]
    return accelerate(loaded, states[0], v, u, work[2], v, theta, stage, a)


@njit(cache=True)
def _linearise_carrier(carrier, q, v, u, theta, scale, work, a, A, B):
    loaded, linkage = carrier.loaded, carrier.loaded.linkage
    states, stage, rest, moved, step, other = work
    n, p = v.shape[0], theta.shape[0]
    pivot = _carrier_acceleration(carrier, q, v, u, theta, work, a)
    if not pivot > 0.0:
        return pivot
    F = forces_along_states(loaded, states, v.reshape(1, n), u.reshape(1, -1), p)
    for k in range(rest.shape[1]):
        for i in range(n):
            F[0, i, p - rest.shape[1] + k] = rest[i, k]
    W = inertial(loaded, states[0], v, v, a, p)
    for i in range(n):
        for k in range(p):
            B[i, k] = (F[0, i, k] - W[i, k]) * scale[k]
    solve_many(stage[4], B)
    step[:] = 0.0
    for j in range(2 * n):
        i = j % n
        step[i] = STEP if j < n else STEP * (1.0 + abs(v[i]))
        if j < n:
            tree_integrate(linkage, q, step, moved)
            _carrier_acceleration(carrier, moved, v, u, theta, work, other)
        else:
            _carrier_acceleration(carrier, q, v + step, u, theta, work, other)
        for r in range(n):
            A[r, j] = (other[r] - a[r]) / step[i]
        step[i] = 0.0
    return pivot


@overload(forward_work)
def _work(structure, n, p):
    def carrier(structure, n, p):
        bodies = structure.loaded.linkage[1].shape[0]
        return (
            np.empty((1, bodies, STATE)),
            loaded_workspace(structure.loaded, n),
            np.empty((n, p - structure.loaded.linkage[3][3] - n + 6)),
            np.empty(n + 1),
            np.zeros(n),
            np.empty(n),
        )

    return carrier if structure.instance_class is Carrier else None


@overload(write_acceleration)
def _write_acceleration(structure, q, v, u, theta, work, a):
    def carrier(structure, q, v, u, theta, work, a):
        return _carrier_acceleration(structure, q, v, u, theta, work, a)

    return carrier if structure.instance_class is Carrier else None


@overload(linearise)
def _linearise(structure, q, v, u, theta, scale, work, a, A, B):
    def carrier(structure, q, v, u, theta, scale, work, a, A, B):
        return _linearise_carrier(structure, q, v, u, theta, scale, work, a, A, B)

    return carrier if structure.instance_class is Carrier else None


@overload(group_of)
def _group_of(structure):
    def carrier(structure):
        return 6

    return carrier if structure.instance_class is Carrier else None


@overload(integrate_into)
def _integrate_into(structure, q, step, out):
    def carrier(structure, q, step, out):
        tree_integrate(structure.loaded.linkage, q, step, out)

    return carrier if structure.instance_class is Carrier else None


@overload(difference_into)
def _difference_into(structure, q0, q1, out):
    def carrier(structure, q0, q1, out):
        tree_difference(structure.loaded.linkage, q0, q1, out)

    return carrier if structure.instance_class is Carrier else None
