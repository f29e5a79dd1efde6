"""A chart of the cone: (44) and (45) are integrated in coordinates that cannot leave it.

η is the logarithm of a number, and of a matrix its Cholesky factor with the logarithms of its
diagonal: any η is inside. Blocks without a sign are their own chart.

So are tied matrices, for a Cholesky factor leaves the span of their E_l: there not any η is inside.
Instead `confine` holds a step to a Dikin ellipsoid, which lies inside the cone.
"""

from __future__ import annotations

import numpy as np

from ..cone import block_solve, compiled, factor, inverse, matrix, metric_solve, read, tied

_REACH = 0.9  # of a step of a tied block, in the metric ∇²b; a Dikin ellipsoid is inside up to 1


@compiled
def confine(cone, start, eta):
    """Cuts the step from `start` (p,) to η (p,) back, in every tied block, to where it is inside.

    The block is then inside after any step: P ⪰ (1 − 0.9) P(start). A step that is cut is shorter
    than RK4's, so that V may rise and the conserved quantity drift.
    """
    for block in range(cone.blocks.shape[0]):
        if not tied(cone, block):
            continue
        first, end, k, _, _ = cone.blocks[block]
        D, S = matrix(cone, block, eta - start), inverse(factor(cone, block, start))
        for i in range(k):
            for j in range(i):
                D[j, i] = D[i, j]
        share = np.dot(S, D)
        length = np.sqrt(np.sum(share * share.T))  # √(dᵀ ∇²b d)
        if length > _REACH:
            for at in range(first, end):
                eta[at] = start[at] + _REACH / length * (eta[at] - start[at])


@compiled
def to_chart(cone, theta):
    """(p,) η of a θ inside; NaN in every block that is outside."""
    eta = theta.copy()
    for j in cone.positive:
        eta[j] = np.log(theta[j]) if theta[j] > 0 else np.nan
    for block in range(cone.blocks.shape[0]):
        L = factor(cone, block, theta)
        if tied(cone, block):
            if np.isnan(L[0, 0]):
                eta[cone.blocks[block, 0] : cone.blocks[block, 1]] = np.nan
            continue
        at = cone.blocks[block, 0]
        for i in range(L.shape[0]):
            for j in range(i + 1):
                eta[at] = np.log(L[i, i]) if i == j else L[i, j]
                at += 1
    return eta


@compiled
def unpack(cone, block, eta):
    """Cholesky factor (k, k) that a matrix block of η holds."""
    at, k = cone.blocks[block, 0], cone.blocks[block, 2]
    L = np.zeros((k, k))
    for i in range(k):
        for j in range(i + 1):
            L[i, j] = np.exp(eta[at]) if i == j else eta[at]
            at += 1
    return L


@compiled
def from_chart(cone, eta, pairing):
    """(p,) θ of any η; `pairing` is `coordinates(cone)`."""
    theta = eta.copy()
    for j in cone.positive:
        theta[j] = np.exp(eta[j])
    for block in range(cone.blocks.shape[0]):
        if tied(cone, block):
            continue
        L = unpack(cone, block, eta)
        P = np.zeros(L.shape)
        for i in range(L.shape[0]):
            for j in range(i + 1):
                for m in range(j + 1):
                    P[i, j] += L[i, m] * L[j, m]
        read(cone, block, P, pairing, theta)
    return theta


@compiled
def chart_rate(cone, eta, theta_rate):
    """(p,) η̇ of a rate θ̇ at η: the recursion of Cholesky's factor, differentiated."""
    rate = theta_rate.copy()
    for j in cone.positive:
        rate[j] = theta_rate[j] * np.exp(-eta[j])
    for block in range(cone.blocks.shape[0]):
        if not tied(cone, block):
            block_rate(cone, block, unpack(cone, block, eta), rate)
    return rate


@compiled
def block_rate(cone, block, L, rate):
    """Turns a block's θ̇ in a rate (p,) into its η̇, from the factor L of its P."""
    L_rate, at = matrix(cone, block, rate), cone.blocks[block, 0]
    for i in range(L.shape[0]):
        for j in range(i + 1):
            total = L_rate[i, j]  # as yet Ṗ_ij
            for m in range(j):
                total -= L_rate[i, m] * L[j, m] + L[i, m] * L_rate[j, m]
            if i == j:
                total *= 0.5
            else:
                total -= L[i, j] * L_rate[j, j]
            L_rate[i, j] = total / L[j, j]
            rate[at] = L_rate[i, j] / L[i, i] if i == j else L_rate[i, j]
            at += 1


@compiled
def natural_rate(cone, eta, theta, stiffness, mu, gradient):
    """(p,) η̇ at η and its θ where θ̇ is `metric_solve`'s, each matrix with a chart factored by η."""
    if stiffness.ndim == 2:
        return chart_rate(cone, eta, metric_solve(cone, theta, stiffness, mu, gradient))
    rate = gradient / stiffness
    for j in cone.positive:
        rate[j] = gradient[j] / (stiffness[j] * theta[j] + mu / theta[j])
    for block in range(cone.blocks.shape[0]):
        flat = tied(cone, block)
        L = factor(cone, block, theta) if flat else unpack(cone, block, eta)
        block_solve(cone, block, L, stiffness, mu, gradient, rate)
        if not flat:
            block_rate(cone, block, L, rate)
    return rate
