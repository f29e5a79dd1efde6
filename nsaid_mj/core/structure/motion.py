"""All along a log that does not depend on θ̂: kinematics, forces, momentum balance.

Any number of identifiers can share a `Motion`. A stage of RK4 computes â of (29) and Wᵀ Δv from it.
"""

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ..numerics.kernels import (
    boolean,
    cube,
    f8,
    helper,
    i8,
    kernel,
    matrix,
    routine,
    vector,
    void,
)
from ..numerics.linalg import copy_into
from ..parameters import Array
from .arrays import AT_V, COUNT, FALL, FRAME, PARENT, RATE, TEN, TWIST, StructureArrays
from .compiled import STRUCTURE, WORKSPACE
from .forces import ALL, COMMANDED, MOVING, forces_inline, write_forces
from .forward_dynamics import accelerate
from .forward_dynamics import stage as structure_stage
from .inertia import add_power, add_weight
from .kinematics import place, place_along
from .poses import half_way
from .spatial import into_body, unrotate

_V = 0  # vectors in the body's axes
_G = 12
_S = 18
_RATE_S = 24


class Outside(NamedTuple):
    """The leading entries of Wᵀ Δv from outside compiled code."""

    # address of a C function of two int64: 0, 1 or 2 for the step's start, middle or end, and the
    # index of the sample at its end; 0 if all entries are the structure's
    address: int
    v_hat: Array  # (n,) v̂ of a stage, input of the function
    a_hat: Array  # (n,) â of a stage, likewise
    leading: Array  # (l,) first entries of Wᵀ Δv, which the function writes


NOTHING_OUTSIDE = Outside(0, *np.empty((3, 0)))


class Motion(NamedTuple):
    """All parts of the RK4 stages along a log of N samples that do not depend on the estimate."""

    structure: StructureArrays  # the robot
    t: Array  # (N,) times [s]
    v: Array  # (N, n) velocities
    vm: Array  # (N−1, n) velocities half-way between samples
    states: Array  # (N, s) states of `structure.kinematics`, at the samples
    middles: Array  # (N−1, s) states half-way between them
    F: Array  # (3, N−1, z) entries of F that can differ from 0, at start, middle and end of a step
    outside: Outside = NOTHING_OUTSIDE  # entries of Wᵀ Δv that are not the structure's


OUTSIDE = types.NamedTuple((i8, vector, vector, vector), Outside)
MOTION = types.NamedTuple((STRUCTURE, vector, *(matrix,) * 4, cube, OUTSIDE), Motion)


