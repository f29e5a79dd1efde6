"""Structures of whole families against their sources' own equations in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.plants import Mismatch
from tests.support.evaluation import Evaluation
from tests.support.fossen import Fossen, true_numbers, vehicle
from tests.support.servo_arm import ServoArm


@pytest.mark.parametrize("seed", range(10))
def test_an_arm_of_position_servos_moves_by_lagranges_equations(seed):
    rng = np.random.default_rng(seed)
    arm = ServoArm(
        *rng.uniform(
            [[0.2], [0.1], [0.05], [1e-3], [1e-3], [0.1], [0.05], [5.0]],
            [[0.6], [0.3], [0.15], [5e-3], [1e-2], [0.5], [0.2], [15.0]],
            (8, 3),
        )
    )
    q, v, u = rng.uniform(-2, 2, 3), rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3)
    expected = arm.acceleration(q, v, u)
    a = Evaluation(arm.structure()).stage(q, v, v, u, arm.theta).a
    assert np.abs(a - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("seed", range(5))
def test_a_bluerov2_with_couplings_moves_by_fossens_equations(seed):
    plant, true = vehicle(true_numbers("full"), 1e-3), true_numbers("full")
    rng, system = np.random.default_rng(seed), Evaluation(plant.system.structure)
    q, v, u = plant.system.random_state(rng)
    x = np.concatenate([q[:3], q[[6, 3, 4, 5]], v])
    expected = Fossen(true, u, Mismatch())(0.0, x)[7:13]
    a = system.stage(q, v, v, u, np.ascontiguousarray(plant.truth)).a
    assert np.abs(a - expected).max() <= 1e-9 * np.abs(expected).max()
