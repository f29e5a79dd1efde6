"""Theorem 2: with excitation in P_⊥ (75), θ̂ converges to the true set."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.log import Measurement
from nsaid_mj.core.nullspace.persistence import PersistenceMonitor
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.control.driver import Driver
from tests.support.bench import TwoVehicles, bench, columns, estimates, simulate

TWO = np.array([2.0, 1.5, 1.0, 3.0, 1.0, 0.8, -1.2, 2.0])  # the true θ of both vehicles


def test_theorem_2_one_vehicle(converged):
    """(75) holds in every window, so θ̂ → P(θ): the direction is found, the scale is not."""
    table, samples, _, theta_hat = converged
    system, scale = table.system, table.system.space.scale
    t, x, v, u = columns(samples)
    a = system.acceleration(t, x, v, u, table.truth)
    W = system.regressor(t, x, v, a, u) * scale
    for k in range(0, len(t) - 1000, 1000):  # 10 s, a period of the lowest tone
        assert PersistenceMonitor.level_of(W[k : k + 1000], table.dt, table.nullspace.P_perp) > 1.0
    ratio = table.nullspace.ratio(theta_hat / scale)
    assert ratio[0] > 0.1
    assert ratio[-1] < 1e-5
    shared = theta_hat[-1] / table.truth
    assert np.ptp(shared) < 1e-4 * shared.mean()
    assert abs(shared.mean() - 1) > 0.02


def test_theorem_2_its_scale_is_the_conserved_length(converged):
    """(30, 45): which member of P(θ) is found is decided by θ̂(0)ᵀ Γ⁻¹ θ̂(0), and foreseeable."""
    table, _, _, theta_hat = converged
    scale, truth = table.system.space.scale, table.truth
    foreseen = np.linalg.norm(theta_hat[0] / scale) / np.linalg.norm(truth / scale)
    assert theta_hat[-1] / truth == pytest.approx(foreseen, rel=1e-4)


def two_vehicles(command, seconds: float) -> tuple[list[Measurement], Array, Array]:
    """(samples, v̂, θ̂) of two vehicles under a command, both 40 % off at first."""
    system, dt = TwoVehicles(), 0.02
    signs = np.array([1, -1, -1, 1, -1, 1, -1, -1])
    samples = simulate(system, TWO, command, dt, round(seconds / dt))
    law = paper_identifier(system, np.full(2, 2.0), np.full(8, 1.0), TWO * (1 + 0.4 * signs), dt)
    return samples, *estimates(law, samples)


def rich(t: float) -> Array:
    """Two commands, three tones each."""
    return np.array(
        [
            np.sin(0.9 * t) + 0.7 * np.sin(2.1 * t + 1) + 0.5 * np.sin(4.3 * t),
            np.sin(1.1 * t + 2) + 0.7 * np.sin(2.6 * t) + 0.5 * np.sin(3.9 * t + 1),
        ]
    )


def test_theorem_2_each_of_two_vehicles_finds_its_own_scale():
    """r = 2: θ̂ → P_s(θ), the plane of (αθ₁, βθ₂), with α ≠ β."""
    _, _, theta_hat = two_vehicles(rich, 80.0)
    nullspace = Nullspace.structural(TwoVehicles(), TWO, np.random.default_rng(0))
    assert nullspace.r == 2
    ratio = nullspace.ratio(theta_hat)
    assert ratio[0] > 0.1
    assert ratio[-1] < 1e-4
    scales = (theta_hat[-1] / TWO).reshape(2, 4)
    assert np.ptp(scales, axis=1).max() < 1e-3
    assert abs(scales[0].mean() - scales[1].mean()) > 0.05


def test_theorem_2_only_what_is_excited_converges():
    """Where (75) fails for the second vehicle, held at rest, only the first one converges."""
    hover = TWO[6] / TWO[7]  # thrust that carries the net weight

    def command(t: float) -> Array:
        return np.array([rich(t)[0], hover])

    samples, v_hat, theta_hat = two_vehicles(command, 80.0)
    dv = np.abs(v_hat - columns(samples)[2]).max(axis=1)
    assert dv[-100:].max() < 1e-4  # Theorem 1 does not need excitation
    first, second = (theta_hat[-1] / TWO).reshape(2, 4)
    assert np.ptp(first) < 1e-3
    assert np.ptp(second) > 0.2
    balance = theta_hat[-1, 7] * hover - theta_hat[-1, 6]
    assert abs(balance) < 1e-4  # all that a motion at rest shows of it
    assert np.array_equal(theta_hat[-1, 5], theta_hat[0, 5])  # drag: not one bit


def test_theorem_2_fails_at_rest():
    """MuJoCo's plant at rest: no excitation (75), no convergence; Δv → 0 all the same."""
    table = bench("scalar_rov")
    plant, system = table.plant, table.system
    hover = np.array([table.truth[2] / table.truth[3]])

    class Hover(Driver):
        def start(self) -> tuple[Array, Array]:
            return np.zeros(1), np.zeros(1)

        def command(self, t: float, q: Array, v: Array) -> Array:
            return hover

    with plant.running():
        samples = plant.trajectory(Hover(), 6000).rows
    t, x, v, u = columns(samples)
    assert np.abs(v).max() < 1e-12
    W = system.regressor(t, x, v, 0 * v, u) * system.space.scale
    assert PersistenceMonitor.level_of(W, table.dt, table.nullspace.P_perp) < 1e-9 * np.linalg.norm(
        W
    )
    law = table.law.build(system, table.truth * [1.4, 0.6, 1.4, 0.8], table.dt)
    v_hat, theta_hat = estimates(law, samples)
    ratio = table.nullspace.ratio(theta_hat / system.space.scale)
    assert np.abs(v_hat - v)[-100:].max() < 1e-6
    assert ratio[-1] > 0.5 * ratio[0]
