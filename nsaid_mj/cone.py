"""The cone of physical parameters: its barrier, its metric, and a chart that cannot leave it.

Every block with a geometry is a convex cone: numbers > 0; the ten inertial parameters of a link
whose pseudo-inertia P(φ) ≻ 0 (Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018); the upper triangle of
an SPD matrix. The barrier b = −Σ log det P(φ_i) − Σ log det M − Σ log θ_j grows without bound at
its edge, and b(sθ) = b(θ) − ν log s, so that ∇b·θ = −ν and ∇²b θ = −∇b.

The chart η of a cone is the logarithm of a number, and of a matrix its Cholesky factor with the
logarithms of its diagonal: any η is inside. Blocks without a sign are their own chart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from .kernels import cholesky
from .parameters import Array, Indices, ParameterSpace


class Cone(NamedTuple):
    """The blocks of θ that are cones, for compiled code.

    Attributes:
        positive: (a,) indices of the parameters that are > 0.
        starts: (b,) first index of every matrix block.
        orders: (b,) size k of its matrix; it has k (k + 1)/2 parameters.
        bases: (b, c, K, K) with matrix Σ_i θ_i bases[block, i], padded by zeros.
        degree: ν, the sum of all orders.
    """

    positive: Indices
    starts: Indices
    orders: Indices
    bases: Array
    degree: int


def cone_of(space: ParameterSpace) -> Cone:
    """The cones of a parameter space."""
    positive, starts, orders, bases = [], [], [], []
    for block, place in space:
        if block.geometry == "positive":
            positive += range(place.start, place.stop)
        elif block.geometry in ("pseudo_inertia", "spd"):
            k = round(((8 * len(block) + 1) ** 0.5 - 1) / 2)
            starts.append(place.start)
            orders.append(k)
            bases.append(_pseudo_inertia() if block.geometry == "pseudo_inertia" else _upper(k))
    largest = max(orders, default=0)
    padded = np.zeros((len(starts), largest * (largest + 1) // 2, largest, largest))
    for i, basis in enumerate(bases):
        count, k, _ = basis.shape
        padded[i, :count, :k, :k] = basis
    first, second, third = (np.array(part, dtype=np.intp) for part in (positive, starts, orders))
    return Cone(first, second, third, padded, len(positive) + sum(orders))


def _upper(k: int) -> Array:
    """(k(k+1)/2, k, k) basis of symmetric matrices by their upper triangle, row by row."""
    basis = np.zeros((k * (k + 1) // 2, k, k))
    for i, (row, column) in enumerate(zip(*np.triu_indices(k), strict=True)):
        basis[i, row, column] = basis[i, column, row] = 1.0
    return basis


def _pseudo_inertia() -> Array:
    """(10, 4, 4) basis of P(φ) = [[½ tr(I) 1 − I, h], [hᵀ, m]] in Pinocchio's order of φ."""
    basis = np.zeros((10, 4, 4))
    basis[0, 3, 3] = 1.0
    for i in range(3):
        basis[1 + i, i, 3] = basis[1 + i, 3, i] = 1.0
    for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        if i == j:
            basis[4 + k, :3, :3] = 0.5 * np.eye(3)
            basis[4 + k, i, i] -= 1.0
        else:
            basis[4 + k, i, j] = basis[4 + k, j, i] = -1.0
    return basis


@njit(cache=True)
def matrix(basis, part):
    """(K, K) Σ_i part_i basis_i."""
    P = np.zeros(basis.shape[1:])
    for i in range(part.shape[0]):
        P += part[i] * basis[i]
    return P


