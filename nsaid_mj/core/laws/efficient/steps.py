"""Steps of θ̂ and its covariance inside the cone, consistent along the unknown scales."""

import numpy as np

from ...numerics.kernels import boolean, f8, i8, kernel, matrix, routine, vector, void
from ...parameters import Array
from ...quotient.cone import (
    CONE,
    Cone,
    block_matrix,
    coordinates,
    inside,
    matrix_into,
    read_block,
    tied,
)

_MARGIN = 1e-6  # distance of θ̂ from the cone's boundary, over the scale of θ
_SMALLEST = 1e-9  # share of a step, below which θ̂ stays
_PASSES = 30  # of projections, at most, until θ̂ is inside


def margin_of(cone: Cone, scale: Array) -> Array:
    """(p,) a small θ inside the cone, with diagonal matrices: θ̂ minus this stays inside."""
    margin = np.zeros(len(scale))
    pairing = coordinates(cone)
    margin[cone.positive] = _MARGIN * scale[cone.positive]
    for block, (*_, first, last) in enumerate(cone.blocks):
        i, j, at = cone.entries[first:last].T
        if tied.py_func(cone, block):  # uncompiled: a few numbers, once
            margin[at[i == j]] = _MARGIN * scale[at[i == j]]
        else:
            diagonal = np.abs(block_matrix(cone, block, scale).diagonal())
            read_block(cone, block, _MARGIN * np.diag(diagonal), pairing, margin)
    return margin


@routine(boolean(matrix, i8, vector))
def _negative(P, k, x):
    """Writes x (k,) with xᵀ P x <= 0 for a symmetric P (k, k); returns whether there is one.

    P is given by its lower triangle, and overwritten with its factors L D Lᵀ.
    """
    for i in range(k):
        for j in range(i):
            total = P[i, j]
            for m in range(j):
                total -= P[i, m] * P[j, m] * P[m, m]
            P[i, j] = total / P[j, j]
            P[i, i] -= P[i, j] * P[i, j] * P[j, j]
        if not P[i, i] > 0.0:
            for j in range(k):
                x[j] = 1.0 if j == i else 0.0
            for j in range(i - 1, -1, -1):
                for m in range(j + 1, i + 1):
                    x[j] -= P[m, j] * x[m]
            return True
    return False


@routine(void(vector, i8, i8, f8, vector, vector, matrix, matrix, vector, vector))
def _onto(plane, start, end, bound, theta, scale, Ptt, Pxt, state, along):
    """Projects θ̂ and the state onto plane · θ = bound, in the metric P⁻¹.

    plane (p,) is 0 but for the parameters from `start` to `end`; along (p,) is workspace.
    """
    missing = bound
    variance = 0.0
    for i in range(start, end):
        missing -= plane[i] * theta[i]
        for j in range(start, end):
            variance += plane[i] * scale[i] * Ptt[i, j] * scale[j] * plane[j]
    if not variance > 0.0:
        return
    for k in range(theta.shape[0]):
        along[k] = 0.0
    for j in range(start, end):  # by rows of the symmetric P: without a loop-carried sum
        for k in range(theta.shape[0]):
            along[k] += Ptt[j, k] * scale[j] * plane[j]
    for k in range(theta.shape[0]):
        theta[k] += scale[k] * along[k] * missing / variance
    for k in range(state.shape[0]):
        own = 0.0
        for j in range(start, end):
            own += Pxt[k, j] * scale[j] * plane[j]
        state[k] += own * missing / variance


