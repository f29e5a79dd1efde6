"""The Cramér–Rao bound against least squares of the whole log."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from nsaid_mj.lab.evaluation.bound import cramer_rao
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from tests.support.batch import batch_bound


@pytest.mark.parametrize("name", ["crazyflie", "bluerov2"])
def test_the_bound_is_that_of_least_squares_in_every_direction(name: str) -> None:
    """Within 10 s the variances of a crazyflie span nine decades, and are down by sixteen."""
    setup = Setup.of(replace(load(name), sensors="noisy", duration=10.0, seed=12))
    with setup.plant.running():
        log = setup.simulate()
    truth, levels = Truth(setup, 10.0), setup.scenario.noise.levels
    Z = truth.nullspace.P_perp
    G = Z @ np.linalg.cholesky(Z.T @ truth.prior_covariance @ Z)
    R = np.repeat(np.array(levels) ** 2, setup.system.n)
    A = batch_bound(setup.system, np.array(truth.theta), R, G, log)
    root = Z.T @ G @ np.linalg.inv(A)
    found = Z.T @ cramer_rao(truth, log, levels) @ Z
    ratios = scipy.linalg.eigh(found, root @ root.T, eigvals_only=True)
    np.testing.assert_allclose(ratios, 1.0, atol=1e-6)
