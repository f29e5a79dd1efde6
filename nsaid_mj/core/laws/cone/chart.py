"""A chart of the cone: coordinates in which (44) and (45) cannot leave it.

η is the logarithm of a positive number, or the Cholesky factor of a matrix with the logarithms of
its diagonal: any η is inside the cone. Free blocks are their own chart.

Tied matrices are their own chart, too, because a Cholesky factor leaves the span of their E_l. For
them not every η is inside; instead `confine` limits a step to a Dikin ellipsoid inside the cone.

An arm's links are evaluated in one SIMD lane each, with the formulas of other blocks.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from ...numerics.kernels import cube, f8, kernel, vector, void
from ...numerics.small_matrices import LANES, over_lanes
from ...parameters import Array, Block, ParameterSpace
from ...quotient.barrier import metric_solve
from ...quotient.cone import (
    CONE,
    Cone,
    compiled,
    coordinates,
    factor_in_place,
    hessian_into,
    inverse_into,
    matrix,
    matrix_into,
    read_into,
    solve_in_place,
    tied,
)

_REACH = 0.9  # of a step of a tied block, in the metric ∇²b; a Dikin ellipsoid is inside up to 1


class Chart(NamedTuple):
    """Workspace of the functions below."""

    matrices: Array  # (4, k, k) for matrices of the largest block
    metric: Array  # (c, c) for its c parameters
    x: Array  # (c,) for its parameters
    rows: Array  # (30 · LANES,) for links in lanes


CHART = types.NamedTuple((cube, f8[:, ::1], vector, vector), Chart)


def chart_of(cone: Cone) -> Chart:
    """New workspace of the functions below."""
    k = 1
    c = 1
    for start, end, size in cone.blocks[cone.others, :3]:
        k = max(k, size)
        c = max(c, end - start)
    rows = np.ones(31 * LANES)
    first = (-rows.ctypes.data % (8 * LANES)) // 8  # lanes that straddle cache lines take a sixth
    rows = rows[first : first + 30 * LANES]  # of the law's time
    return Chart(np.empty((4, k, k)), np.empty((c, c)), np.empty(c), rows)


@kernel(void(CONE, vector, vector), _nrt=True)
def confine(cone, start, eta):
    """Shortens the step from `start` (p,) to η (p,), in place, where it would leave a tied block.

    After any step P ⪰ (1 − 0.9) P(start), so the block is inside the cone. A shortened step lacks
    RK4's accuracy, so V may rise and the conserved quantity may drift.
    """
    for block in cone.others:
        if not tied(cone, block):
            continue
        first, end, k, _, _ = cone.blocks[block]
        D = matrix(cone, block, eta - start)
        L = matrix(cone, block, start)
        S = np.empty((k, k))
        factor_in_place(L, k)
        inverse_into(L, L, S, k)
        for i in range(k):
            for j in range(i):
                D[j, i] = D[i, j]
        share = np.dot(S, D)
        length = np.sqrt(np.sum(share * share.T))  # √(dᵀ ∇²b d)
        if length > _REACH:
            for at in range(first, end):
                eta[at] = start[at] + _REACH / length * (eta[at] - start[at])


@kernel(void(CONE, vector, vector, CHART), _nrt=True)
def to_chart_into(cone, theta, eta, work):
    """Writes η (p,) of θ (p,), with NaN in every block that is outside the cone."""
    eta[:] = theta
    for j in cone.positive:
        eta[j] = np.log(theta[j]) if theta[j] > 0 else np.nan
    for block in cone.others:
        start, end, k, first, last = cone.blocks[block]
        L = work.matrices[0]
        own = cone.entries[first:last]
        matrix_into(own, cone.values[first:last], start, theta[start:end], L, k)
        factor_in_place(L, k)
        is_inside = L[k - 1, k - 1] < np.inf  # what follows a pivot that is not > 0 is NaN
        if not tied(cone, block):
            at = start
            for i in range(k):
                for j in range(i):
                    eta[at + j] = L[i, j]
                eta[at + i] = -np.log(L[i, i])
                at += i + 1
        if not is_inside:
            eta[start:end] = np.nan
    rows = work.rows
    for group in range(0, cone.links.shape[0], LANES):
        links = cone.links[group : group + LANES]
        gather(links, theta, rows, 0, 1.0)
        _link_factor(rows)
        for lane, at in enumerate(links):
            for i in _DIAGONAL:
                rows[LANES * i + lane] = -np.log(rows[LANES * i + lane])
            is_inside = rows[LANES * 9 + lane] > -np.inf
            for i in range(10):
                eta[at + i] = rows[LANES * i + lane] if is_inside else np.nan


@compiled
def gather(links, vector, rows, first, factor):
    """Writes the links' parts of factor · vector (p,) as numbers first … first + 9 of their lanes.

    See `over_lanes` for `rows`; the ten numbers of lane l begin at links[l] in the vector.
    """
    for lane, at in enumerate(links):
        for i in range(10):
            rows[LANES * (first + i) + lane] = factor * vector[at + i]


@compiled
def scatter(links, rows, vector):
    """Writes numbers 0 … 9 of every lane into the links' parts of a vector (p,)."""
    for lane, at in enumerate(links):
        for i in range(10):
            vector[at + i] = rows[LANES * i + lane]