@njit(cache=True)
def factor(cone, block, theta):
    """Cholesky factor (k, k) of a matrix block, and its smallest pivot."""
    k, start = cone.orders[block], cone.starts[block]
    P = matrix(cone.bases[block], theta[start : start + k * (k + 1) // 2])[:k, :k].copy()
    L = np.zeros((k, k))
    return L, cholesky(P, L)


@njit(cache=True)
def inside(cone, theta):
    """Whether θ (p,) is inside: every number > 0 and every matrix positive definite."""
    for j in cone.positive:
        if not theta[j] > 0:
            return False
    for block in range(cone.starts.shape[0]):  # noqa: SIM110 (numba has no generators)
        if not factor(cone, block, theta)[1] > 0:
            return False
    return True


@njit(cache=True)
def barrier(cone, theta):
    """b(θ); infinite outside."""
    total = 0.0
    for j in cone.positive:
        if not theta[j] > 0:
            return np.inf
        total -= np.log(theta[j])
    for block in range(cone.starts.shape[0]):
        L, pivot = factor(cone, block, theta)
        if not pivot > 0:
            return np.inf
        for i in range(L.shape[0]):
            total -= 2 * np.log(L[i, i])
    return total


@njit(cache=True)
def gradient_and_hessian(cone, theta):
    """∇b (p,) and ∇²b (p, p), block diagonal: −tr(P⁻¹E_i) and tr(P⁻¹E_i P⁻¹E_j)."""
    p = theta.shape[0]
    gradient, hessian = np.zeros(p), np.zeros((p, p))
    for j in cone.positive:
        gradient[j] = -1 / theta[j]
        hessian[j, j] = 1 / theta[j] ** 2
    for block in range(cone.starts.shape[0]):
        start, k = cone.starts[block], cone.orders[block]
        count = k * (k + 1) // 2
        L, _ = factor(cone, block, theta)
        inverse = np.linalg.inv(L)
        whitened = np.empty((count, k * k))
        for i in range(count):
            E = np.ascontiguousarray(cone.bases[block, i, :k, :k])
            X = np.dot(np.dot(inverse, E), inverse.T)
            gradient[start + i] = -np.trace(X)
            whitened[i] = X.reshape(k * k)
        hessian[start : start + count, start : start + count] = np.dot(whitened, whitened.T)
    return gradient, hessian


@njit(cache=True)
def to_chart(cone, theta):
    """(p,) η of a θ inside."""
    eta = theta.copy()
    for j in cone.positive:
        eta[j] = np.log(theta[j])
    for block in range(cone.starts.shape[0]):
        L, _ = factor(cone, block, theta)
        at = cone.starts[block]
        for i in range(L.shape[0]):
            for j in range(i + 1):
                eta[at] = np.log(L[i, i]) if i == j else L[i, j]
                at += 1
    return eta


@njit(cache=True)
def unpack(cone, block, eta):
    """Cholesky factor (k, k) that a matrix block of η holds."""
    k, at = cone.orders[block], cone.starts[block]
    L = np.zeros((k, k))
    for i in range(k):
        for j in range(i + 1):
            L[i, j] = np.exp(eta[at]) if i == j else eta[at]
            at += 1
    return L


@njit(cache=True)
def from_chart(cone, eta, pairing):
    """(p,) θ of any η; `pairing` is `coordinates(cone)`."""
    theta = eta.copy()
    for j in cone.positive:
        theta[j] = np.exp(eta[j])
    for block in range(cone.starts.shape[0]):
        L = unpack(cone, block, eta)
        k, start = cone.orders[block], cone.starts[block]
        P = np.dot(L, L.T)
        count = k * (k + 1) // 2
        for i in range(count):
            theta[start + i] = np.sum(pairing[block, i, :k, :k] * P)
    return theta


def coordinates(cone: Cone) -> Array:
    """(b, c, K, K) dual bases: θ_i = Σ_jk dual_i,jk P_jk for every matrix P of a block."""
    dual = np.zeros_like(cone.bases)
    for block, k in enumerate(cone.orders):
        count = k * (k + 1) // 2
        basis = cone.bases[block, :count, :k, :k].reshape(count, k * k)
        dual[block, :count, :k, :k] = np.linalg.solve(basis @ basis.T, basis).reshape(count, k, k)
    return dual


@njit(cache=True)
def chart_rate(cone, eta, theta_rate):
    """(p,) η̇ of a rate θ̇ at η: L⁻¹ Ṗ L⁻ᵀ, its lower half, and L̇ = L Φ."""
    rate = theta_rate.copy()
    for j in cone.positive:
        rate[j] = theta_rate[j] * np.exp(-eta[j])
    for block in range(cone.starts.shape[0]):
        k, at = cone.orders[block], cone.starts[block]
        L = unpack(cone, block, eta)
        P_rate = matrix(cone.bases[block], theta_rate[at : at + k * (k + 1) // 2])[:k, :k].copy()
        half = np.linalg.solve(L, np.ascontiguousarray(np.linalg.solve(L, P_rate).T))
        for i in range(k):
            half[i, i] *= 0.5
            for j in range(i + 1, k):
                half[i, j] = 0.0
        L_rate = np.dot(L, half)
        for i in range(k):
            for j in range(i + 1):
                rate[at] = half[i, i] if i == j else L_rate[i, j]
                at += 1
    return rate


def drawn_inside(
    space: ParameterSpace, theta: Array, error: float, rng: np.random.Generator
) -> Array:
    """(p,) parameters off θ by about ±error, inside the cone whatever the error.

    Numbers are multiplied by e^u, u within ±error; a matrix P becomes A P Aᵀ in balanced units,
    with e^{±error/2} on A's diagonal and ±error/4 off it; blocks without a sign move by ±error of
    their size. A θ on the cone's edge is first moved inside.

    Args:
        space: names, scale and geometry.
        theta: (p,) where to draw about.
        error: largest relative error.
        rng: source of the errors.
    """
    cone, drawn = cone_of(space), np.array(theta, dtype=np.float64)
    dual = coordinates(cone)
    for block, place in space:
        if block.geometry == "free":
            size = np.maximum(np.abs(theta[place]), 0.1 * block.scale)
            drawn[place] += error * size * rng.uniform(-1, 1, len(block))
        elif block.geometry == "positive":
            start = np.maximum(theta[place], 0.01 * block.scale)
            drawn[place] = start * np.exp(error * rng.uniform(-1, 1, len(block)))
    for i, (start, k) in enumerate(zip(cone.starts, cone.orders, strict=True)):
        place = slice(start, start + k * (k + 1) // 2)
        P = matrix(cone.bases[i], theta[place])[:k, :k]
        smallest = 0.01 * np.abs(matrix(cone.bases[i], space.scale[place])[:k, :k].diagonal())
        balance = 1 / np.sqrt(np.maximum(P.diagonal(), smallest))
        N = P * np.outer(balance, balance)
        N += max(0.0, 1e-3 - np.linalg.eigvalsh(N)[0]) * np.eye(k)
        A = error / 4 * rng.uniform(-1, 1, (k, k))
        A[np.diag_indices(k)] = np.exp(error / 2 * rng.uniform(-1, 1, k))
        P = A @ N @ A.T / np.outer(balance, balance)
        drawn[place] = np.einsum("cij,ij->c", dual[i, : len(drawn[place]), :k, :k], P)
    return drawn