@kernel(void(CONE, vector, vector, vector, vector, matrix, matrix, vector, vector, vector, matrix))
def project_inside(cone, margin, before, theta, scale, Ptt, Pxt, state, plane, x, P):
    """Projects θ̂ (p,) into the cone, by half-spaces that contain it, in the metric P⁻¹.

    Such a projection brings θ̂ closer to every point of the half-space, and so to the true θ: (θ̂ −
    θ)ᵀ P⁻¹ (θ̂ − θ) never rises, and P remains a consistent covariance without inflation. Where a
    block's matrix is not positive definite, xᵀ P_b(θ) x > 0 is such a half-space, with x from the
    first pivot of its factorisation that is not positive.

    before (p,) is θ̂ before the step, inside; if `_PASSES` projections onto each half-space do not
    suffice, or θ̂ is not finite, the step is halved until it ends inside. margin (p,) is that of
    `margin_of`, scale (p,) that of θ, Ptt (p, p) and Pxt (2n, p) are covariances of θ/scale with
    itself and the state; theta and the update of the state (2n,) are overwritten. plane and x (p,)
    and P (p, p) are workspace.
    """
    for _ in range(_PASSES):
        outside = False
        for j in cone.positive:
            if not theta[j] >= margin[j]:
                plane[j] = 1.0
                outside = True
                _onto(plane, j, j + 1, 2.0 * margin[j], theta, scale, Ptt, Pxt, state, x)
        for block in range(cone.blocks.shape[0]):
            row = cone.blocks[block]
            start = row[0]
            end = row[1]
            k = row[2]
            first = row[3]
            last = row[4]
            for j in range(start, end):
                plane[j] = theta[j] - margin[j]
            own = cone.entries[first:last]
            values = cone.values[first:last]
            matrix_into(own, values, start, plane[start:end], P, k)
            if _negative(P, k, x):
                bound = 0.0
                outside = True
                for j in range(start, end):
                    plane[j] = 0.0
                for e in range(first, last):
                    i = cone.entries[e, 0]
                    j = cone.entries[e, 1]
                    at = cone.entries[e, 2]
                    plane[at] += cone.weights[e] * x[i] * x[j]
                for j in range(start, end):
                    bound += 2.0 * plane[j] * margin[j]
                _onto(plane, start, end, bound, theta, scale, Ptt, Pxt, state, x)
        if not outside:
            return
    share = 1.0
    while not (inside(cone, theta) or share == 0.0):
        share = 0.5 * share if share > _SMALLEST else 0.0
        for k in range(theta.shape[0]):
            theta[k] = 0.5 * (theta[k] + before[k]) if share > 0.0 else before[k]


@kernel(void(vector, vector, vector, vector, matrix, matrix, vector, vector), inner=True)
def carry_scale(part, before, after, scale, Pxt, Ptt, moved, gained):
    """Transports the error of a part's scale with θ̂, from `before` (p,) to `after` (p,).

    No motion reveals the common scale of the parameters where `part` (p,) is 1 (elsewhere it is 0),
    those of the whole robot or of one limb: B θ̂_part = 0 at the θ̂ at which the step is
    linearised. Linearised elsewhere in the next step, the covariance would mistake the difference
    for information (Huang, Mourikis, Roumeliotis, IJRR 29(5), 2010). To keep an error s of the
    scale, θ = (1 + s)(θ̂ + …), an error of the scale: P ← T P Tᵀ with T = 1 + d wᵀ, d = after −
    before, w ∝ before, wᵀ before = 1 (in units of the scale), which maps `before` to `after` and
    keeps θ̂ᵀ P⁻¹ θ̂. Pxt (2n, p) and Ptt (p, p) are covariances of the state and θ/scale with
    θ/scale, overwritten; moved and gained (p,) are workspace.
    """
    p = before.shape[0]
    norm = 0.0
    along = 0.0
    for k in range(p):
        moved[k] = part[k] * (after[k] - before[k]) / scale[k]
        norm += part[k] * (before[k] / scale[k]) ** 2
        gained[k] = 0.0
    for i in range(p):  # P w by rows of the symmetric P: without a loop-carried sum
        share = part[i] * before[i] / (scale[i] * norm)
        for k in range(p):
            gained[k] += share * Ptt[i, k]
    for i in range(p):
        along += part[i] * before[i] / (scale[i] * norm) * gained[i]
    for k in range(p):  # T P Tᵀ − P = d (P w)ᵀ + (P w) dᵀ + (wᵀ P w) d dᵀ
        gained[k] += 0.5 * along * moved[k]
    for i in range(p):
        own = moved[i]
        share = gained[i]
        for k in range(p):
            Ptt[i, k] += own * gained[k] + share * moved[k]
    for k in range(p):
        gained[k] = part[k] * before[k] / (scale[k] * norm)
    for j in range(Pxt.shape[0]):
        own = 0.0
        for k in range(p):
            own += Pxt[j, k] * gained[k]
        for k in range(p):
            Pxt[j, k] += own * moved[k]