@compiled
def unpack(eta, sign, L, k):
    """Writes the Cholesky factor of a block's η into L (k, k); sign = −1 inverts its diagonal."""
    at = 0
    for i in range(k):
        for j in range(i):
            L[i, j] = eta[at + j]
        L[i, i] = np.exp(sign * eta[at + i])
        at += i + 1


@compiled
def gather_factors(links, eta, sign, rows):
    """Writes the links' Cholesky factors as numbers 0 … 9 of their lanes; see `unpack`."""
    gather(links, eta, rows, 0, 1.0)
    for lane in range(links.shape[0]):
        for i in _DIAGONAL:
            rows[LANES * i + lane] = np.exp(sign * rows[LANES * i + lane])


@compiled
def squared_into(L, P, k):
    """Writes the lower triangle of L Lᵀ into P (k, k); L's diagonal is not inverted."""
    for i in range(k):
        for j in range(i + 1):
            total = L[i, 0] * L[j, 0]
            for m in range(1, j + 1):
                total += L[i, m] * L[j, m]
            P[i, j] = total


@kernel(void(CONE, vector, vector, vector, CHART), _nrt=True)
def from_chart_into(cone, eta, pairing, theta, work):
    """Writes θ (p,) of η (p,); `pairing` is `coordinates(cone)`."""
    theta[:] = eta
    for j in cone.positive:
        theta[j] = np.exp(eta[j])
    L = work.matrices[0]
    P = work.matrices[1]
    for block in cone.others:
        if not tied(cone, block):
            start, end, k, first, last = cone.blocks[block]
            unpack(eta[start:end], 1.0, L, k)
            squared_into(L, P, k)
            read_into(cone.entries[first:last], pairing[first:last], start, P, theta[start:end])
    rows = work.rows
    for group in range(0, cone.links.shape[0], LANES):
        links = cone.links[group : group + LANES]
        gather_factors(links, eta, 1.0, rows)
        _link_parameters(rows)
        scatter(links, rows, theta)


@kernel(f8(CONE, vector, vector, CHART), _nrt=True)
def height(cone, eta, theta, work):
    """The barrier b at η (p,) and its θ (p,), from the logarithms in η; NaN outside the cone."""
    total = 0.0
    for j in cone.positive:
        total -= eta[j]
    for block in range(cone.blocks.shape[0]):
        start, end, k, first, last = cone.blocks[block]
        if tied(cone, block):
            L = work.matrices[0]
            own = cone.entries[first:last]
            matrix_into(own, cone.values[first:last], start, theta[start:end], L, k)
            factor_in_place(L, k)
            for i in range(k):
                total += 2 * np.log(L[i, i])
            continue
        at = start - 1
        for i in range(k):
            at += i + 1
            total -= 2 * eta[at]
    return total


@compiled
def rate_in_place(L, rate, k):
    """Overwrites Ṗ (k, k) by η̇'s matrix, by differentiating the Cholesky recursion."""
    for i in range(k):
        for j in range(i):
            total = rate[i, j] - L[i, j] * rate[j, j]
            for m in range(j):
                total -= rate[i, m] * L[j, m] + L[i, m] * rate[j, m]
            rate[i, j] = total * L[j, j]
        total = 0.5 * rate[i, i]
        for m in range(i):
            total -= rate[i, m] * L[i, m]
        rate[i, i] = total * L[i, i]
    for i in range(k):
        rate[i, i] *= L[i, i]


@compiled
def chart_rate(cone, eta, theta_rate):
    """(p,) η̇ for a rate θ̇ (p,) at η (p,)."""
    rate = theta_rate.copy()
    for j in cone.positive:
        rate[j] = theta_rate[j] * np.exp(-eta[j])
    for block in range(cone.blocks.shape[0]):
        if not tied(cone, block):
            start, end, k, _, _ = cone.blocks[block]
            L = np.empty((k, k))
            P_rate = matrix(cone, block, theta_rate)
            unpack(eta[start:end], -1.0, L, k)
            rate_in_place(L, P_rate, k)
            pack(P_rate, rate[start:end], k)
    return rate


@compiled
def pack(L, eta, k):
    """Writes the lower triangle of L (k, k) into η, row by row."""
    at = 0
    for i in range(k):
        for j in range(i + 1):
            eta[at] = L[i, j]
            at += 1


