"""The cone of physical parameters: its matrices, and the test whether θ is inside.

Every block with a geometry is a convex cone: numbers > 0; the ten inertial parameters of a link
whose pseudo-inertia P(φ) ≻ 0 (Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018); the upper triangle of
an SPD matrix; or, where its entries are tied, fewer numbers with Σ θ_l E_l ≻ 0, a linear matrix
inequality.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from ..numerics.kernels import boolean, f8, i8, kernel, table, vector, void
from ..numerics.kernels import matrix as square
from ..parameters import Array, Block, Indices, ParameterSpace

compiled = kernel(error_model="numpy", _nrt=True)  # division by 0 gives inf or NaN


class Cone(NamedTuple):
    """The blocks of θ that are cones, for compiled code, with their matrices P(θ) sparse."""

    positive: Indices  # (a,) indices of the parameters that must be > 0
    # (b, 5) rows [start, end, k, first, last]: θ_start … θ_end−1 are the parameters of a k × k
    # matrix (k (k + 1)/2 of them unless they are tied), whose entries are first … last − 1
    blocks: Indices
    entries: Indices  # (e, 3) rows [i, j, l], i ≥ j, ordered by l: entry P_ij contains value · θ_l
    values: Array  # (e,) the values of these entries
    weights: Array  # (e,) values, doubled off the diagonal: tr(X E_l) = Σ weights X_ij
    links: Indices  # (l,) first parameters of the blocks that are pseudo-inertias
    others: Indices  # (b − l,) indices of the other blocks
    degree: int  # ν, the number of `positive` parameters plus the sum of all k

    @classmethod
    def of(cls, space: ParameterSpace) -> Cone:
        """The cones of a parameter space."""
        positive = []
        blocks = []
        entries = []
        values = []
        degree = 0
        links = []
        others = []
        for block, place in space:
            if block.geometry == "positive":
                positive += range(place.start, place.stop)
                degree += len(block)
            elif block.geometry != "free":
                basis = _basis(block)
                k = 1 + max(i for i, *_ in basis)
                if block.geometry == "pseudo_inertia":
                    links.append(place.start)
                else:
                    others.append(len(blocks))
                blocks.append((place.start, place.stop, k, len(entries), len(entries) + len(basis)))
                entries += [(i, j, place.start + at) for i, j, at, _ in basis]
                values += [value for *_, value in basis]
                degree += k
        places = np.array(entries, dtype=np.intp).reshape(-1, 3)
        return cls(
            np.array(positive, dtype=np.intp),
            np.array(blocks, dtype=np.intp).reshape(-1, 5),
            places,
            np.array(values, dtype=np.float64),
            np.where(places[:, 0] == places[:, 1], 1.0, 2.0) * values,
            np.array(links, dtype=np.intp),
            np.array(others, dtype=np.intp),
            degree,
        )

    def contains(self, theta: Array) -> bool:
        """Whether θ (p,) is inside: every number > 0, every matrix positive definite."""
        return bool(inside(self, theta))

    def barrier(self, theta: Array) -> float:
        """b(θ) at θ (p,); infinite outside the cone. See `quotient.barrier`."""
        return float(height_of(self, np.array(theta, dtype=np.float64)))

    def derivatives(self, theta: Array) -> tuple[Array, Array]:
        """∇b (p,) and the block-diagonal ∇²b (p, p) at θ (p,); NaN outside the cone.

        Their entries are −tr(P⁻¹E_l) and tr(P⁻¹E_l P⁻¹E_m).
        """
        gradient = np.zeros(len(theta))
        hessian = np.zeros((len(theta), len(theta)))
        differentiate(self, np.array(theta, dtype=np.float64), gradient, hessian)
        return gradient, hessian

    def length(self, theta: Array, step: Array) -> float:
        """Length (dᵀ ∇²b(θ) d)^½ of a step d (p,) at θ (p,); a step shorter than 1 stays inside.

        NaN outside the cone.
        """
        return float(np.sqrt(step @ self.derivatives(theta)[1] @ step))


CONE = types.NamedTuple((i8[::1], table, table, vector, vector, i8[::1], i8[::1], i8), Cone)


_NONE = np.empty(0, dtype=np.intp)
NO_CONE = Cone(
    _NONE, _NONE.reshape(0, 5), _NONE.reshape(0, 3), np.empty(0), np.empty(0), _NONE, _NONE, 0
)
"""The cone of free parameters."""


def _basis(block: Block) -> list[tuple[int, int, int, float]]:
    """Rows (i, j, l, value) of a block's matrix, ordered by l."""
    if block.geometry == "pseudo_inertia":
        return _PSEUDO_INERTIA
    if block.geometry == "tied":
        return sorted(block.entries, key=lambda entry: entry[2])
    k = round(((8 * len(block) + 1) ** 0.5 - 1) / 2)  # spd: the upper triangle, row by row
    pairs = zip(*np.triu_indices(k), strict=True)
    return [(int(column), int(row), at, 1.0) for at, (row, column) in enumerate(pairs)]


