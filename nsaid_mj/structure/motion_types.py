"""Motions: the parts of RK4's stages that depend on a log alone, and the stages.

A stage computes â of (29) and Wᵀ Δv. Any number of identifiers can share a motion. When a loop is
compiled, the motion's type selects the code: that of a `Structure`, of one whose regressor comes
from outside, or the tensors of any system.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, overload

from ..log import Log, Middle
from ..numerics.kernels import kernel
from ..numerics.linalg import copy_into, solve_positive
from ..parameters import Array
from .arrays import StructureArrays, workspace
from .compiled import FAST
from .stage import stage as structure_stage
from .system import SecondOrderSystem

_workspace = njit(workspace)


@kernel()
def stage_work(structure, n):
    """Allocates the workspace of a stage."""
    return _workspace(structure.bodies.shape[0], n)


class StructureMotion(NamedTuple):
    """The motion of a `Structure` along N samples.

    Attributes:
        structure: the robot.
        t: (N,) times [s].
        v: (N, n) velocities.
        vm: (N−1, n) velocities half-way between samples.
        states: (N, s) states of `structure.kinematics`, at the samples.
        middles: (N−1, s) states half-way between them.
        F: (3, N−1, z) entries of F that can differ from 0, at start, middle and end of every step.
    """

    structure: StructureArrays
    t: Array
    v: Array
    vm: Array
    states: Array
    middles: Array
    F: Array


class RegressorMotion(NamedTuple):
    """The motion of a `Structure` with the leading entries of Wᵀ Δv from outside compiled code.

    Attributes:
        t: (N,) times [s].
        v: (N, n) velocities.
        vm: (N−1, n) velocities half-way between samples.
        own: the structure's motion, for â and all other entries.
        v_hat: (n,) v̂ of a stage, input of the function below.
        a_hat: (n,) â of a stage, likewise.
        leading: (l,) first entries of Wᵀ Δv, which the function writes.
        address: address of a C function of two int64: 0, 1 or 2 for the step's start, middle or
            end, and the index of the sample at its end.
    """

    t: Array
    v: Array
    vm: Array
    own: StructureMotion
    v_hat: Array
    a_hat: Array
    leading: Array
    address: int


class TensorMotion(NamedTuple):
    """The motion of any system along N samples, as the tensors of M, C and F.

    Entry [j] of a tensor (n, n, p) at one instant is W_M(q, e_j) or W_C(q, v, e_j).

    Attributes:
        t: (N,) times [s].
        v: (N, n) velocities.
        vm: (N−1, n) velocities half-way between samples.
        M: (2N−1, n, n, p) at the first sample, half-way to the second, at the second, and so on.
        C: (2N−1, n, n, p) at the same instants.
        F: (3, N−1, n, p) force regressor at start, middle and end of every step.
    """

    t: Array
    v: Array
    vm: Array
    M: Array
    C: Array
    F: Array


# -- motions of a log ----------------------------------------------------------------------------


def force_regressors(system: SecondOrderSystem, log: Log, middle: Middle) -> Array:
    """(3, N−1, n, p) F at start, middle and end of every step, with the step's command held."""
    t, held = log.t, log.u[:-1]
    return np.stack(
        [
            system.forces(t[:-1], log.q[:-1], log.v[:-1], held),
            system.forces(0.5 * (t[:-1] + t[1:]), middle.q, middle.v, held),
            system.forces(t[1:], log.q[1:], log.v[1:], held),
        ]
    )


# -- one stage -----------------------------------------------------------------------------------


def stage_workspace(motion):
    """Allocates the workspace of `stage`."""


def stage(motion, at, k, v_hat, theta, work, a_hat, gradient) -> Any:
    """Writes â (n,) of (29) and Wᵀ Δv (p,) at one stage of the step from sample k − 1 to k.

    `motion` is any of this module's; `at` is 0, 1 or 2 for the step's start, middle or end; C
    multiplies v_hat (n,), theta (p,) is the estimate, `work` is of `stage_workspace`. Returns M̂'s
    smallest pivot, > 0 on success.
    """


