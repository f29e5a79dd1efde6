"""The kernels of a structure: W, the stage, skewness, derivatives, interpolation and momentum."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.core.log import Log
from nsaid_mj.core.structure.structure import Structure
from nsaid_mj.core.structure.touching import Touch
from nsaid_mj.core.structure.transition import step
from tests.support.evaluation import Evaluation
from tests.support.matrices import assert_near
from tests.support.strategies import seeds
from tests.support.trees import physical_theta, random_motion, random_structure

trees = st.tuples(seeds, st.sampled_from(["held", "free", "planar"]), st.integers(1, 6))
few = settings(max_examples=25, deadline=None)


def made(tree) -> tuple[Structure, Evaluation, np.random.Generator]:
    structure = random_structure(*tree)
    return structure, Evaluation(structure), np.random.default_rng(tree[0])


@few
@given(trees)
def test_m_is_symmetric_and_what_w_m_multiplies(tree):
    structure, system, rng = made(tree)
    q, _, _, a, _ = random_motion(structure, rng)
    theta = rng.standard_normal(structure.p)
    M = system.mass_matrix(q, theta)
    assert_near(M, M.T)
    assert_near(system.W_M(q, a) @ theta, M @ a)


@few
@given(trees)
def test_m_dot_minus_2c_is_skew_at_any_velocity(tree):
    """Through w ≠ v: C is the whole matrix, not C v alone."""
    structure, system, rng = made(tree)
    q, v, _, _, _ = random_motion(structure, rng)
    theta, h = rng.standard_normal(structure.p), 1e-5
    C = system.coriolis_matrix(q, v, theta)
    M_dot = (
        system.mass_matrix(system.integrate(q, h * v), theta)
        - system.mass_matrix(system.integrate(q, -h * v), theta)
    ) / (2 * h)
    size = max(np.abs(C).max(), np.abs(system.mass_matrix(q, theta)).max())
    assert np.abs(M_dot - C - C.T).max() <= 1e-7 * size


@few
@given(trees)
def test_w_is_the_sum_of_its_parts(tree):
    structure, system, rng = made(tree)
    q, v, w, a, u = random_motion(structure, rng)
    theta = rng.standard_normal(structure.p)
    parts = system.mass_matrix(q, theta) @ a + system.coriolis_matrix(q, v, theta) @ w
    whole = system.regressor(q, v, w, a, u)
    assert_near(whole @ theta, parts - system.F(q, v, u) @ theta, 1e-10)


@few
@given(trees)
def test_the_stage_is_29_and_w_transposed_times_dv(tree):
    structure, system, rng = made(tree)
    q, v, w, _, u = random_motion(structure, rng)
    theta = physical_theta(structure, rng)
    a, gradient, pivot = system.stage(q, v, w, u, theta)
    M = system.mass_matrix(q, theta)
    assert pivot > 0
    force = system.F(q, v, u) @ theta - system.W_C(q, v, w) @ theta
    assert_near(a, np.linalg.solve(M, force), 1e-9)
    W = system.regressor(q, v, w, a, u)
    assert_near(gradient, W.T @ (w - v), 1e-10)
    assert np.abs(W @ theta).max() <= 1e-10 * (np.abs(W) @ np.abs(theta)).max()


@few
@given(trees)
def test_derivatives_equal_central_differences(tree):
    structure, system, rng = made(tree)
    q, v, _, _, u = random_motion(structure, rng)
    theta, scale, h = physical_theta(structure, rng), rng.uniform(0.5, 2, structure.p), 1e-5
    _, A, B = system.linearise(q, v, u, theta, scale)

    def v_dot(q=q, v=v, theta=theta):
        return system.stage(q, v, v, u, theta).a

    expected = np.zeros_like(A)
    for j, e in enumerate(h * np.eye(structure.n)):
        ahead, behind = system.integrate(q, e), system.integrate(q, -e)
        expected[:, j] = (v_dot(ahead) - v_dot(behind)) / (2 * h)
        expected[:, structure.n + j] = (v_dot(v=v + e) - v_dot(v=v - e)) / (2 * h)
    assert_near(A, expected, 1e-4)
    for k in rng.integers(0, structure.p, 5):
        e = 1e-4 * scale[k] * np.eye(structure.p)[k]
        assert_near(
            B[:, k],
            (v_dot(theta=theta + e) - v_dot(theta=theta - e)) / 2e-4,
            1e-5,
            floor=np.abs(B).max(),
        )


@few
@given(trees)
def test_momentum_changes_by_what_the_balance_says(tree):
    """d/dt(M v) = F θ + Cᵀ v, with C from W_C, and the leak's share of momentum."""
    structure, system, rng = made(tree)
    q, v, _, _, u = random_motion(structure, rng)
    n, t = structure.n, np.array([0.0, 0.01])
    qs = np.array([q, system.integrate(q, 0.01 * v)])
    vs, us = np.array([v, v]), np.array([u, u])
    log = Log.unchecked(t, qs, vs, us)
    qm, vm = system.system.midpoints(log, True)
    terms = system.system.momentum_balance(3.0, log, qm, vm)
    transport = np.stack([v @ system.W_C(q, v, e) for e in np.eye(n)])
    expected = 3.0 * system.W_M(q, v) + system.F(q, v, u) + transport
    assert_near(terms[0][0], system.W_M(q, v))
    assert_near(terms[1][0], expected)
    assert_near(system.transport(q, v), transport, floor=np.abs(expected).max())


