"""A motion's information about θ, compiled; also regressors of accelerations, and joint torques.

The information is that of a Kalman filter of (q, v, θ) with exact dynamics, split into a filter of
(q, v) alone and the sensitivity Ψ = ∂x̂/∂θ_⊥ of its estimate (B. Friedland, Treatment of bias in
recursive filtering, IEEE TAC 14, 1969):

    P̄ = F_x P F_xᵀ,    Ψ̄ = F_x Ψ + F_c B S Z,    S_k = P̄ + R,
    J ← J + Ψ̄ᵀ S_k⁻¹ Ψ̄,    Ψ ← R S_k⁻¹ Ψ̄,    P ← R S_k⁻¹ P̄,

where F_x, F_c and B are those of `transition.step` and θ/scale = Z θ_⊥ + const. Workspaces are
those of `arrays.memory_of`.
"""

import numpy as np

from ..numerics.kernels import kernel
from ..numerics.linalg import add_square, cholesky, invert_lower
from .derivatives import linearise
from .forces import ALL, write_forces
from .forward_dynamics import require
from .kinematics import place
from .touching import Touch
from .transition import step

_BLOCK = 16  # samples whose rows enter J together: one product of matrices instead of many


@kernel()
def information_along(structure, work, slopes, theta, scale, basis, R0, R, t, q, v, u, J, root):
    """Adds a motion's information about θ_⊥ to J (d, d); returns whether M and S stayed ≻ 0.

    Args:
        structure: structure of the system.
        work: workspace.
        slopes: workspace.
        theta: (p,) at which the system is linearised.
        scale: (p,) scale of θ.
        basis: (p, d) Z.
        R0: (2n,) variances of the state at the first sample.
        R: (2n,) variances of the noise at all others.
        t: (N,) times [s].
        q: (N, m) positions.
        v: (N, n) velocities.
        u: (N, n_u) commands.
        J: (d, d) information.
        root: whether J holds an upper triangular A with Aᵀ A in its place; see `add_square`.
    """
    n = v.shape[1]
    m = q.shape[1]
    p = scale.shape[0]
    d = basis.shape[1]
    size = 2 * n
    theta = theta.copy()
    scale = scale.copy()
    B = np.empty((n, p))
    at = np.empty(m)
    q1 = np.empty(m)
    v1 = np.empty(n)
    F = np.empty((size, 3 * n))
    touch = Touch(F[:0], v1[:0], F[:0], F[:, :0].copy(), v1[:0], F[:0], F[:0], v1[:0])
    P = np.diag(R0)
    L = np.zeros((size, size))
    inverse = np.zeros((size, size))
    psi = np.zeros((size, d))
    rows = np.zeros((_BLOCK * size, d))
    filled = 0
    for k in range(1, t.shape[0]):
        dt = t[k] - t[k - 1]
        before = (q[k - 1], v[k - 1], u[k - 1])
        pivot = step(
            structure, *before, dt, theta, scale, work, slopes, at, q1, v1, F, B, B[:0], touch
        )
        if not pivot > 0.0:
            return False
        F_x = F[:, :size].copy()
        F_c = F[:, size:].copy()
        psi = np.dot(F_x, psi) + np.dot(F_c, np.dot(B, basis))
        P = np.dot(np.dot(F_x, P), F_x.T)
        S = 0.5 * (P + P.T)
        for i in range(size):
            S[i, i] += R[i]
        if not cholesky(S, L) > 0.0:
            return False
        invert_lower(L, inverse)
        white = np.dot(inverse, psi)
        rows[filled : filled + size] = white
        filled += size
        if filled == rows.shape[0]:
            add_square(rows, J, root)
            filled = 0
        back = inverse.T.copy()
        for i in range(size):
            for j in range(size):
                back[i, j] *= R[i]  # R L⁻ᵀ
        psi = np.dot(back, white)
        P = np.dot(back, np.dot(inverse, P))
    rows[filled:] = 0.0
    add_square(rows, J, root)
    return True


@kernel()
def acceleration_rows(structure, work, slopes, q, v, u, theta, scale, rows):
    """Writes −M⁻¹ W diag(scale) (N, n, p) along a motion; returns whether M ≻ 0."""
    theta = theta.copy()
    scale = scale.copy()
    a = np.empty(v.shape[1])
    none = np.empty((0, v.shape[1]))
    touch = Touch(none, a[:0], none, none.T.copy(), a[:0], none, none, a[:0])
    for k in range(rows.shape[0]):
        at = q[k], v[k], u[k], theta, scale
        if not linearise(structure, *at, work, slopes, a, rows[k], v[k, :0], touch) > 0.0:
            return False
    return True


@kernel()
def torques_along(structure, work, slopes, theta, q, v, a, torque):
    """Writes the joint torques (N, n) of a motion q (N, m), v (N, n), a (N, n) under θ (p,)."""
    still = np.zeros(v.shape[1])
    own = theta.copy()
    for k in range(q.shape[0]):
        place(structure, q[k], v[k], slopes.state)
        write_forces(structure, slopes.state, q[k], v[k], still, ALL, work.scratch, slopes.F)
        require(structure, slopes.state, slopes.F, v[k], a[k], own, work, torque[k])
