"""Persistence levels: those of the Gramian, for any window, subspace and sampling."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.nullspace.persistence import PersistenceMonitor
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=50)
DT = 0.01


def window(rng, k=40, n=2, p=5):
    return rng.standard_normal((k, n, p))


def basis(rng, p, d):
    return np.linalg.qr(rng.standard_normal((p, p)))[0][:, :d]


@FEW
@given(seeds, st.floats(1e-3, 1.0))
def test_the_level_is_the_smallest_eigenvalue_of_the_gramian(seed, dt):
    B = window(np.random.default_rng(seed))
    gramian = dt * np.einsum("kni,knj->ij", B, B)
    expected = np.sqrt(len(B) * dt * np.linalg.eigvalsh(gramian)[0])
    assert PersistenceMonitor.level_of(B, dt) == pytest.approx(expected, rel=1e-8)


@FEW
@given(seeds)
def test_the_level_is_the_excitation_of_the_least_excited_direction(seed):
    rng = np.random.default_rng(seed)
    B = window(rng)
    least = np.linalg.svd(B.reshape(-1, 5))[2][-1]

    def excitation(w):
        return np.sqrt(len(B) * DT * DT * np.sum((B @ w) ** 2))

    assert excitation(least) == pytest.approx(PersistenceMonitor.level_of(B, DT), rel=1e-9)
    for direction in rng.standard_normal((20, 5)):
        w = direction / np.linalg.norm(direction)
        assert excitation(w) >= PersistenceMonitor.level_of(B, DT) * (1 - 1e-12)
        literal = np.linalg.norm(DT * np.sum(B @ w, axis=0))  # (2) as printed
        assert literal <= excitation(w) * (1 + 1e-12)  # Cauchy–Schwarz


@FEW
@given(seeds, st.integers(1, 5))
def test_a_subspace_is_excited_at_least_as_much_as_all(seed, d):
    rng = np.random.default_rng(seed)
    B = window(rng)
    assert PersistenceMonitor.level_of(B, DT, basis(rng, 5, d)) >= PersistenceMonitor.level_of(
        B, DT
    ) * (1 - 1e-9)


@FEW
@given(seeds)
def test_the_level_of_the_whole_space_does_not_depend_on_the_basis(seed):
    rng = np.random.default_rng(seed)
    B = window(rng)
    assert PersistenceMonitor.level_of(B, DT, basis(rng, 5, 5)) == pytest.approx(
        PersistenceMonitor.level_of(B, DT), rel=1e-9
    )


@FEW
@given(seeds, st.floats(1e-3, 1e3))
def test_the_level_scales_with_the_regressor(seed, c):
    B = window(np.random.default_rng(seed))
    assert PersistenceMonitor.level_of(c * B, DT) == pytest.approx(
        c * PersistenceMonitor.level_of(B, DT), rel=1e-9
    )


@FEW
@given(seeds, st.integers(1, 4))
def test_a_constant_regressor_over_twice_the_time_has_twice_the_level(seed, k):
    B = np.tile(np.random.default_rng(seed).standard_normal((1, 5, 5)), (k, 1, 1))
    assert PersistenceMonitor.level_of(np.concatenate([B, B]), DT) == pytest.approx(
        2 * PersistenceMonitor.level_of(B, DT), rel=1e-6
    )


@FEW
@given(seeds)
def test_an_unexcited_direction_has_level_0_and_its_complement_a_positive_one(seed):
    rng = np.random.default_rng(seed)
    Q = basis(rng, 5, 5)
    B = window(rng) @ (Q[:, 1:] @ Q[:, 1:].T)  # nothing along Q's first column
    assert PersistenceMonitor.level_of(B, DT) <= 1e-13 * np.linalg.norm(B)
    assert PersistenceMonitor.level_of(B, DT, Q[:, 1:]) > 1e-3


def test_fewer_rows_than_directions_have_level_0():
    B = window(np.random.default_rng(0), k=2, n=2)
    assert PersistenceMonitor.level_of(B, DT) == 0.0
    assert PersistenceMonitor.level_of(B, DT, np.eye(5)[:, :4]) > 0


def test_the_level_of_no_direction_is_infinite():
    assert (
        PersistenceMonitor.level_of(window(np.random.default_rng(0)), DT, np.zeros((5, 0)))
        == np.inf
    )


def monitored(B, r, dt=DT) -> PersistenceMonitor:
    monitor = PersistenceMonitor(B.shape[2], r, len(B) * dt)
    for W in B:
        monitor.add(W, dt)
    return monitor


@FEW
@given(seeds, st.integers(0, 4))
def test_the_monitor_shows_the_level_and_bounds_it_on_any_complement(seed, r):
    rng = np.random.default_rng(seed)
    B = window(rng)
    monitor = monitored(B, r)
    assert monitor.level == pytest.approx(PersistenceMonitor.level_of(B, DT), rel=1e-6)
    for _ in range(5):  # Courant–Fischer
        assert PersistenceMonitor.level_of(B, DT, basis(rng, 5, 5 - r)) <= monitor.level_perp * (
            1 + 1e-9
        )


def test_the_monitor_shows_the_last_whole_window():
    rng = np.random.default_rng(1)
    first, second, part = window(rng), window(rng), window(rng, k=39)
    monitor = PersistenceMonitor(5, 1, 40 * DT)
    seen = []
    for W in np.concatenate([first, second, part]):
        monitor.add(W, DT)
        seen.append(monitor.level)
    assert seen[38] == 0.0  # no window is whole yet
    assert seen[39] == seen[78] == pytest.approx(PersistenceMonitor.level_of(first, DT), rel=1e-6)
    assert seen[79] == seen[-1] == pytest.approx(PersistenceMonitor.level_of(second, DT), rel=1e-6)


def test_the_monitor_shows_level_0_for_an_unexcited_direction():
    B = window(np.random.default_rng(2))
    B[..., 0] = 0.0
    assert monitored(B, 1).level == pytest.approx(0.0, abs=1e-7)
    assert monitored(B, 1).level_perp == pytest.approx(
        PersistenceMonitor.level_of(B, DT, np.eye(5)[:, 1:]), rel=1e-6
    )


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_the_monitor_refuses_a_bad_window(bad):
    with pytest.raises(InvalidInput) as caught:
        PersistenceMonitor(3, 1, bad)
    assert caught.value.name == "pe_window"
