"""The simulated gain: an expected Gramian of the prior and the excitation alone."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.config import NullspaceAID, floored_inverse
from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab import expected_gramian as simulation
from nsaid_mj.lab import loop as experiment
from nsaid_mj.lab import setup
from nsaid_mj.lab.control.driver import Driver, DriverConfig
from nsaid_mj.lab.control.multisine import MultisineCommand
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.expected_gramian import expected_gramian
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant
from nsaid_mj.lab.plants.world.simulated import SimulatedRobot
from nsaid_mj.lab.record import RECORD_FILE
from nsaid_mj.lab.scenario import Scenario
from tests.support.bench import TwoVehicles
from tests.support.strategies import seeds
from tests.support.summaries import summarize
from tests.support.vehicles import VEHICLES

FEW = settings(deadline=None, max_examples=25)
THETA = np.array([2.0, 1.5, 0.3, 3.0, 1.0, 0.8, -0.2, 2.0])


@dataclass
class Waves(Driver):
    """A driver that starts anywhere and pushes in sines, of no system in particular."""

    n: int
    n_u: int
    size: float = 0.3

    def start(self) -> tuple[Array, Array]:
        return 0.1 * np.cos(np.arange(self.n)), 0.2 * np.sin(1 + np.arange(self.n))

    def command(self, t: float, q: Array, v: Array) -> Array:
        return 0.4 + self.size * np.sin((1 + 0.3 * np.arange(self.n_u)) * t)

    def compiled(self, t: Array) -> None:
        """Only `command` computes it."""


# -- the Gramian ---------------------------------------------------------------------------------


def test_the_expected_gramian_is_the_mean_of_its_definition():
    """By hand, on two vehicles in one dimension: M and W written out, the motion by scipy."""
    system, dt, steps = TwoVehicles(), 0.01, 200
    driver = Waves(2, 2)
    found = expected_gramian(system, driver, THETA, dt, steps * dt)
    expected, (q, v) = np.zeros((8, 8)), driver.start()
    for k in range(steps):
        u = driver.command(k * dt, q, v)
        for i in range(2):
            m, d, g, a = THETA[4 * i : 4 * i + 4]
            rate = (a * u[i] - d * abs(v[i]) * v[i] - g) / m
            row = np.zeros(8)
            row[4 * i : 4 * i + 4] = [rate, abs(v[i]) * v[i], 1.0, -u[i]]
            expected += np.outer(row, row) / m

        def flow(t: float, x: Array, u: Array = u) -> Array:
            m, d, g, a = THETA.reshape(2, 4).T
            return np.r_[x[2:], (a * u - d * np.abs(x[2:]) * x[2:] - g) / m]

        q, v = np.split(solve_ivp(flow, (0, dt), np.r_[q, v], rtol=1e-10, atol=1e-12).y[:, -1], 2)
    np.testing.assert_allclose(found, expected / steps, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("name", ["bluerov2", "f1tenth", "uvms"])
def test_the_rehearsed_motion_is_that_of_the_system(name):
    """The Gramian's trajectory against one with a step of a tenth, and scales taken in."""
    plant = VEHICLES[name].build(1e-3, 1)
    system, theta, scale = plant.system, plant.truth, plant.system.space.scale
    driver = load(name).excitation.build(system, theta, np.random.default_rng(0))
    dt, seen = 0.01, []

    class Spy(Driver):
        def start(self) -> tuple[Array, Array]:
            return driver.start()

        def command(self, t: float, q: Array, v: Array) -> Array:
            seen.append((t, q, v, driver.command(t, q, v)))
            return seen[-1][3]

    found = expected_gramian(system, Spy(), theta, dt, 20 * dt)
    assert [row[0] for row in seen] == pytest.approx(dt * np.arange(20))
    for (_, q, v, u), (_, later, faster, _) in pairwise(seen):
        x = np.r_[q, v]
        for _ in range(20):  # midpoint rule
            step = dt / 20

            def rate(x: Array, u: Array = u) -> Array:
                a = system.acceleration(0.0, x, x[system.m :], u, theta)
                return np.r_[system.J(x[: system.m]) @ x[system.m :], a]

            x = x + step * rate(x + step / 2 * rate(x))
        size = 1 + np.abs(faster).max()
        assert np.abs(system.difference(x[: system.m], later)).max() <= 1e-5 * size
        assert np.abs(x[system.m :] - faster).max() <= 1e-4 * size
    direct = np.zeros((system.p, system.p))
    for t, q, v, u in seen:
        x = np.r_[q, v]
        a = system.acceleration(t, x, v, u, theta)
        W = system.regressor(t, x, v, a, u) * scale
        direct += W.T @ np.linalg.inv(system.mass_matrix(x, theta)) @ W / len(seen)
    np.testing.assert_allclose(found, direct, rtol=1e-8, atol=1e-9 * np.abs(direct).max())


