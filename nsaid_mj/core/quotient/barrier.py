"""The barrier of the cone of physical parameters, and its metric.

b = −Σ log det P(φ_i) − Σ log det M − Σ log θ_j grows without bound towards the boundary, and
b(sθ) = b(θ) − ν log s, so that ∇b·θ = −ν and ∇²b θ = −∇b.
"""

import numpy as np

from ..numerics.kernels import kernel, matrix, vector, void
from ..parameters import Array
from .cone import (
    CONE,
    Cone,
    compiled,
    factor_in_place,
    factor_into,
    height_of,
    inverse_into,
    solve_in_place,
)


def barrier(cone: Cone, theta: Array) -> float:
    """b(θ) at θ (p,); infinite outside the cone."""
    return height_of(cone, np.array(theta, dtype=np.float64))


@kernel(void(CONE, matrix, vector))
def _barriers(cone, thetas, found):
    for k in range(thetas.shape[0]):
        found[k] = height_of(cone, thetas[k])


def barriers(cone: Cone, thetas: Array) -> Array:
    """(N,) b at N points θ (N, p)."""
    found = np.empty(len(thetas))
    _barriers(cone, np.array(thetas, dtype=np.float64), found)
    return found


@kernel(void(CONE, vector, matrix, vector, vector), _nrt=True)
def _gaps(cone, theta, thetas, gradient, found):
    own = height_of(cone, theta)
    nothing = np.empty((0, 0))
    for k in range(thetas.shape[0]):
        estimate = thetas[k]
        _differentiate(cone, estimate, gradient, nothing)
        found[k] = own - height_of(cone, estimate)
        for i in range(theta.shape[0]):
            found[k] -= gradient[i] * (theta[i] - estimate[i])


def gaps(cone: Cone, theta: Array, thetas: Array) -> Array:
    """(N,) Bregman divergences b(θ) − b(θ̂) − ∇b(θ̂)·(θ − θ̂) of N points θ̂ (N, p) from θ (p,)."""
    found = np.empty(len(thetas))
    points = np.array(thetas, dtype=np.float64)
    _gaps(cone, np.array(theta, dtype=np.float64), points, np.zeros(len(theta)), found)
    return found


@compiled
def hessian_into(entries, weights, start, S, hessian, c):
    """Writes the lower triangle of a block's part tr(P⁻¹E_l P⁻¹E_m) of ∇²b, from S = P⁻¹ (k, k).

    The block has c parameters in θ from `start` on, rows [i, j, l] in entries (e, 3), weights (e,).
    hessian is (c, c) or larger.
    """
    for i in range(c):
        for j in range(c):
            hessian[i, j] = 0.0
    for e in range(entries.shape[0]):
        a = entries[e, 0]
        b = entries[e, 1]
        row = entries[e, 2] - start
        for f in range(entries.shape[0]):
            i = entries[f, 0]
            j = entries[f, 1]
            column = entries[f, 2] - start
            if column > row:
                break
            weight = 0.5 * weights[e] * weights[f]
            hessian[row, column] += weight * (S[a, i] * S[b, j] + S[a, j] * S[b, i])


@kernel(void(CONE, vector, vector, matrix), _nrt=True)
def _differentiate(cone, theta, gradient, hessian):
    """Writes ∇b, and ∇²b if `hessian` is (p, p) and not (0, 0), into zeros."""
    k = 0
    whole = hessian.shape[0] > 0
    for j in cone.positive:
        own = 1 / theta[j] if theta[j] > 0 else np.nan
        gradient[j] = -own
        if whole:
            hessian[j, j] = own * own
    for block in range(cone.blocks.shape[0]):
        k = max(k, cone.blocks[block, 2])
    L = np.empty((k, k))
    S = np.empty((k, k))
    for block in range(cone.blocks.shape[0]):
        row = cone.blocks[block]
        start = row[0]
        c = row[1] - row[0]
        first = row[3]
        last = row[4]
        factor_into(cone, block, theta, L)
        inverse_into(L, L, S, row[2])
        entries = cone.entries[first:last]
        weights = cone.weights[first:last]
        gradient[start : row[1]] = 0.0
        for e in range(last - first):
            gradient[entries[e, 2]] -= weights[e] * S[entries[e, 0], entries[e, 1]]
        if whole:
            part = hessian[start : row[1], start : row[1]]
            hessian_into(entries, weights, start, S, part, c)
            for i in range(c):
                for j in range(i):
                    part[j, i] = part[i, j]


def gradient_and_hessian(cone: Cone, theta: Array) -> tuple[Array, Array]:
    """∇b (p,) and the block-diagonal ∇²b (p, p) at θ (p,); NaN outside the cone.

    Their entries are −tr(P⁻¹E_l) and tr(P⁻¹E_l P⁻¹E_m).
    """
    gradient = np.zeros(len(theta))
    hessian = np.zeros((len(theta), len(theta)))
    _differentiate(cone, np.array(theta, dtype=np.float64), gradient, hessian)
    return gradient, hessian


def local_norm(cone: Cone, theta: Array, step: Array) -> float:
    """Length (dᵀ ∇²b(θ) d)^½ of a step d (p,) at θ (p,); a step shorter than 1 stays inside.

    NaN outside the cone.
    """
    return float(np.sqrt(step @ gradient_and_hessian(cone, theta)[1] @ step))


@compiled
def metric_solve(cone, theta, stiffness, mu, gradient):
    """(p,) (Γ⁻¹ + μ ∇²b(θ))⁻¹ times a gradient (p,), at θ (p,); NaN outside the cone.

    stiffness (p, p) is Γ⁻¹, mu the weight μ of the barrier.
    """
    metric = np.zeros(stiffness.shape)
    x = gradient.copy()
    _differentiate(cone, theta, np.zeros(x.shape), metric)
    for i in range(x.shape[0]):
        for j in range(x.shape[0]):
            metric[i, j] = stiffness[i, j] + mu * metric[i, j]
    factor_in_place(metric, x.shape[0])
    solve_in_place(metric, x, x.shape[0])
    return x
