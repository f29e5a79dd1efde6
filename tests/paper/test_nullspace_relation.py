"""(13–15, 32): the truth lies in the regressor's nullspace, with all that is equivalent to it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.nullspace.subspace import Nullspace
from tests.support.bench import Bench, TwoVehicles, bench, estimates, random_states
from tests.support.vehicles import coordinate_map


def test_13_mujoco_moves_in_the_nullspace_of_W(table: Bench):
    """(13) W(t, x, v, v̇) θ = 0 with MuJoCo's own q, v and qacc, and the true θ."""
    plant, system, theta = table.plant, table.system, table.truth
    driver = table.excitation.build(system, table.prior(0.3), np.random.default_rng(8))
    at = coordinate_map(plant)
    worst, speeds = 0.0, []
    with plant.running():
        now = plant.begin(driver)
        for _ in range(1000):
            plant.data.ctrl[:] = now.u
            mujoco.mj_forward(plant.model, plant.data)  # mj_step leaves last step's qacc
            a = plant.data.qacc.copy() if at is None else at.acceleration(plant.data)
            W = system.regressor(now.t, np.concatenate([now.q, now.v]), now.v, a, now.u)
            worst = max(worst, np.abs(W @ theta).max() / np.abs(W * theta).max())
            speeds.append(now.v)
            now = plant.drive(driver, now, 1).at(-1)
    assert np.min(speeds) < -0.01 < 0.01 < np.max(speeds)  # drag and friction of both signs
    assert worst <= 1e-10


def test_14_acceleration_does_not_see_the_scale(table: Bench):
    """(14) v̇(αθ) = v̇(θ) for any α ≠ 0, negative ones too; W(αθ) = α W θ is mere linearity."""
    system, (t, x, v, u) = table.system, table.states(5)
    a = system.acceleration(t, x, v, u, table.truth)
    for alpha in (-3.0, 1e-3, 0.7, 1e4):
        scaled = system.acceleration(t, x, v, u, alpha * table.truth)
        assert np.abs(scaled - a).max() <= 1e-10 * np.abs(a).max()


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum"])
def test_14_scaled_estimates_stay_scaled(name: str):
    """(14) through (44, 45): θ̂ → αθ̂ and Γ → αΓ give the same v̂(t) and α times the same θ̂(t).

    With α = 4 every product and square root scales without rounding: the runs agree to the bit.
    """
    table, alpha = bench(name), 4.0
    samples, prior, system = table.drive(1.0), table.prior(0.3), bench(name).system
    K, Gamma = np.full(system.n, 5.0), 0.1 * system.space.scale**2

    def run(alpha: float) -> tuple[np.ndarray, np.ndarray]:
        law = paper_identifier(system, K, alpha * Gamma, alpha * prior, table.dt)
        return estimates(law, samples)

    (v_hat, theta_hat), (v_scaled, theta_scaled) = run(1.0), run(alpha)
    assert np.abs(theta_hat[-1] - prior).max() > 0
    assert np.array_equal(v_hat, v_scaled)
    assert np.array_equal(alpha * theta_hat, theta_scaled)


def test_15_with_iff_the_set_is_no_subspace():
    """(15, 32): P(θ) ∪ {0} is a linear subspace only if (15)'s ⇔ is read as ⇒.

    Of two vehicles that do not touch, take θ* = (θ₁, 0), the mean of the two members (θ₁, θ₂) and
    (θ₁, −θ₂). Whatever moves as θ says has W θ* = 0 (⇒), but W θ* = 0 also where the second
    vehicle moves as it likes (not ⇐), and M(x, θ*) is singular: (26) has no v̇. `Nullspace` is
    the subspace of ⇒, and (42) must be read as θ̂ → P_s(θ).
    """
    system, theta = TwoVehicles(), np.array([2.0, 1.5, 0.3, 3.0, 1.0, 0.8, -0.2, 2.0])
    members = [theta, np.concatenate([theta[:4], -theta[4:]])]
    mean = (members[0] + members[1]) / 2
    t, x, v, u = random_states(system, 50, seed=9)
    a = system.acceleration(t, x, v, u, theta)
    other = a + np.array([0.0, 1.0])  # the second vehicle does not move as θ says

    def seen(member: np.ndarray, a: np.ndarray) -> np.ndarray:
        return np.abs(system.regressor(t, x, v, a, u) @ member).max(axis=1)

    for member in members:  # both are in P(θ), ⇒ and ⇐
        assert (seen(member, a) < 1e-14).all()
        assert (seen(member, other) > 0.1).all()
    assert (seen(mean, a) < 1e-14).all()
    assert (seen(mean, other) < 1e-14).all()  # ⇐ fails: the mean is not in P(θ)
    assert np.linalg.det(system.mass_matrix(x[0], mean)) == 0
    nullspace = Nullspace.structural(system, theta, np.random.default_rng(0))
    assert nullspace.r == 2
    assert nullspace.ratio(mean / system.space.scale) < 1e-14