# P(φ) = [[½ tr(I) 1 − I, h], [hᵀ, m]], φ = (m, h, Ixx, Ixy, Iyy, Ixz, Iyz, Izz) as Pinocchio's
_PSEUDO_INERTIA = [
    (3, 3, 0, 1.0),
    (3, 0, 1, 1.0),
    (3, 1, 2, 1.0),
    (3, 2, 3, 1.0),
    (0, 0, 4, -0.5),
    (1, 1, 4, 0.5),
    (2, 2, 4, 0.5),
    (1, 0, 5, -1.0),
    (0, 0, 6, 0.5),
    (1, 1, 6, -0.5),
    (2, 2, 6, 0.5),
    (2, 0, 7, -1.0),
    (2, 1, 8, -1.0),
    (0, 0, 9, 0.5),
    (1, 1, 9, 0.5),
    (2, 2, 9, -0.5),
]


@compiled
def tied(cone, block):
    """Whether a block has fewer parameters than its symmetric matrix has distinct entries."""
    row = cone.blocks[block]
    start = row[0]
    end = row[1]
    k = row[2]
    return end - start < k * (k + 1) // 2


def coordinates(cone: Cone) -> Array:
    """(e,) weights that recover θ from P: θ_l = Σ weight · P_ij over its entries; 0 where tied."""
    pairing = np.zeros(len(cone.values))
    for block, (start, _, k, first, last) in enumerate(cone.blocks):
        if tied.py_func(cone, block):  # uncompiled: called while modules are imported
            continue
        own = slice(first, last)
        i, j, at = cone.entries[own].T
        basis = np.zeros((k * (k + 1) // 2, k * (k + 1) // 2))
        basis[i * (i + 1) // 2 + j, at - start] = cone.values[own]
        pairing[own] = np.linalg.inv(basis)[at - start, i * (i + 1) // 2 + j]
    return pairing


def block_matrix(cone: Cone, block: int, theta: Array) -> Array:
    """(k, k) lower triangle of a block's P at θ (p,); uncompiled, for a few calls."""
    _, _, k, first, last = cone.blocks[block]
    i, j, at = cone.entries[first:last].T
    P = np.zeros((k, k))
    np.add.at(P, (i, j), cone.values[first:last] * theta[at])
    return P


def read_block(cone: Cone, block: int, P: Array, pairing: Array, theta: Array) -> None:
    """Writes a block's parameters in θ (p,) from the lower triangle of its P (k, k); uncompiled."""
    start, end, _, first, last = cone.blocks[block]
    i, j, at = cone.entries[first:last].T
    theta[start:end] = 0.0
    np.add.at(theta, at, pairing[first:last] * P[i, j])


@compiled
def matrix(cone, block, theta):
    """(k, k) lower triangle of a block's P at θ (p,)."""
    row = cone.blocks[block]
    start = row[0]
    k = row[2]
    first = row[3]
    last = row[4]
    P = np.empty((k, k))
    matrix_into(cone.entries[first:last], cone.values[first:last], start, theta[start:], P, k)
    return P


@compiled
def matrix_into(entries, values, start, theta, P, k):
    """Writes the lower triangle of a block's P into P (≥ k, ≥ k), with zeros above the diagonal.

    `entries` (e, 3) are the block's rows [i, j, l], `values` (e,) its values; its parameters in
    theta begin at `start`.
    """
    for i in range(k):
        for j in range(k):
            P[i, j] = 0.0
    for e in range(entries.shape[0]):
        P[entries[e, 0], entries[e, 1]] += values[e] * theta[entries[e, 2] - start]


@compiled
def read_into(entries, pairing, start, P, theta):
    """Writes a block's parameters into theta, from `start` on, from the lower triangle of its P.

    P is (k, k) or larger; `entries` (e, 3) are the block's rows [i, j, l], `pairing` (e,) is its
    part of `coordinates`.
    """
    for e in range(entries.shape[0]):
        theta[entries[e, 2] - start] = 0.0
    for e in range(entries.shape[0]):
        theta[entries[e, 2] - start] += pairing[e] * P[entries[e, 0], entries[e, 1]]


@compiled
def factor_into(cone, block, theta, L):
    """Writes a block's factor, see `factor_in_place`, into L (k, k); NaN if P is not ≻ 0."""
    row = cone.blocks[block]
    first = row[3]
    last = row[4]
    matrix_into(
        cone.entries[first:last], cone.values[first:last], row[0], theta[row[0] :], L, row[2]
    )
    factor_in_place(L, row[2])
    if not L[row[2] - 1, row[2] - 1] < np.inf:  # what follows a pivot < 0 is NaN
        for i in range(row[2]):
            for j in range(row[2]):
                L[i, j] = np.nan


@compiled
def inverse_into(L, X, S, k):
    """Writes P⁻¹ for P = L Lᵀ into S (k, k) and L⁻¹ into X (k, k), which may be L itself.

    In this and all `_in_place` functions a factor stores the reciprocals of its diagonal.
    """
    for j in range(k):
        X[j, j] = L[j, j]
        for i in range(j + 1, k):
            total = L[i, j] * X[j, j]
            for m in range(j + 1, i):
                total += L[i, m] * X[m, j]
            X[i, j] = -total * L[i, i]
    for i in range(k):
        for j in range(i + 1):
            total = X[i, i] * X[i, j]
            for m in range(i + 1, k):
                total += X[m, i] * X[m, j]
            S[i, j] = S[j, i] = total


@kernel(f8(CONE, vector), _nrt=True)
def height_of(cone, theta):
    """The barrier of `quotient.barrier` at θ (p,); infinite outside the cone."""
    total = 0.0
    k = 0
    for j in cone.positive:
        if not theta[j] > 0:
            return np.inf
        total -= np.log(theta[j])
    for block in range(cone.blocks.shape[0]):
        k = max(k, cone.blocks[block, 2])
    L = np.empty((k, k))
    for block in range(cone.blocks.shape[0]):
        factor_into(cone, block, theta, L)
        k = cone.blocks[block, 2]
        if not L[k - 1, k - 1] < np.inf:  # what follows a pivot that is not > 0 is NaN
            return np.inf
        for i in range(k):
            total += 2 * np.log(L[i, i])
    return total


@kernel(boolean(CONE, vector), _nrt=True)
def inside(cone, theta):
    """Whether θ (p,) is inside the cone: every number > 0, every matrix positive definite."""
    return height_of(cone, theta) < np.inf


@compiled
def factor_in_place(A, n):
    """Overwrites the lower triangle of A (n, n) with its Cholesky factor; NaN if A is not ≻ 0.

    It has no branches, so the code vectorises over many matrices: the root of a pivot < 0 is NaN,
    and so is everything after a pivot of 0.
    """
    for j in range(n):  # by columns: the entries of one column are independent
        pivot = A[j, j]
        for m in range(j):
            pivot -= A[j, m] * A[j, m]
        A[j, j] = 1 / np.sqrt(pivot)
        for i in range(j + 1, n):
            total = A[i, j]
            for m in range(j):
                total -= A[i, m] * A[j, m]
            A[i, j] = total * A[j, j]


@compiled
def solve_in_place(L, x, n):
    """Overwrites b in x (n,) with the solution of L Lᵀ x = b."""
    for i in range(n):
        total = x[i]
        for m in range(i):
            total -= L[i, m] * x[m]
        x[i] = total * L[i, i]
    for i in range(n - 1, -1, -1):
        x[i] *= L[i, i]
        for m in range(i):
            x[m] -= L[i, m] * x[i]


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


@kernel(void(CONE, vector, vector, square), _nrt=True)
def differentiate(cone, theta, gradient, hessian):
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