@kernel(void(CONE, vector, vector, f8[:, ::1], f8, vector, vector), _nrt=True)
def dense_rate_into(cone, eta, theta, stiffness, mu, gradient, rate):
    """Writes what `natural_rate_into` does, for a dense Γ⁻¹ (p, p)."""
    rate[:] = chart_rate(cone, eta, metric_solve(cone, theta, stiffness, mu, gradient))


@kernel(void(CONE, vector, vector, vector, f8, vector, vector, CHART), _nrt=True)
def natural_rate_into(cone, eta, theta, stiffness, mu, gradient, rate, work):
    """Writes η̇ (p,) for θ̇ = (Γ⁻¹ + μ ∇²b(θ))⁻¹ times a gradient (p,).

    No matrix with a chart needs factorising, since η contains its Cholesky factor. theta (p,) is θ
    of eta (p,), stiffness (p,) is the diagonal of Γ⁻¹; `work` is made by `chart_of`.
    """
    for j in range(rate.shape[0]):
        rate[j] = gradient[j] / stiffness[j]
    for j in cone.positive:
        rate[j] = gradient[j] / (stiffness[j] * theta[j] + mu / theta[j])
    share = 1 / mu
    L, X, S, P_rate = work.matrices
    metric = work.metric
    x = work.x
    rows = work.rows
    for block in cone.others:
        start, end, k, first, last = cone.blocks[block]
        c = end - start
        entries = cone.entries[first:last]
        values = cone.values[first:last]
        flat = tied(cone, block)
        if flat:
            matrix_into(entries, values, start, theta[start:end], L, k)
            factor_in_place(L, k)
        else:
            unpack(eta[start:end], -1.0, L, k)
        inverse_into(L, X, S, k)
        hessian_into(entries, cone.weights[first:last], start, S, metric, c)
        for i in range(c):
            metric[i, i] += share * stiffness[start + i]
            x[i] = share * gradient[start + i]
        factor_in_place(metric, c)
        solve_in_place(metric, x, c)
        if flat:
            rate[start:end] = x[:c]
        else:
            matrix_into(entries, values, start, x, P_rate, k)
            rate_in_place(L, P_rate, k)
            pack(P_rate, rate[start:end], k)
    for group in range(0, cone.links.shape[0], LANES):
        links = cone.links[group : group + LANES]
        gather_factors(links, eta, -1.0, rows)
        gather(links, stiffness, rows, 10, share)
        gather(links, gradient, rows, 20, share)
        _link_rate(rows)
        scatter(links, rows, rate)


# -- formulas of one link, which `over_lanes` evaluates for several ------------------------------

_LINK = Cone.of(
    ParameterSpace((Block("link", tuple("0123456789"), ("",) * 10, np.ones(10), "pseudo_inertia"),))
)
_LOWER = np.tril_indices(4)
_DIAGONAL = (0, 2, 5, 9)  # of a lower triangle (4, 4), row by row


def _of(*shape: int):
    return np.zeros(shape, dtype=object)


def _factor(theta):
    """θ (10,) to the Cholesky factor of P(θ), its diagonal inverted."""
    L = _of(4, 4)
    matrix_into.py_func(_LINK.entries, _LINK.values, 0, theta, L, 4)
    factor_in_place.py_func(L, 4)
    return L[_LOWER]


def _parameters(factor):
    """The Cholesky factor of P(θ) to θ (10,)."""
    L = _of(4, 4)
    P = _of(4, 4)
    theta = _of(10)
    L[_LOWER] = factor
    squared_into.py_func(L, P, 4)
    read_into.py_func(_LINK.entries, coordinates(_LINK), 0, P, theta)
    return theta


def _rate(numbers):
    """η̇ (10,) from the factor, its diagonal inverted, Γ⁻¹/μ and the gradient/μ, (30,) in all."""
    L = _of(4, 4)
    X = _of(4, 4)
    S = _of(4, 4)
    P_rate = _of(4, 4)
    metric = _of(10, 10)
    L[_LOWER], x = numbers[:10], numbers[20:].copy()
    inverse_into.py_func(L, X, S, 4)
    hessian_into.py_func(_LINK.entries, _LINK.weights, 0, S, metric, 10)
    metric[np.diag_indices(10)] += numbers[10:20]
    factor_in_place.py_func(metric, 10)
    solve_in_place.py_func(metric, x, 10)
    matrix_into.py_func(_LINK.entries, _LINK.values, 0, x, P_rate, 4)
    rate_in_place.py_func(L, P_rate, 4)
    return P_rate[_LOWER]


_link_factor = over_lanes(_factor, 10)
_link_parameters = over_lanes(_parameters, 10)
_link_rate = over_lanes(_rate, 30)
