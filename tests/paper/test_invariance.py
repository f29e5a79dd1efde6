"""(16–17, 20–28): parameters in P(θ) move alike; others do not."""

from __future__ import annotations

import numpy as np

from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.conventional import ConventionalAID
from nsaid_mj.core.parameters import Array
from tests.support.bench import Bench, bench, estimates


def member(table: Bench, rng: np.random.Generator, x: Array) -> Array:
    """(p,) a random θ* of P_s(θ), far from θ, with M(x, θ*) positive definite at all of x."""
    scale, nullspace = table.system.space.scale, table.nullspace
    theta_s = table.truth / scale
    step = nullspace.P @ rng.standard_normal(nullspace.r)
    step *= np.linalg.norm(theta_s) / np.linalg.norm(step)
    for size in 0.5 ** np.arange(20):
        theta = scale * (rng.uniform(0.5, 2.0) * theta_s + size * step)
        if (np.linalg.eigvalsh(table.system.mass_matrix(x, theta)) > 0).all():
            return theta
    raise AssertionError("no positive definite member found")


def test_28_parameters_in_P_move_alike(table: Bench):
    """(20–28) v̇(t, x, v, θ*) = v̇(t, x, v, θ) for θ* in P(θ), at states P̄ has not seen."""
    system, rng = table.system, np.random.default_rng(10)
    t, x, v, u = table.states(20, seed=11)
    a = system.acceleration(t, x, v, u, table.truth)
    M = system.mass_matrix(x, table.truth)
    for _ in range(5):
        theta = member(table, rng, x)
        distance = np.linalg.norm((theta - table.truth) / system.space.scale)
        assert distance > 0.05 * np.linalg.norm(table.truth / system.space.scale)
        a_star = system.acceleration(t, x, v, u, theta)
        tolerance = 1e-11 * np.linalg.cond(np.concatenate([M, system.mass_matrix(x, theta)])).max()
        assert np.abs(a_star - a).max() <= tolerance * np.abs(a).max()


def test_28_parameters_off_P_move_differently(table: Bench):
    """The converse of (28): every direction of P_⊥, the weakest too, changes some v̇.

    To first order M δv̇ = −W δθ, so that the rms change is at least what the smallest singular
    value of M⁻¹W P̄_⊥ over the states says.
    """
    system, scale, nullspace = table.system, table.system.space.scale, table.nullspace
    t, x, v, u = table.states(10 * system.p, seed=12)
    a = system.acceleration(t, x, v, u, table.truth)
    W = np.linalg.solve(system.mass_matrix(x, table.truth), system.regressor(t, x, v, a, u) * scale)
    _, s, directions = np.linalg.svd(
        W.reshape(-1, system.p) @ nullspace.P_perp, full_matrices=False
    )
    for k in (0, -1):
        step = (
            1e-6 * np.linalg.norm(table.truth / scale) * scale * (nullspace.P_perp @ directions[k])
        )
        change = system.acceleration(t, x, v, u, table.truth + step) - a
        predicted = 1e-6 * np.linalg.norm(table.truth / scale) * s[k]
        assert predicted > 0
        assert abs(np.linalg.norm(change) / predicted - 1) < 0.05


def test_17_reduced_form_agrees_with_the_nullspace():
    """(16, 17): with the mass held at 1, the others become d/m, g/m, a/m: NS-AID's direction."""
    table = bench("scalar_rov")
    samples, system, truth = table.drive(60.0), table.system, table.truth
    prior = table.prior(0.5)
    nullspace_law = NullspaceAID(K=5.0, gain=0.3).build(system, prior, table.dt)
    reduced_law = ConventionalAID(K=5.0, gain=0.01, known=("mass",)).build(
        system, np.concatenate([[1.0], prior[1:] / prior[0]]), table.dt
    )
    full = estimates(nullspace_law, samples)[1][-1]
    reduced = estimates(reduced_law, samples)[1][-1]
    assert reduced[0] == 1.0
    assert np.abs(reduced[1:] / (truth[1:] / truth[0]) - 1).max() < 1e-2
    assert np.abs(full / full[0] / reduced - 1).max() < 2e-2
    assert abs(full[0] / truth[0] - 1) > 0.05  # NS-AID has no reason to find the mass itself