@pytest.mark.parametrize("name", VEHICLES)
def test_the_expected_gramian_is_semidefinite_and_blind_to_the_prior(name):
    """Symmetric, positive semidefinite, finite; and W θ = 0 (30): θ/scale is in its nullspace."""
    plant = VEHICLES[name].build(1e-3, 1)
    system = plant.system
    prior = plant.truth * (1 + 0.1 * np.random.default_rng(1).uniform(-1, 1, system.p))
    _, v, _ = system.random_state(np.random.default_rng(2))
    waves = Waves(system.n, system.n_u)
    waves.start = lambda: (0.1 * np.ones(system.n), v)  # under way, as cars must be
    H = expected_gramian(system, waves, prior, 2e-3, 0.1)
    assert H.shape == (system.p, system.p) and np.isfinite(H).all()
    size = np.abs(H).max()
    assert size > 0 and np.abs(H - H.T).max() <= 1e-14 * size
    values = np.linalg.eigvalsh(H)
    assert values[0] >= -1e-13 * values[-1]
    along = prior / system.space.scale
    assert np.abs(H @ along).max() <= 1e-8 * size * np.abs(along).max()


@pytest.mark.parametrize("steps", [1, 5, 2999, 3001, pytest.param(9000, marks=pytest.mark.slow)])
def test_a_long_rehearsal_is_subsampled(steps, monkeypatch):
    """At most 3000 samples, evenly over the whole motion; every one of them where there are few."""
    system, solved = TwoVehicles(), []
    honest = np.linalg.cholesky
    monkeypatch.setattr(np.linalg, "cholesky", lambda M: solved.append(1) or honest(M))
    expected_gramian(system, Waves(2, 2), THETA, 0.01, steps * 0.01)
    assert len(solved) <= simulation._SAMPLES
    assert len(solved) > min(steps, simulation._SAMPLES) / 2 - 1
    if steps <= simulation._SAMPLES:
        assert len(solved) == steps


def test_rehearsal_is_deterministic_and_leaves_its_inputs_unchanged():
    plant = BlueROV2Plant().build(1e-2, 1)
    theta = plant.truth.copy()
    one, two = (expected_gramian(plant.system, Waves(6, 8), theta, 0.01, 1.0) for _ in range(2))
    assert (one == two).all() and (theta == plant.truth).all()


# -- motions that end ----------------------------------------------------------------------------


def wrong(kind: str) -> tuple[SecondOrderSystem, Array]:
    """A system, and a θ under which its motion cannot be simulated."""
    plant = BlueROV2Plant().build(1e-2, 1)
    theta, space = plant.truth.copy(), plant.system.space
    if kind == "no mass":
        theta[space["mass matrix"]] *= -1
    elif kind == "indefinite":
        theta[space.index("M_15")] = 1e3
    elif kind == "not a number":
        theta[space.index("net weight")] = np.nan
    else:
        theta[space["quadratic drag"]] *= -50
    return plant.system, theta


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", ["no mass", "indefinite", "not a number", "drag that pushes"])
def test_a_prior_that_cannot_be_simulated_is_refused_with_the_remedy(kind):
    system, theta = wrong(kind)
    with pytest.raises(InvalidInput) as caught:
        expected_gramian(system, Waves(6, 8), theta, 0.01, 60.0)
    assert caught.value.name == "gamma" and "--gamma scale" in caught.value.remedy


