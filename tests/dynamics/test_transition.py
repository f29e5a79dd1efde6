"""Forward dynamics with derivatives: against the plant's own motion and against differences."""

from functools import cache

import numpy as np
import pytest

from nsaid_mj.dynamics.transition import transition, transition_work
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.setup import Setup, trajectory

FAMILIES = ("ur5", "bluerov2", "crazyflie", "f1tenth", "remus100", "astrobee", "scalar_rov")
CARRIERS = ("borinot", "uvms")


@cache
def setup(name: str) -> Setup:
    return Setup.of(load(name))


class Stepper:
    """One step of a scenario's structure, from any state and parameters."""

    def __init__(self, name: str):
        self.system, self.scale = setup(name).system, setup(name).system.space.scale
        self.structure = self.system.forward
        n, m, p = self.system.n, self.system.m, self.system.p
        self.work = transition_work(self.structure, n, m, p)
        self.end = np.empty(m), np.empty(n)

    def __call__(self, q, v, u, dt, theta):
        """(m,), (n,) the end, and (2n, 2n+p) its derivatives; copies."""
        pivot, F = transition(self.structure, q, v, u, dt, theta, self.scale, self.work, *self.end)
        assert pivot > 0
        return self.end[0].copy(), self.end[1].copy(), F.copy()


@pytest.mark.parametrize("name", [*FAMILIES, *CARRIERS])
def test_a_step_under_the_true_parameters_follows_the_plant(name: str) -> None:
    made, step = setup(name), Stepper(name)
    with made.plant.running():
        log = trajectory(made.plant, made.driver(), 40)
    for k in (10, 25, 38):
        q, v, _ = step(log.q[k], log.v[k], log.u[k], log.t[k + 1] - log.t[k], made.plant.truth)
        size = np.abs(log.v).max()
        assert np.abs(made.system.difference(q, log.q[k + 1])).max() < 1e-9 * size
        assert np.abs(v - log.v[k + 1]).max() < 1e-7 * size


@pytest.mark.parametrize("name", [*FAMILIES, *CARRIERS])
def test_derivatives_of_a_step_are_those_of_differences(name: str) -> None:
    made, step = setup(name), Stepper(name)
    system, rng = made.system, np.random.default_rng(1)
    n, dt, theta = system.n, made.scenario.dt, made.prior
    q, v, u = system.random_state(rng)
    v = 0.3 * v if name == "remus100" else v
    q1, v1, F = step(q, v, u, dt, theta)

    def end(deviation: np.ndarray) -> np.ndarray:
        dq, dv, dtheta = np.split(deviation, [n, 2 * n])
        there = step(system.integrate(q, dq), v + dv, u, dt, theta + step.scale * dtheta)
        return np.concatenate([system.difference(q1, there[0]), there[1] - v1])

    h = 1e-5
    slopes = [(end(h * e) - end(-h * e)) / (2 * h) for e in np.eye(F.shape[1])]
    for rows in (slice(0, n), slice(n, 2 * n)):
        for columns in (slice(0, n), slice(n, 2 * n), slice(2 * n, None)):
            expected = np.array(slopes).T[rows, columns]
            size = max(np.abs(expected).max(), 1e-6)
            assert np.abs(F[rows, columns] - expected).max() < 1e-4 * size
