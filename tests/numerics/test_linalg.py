"""The compiled linear algebra agrees with numpy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.numerics.linalg import cholesky, evaluate, solve_positive, times_into
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
    for gain, dense in ((d, np.diag(d)), (spd(rng, n),) * 2):
        product = np.full(n, np.nan)
        times_into(gain, x, product)
        np.testing.assert_allclose(product, dense @ x, rtol=1e-13, atol=1e-13)


def system(rng, n: int, p: int):
    """A mass tensor that is PD at θ = (1, 0.1 …), and C, F rows."""
    tensor = np.stack([spd(rng, n) if k == 0 else np.diag(rng.random(n)) for k in range(p)], -1)
    theta = np.r_[1.0, 0.1 * rng.random(p - 1)]
    return tensor, rng.standard_normal((n, p)), rng.standard_normal((n, p)), theta


@FEW
@given(seeds, st.integers(1, 6), st.integers(1, 9))
def test_evaluate_is_29_10_and_30(seed, n, p):
    tensor, W_C, F, theta = system(np.random.default_rng(seed), n, p)
    a, W, pivot = evaluate(tensor, W_C, F, theta)
    M = tensor @ theta
    size = (np.abs(tensor) @ np.abs(theta)).max() * np.abs(a).max() + np.abs(F - W_C).sum()
    np.testing.assert_allclose(M @ a, (F - W_C) @ theta, rtol=0, atol=1e-13 * size)  # (29)
    expected = np.einsum("j,jip->ip", a, tensor) + W_C - F  # (10)
    np.testing.assert_allclose(W, expected, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(W @ theta, 0, atol=1e-13 * size)  # (30)
    assert pivot > 0


def test_evaluate_gives_NaN_and_no_pivot_where_M_is_not_positive():
    tensor, W_C, F, theta = system(np.random.default_rng(0), 3, 4)
    a, W, pivot = evaluate(tensor, W_C, F, -theta)
    assert np.isnan(a).all() and not pivot > 0
    np.testing.assert_array_equal(W, W_C - F)


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