def _call(_: Any, address: Any, at: Any, k: Any) -> Any:
    """In compiled code, calls a C function of two int64 at an address."""

    def made(context: Any, builder: Any, _: Any, given: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word, word]).as_pointer()
        builder.call(builder.inttoptr(given[0], kind), given[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), made


call: Any = intrinsic(_call)


@helper(f8(MOTION, i8, i8, vector, vector, WORKSPACE, vector, vector))
def own_stage(motion, at, k, v_hat, theta, work, a_hat, gradient):
    """`stage` of a robot whose Wᵀ Δv is the structure's alone."""
    state = motion.middles[k - 1] if at == 1 else motion.states[k - 1 + at // 2]
    v = motion.vm[k - 1] if at == 1 else motion.v[k - 1 + at // 2]
    F = motion.F[at, k - 1]
    return structure_stage(motion.structure, state, v, F, v_hat, theta, work, a_hat, gradient)


@helper(f8(MOTION, i8, i8, vector, vector, WORKSPACE, vector, vector))
def stage(motion, at, k, v_hat, theta, work, a_hat, gradient):
    """Writes â (n,) of (29) and Wᵀ Δv (p,) at one stage of the step from sample k − 1 to k.

    `at` is 0, 1 or 2 for the step's start, middle or end; C multiplies v_hat (n,), theta (p,) is
    the estimate, `work` is workspace. Returns M̂'s smallest pivot, > 0 on success.
    """
    outside = motion.outside
    pivot = own_stage(motion, at, k, v_hat, theta, work, a_hat, gradient)
    if outside.address != 0 and pivot > 0.0:
        copy_into(v_hat, outside.v_hat)
        copy_into(a_hat, outside.a_hat)
        call(outside.address, at, k)
        copy_into(outside.leading, gradient)
    return pivot


@kernel(void(STRUCTURE, boolean, vector, matrix, matrix, WORKSPACE, matrix, matrix))
def between(structure, hermite, t, q, v, work, qm, vm):
    """Writes positions qm (N−1, m) and velocities vm (N−1, n) half-way between N samples.

    `hermite` selects cubic Hermite interpolation, else the mean of both velocities. t is (N,) [s],
    q (N, m), v (N, n).
    """
    bodies = structure.bodies
    rows = work.rows
    x = work.scratch
    for k in range(t.shape[0] - 1):
        dt = t[k + 1] - t[k]
        half_way(bodies, q[k], v[k], q[k + 1], v[k + 1], dt, hermite, rows, x, qm[k], vm[k])


@kernel(void(STRUCTURE, matrix, matrix, matrix, matrix, matrix, WORKSPACE, matrix, matrix, cube))
def along(structure, q, v, qm, vm, u, work, states, middles, F):
    """Writes states and forces at N samples and half-way between them, commands held in a step.

    Args:
        structure: the robot.
        q: (N, m) positions.
        v: (N, n) velocities.
        qm: (N−1, m) positions half-way.
        vm: (N−1, n) velocities half-way.
        u: (N, n_u) commands.
        work: workspace.
        states: (N, s) at the samples; written.
        middles: (N−1, s) half-way between; written.
        F: (3, N−1, z) entries of F at start, middle and end of every step; written.
    """
    place_along(structure, q, v, states)
    place_along(structure, qm, vm, middles)
    for k in range(qm.shape[0]):
        for at in range(3):  # start, middle and end of the step
            state = middles[k]
            position = qm[k]
            velocity = vm[k]
            if at != 1:
                state = states[k + at // 2]
                position = q[k + at // 2]
                velocity = v[k + at // 2]
            which = MOVING if at > 0 else COMMANDED if k > 0 else ALL
            entries = F[at, k]
            for z in range(entries.shape[0]):  # what is not written below has not changed
                if at > 0:
                    entries[z] = F[0, k, z]
                elif k > 0:
                    entries[z] = F[2, k - 1, z]
            forces_inline(structure, state, position, velocity, u[k], which, work.scratch, entries)


@kernel(
    void(
        STRUCTURE,
        boolean,
        vector,
        matrix,
        matrix,
        matrix,
        WORKSPACE,
        matrix,
        matrix,
        matrix,
        matrix,
        cube,
    )
)
def write_motion(structure, hermite, t, q, v, u, work, qm, vm, states, middles, F):
    """What `between` and `along` write, by one call: a step called from Python waits for it."""
    between(structure, hermite, t, q, v, work, qm, vm)
    along(structure, q, v, qm, vm, u, work, states, middles, F)


@kernel(
    void(
        STRUCTURE, matrix, matrix, matrix, matrix, matrix, vector, vector, WORKSPACE, matrix, vector
    )
)
def accelerate_at(structure, q, v, u, w, theta, state, F, work, a, pivots):
    """Writes â of (29) at N samples into a (N, n), and M̂'s smallest pivots, > 0 on success.

    q (N, m) and v (N, n) are measured, u is (N, n_u), C multiplies w (N, n), theta (N, p) are the
    estimates; state (s,) and F (z,) are workspace.
    """
    for k in range(q.shape[0]):
        place(structure, q[k], v[k], state)
        write_forces(structure, state, q[k], v[k], u[k], ALL, work.scratch, F)
        pivots[k] = accelerate(structure, state, F, w[k], theta[k], work, a[k])


@routine(void(STRUCTURE, vector, vector, f8, vector, matrix, matrix))
def _write_balance(structure, state, v, leak, x, momentum, drive):
    """Writes W_M v, and a W_M v + weight + (the regressor of Cᵀ v), (n, p) each.

    In an inertial frame, row j of a body is S_jᵀ I V, and S_jᵀ I (a V + g) + Ṡ_jᵀ I V; only
    rigid-body parameters have weight.
    """
    bodies = structure.bodies
    entries = structure.entries
    values = structure.values
    rotors = structure.rotors
    axes = bodies.shape[0] * FRAME
    ground = axes + v.shape[0] * FRAME
    for i in range(v.shape[0]):
        for k in range(momentum.shape[1]):
            momentum[i, k] = 0.0
            drive[i, k] = 0.0
    for b in range(bodies.shape[0]):
        frame = b * FRAME
        ancestor = b
        into_body(state, frame, state, frame + TWIST, x, _V)
        unrotate(state, frame, state, ground + FALL, x, _G)
        while ancestor >= 0:
            first = bodies[ancestor, AT_V]
            for j in range(first, first + bodies[ancestor, COUNT]):
                axis = axes + j * FRAME
                into_body(state, frame, state, axis, x, _S)
                into_body(state, frame, state, axis + RATE, x, _RATE_S)
                add_power(bodies, entries, values, b, x, _S, _V, _V, momentum, j)
                add_power(bodies, entries, values, b, x, _RATE_S, _V, _V, drive, j)
                if bodies[b, TEN] >= 0:
                    add_weight(x, _S, _G, drive, j, bodies[b, TEN])
            ancestor = bodies[ancestor, PARENT]
    for r in range(rotors.shape[0]):
        i = rotors[r, 0]
        j = rotors[r, 1]
        k = rotors[r, 2]
        momentum[i, k] += v[j]
        if i != j:
            momentum[j, k] += v[i]
    for i in range(v.shape[0]):
        for k in range(momentum.shape[1]):
            drive[i, k] += leak * momentum[i, k]


@helper(void(STRUCTURE, matrix, vector, matrix))
def _add_forces(structure, drive, F, out):
    """Writes drive + F, (n, p), from the entries of F."""
    nonzeros = structure.nonzeros
    for i in range(drive.shape[0]):
        for k in range(drive.shape[1]):
            out[i, k] = drive[i, k]
    for z in range(nonzeros.shape[0]):
        out[nonzeros[z, 0], nonzeros[z, 1]] += F[z]


@kernel(
    void(
        STRUCTURE,
        f8,
        matrix,
        matrix,
        matrix,
        matrix,
        cube,
        WORKSPACE,
        matrix,
        matrix,
        cube,
        cube,
        cube,
        cube,
    )
)
def balance(
    structure, leak, v, vm, states, middles, F, work, drive, unused, momenta, start, half, end
):
    """Writes the terms of the filtered momentum balance of a motion.

    Args:
        structure: the robot.
        leak: rate a of the filter [1/s].
        v: (N, n) velocities at the samples.
        vm: (N−1, n) velocities half-way between.
        states: states of `along`, as `middles` and `F`.
        middles: (N−1, s).
        F: (3, N−1, z).
        work: workspace.
        drive: (n, p) workspace, as `unused`.
        unused: (n, p).
        momenta: (N, n, p) W_M(q, v) at the samples; written.
        start: (N−1, n, p) a W_M v + F + Cᵀ v at the start of every step; written.
        half: (N−1, n, p) the same half-way; written.
        end: (N−1, n, p) the same at the end; written.
    """
    steps = v.shape[0] - 1
    for k in range(steps + 1):
        _write_balance(structure, states[k], v[k], leak, work.scratch, momenta[k], drive)
        if k > 0:
            _add_forces(structure, drive, F[2, k - 1], end[k - 1])
        if k < steps:
            _add_forces(structure, drive, F[0, k], start[k])
            _write_balance(structure, middles[k], vm[k], leak, work.scratch, unused, drive)
            _add_forces(structure, drive, F[1, k], half[k])