@few
@given(trees)
def test_difference_undoes_integrate(tree):
    structure, system, rng = made(tree)
    q, v, _, _, _ = random_motion(structure, rng)
    assert_near(system.difference(q, system.integrate(q, 0.5 * v)), 0.5 * v, 1e-9)


@pytest.mark.parametrize(
    "base,longest",
    [("held", 0.02), ("free", 0.005), ("planar", 0.02)],
    ids=["held", "free", "planar"],
)
def test_a_step_is_of_fifth_order_and_its_derivatives_of_third(base, longest):
    """In steps short enough for the leading term, and long enough to rise above rounding."""
    structure = random_structure(3, base, 3)
    smooth = ("viscous", "motor", "linear_drag", "thruster", "weight", "spring", "cubic")
    columns = [c for c in structure.columns if c.kind in smooth]
    structure = Structure(structure.bodies, structure.inertias, columns, structure.p, 3)
    system, rng = Evaluation(structure), np.random.default_rng(5)
    q, v, _, _, u = random_motion(structure, rng)
    theta, n = physical_theta(structure, rng), structure.n
    work, slopes = structure.memory()

    def ends(q, v, dt, parts=1):
        F, B = np.zeros((2 * n, 3 * n)), np.zeros((n, structure.p))
        for _ in range(parts):
            q1, v1, at = np.zeros(structure.m), np.zeros(n), np.zeros(structure.m)
            pivot = step(
                structure.arrays,
                q,
                v,
                u,
                dt / parts,
                theta,
                np.ones(structure.p),
                work,
                slopes,
                at,
                q1,
                v1,
                F,
                B,
                np.zeros((0, n)),
                Touch.of(0, n),
            )
            assert pivot > 0
            q, v = q1, v1
        return q, v, F

    errors, flows = [], []
    for dt in (longest, longest / 2):
        q1, v1, F = ends(q, v, dt)
        q2, v2, _ = ends(q, v, dt, 16)
        errors.append(np.abs(np.r_[system.difference(q1, q2), v1 - v2]).max())
        expected, h = np.zeros((2 * n, 2 * n)), 1e-6
        for j, e in enumerate(h * np.eye(2 * n)):
            q2, v2, _ = ends(system.integrate(q, e[:n]), v + e[n:], dt, 4)
            q3, v3, _ = ends(system.integrate(q, -e[:n]), v - e[n:], dt, 4)
            expected[:, j] = np.r_[system.difference(q3, q2), v2 - v3] / (2 * h)
        flows.append(np.abs(F[:, : 2 * n] - expected).max())
    assert np.log2(errors[0] / errors[1]) > 4.5
    assert np.log2(flows[0] / flows[1]) > 2.5
