"""Single bodies against their sources' equations in numpy, see `tests.support.single_bodies`."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.matrices import assert_near
from tests.support.single_bodies import FAMILIES, random, regressor


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", range(5))
def test_every_column_of_w_is_that_of_the_source(family, seed):
    rng = np.random.default_rng(seed)
    made = random(family, rng)
    system = made.system
    q, v, u = system.random_state(rng)
    a = rng.standard_normal(system.n)
    expected, found = regressor(made, q, v, a, u), system._W(0.0, q, v, v, a, u)
    assert found.shape == (system.n, system.p)
    for k in range(system.p):
        assert_near(found[:, k], expected[:, k], 1e-12)
        assert np.abs(expected[:, k]).max() > 0


@pytest.mark.parametrize("family", FAMILIES)
def test_a_step_forward_and_its_difference_are_those_of_the_kinematics(family):
    """q̇ = J v, and integrate undoes difference."""
    rng, h = np.random.default_rng(1), 1e-6
    system = random(family, rng).system
    q, v, _ = system.random_state(rng)
    ahead, behind = system.integrate(q, h * v), system.integrate(q, -h * v)
    assert_near((ahead - behind) / (2 * h), system.J(q) @ v, 1e-8)
    assert_near(system.difference(q, system.integrate(q, 0.3 * v)), 0.3 * v, 1e-9)
