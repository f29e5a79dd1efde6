"""(E1) to (E3) of docs/theory.md, section 6: what periodic signals excite."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.core.nullspace.persistence import PersistenceMonitor
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.lab.control.tracking import FourierTracking
from nsaid_mj.lab.library import load
from nsaid_mj.plans.excite.experiment import Experiment
from nsaid_mj.plans.excite.information import ranks
from nsaid_mj.plans.excite.limits import Limit, Limits


@pytest.fixture(scope="module")
def arm() -> tuple[Experiment, Limits]:
    base = FourierTracking(fundamental=0.5, harmonics=4)
    experiment = Experiment.of(replace(load("double_pendulum"), excitation=base, duration=4.0))
    ends = {"position": 2.0, "speed": 6.0, "acceleration": 40.0, "torque": 20.0}
    limits = {name: Limit(-np.full(2, x), np.full(2, x), "") for name, x in ends.items()}
    return experiment, Limits(limits)


def test_e1_a_periodic_motion_of_full_rank_has_a_level_that_grows_with_the_window():
    t = np.arange(0, 1, 1e-3)
    B = np.stack([np.sin(2 * np.pi * t), np.cos(2 * np.pi * t), np.ones_like(t)], axis=1)
    G = np.einsum("ti,tj->ij", B, B) * 1e-3
    expected = np.sqrt(np.linalg.eigvalsh(G)[0])
    assert PersistenceMonitor.level_of(B[:, None, :], 1e-3) == pytest.approx(expected)
    twice = np.tile(B[:, None, :], (2, 1, 1))
    assert PersistenceMonitor.level_of(twice, 1e-3) >= np.sqrt(2) * expected * (1 - 1e-9)


def test_e1_no_window_excites_a_direction_that_one_period_does_not():
    t = np.arange(0, 3, 1e-3)
    B = np.stack([np.sin(2 * np.pi * t), 2 * np.sin(2 * np.pi * t)], axis=1)
    assert PersistenceMonitor.level_of(B[:, None, :], 1e-3) < 1e-12


@pytest.mark.parametrize("lines", [1, 2, 3])
def test_e2_lines_bound_the_rank(lines):
    rng, t = np.random.default_rng(lines), np.arange(0, 1, 1e-3)
    waves = [np.ones_like(t)]
    for k in range(1, lines + 1):
        waves += [np.sin(2 * np.pi * k * t), np.cos(2 * np.pi * k * t)]
    rows = np.array(waves).T @ rng.standard_normal((2 * lines + 1, 12))
    assert 12 - Nullspace.of(rows).r == 2 * lines + 1


def test_e2_a_product_of_signals_has_as_many_lines_as_its_degree_allows():
    t = np.arange(0, 1, 1e-3)
    rng, h, degree = np.random.default_rng(0), 2, 3
    k = 2 * np.pi * np.arange(1, h + 1)
    signal = np.sin(np.outer(t, k) + rng.uniform(0, 6, h)) @ rng.standard_normal(h)
    columns = np.stack([signal**power for power in range(degree + 1)], axis=1)
    spectrum = np.abs(np.fft.rfft(columns, axis=0)).max(axis=1)
    lines = np.flatnonzero(spectrum > 1e-9 * spectrum.max())
    assert lines.max() <= degree * h


def test_e3_random_motions_have_the_same_rank_and_more_harmonics_never_less(arm):
    experiment, limits = arm
    found = [ranks(experiment, limits, seed) for seed in range(4)]
    assert all(each.measured == found[0].measured for each in found)
    measured = [rank for _, rank in found[0].measured]
    assert measured == sorted(measured)
    assert measured[0] < measured[-1] == found[0].needed


@pytest.mark.parametrize("v0", [-3.0, 0.0, 5.0])
def test_e4_a_periodic_command_of_a_damped_axis_leads_to_one_periodic_motion(v0):
    """m v̇ = k u − d v − c tanh(v/w) − b |v| v − g, u a square wave of period 1."""
    rng = np.random.default_rng(0)
    m, k, d, c, b, g, h = *rng.uniform(0.5, 2, 6), 1e-3

    def rate(v: float, u: float) -> float:
        return float((k * u - d * v - c * np.tanh(v / 0.1) - b * abs(v) * v - g) / m)

    speeds = [[v0, 1.0]]
    for i in range(12000):
        u = 4.0 if i % 1000 < 300 else -2.0
        ahead = [v + 0.5 * h * rate(v, u) for v in speeds[-1]]
        speeds.append([v + h * rate(w, u) for v, w in zip(speeds[-1], ahead, strict=True)])
    apart = np.abs(np.diff(np.array(speeds), axis=1)[:, 0])
    t = h * np.arange(len(apart))
    assert (apart <= abs(v0 - 1) * np.exp(-d / m * t) * (1 + 1e-3) + 1e-12).all()
    last = np.array(speeds)[:, 0]
    assert last[-1000:] == pytest.approx(last[-2000:-1000], abs=1e-6)
    assert np.ptp(last[-1000:]) > 0.1


@pytest.mark.parametrize(("amplitude", "rank"), [(1.0, 3), (0.0, 1)])
def test_e4_one_sine_excites_a_linear_axis_and_a_constant_does_not(amplitude, rank):
    """m v̇ = k u − d v − g: W = (v̇, v, 1, −u), of which θ = (m, d, g, k) is the nullspace."""
    m, d, g, k, w = 2.0, 0.7, 0.4, 1.3, 3.0
    t = np.arange(0, 2 * np.pi / w, 1e-3)
    reply = k * amplitude / (1j * w * m + d) * np.exp(1j * w * t)
    v, a, u = reply.imag - g / d, (1j * w * reply).imag, amplitude * np.sin(w * t)
    W = np.stack([a, v, np.ones_like(t), -u], axis=1)
    assert np.abs(W @ [m, d, g, k]).max() < 1e-12
    assert np.linalg.matrix_rank(W, tol=1e-9 * np.linalg.norm(W)) == rank
