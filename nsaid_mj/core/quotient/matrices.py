"""Factors, shares and inverses of semidefinite matrices that rounding may have left indefinite."""

import numpy as np
import scipy.linalg
from scipy.linalg import lapack

from ..parameters import Array

_RIDGE = 1e-13  # share of a matrix's diagonal that is added against rounding errors


def cholesky(matrix: Array) -> Array:
    """(p, p) lower factor of a matrix > 0, which rounding may have left slightly indefinite."""
    ridge = _RIDGE
    widest = 1e10 * _RIDGE
    while True:
        try:
            whole = matrix + ridge * np.diag(np.diag(matrix))
            return np.linalg.cholesky(whole).astype(np.float64)
        except np.linalg.LinAlgError:
            ridge *= 100
            if ridge > widest:
                raise


def common_root(whole: Array, part: Array) -> tuple[Array, Array]:
    """(p, p) R and (p,) s with R Rᵀ = whole > 0, and R diag(s) Rᵀ = part ⪰ 0."""
    unit = np.sqrt(np.diag(whole))
    balance = np.outer(unit, unit)
    L = cholesky(whole / balance)
    half = lapack.dtrtrs(L, lapack.dtrtrs(L, part / balance, lower=1)[0].T, lower=1)[0]
    shares, vectors, failed = lapack.dsyevd(0.5 * (half + half.T))
    if failed:
        raise np.linalg.LinAlgError("the shares of a matrix do not converge")
    return unit[:, None] * (L @ vectors), np.array(shares, dtype=np.float64)


def square_root(matrix: Array) -> Array:
    """(p, p) R with R Rᵀ = a matrix ⪰ 0; negative eigenvalues, from rounding, count as 0."""
    unit = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = scipy.linalg.eigh(matrix / np.outer(unit, unit))
    return np.asarray(unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)


def solve(matrix: Array, right: Array) -> Array:
    """(p,) solution with a matrix > 0, scaled to unit diagonal for conditioning."""
    unit = 1 / np.sqrt(np.diag(matrix))
    scaled = matrix * unit[:, None] * unit
    _, found, failed = lapack.dposv(scaled, right * unit, lower=1)
    if failed:  # rounding left it indefinite
        found = np.linalg.solve(scaled, right * unit)
    return np.asarray(found * unit, dtype=np.float64)


def sandwich_root(hessian: Array, scatter: Array) -> Array:
    """(p, p) R with R Rᵀ = H⁻¹ S H⁻¹, for H > 0 and S ⪰ 0, both (p, p)."""
    unit = 1 / np.sqrt(np.diag(hessian))
    balance = np.outer(unit, unit)
    bread = cholesky(hessian * balance)
    root = np.linalg.solve(bread.T, np.linalg.solve(bread, square_root(scatter * balance)))
    return np.array(unit[:, None] * root, dtype=np.float64)