@overload(stage_workspace)
def _stage_workspace(motion):
    def structured(motion):
        return stage_work(motion.structure, motion.v.shape[1])

    def tensor(motion):
        n = motion.v.shape[1]
        return np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))

    def outside(motion):
        return stage_work(motion.own.structure, motion.v.shape[1])

    return {StructureMotion: structured, RegressorMotion: outside}.get(
        motion.instance_class, tensor
    )


@overload(stage, jit_options=FAST)
def _stage(motion, at, k, v_hat, theta, work, a_hat, gradient):
    def structured(motion, at, k, v_hat, theta, work, a_hat, gradient):
        return structured_gradient(motion, at, k, v_hat, theta, work, a_hat, gradient)

    def tensor(motion, at, k, v_hat, theta, work, a_hat, gradient):
        v = motion.vm[k - 1] if at == 1 else motion.v[k - 1 + at // 2]
        instant = 2 * (k - 1) + at
        return tensor_gradient(
            motion.M[instant],
            motion.C[instant],
            motion.F[at, k - 1],
            v,
            v_hat,
            theta,
            work,
            a_hat,
            gradient,
        )

    def outside(motion, at, k, v_hat, theta, work, a_hat, gradient):
        return outside_gradient(motion, at, k, v_hat, theta, work, a_hat, gradient)

    return {StructureMotion: structured, RegressorMotion: outside}.get(
        motion.instance_class, tensor
    )


@njit(**FAST)
def structured_gradient(motion, at, k, v_hat, theta, work, a_hat, gradient):
    """A stage of a `StructureMotion`; see `stage`."""
    state = motion.middles[k - 1] if at == 1 else motion.states[k - 1 + at // 2]
    v = motion.vm[k - 1] if at == 1 else motion.v[k - 1 + at // 2]
    F, structure = motion.F[at, k - 1], motion.structure
    return structure_stage(structure, state, v, F, v_hat, theta, work, a_hat, gradient)


def _call(_: Any, address: Any, at: Any, k: Any) -> Any:
    """In compiled code, calls a C function of two int64 at an address."""

    def made(context: Any, builder: Any, _: Any, given: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word, word]).as_pointer()
        builder.call(builder.inttoptr(given[0], kind), given[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), made


call: Any = intrinsic(_call)


@njit(**FAST)
def outside_gradient(motion, at, k, v_hat, theta, work, a_hat, gradient):
    """A stage of a `RegressorMotion`; see `stage`."""
    pivot = structured_gradient(motion.own, at, k, v_hat, theta, work, a_hat, gradient)
    if pivot > 0.0:
        copy_into(v_hat, motion.v_hat)
        copy_into(a_hat, motion.a_hat)
        call(motion.address, at, k)
        copy_into(motion.leading, gradient[: motion.leading.shape[0]])
    return pivot


_ALLOCATING: Any = {"_nrt": True}  # np.dot allocates


@njit(**_ALLOCATING)
def tensor_gradient(M, C, F, v, v_hat, theta, work, a_hat, gradient):
    """Writes â (n,) of (29) and Wᵀ Δv (p,); returns M̂'s smallest pivot, > 0 on success.

    M and C (n, n, p) are tensors with W_M(a) = Σ_j a_j M[j] and W_C(w) = Σ_j w_j C[j]; F is (n, p).
    """
    n, p = F.shape
    M_hat, C_hat, L = work
    M_hat[:] = np.dot(M.reshape(n * n, p), theta).reshape(n, n)  # (8)
    C_hat[:] = np.dot(C.reshape(n * n, p), theta).reshape(n, n)  # (9)
    a_hat[:] = np.dot(F, theta) - np.dot(v_hat, C_hat)
    pivot = solve_positive(M_hat, L, a_hat)  # (29)
    if not pivot > 0.0:
        return pivot
    gradient[:] = 0.0
    for i in range(n):
        dv = v_hat[i] - v[i]  # (37)
        for k in range(p):
            gradient[k] -= dv * F[i, k]
        for j in range(n):
            of_M, of_C = dv * a_hat[j], dv * v_hat[j]
            for k in range(p):
                gradient[k] += of_M * M[j, i, k] + of_C * C[j, i, k]
    return pivot


STAGES = structured_gradient, outside_gradient, tensor_gradient, stage_work
"""Callees of `stage_workspace` and `stage`, for kernels that use them."""
