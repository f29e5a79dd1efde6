"""Forward dynamics with derivatives: against the plant's own motion and against differences."""

from functools import cache

import numpy as np
import pytest

from nsaid_mj.core.structure.touching import Touch
from nsaid_mj.core.structure.transition import step
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup

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
        self.memory, self.at = self.system.structure.memory(), np.empty(m)
        self.none = np.zeros((0, n)), Touch.of(0, n)
        self.end = np.empty(m), np.empty(n), np.empty((2 * n, 3 * n)), np.empty((n, p))

    def __call__(self, q, v, u, dt, theta):
        """(m,), (n,) the end, and (2n, 2n+p) its derivatives; copies."""
        size, start = 2 * len(v), (q, v, u, dt, np.array(theta), np.array(self.scale))
        pivot, (F, B) = (
            step(self.structure, *start, *self.memory, self.at, *self.end, *self.none),
            self.end[2:],
        )
        assert pivot > 0
        F = np.hstack([F[:, :size], F[:, size:] @ B])
        return self.end[0].copy(), self.end[1].copy(), F


@pytest.mark.parametrize(
    "name", [*FAMILIES, *(pytest.param(name, marks=pytest.mark.slow) for name in CARRIERS)]
)
def test_a_step_under_the_true_parameters_follows_the_plant(name: str) -> None:
    made, step = setup(name), Stepper(name)
    with made.plant.running():
        log = made.plant.trajectory(made.driver(), 40)
    for k in (10, 25, 38):
        q, v, _ = step(log.q[k], log.v[k], log.u[k], log.t[k + 1] - log.t[k], made.plant.truth)
        size = np.abs(log.v).max()
        assert np.abs(made.system.difference(q, log.q[k + 1])).max() < 1e-9 * size
        assert np.abs(v - log.v[k + 1]).max() < 1e-7 * size


@pytest.mark.parametrize("name", [*FAMILIES, *CARRIERS])
def test_derivatives_of_a_step_tend_to_those_of_differences(name: str) -> None:
    made, step = setup(name), Stepper(name)
    system, rng = made.system, np.random.default_rng(1)
    n, theta = system.n, made.prior
    q, v, u = system.random_state(rng)
    v = 0.3 * v if name == "remus100" else v

    def errors(dt: float) -> np.ndarray:
        """(2,) errors of the derivatives of q and v at the end, relative to what the step does."""
        q1, v1, F = step(q, v, u, dt, theta)

        def end(deviation: np.ndarray) -> np.ndarray:
            dq, dv, dtheta = np.split(deviation, [n, 2 * n])
            there = step(system.integrate(q, dq), v + dv, u, dt, theta + step.scale * dtheta)
            return np.concatenate([system.difference(q1, there[0]), there[1] - v1])

        h, still = 1e-5, np.eye(*F.shape)
        expected = np.array([(end(h * e) - end(-h * e)) / (2 * h) for e in np.eye(F.shape[1])]).T
        off, size = np.abs(F - expected), np.abs(expected - still)
        return np.array([off[rows].max() / size[rows].max() for rows in (slice(n), slice(n, None))])

    dt = made.scenario.dt
    coarse, fine = errors(dt), errors(dt / 4)
    assert (coarse < 0.05).all()  # of a joint whose friction changes its sign within the step
    assert (fine < np.maximum(coarse / 5, 1e-5)).all()
