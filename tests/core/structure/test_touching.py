"""A step whose contacts move as measured: what it holds, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.core.structure.contacts import contact_jacobians
from nsaid_mj.core.structure.touching import Touch
from nsaid_mj.core.structure.transition import step
from tests.support.walkers import quadruped

DT = 1e-3


@pytest.fixture(scope="module")
def stepped():
    """A step of solo12 from a random state, as a function of θ; its start, J and w."""
    system, theta = quadruped(0.02)
    rng = np.random.default_rng(0)
    q, v, u = system.random_state(rng)
    structure = system.structure
    J = contact_jacobians(structure, structure.contacts, q[None])[0][0]
    w = rng.standard_normal(len(J))
    touch = Touch.of(*J.shape)
    touch.J[:] = J
    touch.w[:] = w
    n, m, p = system.n, system.m, system.p
    scale = np.array(system.space.scale)

    def move(theta):
        work, slopes = structure.memory()
        end = np.empty(m), np.empty(m), np.empty(n), np.empty((2 * n, 3 * n)), np.empty((n, p))
        start = q, v, u, DT, theta, scale
        pivot = step(structure.arrays, *start, work, slopes, *end, np.zeros((0, n)), touch)
        assert pivot > 0
        return end[2], end[3][n:, 2 * n :] @ end[4]

    return move, theta, scale, v, J, w, touch


def test_the_contacts_gain_the_velocity_that_was_measured(stepped):
    move, theta, _, v, J, w, touch = stepped
    after, _ = move(theta)
    np.testing.assert_allclose(J @ (after - v), DT * w, atol=1e-7 * np.abs(after - v).max())
    np.testing.assert_allclose(J @ touch.Y, np.eye(len(J)), atol=1e-6)


def test_derivatives_by_theta_are_those_of_the_step(stepped):
    """But for what contact forces can do, which the derivatives hold and the filter leaves free."""
    move, theta, scale, _, J, _, touch = stepped
    rng = np.random.default_rng(1)
    for _ in range(5):
        change = 1e-4 * rng.standard_normal(len(theta)) * theta
        ahead = move(theta + change)[0]
        behind = move(theta - change)[0]
        predicted = 2 * move(theta)[1] @ (change / scale)
        predicted -= touch.Y @ (J @ predicted)
        np.testing.assert_allclose(ahead - behind, predicted, atol=0.05 * np.abs(predicted).max())


def test_the_scale_of_theta_moves_nothing(stepped):
    """With contacts that move as measured, θ and 2 θ lead to one end: forces scale along."""
    move, theta, *_ = stepped
    np.testing.assert_allclose(move(2 * theta)[0], move(theta)[0], rtol=1e-9)
