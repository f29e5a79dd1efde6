"""The compiled linear algebra agrees with numpy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.core.numerics.linalg import (
    add_product,
    add_square,
    cholesky,
    solve_positive,
    times_into,
)
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=40)
sizes = st.integers(1, 8)


def spd(rng, n: int) -> np.ndarray:
    A = rng.standard_normal((n, n))
    return A @ A.T + 0.1 * np.eye(n)


@FEW
@given(seeds, sizes)
def test_cholesky_factorises_and_returns_the_smallest_pivot(seed, n):
    M, L = spd(np.random.default_rng(seed), n), np.zeros((n, n))
    pivot = cholesky(M, L)
    np.testing.assert_allclose(L @ L.T, M, rtol=1e-12, atol=1e-12)
    assert pivot == pytest.approx((np.diag(L) ** 2).min(), rel=1e-12)
    assert (np.triu(L, 1) == 0).all()


@FEW
@given(seeds, sizes)
def test_cholesky_reads_the_lower_triangle_only(seed, n):
    M = spd(np.random.default_rng(seed), n)
    whole, lower = np.zeros((n, n)), np.zeros((n, n))
    half = np.where(np.triu(np.ones((n, n)), 1) > 0, np.nan, M)
    assert cholesky(M, whole) == cholesky(half, lower)
    assert (whole == lower).all()


@FEW
@given(seeds, st.integers(1, 8), st.floats(1e-3, 10))
def test_the_pivot_is_positive_exactly_where_M_is(seed, n, gap):
    """Shifting the spectrum so that the smallest eigenvalue is ±gap moves the pivot's sign."""
    M = spd(np.random.default_rng(seed), n)
    shift = np.linalg.eigvalsh(M)[0] * np.eye(n)
    assert cholesky(M - shift + gap * np.eye(n), np.zeros((n, n))) > 0
    assert not cholesky(M - shift - gap * np.eye(n), np.zeros((n, n))) > 0


@pytest.mark.parametrize("at", [(0, 0), (2, 1), (2, 2)])
def test_NaN_in_M_is_not_positive(at):
    M = np.eye(3)
    M[at] = np.nan
    assert not cholesky(M, np.zeros((3, 3))) > 0


@FEW
@given(seeds, sizes)
def test_times_into_takes_a_diagonal_or_a_matrix(seed, n):
    rng = np.random.default_rng(seed)
    d, x = rng.standard_normal(n), rng.standard_normal(n)
    for gain, dense in ((d[None], np.diag(d)), (spd(rng, n),) * 2):
        product = np.full(n, np.nan)
        times_into(gain, x, product)
        np.testing.assert_allclose(product, dense @ x, rtol=1e-13, atol=1e-13)


@FEW
@given(seeds, sizes)
def test_solve_positive_equals_numpy_and_returns_the_smallest_pivot(seed, n):
    rng = np.random.default_rng(seed)
    M, b = spd(rng, n), rng.standard_normal(n)
    x = b.copy()
    pivot = solve_positive(np.tril(M), np.full((n, n), np.nan), x)
    np.testing.assert_allclose(x, np.linalg.solve(M, b), rtol=1e-9, atol=1e-12)
    assert pivot == pytest.approx(np.diag(np.linalg.cholesky(M)).min() ** 2, rel=1e-9)


@pytest.mark.parametrize("bad", [-1.0, 0.0, np.nan])
def test_an_indefinite_matrix_has_no_positive_pivot(bad):
    assert not solve_positive(np.diag([2.0, bad, 1.0]), np.empty((3, 3)), np.ones(3)) > 0


@FEW
@given(seeds, sizes, st.integers(1, 30))
def test_a_square_is_added_to_a_matrix_or_to_its_root(seed, d, k):
    rng = np.random.default_rng(seed)
    A, root = rng.standard_normal((k, d)), np.triu(rng.standard_normal((d, d)))
    A[:, rng.integers(d)] = 0.0
    expected = root.T @ root + A.T @ A
    C = root.T @ root
    add_square(A.copy(), C, False)
    add_square(A.copy(), root, True)
    np.testing.assert_allclose(C, expected, atol=1e-12)
    np.testing.assert_allclose(root.T @ root, expected, atol=1e-12)
    assert (np.tril(root, -1) == 0).all()


@FEW
@given(seeds, st.integers(2, 8))
def test_a_root_keeps_what_its_square_would_round_away(seed, d):
    """Of a direction with 1e-20 of the information of the others."""
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.standard_normal((d, d)))[0]
    root = np.eye(d)
    for _ in range(10):
        strong = 1e10 * rng.standard_normal((3 * d, d - 1)) @ basis[:, 1:].T
        add_square(strong, root, True)
    assert np.linalg.norm(np.linalg.solve(root.T, basis[:, 0])) == pytest.approx(1.0, rel=1e-4)


@FEW
@given(seeds, st.integers(1, 9), st.integers(1, 9), st.integers(1, 40))
def test_a_product_is_added_and_a_square_stays_symmetric(seed, n, m, k):
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((n, m)), rng.standard_normal((m, k)), np.ones((n, k))
    add_product(-1.0, A, B, C)
    np.testing.assert_allclose(C, 1 - A @ B, atol=1e-13)
    square = np.eye(k)
    add_product(-1.0, B.T, B, square)
    np.testing.assert_allclose(square, np.eye(k) - B.T @ B, atol=1e-13)
    np.testing.assert_allclose(square, square.T, atol=1e-15)
