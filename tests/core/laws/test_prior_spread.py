"""The covariance of a prior: how far the truth may be, from the estimate and the spread alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_triangular

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.parameters import Array, Block, ParameterSpace
from tests.support.remembered import scenario_plant

ROBOTS = ["ur5", "panda", "bluerov2", "crazyflie", "f1tenth", "remus100", "astrobee"]


def random_tree(seed: int) -> tuple[ParameterSpace, Array]:
    """A tree with bodies from 10 g to 30 kg, needles, plates and far centres of mass."""
    rng = np.random.default_rng(seed)
    blocks, theta = [], []
    count = int(rng.integers(2, 10))
    for i in range(count):
        mass, size = 10 ** rng.uniform([-2, -1.5], [1.5, 0])
        axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        widths = size * 10 ** rng.uniform(-2.5, 0, 3) * (rng.random(3) < 0.9)
        centre = size * rng.standard_normal(3) * 10 ** rng.uniform(-1.5, 0.3)
        second = (axes * widths**2) @ axes.T + np.outer(centre, centre)
        (xx, xy, xz), (_, yy, yz), (*_, zz) = mass * (np.trace(second) * np.eye(3) - second)
        theta += [mass, *(mass * centre), xx, xy, yy, xz, yz, zz]
        length = float(np.sqrt((xx + yy + zz) / (2 * mass)))
        blocks.append(
            Block.of_link(i, f"body {i}", float(Block.guessed(mass)), float(Block.guessed(length)))
        )
    friction = 10 ** rng.uniform(-3, 1, count)
    names = tuple(f"friction {i}" for i in range(count))
    guesses = friction * 10 ** rng.uniform(-0.5, 0.5, count)
    blocks.append(Block("friction", names, ("1",) * count, guesses, "positive"))
    return ParameterSpace(tuple(blocks)), np.r_[theta, friction]


def squares(space: ParameterSpace, estimate: Array, truth: Array, error: float) -> float:
    """χ²/p of an estimate under its own covariance."""
    root = np.linalg.cholesky(Prior(space, estimate, error).covariance())
    e = solve_triangular(root, (truth - estimate) / space.scale, lower=True)
    return float(e @ e / len(e))


def mean_squares(space: ParameterSpace, published: Array, error: float, seed: int) -> Array:
    """Mean χ²/p of 50 estimates: truth drawn about them; they about a truth; about `published`."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(50):
        moved = Prior(space, published, 0.0).draw(rng)
        truth = Prior(space, published, error).draw(rng)
        found.append(
            (
                squares(space, moved, truth, error),
                squares(space, Prior(space, truth, error).draw(rng), truth, error),
                squares(space, Prior(space, published, error).draw(rng), published, error),
            )
        )
    return np.mean(found, axis=0)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_spread_of_a_robots_prior_is_the_stated_one_under_both_kinds_of_prior(name):
    plant = scenario_plant(name)
    found = mean_squares(plant.system.space, plant.truth, 0.3, seed=1)
    assert np.abs(found - 1).max() < 0.3, found


@pytest.mark.parametrize("seed", range(6))
def test_the_spread_of_a_random_trees_prior_is_the_stated_one(seed):
    space, truth = random_tree(seed)
    found = mean_squares(space, truth, 0.3, seed)
    assert np.abs(found - 1).max() < 0.3, found


@pytest.mark.parametrize("error", [0.1, pytest.param(0.3, marks=pytest.mark.slow)])
def test_second_moments_are_those_of_the_draws(error):
    space, theta = random_tree(0)
    rng = np.random.default_rng(0)
    theta = Prior(space, theta, 0.0).draw(rng)
    draws = np.array([Prior(space, theta, error).draw(rng) - theta for _ in range(2000)])
    draws /= space.scale
    stated = Prior(space, theta, error).covariance()
    for _, place in space:
        root = np.linalg.cholesky(stated[place, place])
        e = solve_triangular(root, draws[:, place].T, lower=True)
        ratio = np.linalg.eigvalsh(e @ e.T / len(draws))
        assert ratio[0] > 0.8 and ratio[-1] < 1.25, ratio


def test_a_covariance_is_positive_definite_by_block_and_depends_on_the_estimate_alone():
    space, theta = random_tree(3)
    found = Prior(space, theta, 0.3).covariance()
    assert (found == Prior(space, theta.copy(), 0.3).covariance()).all()
    assert (block_diag(*(found[place, place] for _, place in space)) == found).all()
    assert np.abs(found - found.T).max() <= 1e-15 * np.abs(found).max()
    np.linalg.cholesky(found)


def test_a_number_that_was_moved_inside_may_be_anything_below():
    space = ParameterSpace((Block("drag", ("a", "b"), ("1", "1"), np.full(2, 100.0), "positive"),))
    found = np.diag(Prior(space, np.array([1.1, 100.0]), 0.3).covariance())
    assert np.sqrt(found[0]) == pytest.approx(0.01)  # 1 % of its scale
    assert np.sqrt(found[1]) == pytest.approx(0.3 / np.sqrt(3), rel=0.05)


def test_a_prior_of_any_spread_has_a_finite_covariance():
    space, theta = random_tree(0)
    found = Prior(space, theta, 1e15).covariance()
    assert np.isfinite(found).all() and (np.diag(found) > 0).all()
    assert (found == Prior(space, theta, 20.0).covariance()).all()


@pytest.mark.parametrize("error", [0.0, -0.1, np.nan, np.inf])
def test_a_prior_without_a_spread_is_refused(error):
    space, theta = random_tree(0)
    with pytest.raises(InvalidInput, match="relative error > 0"):
        Prior(space, theta, error).covariance()


@pytest.mark.parametrize("error", [1e-8, 1e-13, 1e-170])
def test_the_spread_of_a_tiny_error_is_positive_definite(error):
    space, theta = random_tree(0)
    np.linalg.cholesky(Prior(space, theta, error).covariance())
