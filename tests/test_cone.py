"""The cone of physical parameters: its barrier, its chart, and the law in its metric."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj import cone as geometry
from nsaid_mj.cli import load
from nsaid_mj.errors import InvalidInput
from nsaid_mj.experiment import Cost, Seeds, trajectory
from nsaid_mj.identifiers import NullspaceAID, Status
from nsaid_mj.identifiers.cone_aid import ConeIdentifier
from nsaid_mj.identifiers.nullspace_aid import NullspaceIdentifier
from nsaid_mj.plants import ArmPlant, BlueROV2Plant, Plant

FEW = settings(deadline=None, max_examples=15)
seeds = st.integers(0, 2**32 - 1)
CONFIGS = {"rov": BlueROV2Plant(), "pendulum": ArmPlant(robot="double_pendulum")}
plants = pytest.mark.parametrize("name", CONFIGS)


@cache
def plant(name: str) -> Plant:
    return CONFIGS[name].build(1e-2 if name == "rov" else 1e-3, 3)


def inside(name: str, seed: int, error: float = 0.3) -> np.ndarray:
    p = plant(name)
    rng = np.random.default_rng(seed)
    return geometry.drawn_inside(p.system.space, p.truth, error, rng)


@cache
def rows(name: str, seconds: float) -> list:
    scenario = load("bluerov2" if name == "rov" else "double_pendulum")
    p = plant(name)
    rng = np.random.default_rng(Seeds.of(0).excitation)
    driver = scenario.excitation.build(p.system, p.truth, rng)
    with p.running():
        return list(trajectory(p, driver, round(seconds / p.dt), None, Cost()))


def identify(law: NullspaceIdentifier, measured: list) -> list:
    states = [law.init(measured[0])]
    for before, after in pairwise(measured):
        states.append(law.step(states[-1], before, after))
        assert states[-1].status is Status.completed
    return states


def build(name: str, prior: np.ndarray, gain: float = 1.0, mu: float = 1.0) -> ConeIdentifier:
    system, dt = plant(name).system, plant(name).dt
    return ConeIdentifier(system, np.full(system.n, 6.0), gain * system.space.scale**2, prior, dt,
                          mu)  # fmt: skip


# -- geometry ----------------------------------------------------------------------------------


@plants
@FEW
@given(seeds, st.floats(0, 2))
def test_what_is_drawn_is_inside_and_survives_the_chart(name, seed, error):
    cone, theta = geometry.cone_of(plant(name).system.space), inside(name, seed, error)
    assert geometry.inside(cone, theta) and np.isfinite(geometry.barrier(cone, theta))
    again = geometry.from_chart(cone, geometry.to_chart(cone, theta), geometry.coordinates(cone))
    np.testing.assert_allclose(again, theta, rtol=1e-9, atol=1e-12 * np.abs(theta).max())


@plants
@FEW
@given(seeds)
def test_any_chart_point_is_inside(name, seed):
    cone = geometry.cone_of(plant(name).system.space)
    eta = np.random.default_rng(seed).uniform(-2, 2, plant(name).system.p)
    theta = geometry.from_chart(cone, eta, geometry.coordinates(cone))
    assert geometry.inside(cone, theta)


@plants
@FEW
@given(seeds)
def test_the_barrier_is_logarithmically_homogeneous(name, seed):
    """b(sθ) = b(θ) − ν log s, so ∇b·θ = −ν and ∇²b θ = −∇b."""
    cone, theta = geometry.cone_of(plant(name).system.space), inside(name, seed)
    gradient, hessian = geometry.gradient_and_hessian(cone, theta)
    own = np.diag(hessian) > 0  # parameters of the cone; the others have no barrier
    assert gradient @ theta == pytest.approx(-cone.degree)
    np.testing.assert_allclose(hessian @ np.where(own, theta, 0), -gradient, rtol=1e-6,
                               atol=1e-9 * np.abs(gradient).max())  # fmt: skip
    fall = geometry.barrier(cone, theta) - geometry.barrier(cone, 3 * theta)
    assert fall == pytest.approx(cone.degree * np.log(3))


@plants
@FEW
@given(seeds)
def test_derivatives_are_differences(name, seed):
    cone, theta = geometry.cone_of(plant(name).system.space), inside(name, seed, 0.2)
    step = 1e-6 * (inside(name, seed + 1, 0.2) - theta)
    plus, minus = theta + step, theta - step
    gradient, hessian = geometry.gradient_and_hessian(cone, theta)
    rise = geometry.barrier(cone, plus) - geometry.barrier(cone, minus)
    assert rise == pytest.approx(2 * gradient @ step, rel=1e-4, abs=1e-9)
    turn = (geometry.gradient_and_hessian(cone, plus)[0]
            - geometry.gradient_and_hessian(cone, minus)[0])  # fmt: skip
    np.testing.assert_allclose(turn, 2 * hessian @ step, atol=1e-5 * np.abs(turn).max())
    eta = geometry.to_chart(cone, theta)
    moved = geometry.to_chart(cone, plus) - geometry.to_chart(cone, minus)
    rate = geometry.chart_rate(cone, eta, step)
    np.testing.assert_allclose(moved, 2 * rate, atol=1e-5 * np.abs(moved).max())


# -- the law -----------------------------------------------------------------------------------


@plants
def test_v_falls_and_the_conserved_quantity_stays(name):
    p, measured = plant(name), rows(name, 5.0)
    law = build(name, inside(name, 1))
    states = identify(law, measured)
    theta = np.array([s.theta_hat for s in states])
    conserved = law.conserved(theta)
    assert np.abs(conserved / conserved[0] - 1).max() < 1e-6
    V = []
    for m, s in zip(measured, states, strict=True):
        dv = s.v_hat - m.v
        M = p.system.mass_matrix(np.r_[m.q, m.v], p.truth)
        V.append(0.5 * dv @ M @ dv + float(law.divergence(p.truth, s.theta_hat)))
    V = np.array(V)
    assert V[-1] < 0.99 * V[0] and np.diff(V).max() < 1e-6 * V[0]


def test_no_start_and_no_gain_leaves_the_cone():
    """Where constant Γ loses M̂ > 0, the cone's metric does not."""
    cone, lost = geometry.cone_of(plant("rov").system.space), 0
    measured = rows("rov", 5.0)[:200]
    for seed in range(6):
        prior = inside("rov", seed, 1.0)
        states = identify(build("rov", prior, gain=100.0), measured)
        assert all(geometry.inside(cone, s.theta_hat) for s in states)
        system = plant("rov").system
        plain = NullspaceIdentifier(system, np.full(6, 6.0), 100.0 * system.space.scale**2, prior,
                                    plant("rov").dt)  # fmt: skip
        state = plain.init(measured[0])
        for before, after in pairwise(measured):
            state = plain.step(state, before, after)
            if state.status is not Status.completed:
                lost += 1
                break
    assert lost > 0


def test_the_compiled_body_step_is_the_general_one(monkeypatch):
    measured, law = rows("rov", 5.0)[:60], build("rov", inside("rov", 2))
    fast = identify(law, measured)[-1]
    monkeypatch.setattr(law, "_body_step", law._step)
    slow = identify(law, measured)[-1]
    scale = law.system.space.scale
    np.testing.assert_allclose(fast.theta_hat / scale, slow.theta_hat / scale, rtol=0, atol=1e-11)
    np.testing.assert_allclose(fast.v_hat, slow.v_hat, rtol=0, atol=1e-11)


def test_without_a_barrier_it_is_the_papers_law():
    p = plant("rov")
    config = NullspaceAID(K=6.0, gain=0.6, law="cone", barrier=0.0)
    law = config.build(p.system, p.truth, p.dt, True)
    assert type(law) is NullspaceIdentifier and not config.in_cone


def test_a_start_outside_the_cone_is_refused():
    p = plant("rov")
    prior = p.truth.copy()
    prior[0] = -1.0
    with pytest.raises(InvalidInput, match="cone"):
        build("rov", prior)
    with pytest.raises(InvalidInput, match="mu"):
        build("rov", p.truth, mu=0.0)