@pytest.mark.filterwarnings("error")
def test_a_run_whose_prior_cannot_be_simulated_writes_nothing(tmp_path):
    hopeless = simulated("bluerov2", initial_error=20.0)
    with pytest.raises(InvalidInput) as caught:
        experiment.run(hopeless, tmp_path / "out")
    assert caught.value.remedy and not (tmp_path / "out").exists()


# -- the gain ------------------------------------------------------------------------------------


@FEW
@given(seeds, st.integers(1, 12), st.floats(1e-6, 1.0))
def test_a_floored_inverse_is_the_inverse_above_its_floor(seed, p, floor):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.standard_normal((p, p)))[0]
    values = 10.0 ** rng.uniform(-9, 3, p) * rng.choice([0, 1], p, p=[0.2, 0.8])
    values[0] = 10.0 ** rng.uniform(0, 3)
    H = (axes * values) @ axes.T
    inverse = floored_inverse(0.5 * (H + H.T), floor)
    raised = np.maximum(values, floor * values.max())
    np.testing.assert_allclose(
        inverse, (axes / raised) @ axes.T, atol=1e-7 / (floor * values.max())
    )
    assert (inverse == inverse.T).all()
    eigenvalues = np.linalg.eigvalsh(inverse)
    assert eigenvalues[0] > 0 and eigenvalues[-1] <= 1.001 / (floor * values.max())
    if floor == 1.0:
        np.testing.assert_allclose(inverse, np.eye(p) / values.max(), rtol=1e-9, atol=1e-12)


def test_a_gain_for_a_motion_without_excitation_is_refused():
    with pytest.raises(InvalidInput) as caught, np.errstate(all="ignore"):
        system = ScalarRovPlant().build(1e-2, 0).system
        law = NullspaceAID(gamma="simulated")
        law.build(system, np.ones(4), 0.01, gramian=lambda: np.zeros((4, 4)))
    assert caught.value.remedy


def test_a_simulated_gain_without_a_driver_is_refused():
    plant = ScalarRovPlant().build(1e-2, 0)
    with pytest.raises(InvalidInput) as caught:
        NullspaceAID(gamma="simulated").build(plant.system, plant.truth, 0.01)
    assert caught.value.name == "gamma" and caught.value.remedy


def test_the_simulated_gain_gives_every_direction_the_same_rate():
    """Γ = rate·K·S H⁻¹ S: in θ/scale, Γ H / K is rate·I where H is above the floor."""
    plant = BlueROV2Plant().build(1e-2, 1)
    system, p = plant.system, plant.system.p
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.standard_normal((p, p)))[0]
    values = np.r_[1e-6, np.geomspace(0.1, 10, p - 1)]
    H = (axes * values) @ axes.T
    law = NullspaceAID(K=6.0, gamma="simulated", rate=0.2, floor=1e-3)
    identifier = law.build(system, plant.truth, 0.01, gramian=lambda: 0.5 * (H + H.T))
    assert isinstance(identifier, NullspaceIdentifier) and identifier.metric.Gamma.shape == (p, p)
    scale = system.space.scale
    rates = axes.T @ (identifier.metric.Gamma / np.outer(scale, scale)) @ H @ axes / 6.0
    np.testing.assert_allclose(rates, np.diag(0.2 * values / np.maximum(values, 0.01)), atol=1e-8)


def test_a_gain_by_scale_needs_no_rehearsal():
    def never() -> Array:
        raise AssertionError

    plant = ScalarRovPlant().build(1e-2, 0)
    law = NullspaceAID(gamma="scale", gain=0.5)
    identifier = law.build(plant.system, plant.truth, 0.01, gramian=never)
    assert isinstance(identifier, NullspaceIdentifier)
    assert (identifier.metric.Gamma == 0.5 * plant.system.space.scale**2).all()


