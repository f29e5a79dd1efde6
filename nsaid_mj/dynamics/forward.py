"""Forward dynamics v̇ = f(q, v, u, θ) of a structure, for compiled loops.

Kernels of `structure` take no array that is read-only, as parts of compiled tuples may be: these
functions copy parameters, and allocate workspaces. Positions change by tangent steps.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.kernels import kernel
from ..structure.arrays import slopes, workspace
from ..structure.slopes import linearise as write_derivatives
from ..structure.transition import step

_workspace, _slopes = njit(workspace), njit(slopes)


@kernel()
def stage_work(structure, n):
    """Allocates the workspace of a stage."""
    return _workspace(structure.bodies.shape[0], n)


@kernel()
def forward_work(structure, n):
    """Allocates the workspace of `linearise`."""
    bodies, terms = structure.bodies.shape[0], structure.terms.shape[0]
    return stage_work(structure, n), _slopes(bodies, n, terms, structure.nonzeros.shape[0])


@kernel()
def transition_work(structure, n, m, p):
    """Allocates the workspace of `transition`."""
    own, rates, flow = forward_work(structure, n), np.empty((1, n)), np.empty((2 * n, 3 * n))
    return own, np.empty(m), np.empty((n, p)), rates, flow


@kernel()
def linearise(structure, q, v, u, theta, scale, work, a, B):
    """Writes v̇ and its derivatives; those by q and v, (n, 2n), are in the workspace.

    Args:
        structure: the robot.
        q: (m,) position.
        v: (n,) velocity.
        u: (n_u,) command.
        theta: (p,) parameters.
        scale: (p,) their scale.
        work: workspace of `forward_work`.
        a: (n,) v̇ of (29) with C v; written.
        B: (n, p) ∂v̇/∂(θ/scale) = −M⁻¹ W diag(scale); written.

    Returns:
        M's smallest pivot, > 0 if it succeeded.
    """
    stage, slopes = work
    own, size = theta.copy(), scale.copy()
    return write_derivatives(structure, q, v, u, own, size, stage, slopes, a, B, v[:0])


@kernel()
def transition(structure, q, v, u, dt, theta, scale, work, q1, v1):
    """Writes the state after a step with the command held, and its derivatives.

    Args:
        structure: the robot.
        q: (m,) position at the step's start.
        v: (n,) velocity at the step's start.
        u: (n_u,) command.
        dt: the step [s].
        theta: (p,) parameters.
        scale: (p,) their scale.
        work: workspace of `transition_work`.
        q1: (m,) position at the end; written.
        v1: (n,) velocity at the end; written.

    Returns:
        M's smallest pivot, > 0 if it succeeded; (2n, 3n) the derivatives of the end with respect to
        (q, v) at the start and c; and (n, p) those of c with respect to θ/scale: see
        `structure.transition`.
    """
    (stage, slopes), at, B, _, F = work
    own, size = theta.copy(), scale.copy()
    pivot = step(structure, q, v, u, dt, own, size, stage, slopes, at, q1, v1, F, B, B[:0])
    return pivot, F, B
