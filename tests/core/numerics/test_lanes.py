"""A kernel compiled for several runs at once does for each what the same text does for one."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import types

from nsaid_mj.core.numerics.kernels import f8, helper, kernel, vector, void
from nsaid_mj.core.numerics.lanes import COMPILED, WIDTH, as_lanes, widened

pytestmark = pytest.mark.skipif(not COMPILED, reason="plain Python has no lanes")


class Pair(NamedTuple):
    """Two arrays."""

    x: np.ndarray
    y: np.ndarray


PAIR = types.NamedUniTuple(vector, 2, Pair)


@helper(f8(f8, f8))
def _larger(a, b):
    """The sum of two numbers and their smaller, or 0 where it is not positive."""
    least = min(a, b)
    return a + b + least if least > 0.0 else 0.0


@helper(void(PAIR, vector, vector))
def _one(pair, shared, out):
    """Every operation that lanes have, also on numbers of all runs."""
    out[0] = 1
    out[1] = 2 * pair.x[0] - pair.y[0] / 3.0
    out[2] = 1.0 / pair.x[1]
    out[2] += shared[0] * pair.y[1]
    out[2] -= -pair.x[0]
    out[2] *= pair.y[0]
    out[2] /= shared[1]
    total = 0.0
    for i in range(pair.x.shape[0]):
        total += pair.x[i] * pair.y[i]
    out[3] = total
    out[4] = _larger(pair.x[0], pair.y[0])


@kernel(void(PAIR, vector, vector), cache=False)
def _alone(pair, shared, out):
    _one(pair, shared, out)


@kernel(void(widened(PAIR), vector, widened(vector)), cache=False)
def _together(pair, shared, out):
    _one(as_lanes(pair), shared, as_lanes(out))


@pytest.fixture
def numbers() -> Pair:
    """For every run, all greater than 0."""
    rng = np.random.default_rng(0)
    return Pair(*rng.uniform(0.1, 2.0, (2, 6, WIDTH)))


def each(pair: Pair, shared: np.ndarray) -> np.ndarray:
    """The results of every run by itself, side by side."""
    found = np.empty((5, WIDTH))
    for k in range(WIDTH):
        out = np.empty(5)
        _alone(Pair(pair.x[:, k].copy(), pair.y[:, k].copy()), shared, out)
        found[:, k] = out
    return found


def test_lanes_have_the_bits_of_single_runs(numbers: Pair) -> None:
    shared = np.array([0.3, -1.7])
    out = np.empty((5, WIDTH))
    _together(numbers, shared, out)
    np.testing.assert_array_equal(out, each(numbers, shared))


def test_a_condition_holds_if_it_does_for_all_runs(numbers: Pair) -> None:
    numbers.x[0, WIDTH - 1] = -1.0
    out = np.empty((5, WIDTH))
    _together(numbers, np.ones(2), out)
    assert not out[4].any() and each(numbers, np.ones(2))[4, :-1].all()


def test_a_number_that_is_not_finite_stays_in_its_lane(numbers: Pair) -> None:
    numbers.x[1, 3] = np.nan
    out = np.empty((5, WIDTH))
    _together(numbers, np.ones(2), out)
    np.testing.assert_array_equal(out, each(numbers, np.ones(2)))
    assert np.isnan(out[2:4, 3]).all() and np.isfinite(np.delete(out, 3, axis=1)).all()