def test_two_identifiers_of_a_run_share_one_rehearsal(monkeypatch):
    calls = []
    honest = simulation.expected_gramian
    monkeypatch.setattr(
        simulation, "expected_gramian", lambda *a: calls.append(a[-1]) or honest(*a)
    )
    law = NullspaceAID(K=6.0, gamma="simulated")
    scenario = replace(load("bluerov2"), identifier=law, rivals={"twin": law}, duration=2.0)
    identifiers = setup.Setup.of(scenario).identifiers()
    assert calls == [2.0]  # and no longer than the run
    assert (identifiers[""].metric.Gamma == identifiers["twin"].metric.Gamma).all()  # pyright: ignore


# -- the wall ------------------------------------------------------------------------------------


SHORT = {"duration": 2.0, "held_out": 1.0, "pe_window": 1.0}


def simulated(name: str, **changes) -> Scenario:
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    return replace(scenario, identifier=replace(scenario.identifier, gamma="simulated"), **changes)


@pytest.mark.parametrize("name", ["bluerov2", "astrobee"])
@pytest.mark.parametrize("gamma", ["simulated", "scale"])
def test_removing_the_truth_after_the_prior_does_not_change_the_record(
    name, gamma, tmp_path, monkeypatch
):
    """The gain's design comes after the prior: from there on nobody reads what is true."""
    scenario = simulated(name, **SHORT)
    scenario = replace(scenario, identifier=replace(scenario.identifier, gamma=gamma))
    experiment.run(scenario, tmp_path / "clean")
    experiment.run(scenario, tmp_path / "again")
    clean = (tmp_path / "clean" / RECORD_FILE).read_bytes()
    assert (tmp_path / "again" / RECORD_FILE).read_bytes() == clean

    class ReachedError(Exception):
        pass

    def nobody(self: SimulatedRobot) -> Array:
        raise ReachedError

    honest = setup.draw_prior

    def draw_prior(truth: Array, *rest) -> Array:
        prior = honest(truth, *rest)
        truth[:] = np.nan
        monkeypatch.setattr(SimulatedRobot, "truth", property(nobody))
        return prior

    monkeypatch.setattr(setup, "draw_prior", draw_prior)
    experiment.run(scenario, tmp_path / "poisoned")
    assert (tmp_path / "poisoned" / RECORD_FILE).read_bytes() == clean


def test_the_simulated_gain_depends_on_prior_and_excitation_only():
    def gain(scenario: Scenario) -> Array:
        return setup.Setup.of(scenario).identifiers()[""].metric.Gamma  # pyright: ignore

    base = simulated("bluerov2", duration=3.0)
    assert (gain(base) == gain(replace(base, sensors="noisy", held_out=7.0))).all()
    assert (gain(base) != gain(replace(base, initial_error=0.2))).any()
    gentle: DriverConfig = MultisineCommand(low=0.1, high=1.0, amplitude=0.4)
    assert (gain(base) != gain(replace(base, excitation=gentle))).any()


# -- a run ---------------------------------------------------------------------------------------


def test_the_simulated_gain_beats_the_scaled_one_and_the_summary_names_it(tmp_path):
    summaries = {}
    base = simulated("bluerov2", duration=60.0, held_out=5.0, record_every=5)
    base = replace(base, identifier=replace(base.identifier, rate=0.3, floor=1e-3))
    for gamma in ("scale", "simulated"):
        scenario = replace(base, identifier=replace(base.identifier, gamma=gamma))
        done = experiment.run(scenario, tmp_path / gamma)
        summary = summarize(done, Truth.of(done))
        assert summary["gamma"] == gamma and summary["status"] == "completed"
        assert summary["lyapunov_violations"] == 0 and summary["conserved_drift"] < 1e-5
        assert json.loads(scenario.to_json())["identifier"]["gamma"] == gamma
        assert Scenario.from_json(scenario.to_json()) == scenario
        summaries[gamma] = summary["theta_perp_ratio"]
    assert summaries["simulated"] < 0.5 * summaries["scale"]
