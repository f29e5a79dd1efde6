"""(18, 19): dynamics divided by M(θ) are linear in products of M⁻¹ and θ, and no longer in θ."""

from __future__ import annotations

import numpy as np

from nsaid_mj.core.parameters import Array
from tests.support.bench import bench


def normalised(name: str) -> tuple[Array, Array, Array, Array]:
    """v̇ (N, n) and F − W_C (N, n, p) at random states, and M⁻¹ (n, n) and θ (p,) of the truth."""
    table = bench(name)
    system, truth = table.system, table.truth
    t, x, v, u = table.states(20 * system.p, seed=23)
    v_dot = system.acceleration(t, x, v, u, truth)
    rest = -system.regressor(t, x, v, np.zeros_like(v), u)  # F − W_C: (10) at v̇ = 0
    M = system.mass_matrix(x, truth)
    assert np.array_equal(M, np.broadcast_to(M[0], M.shape))  # M(θ) as in (6), not M(q, θ)
    return v_dot, rest, np.linalg.inv(M[0]), truth


def test_18_19_the_sides_agree():
    """(18) = (19): v̇ + M⁻¹ C v = M⁻¹ [−D v − g + τ], C v and the forces formed separately."""
    table = bench("bluerov2")
    system, truth = table.system, table.truth
    t, x, v, u = table.states(50, seed=23)
    M, C = system.mass_matrix(x, truth), system.coriolis_matrix(x, truth)
    Cv = np.einsum("kij,kj->ki", C, v)
    forces = system.F(t, x, u) @ truth
    left = system.acceleration(t, x, v, u, truth) + np.linalg.solve(M, Cv[..., None])[..., 0]
    right = np.linalg.solve(M, forces[..., None])[..., 0]
    assert np.abs(Cv).max() > 0.1 * np.abs(forces).max()  # or C would not matter
    assert np.abs(left - right).max() < 1e-12 * np.abs(right).max()


def test_19_is_linear_in_products_of_inverse_mass_and_parameters():
    """(19) Row i of v̇ is (F − W_C) times one constant vector, Σ_j (M⁻¹)_ij θ_k by entry."""
    for name in ("scalar_rov", "bluerov2"):
        v_dot, rest, M_inverse, truth = normalised(name)
        for i, row in enumerate(M_inverse):
            products = np.outer(row, truth).ravel()
            predicted = rest.reshape(len(rest), -1) @ products
            assert np.abs(predicted - v_dot[:, i]).max() < 1e-11 * np.abs(v_dot).max()


def test_19_is_not_linear_in_the_parameters():
    """(17, 19) For one velocity θ/m still gives v̇ = (F − W_C) β; for six no β does."""
    misfits = {}
    for name in ("scalar_rov", "bluerov2"):
        v_dot, rest, _, truth = normalised(name)
        scale = bench(name).system.space.scale
        stack, right = (rest * scale).reshape(-1, len(truth)), v_dot.ravel()
        beta = np.linalg.lstsq(stack, right, rcond=None)[0]
        misfits[name] = np.linalg.norm(stack @ beta - right) / np.linalg.norm(right)
    assert misfits["scalar_rov"] < 1e-12
    assert misfits["bluerov2"] > 0.1


def test_19_needs_more_numbers_than_the_nullspace_parameterisation():
    """(17, 19) Numbers that v̇ as a linear model needs: p − 1 for one velocity, over 5 p for six.

    Every row of v̇ needs as many as F − W_C has independent entries, as functions of the state.
    """
    counts = {}
    for name in ("scalar_rov", "bluerov2"):
        _, rest, _, _ = normalised(name)
        columns = (rest * bench(name).system.space.scale).reshape(len(rest), -1)
        counts[name] = len(rest[0]) * np.linalg.matrix_rank(columns, tol=1e-9 * len(columns))
    assert counts["scalar_rov"] == 4 - 1
    assert counts["bluerov2"] > 5 * bench("bluerov2").system.p
