"""Single bodies against their sources' equations in numpy, see `tests.support.single_bodies`."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.structure.evaluation import Evaluation
from tests.support.converted import convert
from tests.support.matrices import assert_near
from tests.support.single_bodies import FAMILIES, random, regressor


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", range(5))
def test_every_column_of_w_is_that_of_the_source(family, seed):
    """Of the structure, and of today's own compiled equations."""
    rng = np.random.default_rng(seed)
    made = random(family, rng)
    system = made.system
    q, v, u = system.random_state(rng)
    a = rng.standard_normal(system.n)
    expected = regressor(made, q, v, a, u)
    for found in (
        Evaluation(convert(system)).regressor(q, v, v, a, u),
        system._W(0.0, q, v, v, a, u),
    ):
        assert found.shape == (system.n, system.p)
        for k in range(system.p):
            assert_near(found[:, k], expected[:, k], 1e-12)
            assert np.abs(expected[:, k]).max() > 0
