"""Every packed robot as a structure: today's systems' numbers, until these are gone.

Arms keep C to rounding. Bodies that change C are compared at w = v, where C v is the same for every
choice of C.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from nsaid_mj.log import Log
from nsaid_mj.parameters import Array
from nsaid_mj.structure.evaluation import Evaluation
from tests.support.converted import convert
from tests.support.matrices import assert_near
from tests.support.plants import draw_state, plant

ARMS = ["ur5", "panda", "kinova", "xarm7", "z1", "double_pendulum", "solo12 free"]
OTHERS = ["uvms", "borinot"]
BAR = 1e-12


@cache
def evaluation(name: str) -> Evaluation:
    return Evaluation(convert(plant(name).system))


def drawn(name: str, seed: int) -> tuple[Array, Array, Array, Array, Array]:
    """(q, v, w, a, u) of the size seen in operation."""
    system = plant(name).system
    x, w, a, u, _ = draw_state(system, seed)
    return x[: system.m], x[system.m :], w, a, u


@pytest.mark.parametrize("name", ARMS + OTHERS)
@pytest.mark.parametrize("seed", range(2))
def test_forces_and_w_at_the_measured_velocity_are_todays(name, seed):
    old, new = plant(name).system, evaluation(name)
    q, v, _, a, u = drawn(name, seed)
    assert_near(new.F(q, v, u), old._F(0.0, q, v, u), BAR)
    assert_near(new.regressor(q, v, v, a, u), old._W(0.0, q, v, v, a, u), BAR)


@pytest.mark.parametrize("name", ARMS)
def test_w_of_arms_is_todays_at_any_velocity(name):
    old, new = plant(name).system, evaluation(name)
    q, v, w, a, u = drawn(name, 5)
    assert_near(new.regressor(q, v, w, a, u), old._W(0.0, q, v, w, a, u), BAR)


@pytest.mark.parametrize("name", ARMS + OTHERS)
def test_the_stage_at_the_truth_is_todays(name):
    old, new, theta = plant(name).system, evaluation(name), plant(name).truth
    q, v, w, _, u = drawn(name, 7)
    a, _, pivot = old.evaluate_at(0.0, q, v, u, v, theta)
    stage = new.stage(q, v, v.copy(), u, np.ascontiguousarray(theta))
    assert_near(stage.a, a, 1e-10)
    assert stage.pivot == pytest.approx(pivot, rel=1e-9)
    stage = new.stage(q, v, w, u, np.ascontiguousarray(theta))
    W = new.regressor(q, v, w, stage.a, u)
    assert_near(stage.gradient, W.T @ (w - v), 1e-11)
    assert np.abs(W @ theta).max() <= 1e-12 * (np.abs(W) @ np.abs(theta)).max()


@pytest.mark.parametrize("name", ["ur5", "kinova", "uvms"])
@pytest.mark.parametrize("hermite", [True, False])
def test_interpolation_and_momentum_balance_are_todays(name, hermite):
    old, dt, rng = plant(name).system, 0.01, np.random.default_rng(1)
    q, v, _, _, u = drawn(name, 1)
    rows = [(q, v, u)]
    for k in range(3):
        q, v = old.integrate(q, dt * v), v * (1 + 0.1 * rng.standard_normal(old.n))
        rows.append((q, v, drawn(name, 2 + k)[4]))
    qs, vs, us = (np.array(part) for part in zip(*rows, strict=True))
    log = Log.unchecked(dt * np.arange(4.0), qs, vs, us)
    new = evaluation(name)
    qm, vm = new.midpoints(hermite, log.t, qs, vs)
    middle = old.midpoints(log, hermite)
    assert_near(qm, middle.q)
    assert_near(vm, middle.v)
    terms = new.balance(2.0, vs, vm, new.along(qs, vs, qm, vm, us))
    for own, expected in zip(terms, old.momentum_balance(2.0, log, qm, vm), strict=True):
        assert_near(own, expected)
