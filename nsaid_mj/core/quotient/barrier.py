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
    differentiate,
    factor_in_place,
    height_of,
    solve_in_place,
)


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
        differentiate(cone, estimate, gradient, nothing)
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
def metric_solve(cone, theta, stiffness, mu, gradient):
    """(p,) (Γ⁻¹ + μ ∇²b(θ))⁻¹ times a gradient (p,), at θ (p,); NaN outside the cone.

    stiffness (p, p) is Γ⁻¹, mu the weight μ of the barrier.
    """
    metric = np.zeros(stiffness.shape)
    x = gradient.copy()
    differentiate(cone, theta, np.zeros(x.shape), metric)
    for i in range(x.shape[0]):
        for j in range(x.shape[0]):
            metric[i, j] = stiffness[i, j] + mu * metric[i, j]
    factor_in_place(metric, x.shape[0])
    solve_in_place(metric, x, x.shape[0])
    return x
