"""One joint, simulated open loop, against its differential equation and Coulomb's law."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nsaid_mj.clinic.servos.simulation import JointLog, simulate


def joint_log(t, target, load=0.0, inertia=0.0):
    ones = np.ones(len(t))
    return JointLog(t, target, target[0] * ones, load * ones, inertia * ones)


@pytest.mark.parametrize("a", [0.002, 2e-4])
def test_without_friction_it_is_the_linear_equation(a):
    T, g, load, inertia = 0.06, 0.08, 0.4, 0.01
    t = np.arange(0, 2, 0.02)
    target = 0.5 * np.sin(3 * t)
    found = simulate(joint_log(t, target, load, inertia), np.array([T, 1e-12, g, a, 1e-9]))

    def equation(time, x):
        held = target[min(int(time / 0.02 + 1e-9), len(t) - 1)]
        return [x[1], (held - x[0] - T * x[1] - g * load) / (a + g * inertia)]

    exact = solve_ivp(equation, (0, t[-1]), [0, 0], "LSODA", t, rtol=1e-8, max_step=2e-3).y[0]
    assert np.abs(found - exact).max() < 0.01 * np.ptp(exact)


def test_it_sticks_exactly_within_the_friction_and_slips_beyond():
    t, f = np.arange(0, 4, 0.02), 0.03
    theta = np.array([0.06, f, 0.08, 2e-4, 0.01])  # overdamped
    target = np.where(t < 1, 0.0, 0.9 * f)
    assert not simulate(joint_log(t, target), theta).any()
    target = np.where(t < 1, 0.0, 0.5)
    found = simulate(joint_log(t, target), theta)
    assert found[-1] == pytest.approx(found[-50], abs=1e-9)
    assert 0.5 - found[-1] == pytest.approx(f, rel=0.05)


def test_a_load_within_the_friction_does_not_creep():
    t = np.arange(0, 4, 0.02)
    theta = np.array([0.06, 0.03, 0.08, 2e-3, 0.01])
    assert not simulate(joint_log(t, np.zeros(len(t)), load=0.02 / 0.08), theta).any()
    sunk = simulate(joint_log(t, np.zeros(len(t)), load=0.05 / 0.08), theta)
    assert sunk[-1] == pytest.approx(-0.02, abs=2e-3)


def test_a_delay_of_one_row_is_the_target_one_row_late():
    t = np.arange(200) * 0.02
    target = np.cumsum(np.random.default_rng(0).normal(0, 0.02, 200))
    late = np.r_[target[0], target[:-1]]
    theta = np.array([0.06, 0.01, 0.08, 2e-3, 0.02])
    now = np.r_[theta[:4], 1e-12]
    np.testing.assert_allclose(
        simulate(joint_log(t, target), theta), simulate(joint_log(t, late), now), atol=1e-9
    )
