"""Compiled linear algebra on the small matrices of one stage. No fastmath: NaN stays visible."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def cholesky(M, L):
    """Factorises M = L Lᵀ, reading M's lower triangle; returns the smallest pivot.

    The pivot is not > 0 (it may be NaN) where M is not positive definite, and L is then unfinished.
    """
    n = M.shape[0]
    smallest = np.inf
    for j in range(n):
        pivot = M[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if not pivot > 0.0:
            return pivot
        smallest = min(smallest, pivot)
        L[j, j] = np.sqrt(pivot)
        for i in range(j + 1, n):
            s = M[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = s / L[j, j]
    return smallest


@njit(cache=True)
def solve_positive(M, L, x):
    """Overwrites b in x (n,) by M⁻¹ b, reading M's lower triangle; returns the smallest pivot.

    M = L D Lᵀ, without square roots and with one division in a row: below L's diagonal is L, on it
    1/D, above it (L D)ᵀ. Where the pivot is not > 0, x is unfinished.
    """
    n = M.shape[0]
    smallest = np.inf
    for i in range(n):
        pivot, y = M[i, i], x[i]
        for j in range(i):
            s = M[i, j]
            for k in range(j):
                s -= L[k, i] * L[j, k]
            L[j, i] = s
            L[i, j] = s * L[j, j]
            pivot -= s * L[i, j]
            y -= L[i, j] * x[j]
        if not pivot > 0.0:
            return pivot
        smallest = min(smallest, pivot)
        L[i, i], x[i] = 1.0 / pivot, y
    for i in range(n - 1, -1, -1):
        x[i] *= L[i, i]
        for k in range(i + 1, n):
            x[i] -= L[k, i] * x[k]
    return smallest


@njit(cache=True)
def copy_into(source, target):
    """Writes the numbers of an array (k,) into another: faster than a slice where k is small."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@njit(cache=True)
def times_into(gain, vector, product):
    """Writes a gain, given by its diagonal (k,) or whole (k, k), times a vector (k,)."""
    if gain.ndim == 1:
        for i in range(vector.shape[0]):
            product[i] = gain[i] * vector[i]
    else:
        np.dot(gain, vector, product)


@njit(cache=True)
def evaluate(mass_tensor, W_C, F, theta):
    """â of (29), W of (10, 31) and M̂'s smallest pivot, from M(x, θ) = mass_tensor · θ."""
    n, _, p = mass_tensor.shape
    M_hat = np.dot(mass_tensor.reshape(n * n, p), theta).reshape(n, n)  # (8)
    L = np.zeros((n, n))
    W = W_C - F
    a_hat = -np.dot(W, theta)
    pivot = solve_positive(M_hat, L, a_hat)  # (29)
    if not pivot > 0.0:
        return np.full(n, np.nan), W, pivot
    return a_hat, np.dot(a_hat, mass_tensor.reshape(n, n * p)).reshape(n, p) + W, pivot  # (10)
