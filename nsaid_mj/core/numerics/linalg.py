"""Compiled linear algebra for the small matrices of one stage. No fastmath, so NaN propagates."""

import numpy as np

from .kernels import boolean, f8, helper, inlined, kernel, matrix, strided, vector, void


@kernel(f8(matrix, matrix))
def cholesky(M, L):
    """Factorises M = L Lᵀ into L (n, n), reading M's lower triangle; returns the smallest pivot.

    If M is not positive definite, the pivot is ≤ 0 or NaN, and L is incomplete.
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


@kernel(f8(matrix, matrix, vector), inner=True)
def solve_positive(M, L, x):
    """Overwrites b in x (n,) with M⁻¹ b, reading M's lower triangle; returns the smallest pivot.

    M = L D Lᵀ, without square roots and with one division per row. The array L (n, n) is a
    workspace: it holds L below the diagonal, 1/D on it and (L D)ᵀ above it. If the pivot is not
    > 0, x is incomplete.
    """
    n = M.shape[0]
    smallest = np.inf
    for i in range(n):
        pivot = M[i, i]
        y = x[i]
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
        L[i, i] = 1.0 / pivot
        x[i] = y
    for i in range(n - 1, -1, -1):
        x[i] *= L[i, i]
        for k in range(i + 1, n):
            x[i] -= L[k, i] * x[k]
    return smallest


solve_inline = inlined(solve_positive)


@kernel(void(matrix, matrix), inner=True)
def solve_many(L, X):
    """Overwrites B in X (n, k) with M⁻¹ B, with the factor L that `solve_positive` left."""
    n, k = X.shape
    for i in range(n):
        for j in range(i):
            factor = L[i, j]
            for c in range(k):
                X[i, c] -= factor * X[j, c]
    for i in range(n - 1, -1, -1):
        factor = L[i, i]
        for c in range(k):
            X[i, c] *= factor
        for j in range(i + 1, n):
            factor = L[j, i]
            for c in range(k):
                X[i, c] -= factor * X[j, c]


@kernel(void(matrix, matrix), inner=True)
def invert_lower(L, inverse):
    """Writes L⁻¹ (n, n) of a lower triangular L (n, n)."""
    for i in range(L.shape[0]):
        for j in range(L.shape[0]):
            inverse[i, j] = 1.0 if i == j else 0.0
        for j in range(i):
            for k in range(j + 1):
                inverse[i, k] -= L[i, j] * inverse[j, k]
        for k in range(i + 1):
            inverse[i, k] /= L[i, i]


@helper(void(vector, vector))
def copy_into(source, target):
    """Writes the numbers of an array (k,) into another: faster than a slice where k is small."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@helper(void(matrix, vector, vector))
def times_into(gain, vector, product):
    """Writes a symmetric gain (k, k), or its diagonal (1, k), times a vector (k,) into product."""
    if gain.shape[0] == 1:
        for i in range(vector.shape[0]):
            product[i] = gain[0, i] * vector[i]
        return
    for i in range(vector.shape[0]):
        product[i] = 0.0
    for j in range(vector.shape[0]):  # by rows: the inner loop has no loop-carried sum
        for i in range(vector.shape[0]):
            product[i] += gain[j, i] * vector[j]


@kernel(void(f8, strided, matrix, matrix), inner=True, fastmath={"contract"})
def add_product(sign, A, B, C):
    """Adds A B, times a sign, to C (n, k), for A (n, m) of any strides and B (m, k).

    Three rows of C and four of B are combined at a time, with few loads for each operation: where n
    or m is small, this takes a third to three quarters of the time of BLAS, which first copies B.
    """
    n, m = A.shape
    k = C.shape[1]
    for i in range(0, n - 2, 3):
        X = C[i]
        Y = C[i + 1]
        Z = C[i + 2]
        for j in range(0, m - 3, 4):
            x0 = sign * A[i, j]
            y0 = sign * A[i + 1, j]
            z0 = sign * A[i + 2, j]
            x1 = sign * A[i, j + 1]
            y1 = sign * A[i + 1, j + 1]
            z1 = sign * A[i + 2, j + 1]
            x2 = sign * A[i, j + 2]
            y2 = sign * A[i + 1, j + 2]
            z2 = sign * A[i + 2, j + 2]
            x3 = sign * A[i, j + 3]
            y3 = sign * A[i + 1, j + 3]
            z3 = sign * A[i + 2, j + 3]
            for c in range(k):
                b0 = B[j, c]
                b1 = B[j + 1, c]
                b2 = B[j + 2, c]
                b3 = B[j + 3, c]
                X[c] = X[c] + x0 * b0 + x1 * b1 + x2 * b2 + x3 * b3
                Y[c] = Y[c] + y0 * b0 + y1 * b1 + y2 * b2 + y3 * b3
                Z[c] = Z[c] + z0 * b0 + z1 * b1 + z2 * b2 + z3 * b3
    for i in range(n):  # the rest
        for j in range(0 if i >= n - n % 3 else m - m % 4, m):
            own = sign * A[i, j]
            for c in range(k):
                C[i, c] += own * B[j, c]


@kernel(void(matrix, matrix, matrix), inner=True)
def multiply(A, B, C):
    """Writes A B (n, k) into C, for A (n, m) and B (m, k)."""
    for i in range(C.shape[0]):
        for j in range(C.shape[1]):
            C[i, j] = 0.0
    add_product(1.0, A, B, C)


@kernel(void(matrix, matrix, matrix), inner=True, _nrt=True)
def multiply_transposed(A, B, C):
    """Writes A Bᵀ (n, k) into C, for A (n, m) and B (k, m), by BLAS."""
    np.dot(A, B.T, C)


@kernel(void(matrix, matrix, boolean), inner=True, _nrt=True)
def add_square(A, C, root):
    """Adds Aᵀ A to C (d, d), for A (k, d).

    With `root`, an upper triangular U stands in C for Uᵀ U, and Householder's reflections, which
    overwrite A, make one of both. Nothing is squared: rounding then hides what is below 1e-32 of
    the largest eigenvalue of Uᵀ U, instead of 1e-16.
    """
    if not root:
        C += np.dot(A.T, A)
        return
    size = C.shape[0]
    shares = np.empty(C.shape[0])
    for j in range(size):
        square = 0.0
        for i in range(A.shape[0]):
            square += A[i, j] * A[i, j]
        if square == 0.0:
            continue
        norm = np.copysign(np.sqrt(C[j, j] * C[j, j] + square), C[j, j])
        first = C[j, j] + norm  # of the vector of the reflection; its others are A's column
        for c in range(j, size):
            shares[c] = first * C[j, c]
        for i in range(A.shape[0]):
            for c in range(j, size):
                shares[c] += A[i, j] * A[i, c]
        for c in range(j, size):
            shares[c] /= norm * first
            C[j, c] -= shares[c] * first
        for i in range(A.shape[0]):
            own = A[i, j]
            for c in range(j, size):
                A[i, c] -= shares[c] * own
