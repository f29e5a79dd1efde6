"""(46): when the estimated mass matrix stays positive definite, and when it does not."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.scenario import Scenario
from tests.support.bench import TwoVehicles, bench, simulate
from tests.support.summaries import summarize


def mass_tensor(table, x: Array) -> Array:
    """(n, n, p) with M(x, θ) = tensor · θ, column by column from (8)."""
    return np.stack([table.system.mass_matrix(x, e) for e in np.eye(table.system.p)], axis=-1)


@pytest.mark.parametrize(("error", "holds"), [(0.01, True), (0.5, False)])
def test_46_margin_is_the_one_of_its_definition(tmp_path: Path, error: float, holds: bool):
    """(46) as a run's summary has it, by hand: for the vehicle λ_min(M) is the mass.

    Where it holds, no step's M̂ comes nearer to 0 than the margin ε.
    """
    table = bench("scalar_rov")
    scenario = Scenario(
        table.config,
        table.excitation,
        table.law,
        initial_error=error,
        duration=20.0,
        dt=table.dt,
        held_out=5.0,
    )
    result = run(scenario, tmp_path)
    summary = summarize(result, Truth.of(result))
    Gamma = 0.1 * table.system.space.scale**2
    dtheta, truth = result.prior - result.plant.truth, result.plant.truth
    reach = np.sqrt(Gamma.max() * np.sum(dtheta**2 / Gamma))
    margin = summary["assumption_46_margin"]
    assert margin == pytest.approx(truth[0] - reach, rel=1e-9)
    assert (margin > 0) == holds
    if holds:
        assert result.record["pivot"][1:].min() >= margin


def test_46_without_it_definiteness_can_be_lost():
    """Where (46) fails, M̂ may stop being positive definite on the way, and the run says so."""
    table = bench("scalar_rov")
    prior = table.truth * [0.1, 3.0, -2.0, 0.3]
    law = NullspaceAID(K=5.0, gain=1.0).build(table.system, prior, table.dt)
    samples = table.drive(20.0)
    state = law.init(samples[0])
    for previous, now in pairwise(samples):
        state = law.step(state, previous, now)
        if state.status is not Status.completed:
            break
    assert state.status is Status.estimate_not_positive_definite
    assert not state.pivot > 0
    assert state.theta_hat[0] > 0  # the last estimate before that is kept


def test_46_is_not_enough_where_M_amplifies_errors():
    """(46) takes ‖M(x, Δθ)‖ ≤ ‖Δθ‖ for granted; an arm's M does not keep that.

    With Γ = I, (46) is ‖Δθ‖ + ε ≤ λ_min(M(x, θ)) for all x. The UR5's last joint turns one link,
    about y: M₆₆ = Iyy₆ + rotor₆. Errors of −c in both take M₆₆ down by 2c = √2 ‖Δθ‖, so M̂ is not
    positive definite at a Δθ that (46) allows. As Theorem 1 keeps no more than
    ‖Δθ(t)‖ ≤ ‖Δθ(t₀)‖, (46) needs the factor L = max ‖M(x, Δθ)‖/‖Δθ‖ on its left.
    """
    table = bench("ur5")
    system, truth = table.system, table.truth
    two = [system.space.index("Iyy_6"), system.space.index("rotor_6")]
    least = truth[system.space["rotor inertia"]].min()  # λ_min(M(x, θ)) is no less, for any x
    _, x, _, u = table.states(20)
    assert (np.linalg.eigvalsh(system.mass_matrix(x, truth)) >= least).all()
    assert np.allclose(system.mass_matrix(x, truth)[:, 5, 5], truth[two].sum(), rtol=1e-12)
    dtheta = np.zeros(system.p)
    dtheta[two] = -1.01 * truth[two].sum() / 2
    assert np.linalg.norm(dtheta) < 0.98 * least  # (46) is met, with ε = 0.02 λ_min
    for sample, command in zip(x, u, strict=True):
        q, v = system.split(sample)
        _, _, pivot = system.evaluate_at(0.0, q, v, command, v, truth + dtheta)
        assert not pivot > 0
        assert np.linalg.eigvalsh(system.mass_matrix(sample, truth + dtheta))[0] < 0


def test_46_with_its_factor_is_enough(table):
    """L √(λ_max(Γ) Δθᵀ Γ⁻¹ Δθ) < λ_min(M(x, θ)) leaves M̂ ≻ 0, for the worst Δθ too (Weyl).

    L is the largest singular value of Δθ ↦ M(x, Δθ): at 0.999 of the bound every M̂ is positive
    definite, in the directions L belongs to and in random ones.
    """
    system, truth, rng = table.system, table.truth, np.random.default_rng(22)
    _, x, _, _ = table.states(5)
    for sample in x:
        tensor = mass_tensor(table, sample).reshape(-1, system.p)
        _, s, directions = np.linalg.svd(tensor, full_matrices=False)
        least = np.linalg.eigvalsh(system.mass_matrix(sample, truth))[0]
        for direction in (directions[0], -directions[0], *rng.standard_normal((20, system.p))):
            step = 0.999 * least / s[0] * direction / np.linalg.norm(direction)
            assert np.linalg.eigvalsh(system.mass_matrix(sample, truth + step))[0] > 0


def test_46_may_hold_for_any_one_member_of_P():
    """(38, 46): θ may be any member of P(θ), so (46) may hold for one and fail for another.

    Only the distance to the nearest member in Γ's metric counts, relative to its own M: an
    estimate 4 times too large in all of θ is perfect, and (46) says so of the right member.
    """
    system, dt = TwoVehicles(), 0.02
    truth = np.array([2.0, 1.5, 1.0, 3.0, 1.0, 0.8, -1.2, 2.0])
    prior = 4.0 * truth
    assert Nullspace.structural(system, truth, np.random.default_rng(0)).ratio(prior) < 1e-12
    margins = [
        np.linalg.eigvalsh(system.mass_matrix(np.zeros(4), member))[0]
        - np.linalg.norm(prior - member)
        for member in (truth, 4.0 * truth)
    ]
    assert margins[0] < 0 < margins[1]
    samples = simulate(system, truth, lambda t: np.sin([t, 2 * t]), dt, 200)
    law = NullspaceAID(K=2.0, gain=1.0).build(system, prior, dt)
    state = law.init(samples[0])
    for previous, now in pairwise(samples):
        state = law.step(state, previous, now)
    assert np.abs(state.v_hat - samples[-1].v).max() < 1e-6  # order 4 in dt
    assert state.theta_hat == pytest.approx(prior, rel=1e-6)
