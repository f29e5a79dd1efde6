"""A structure's inertial regressors, M, bias and C are Pinocchio's."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.support.evaluation import Evaluation
from tests.support.matrices import assert_near
from tests.support.plants import draw_state, plant


@pytest.mark.parametrize("robot", ["ur5", "panda", "kinova", "xarm7", "z1", "solo12 free"])
@pytest.mark.parametrize("seed", range(3))
def test_regressor_mass_bias_and_coriolis_matrix(robot, seed):
    system = plant(robot).system
    new, links, rng = Evaluation(system.structure), 10 * system.bodies, np.random.default_rng(seed)
    model = pin.Model(system.model)
    for i in range(1, model.njoints):
        model.inertias[i] = pin.Inertia.Random()
    theta = np.zeros(system.p)
    theta[:links] = np.concatenate([i.toDynamicParameters() for i in list(model.inertias)[1:]])
    data = model.createData()
    x, _, a, u, _ = draw_state(system, rng)
    q, v, a = x[: system.m], x[system.m :], np.ascontiguousarray(a)
    still = np.zeros(system.n)
    expected = pin.computeJointTorqueRegressor(model, data, q, v, a)
    assert_near(new.regressor(q, v, v, a, 0 * u)[:, :links], expected)
    mass = pin.crba(model, data, q)
    assert_near(new.mass_matrix(q, theta), np.triu(mass) + np.triu(mass, 1).T)
    bias = pin.nonLinearEffects(model, data, q, v)
    assert_near(new.regressor(q, v, v, still, 0 * u) @ theta, bias)
    if not system.group:  # of a floating base Pinocchio's matrix is another one
        C = pin.computeCoriolisMatrix(model, data, q, v)
        assert_near(new.coriolis_matrix(q, v, theta), C)
