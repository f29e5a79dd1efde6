"""(29–31): any estimate lies in the nullspace of its own regressor."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.joints import JointTree
from tests.support.bench import Bench, bench
from tests.support.dense import Dense


def estimate(table: Bench, rng: np.random.Generator, x: Array, error: float = 1.0) -> Array:
    """(p,) a random θ̂, off by up to ±error of every parameter, with M(x, θ̂) positive definite."""
    for size in error * 0.7 ** np.arange(30):
        theta = table.truth + size * table.system.space.scale * rng.uniform(-1, 1, table.system.p)
        if np.linalg.eigvalsh(table.system.mass_matrix(x, theta))[0] > 0:
            return theta
    raise AssertionError("no positive definite estimate found")


def test_30_the_estimate_is_in_its_own_nullspace(table: Bench):
    """(30) W(t, x, w, θ̂) θ̂ = 0 for any w ≠ v and any θ̂ ≠ θ; the truth is not in there."""
    system, rng = table.system, np.random.default_rng(13)
    for t, x, v, u in zip(*table.states(10), strict=True):
        theta, w = estimate(table, rng, x), v + rng.standard_normal(system.n)
        a_hat, W, pivot = system.evaluate_at(t, *system.split(x), u, w, theta)
        assert pivot > 0
        assert np.isfinite(a_hat).all()
        assert np.abs(W @ theta).max() <= 1e-12 * np.abs(W * theta).max()
        assert np.abs(W @ table.truth).max() > 1e-3 * np.abs(W * table.truth).max()


def check_evaluate(table: Bench, theta: Array, sample, tolerance: float) -> float:
    """`evaluate` against the definitions (29), (10); returns M̂'s smallest pivot."""
    system, (t, x, w, u) = table.system, sample
    state = t, *system.split(x), u
    a_hat, W, pivot = system.evaluate_at(*state, w, theta)
    base_a, base_W, base_pivot = Dense(system).evaluate_at(*state, w, theta)
    least = np.linalg.eigvalsh(system.mass_matrix(x, theta))[0]
    assert (pivot > 0) == (base_pivot > 0) == (least > 0)
    if not least > 0:
        assert np.isnan(a_hat).all()
        assert np.isnan(base_a).all()
        return pivot
    a = system.acceleration(t, x, w, u, theta)
    W_defined = system.regressor(t, x, w, a, u)
    assert pivot == pytest.approx(base_pivot, rel=tolerance)
    for mine in (a_hat, base_a):
        assert np.abs(mine - a).max() <= tolerance * np.abs(a).max()
    for mine in (W, base_W):
        assert np.abs(mine - W_defined).max() <= tolerance * np.abs(W_defined).max()
    return pivot


def test_29_10_evaluate_agrees_with_the_definitions(table: Bench):
    """(29), (10): one call gives v̇(t, x, w, θ̂), W(t, x, w, θ̂), and whether M̂ ≻ 0.

    Both answers about M̂ occur; the arms' fast way and the general one agree with the definitions.
    """
    rng = np.random.default_rng(14)
    definite = 0
    for t, x, v, u in zip(*table.states(20), strict=True):
        w = v + rng.standard_normal(table.system.n)
        theta = estimate(table, rng, x)
        condition = np.linalg.cond(table.system.mass_matrix(x, theta))
        definite += check_evaluate(table, theta, (t, x, w, u), 1e-12 * condition) > 0
        indefinite = theta - 2 * table.truth
        assert not check_evaluate(table, indefinite, (t, x, w, u), 1e-12 * condition) > 0
    assert definite == 20


@pytest.mark.parametrize("mass", [-0.3, -2e-6, -1e-12, 0.0, 1e-12, 2e-6])
def test_29_evaluate_takes_links_of_any_mass(arm: Bench, mass: float):
    """(29) needs M̂ ≻ 0 only: a link's own mass may be negative, 0, or (in scales) nearly so.

    Pinocchio stores h/m, and loses h²/(m I) digits: 1e6 eps at the smallest mass it is given.
    """
    system, rng = arm.system, np.random.default_rng(15)
    assert isinstance(system, JointTree)
    found = 0
    for t, x, v, u in zip(*arm.states(10), strict=True):
        theta = estimate(arm, rng, x, error=0.3)
        link = int(rng.integers(system.n))
        theta[10 * link] = mass * system.scales.mass[link]
        condition = np.linalg.cond(system.mass_matrix(x, theta))
        found += check_evaluate(arm, theta, (t, x, v + 0.3, u), 1e-9 * condition) > 0
    assert found > 0


@pytest.mark.parametrize("last_two", [(-0.1, -0.1), (-0.3, 0.1879), (-0.1879, 0.1879)])
def test_29_evaluate_takes_subtrees_of_any_mass(last_two: tuple[float, float]):
    """(29) needs M̂ ≻ 0 only, and the UR5's stays so when its last two links weigh less than 0.

    Pinocchio's composite inertia divides by the sum of two masses, or by eps where that is not
    positive: there M̂'s smallest pivot would come out as −1e26 where it is 0.11.
    """
    table = bench("ur5")
    theta = table.truth.copy()
    theta[[40, 50]] = last_two
    t, x, v, u = (part[0] for part in table.states(1))
    condition = np.linalg.cond(table.system.mass_matrix(x, theta))
    assert check_evaluate(table, theta, (t, x, v, u), 1e-9 * condition) > 0
