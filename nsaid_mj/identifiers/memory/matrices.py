"""Factors and shares of semidefinite matrices that rounding may have left indefinite."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ...parameters import Array

_RIDGE = 1e-13  # share of a matrix's diagonal that is added against rounding errors
_SINGULAR = 1e-14  # share of the largest eigenvalue below which an eigenvalue is rounding error


def cholesky(matrix: Array) -> Array:
    """(p, p) lower factor of a matrix > 0, which rounding may have left slightly indefinite."""
    ridge, widest = _RIDGE, 1e10 * _RIDGE
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
    half = np.linalg.solve(L, np.linalg.solve(L, part / balance).T)
    shares, vectors = scipy.linalg.eigh(0.5 * (half + half.T))
    return unit[:, None] * (L @ vectors), np.array(shares, dtype=np.float64)


def square_root(matrix: Array) -> Array:
    """(p, p) R with R Rᵀ = a matrix ⪰ 0; negative eigenvalues, from rounding, count as 0."""
    unit = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = scipy.linalg.eigh(matrix / np.outer(unit, unit))
    return np.asarray(unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)


def eliminated(matrix: Array, freed: np.ndarray) -> Array:
    """The least of θᵀ H θ over some parameters, as a quadratic form of the others.

    It is the Schur complement of their block, formed from a factor of H: ⪰ 0 and at most H, also
    where H is singular.

    Args:
        matrix: (p, p) H ⪰ 0; rounding errors may leave it indefinite.
        freed: (p,) mask of the parameters over which the least is taken.

    Returns:
        (p, p) the form, 0 in the rows and columns of these parameters.
    """
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    values, vectors = scipy.linalg.eigh(matrix * np.outer(unit, unit))
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    axes, lengths, _ = np.linalg.svd(root[:, freed], full_matrices=False)
    axes = axes[:, lengths**2 > _SINGULAR * max(1.0, values[-1])]
    rest = (root - axes @ (axes.T @ root)) * np.where(freed, 0.0, size)
    return rest.T @ rest
