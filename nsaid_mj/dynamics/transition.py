"""One RK4 step of v̇ = f(q, v, u, θ) and of its derivatives, for any structure of `forward`.

Positions are integrated in the tangent step ξ from the step's start, with
ξ̇ = v + ½[ξ, v] + 1/12 [ξ, [ξ, v]]. A deviation (δq, δv, δθ), with δq the tangent step from the
undisturbed position, obeys

    δ̇q = δv − [v, δq],    δ̇v = ∂v̇/∂q δq + ∂v̇/∂v δv + ∂v̇/∂θ δθ,

which RK4 integrates with the same stages.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.spatial import bracket
from .forward import forward_work, group_of, integrate_into, linearise


@njit(cache=True)
def transition_work(structure, n, m, p):
    """Allocates the workspace of `transition`."""
    size = 2 * n + p
    return (
        forward_work(structure, n, p),
        np.empty((n, size)),
        np.empty((2, n)),
        np.empty((2, n)),
        np.empty((2, n)),
        np.empty(m),
        np.empty((2 * n, size)),
        np.empty((2 * n, size)),
        np.empty((2 * n, size)),
    )


@njit(cache=True)
def transition(structure, q, v, u, dt, theta, scale, work, q1, v1):
    """Writes the state after a step with the command held, and its derivatives.

    Args:
        structure: the structure.
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
        M's smallest pivot, > 0 if it succeeded; and (2n, 2n+p) the derivatives of the end with
        respect to (q, v, θ/scale) at the start.
    """
    forward, J, rates, now, sums, at, X, K, total = work
    a, rate = rates[0], rates[1]
    way, speed = now[0], now[1]
    n, group, pivot = v.shape[0], group_of(structure), np.inf
    X[:], total[:] = 0.0, 0.0
    for i in range(2 * n):
        X[i, i] = total[i, i] = 1.0
    way[:], speed[:], sums[:] = 0.0, v, 0.0
    integrate_into(structure, q, way, at)
    for weight, reach in ((dt / 6, 0.5 * dt), (dt / 3, 0.5 * dt), (dt / 3, dt), (dt / 6, 0.0)):
        pivot = min(pivot, linearise(structure, at, speed, u, theta, scale, forward, a, J))
        if not pivot > 0.0:
            return pivot, total
        _way_rate(group, way, speed, rate)
        _deviation_rates(group, speed, J, X, K)
        for i in range(n):
            sums[0, i] += weight * rate[i]
            sums[1, i] += weight * a[i]
        for i in range(2 * n):
            for k in range(K.shape[1]):
                total[i, k] += weight * K[i, k]
        if reach > 0.0:
            for i in range(n):
                way[i], speed[i] = reach * rate[i], v[i] + reach * a[i]
            integrate_into(structure, q, way, at)
            for i in range(2 * n):
                for k in range(K.shape[1]):
                    X[i, k] = reach * K[i, k]
                X[i, i] += 1.0
    for i in range(n):
        v1[i] = v[i] + sums[1, i]
    integrate_into(structure, q, sums[0], q1)
    return pivot, total


@njit(cache=True)
def _way_rate(group, way, v, rate):
    """Writes ξ̇ (n,) at the tangent step ξ = `way` (n,) and the velocity v (n,)."""
    rate[:] = v
    if group:
        once = bracket(group, way, v)
        twice = bracket(group, way, once)
        for i in range(group):
            rate[i] += 0.5 * once[i] + twice[i] / 12


@njit(cache=True)
def _deviation_rates(group, v, J, X, K):
    """Writes the rates K (2n, 2n+p) of deviations X, whose last p columns are those of θ."""
    n, size = J.shape
    for i in range(n):
        for k in range(size):
            K[i, k] = X[n + i, k]
            K[n + i, k] = 0.0
        for k in range(2 * n, size):
            K[n + i, k] = J[i, k]
        for j in range(2 * n):
            factor = J[i, j]
            if factor != 0.0:
                for k in range(size):
                    K[n + i, k] += factor * X[j, k]
    if group == 6:
        for k in range(size):
            _add_bracket(v, X, K, k)
    elif group == 3:
        for k in range(size):
            K[0, k] -= v[1] * X[2, k] - v[2] * X[1, k]
            K[1, k] -= v[2] * X[0, k] - v[0] * X[2, k]


@njit(cache=True, inline="always")
def _add_bracket(a, X, K, k):
    """Subtracts the Lie bracket of the twist a (6,) with column k of X from that of K."""
    x, y, z, r, s, t = X[0, k], X[1, k], X[2, k], X[3, k], X[4, k], X[5, k]
    K[0, k] -= a[4] * z - a[5] * y + a[1] * t - a[2] * s
    K[1, k] -= a[5] * x - a[3] * z + a[2] * r - a[0] * t
    K[2, k] -= a[3] * y - a[4] * x + a[0] * s - a[1] * r
    K[3, k] -= a[4] * t - a[5] * s
    K[4, k] -= a[5] * r - a[3] * t
    K[5, k] -= a[3] * s - a[4] * r
