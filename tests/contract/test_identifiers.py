"""One contract for all identifiers: pure functions, typed errors, no access to true values."""

import copy
import gc
import pickle
import types
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.base import State, Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.conventional import ConventionalAID, known_mask
from nsaid_mj.core.laws.metric import ConstantMetric
from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.laws.settings import MemoryConfig
from nsaid_mj.lab import loop as experiment
from nsaid_mj.lab.control.multisine import MultisineCommand
from nsaid_mj.lab.control.tracking import FourierTracking
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.record import RECORD_FILE
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.lab.setup import Setup
from nsaid_mj.watch import supervised
from tests.support.own_law import OwnConfig
from tests.support.plants import drive

FEW = settings(deadline=None, max_examples=15)
VEHICLES = ["bluerov2", "astrobee", "remus100", "hummingbird", "f1tenth", "uvms", "borinot"]


def packed(name: str) -> Scenario:
    """A packed scenario in steps of 1 ms, its Γ by scale."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    law = NullspaceAID(scenario.identifier.K, scenario.identifier.gain)
    return replace(scenario, identifier=law, dt=1e-3, record_every=1)


SCENARIOS = {
    "scalar": Scenario(ScalarRovPlant(), MultisineCommand(), NullspaceAID(K=5.0, gain=0.01)),
    "double_pendulum": Scenario(ArmPlant("double_pendulum"), FourierTracking(0.2)),
    "continuous": Scenario(ArmPlant("double_pendulum_continuous"), FourierTracking(0.2)),
    "kinova": Scenario(ArmPlant("kinova"), FourierTracking(0.2)),
} | {name: packed(name) for name in VEHICLES}
OFTEN = MemoryConfig(block=4e-3, interval=8e-3)
LAWS = {
    "NullspaceAID": NullspaceAID,
    "linear": lambda K, gain: NullspaceAID(K, gain, "linear"),
    "cone": lambda K, gain: NullspaceAID(K, gain, law="cone"),
    "memory": lambda K, gain: NullspaceAID(K, gain, law="memory", memory=OFTEN),
    "efficient": lambda K, gain: NullspaceAID(K, gain, law="efficient", memory=OFTEN),
    "ConventionalAID": lambda K, gain: ConventionalAID(K, gain, ("actuators",)),
    "own": OwnConfig,
}
FILTERED = ["scalar", "continuous", "bluerov2"]
"""Systems on which the law `efficient` is tried: each takes a minute to compile."""
ALL = [(s, law) for s in SCENARIOS for law in LAWS if law != "efficient" or s in FILTERED]
contract = pytest.mark.parametrize("name,law", ALL)
of_the_package = pytest.mark.parametrize("name,law", [x for x in ALL if x[1] != "own"])
constant = pytest.mark.parametrize(
    "name,law", [x for x in ALL if x[1] not in ("cone", "memory", "efficient", "own")]
)
systems = pytest.mark.parametrize("name", SCENARIOS)
runs = pytest.mark.parametrize("name", ["scalar", "double_pendulum", "continuous", *VEHICLES])


@cache
def motion(name: str):
    """(system, prior in the cone, 41 measurements) of a driven plant, dt = 1 ms."""
    scenario = replace(SCENARIOS[name], dt=1e-3, rivals={"cone": NullspaceAID(law="cone")})
    setup = Setup.of(scenario)
    plant, prior = setup.plant, setup.prior
    driver = scenario.excitation.build(plant.system, prior, np.random.default_rng(0))
    seen = drive(plant, driver, 0.04).rows
    return plant.system, prior, seen


def build(name: str, law: str):
    system, prior, _ = motion(name)
    config = SCENARIOS[name].identifier
    return supervised(LAWS[law](config.K, config.gain).build(system, prior, 1e-3))


def identify(identifier, seen) -> list[State]:
    states = [identifier.init(seen[0])]
    for previous, now in pairwise(seen):
        states.append(identifier.step(states[-1], previous, now))
    return states


def assert_same(one: State, other: State) -> None:
    """Equal to the bit."""
    for a, b in zip(one[:5], other[:5], strict=True):
        assert np.array_equal(np.asarray(a), np.asarray(b))
    assert pickle.dumps(one[5:]) == pickle.dumps(other[5:])


# -- init and step -----------------------------------------------------------------------------


@contract
def test_an_identifier_starts_at_the_measured_velocity_and_the_prior(name, law):
    system, prior, seen = motion(name)
    state = build(name, law).init(seen[3])
    assert (state.v_hat - seen[3].v == 0).all()  # (46): Δv(t₀) = 0
    assert (state.theta_hat == prior).all()
    assert state.t == seen[3].t and state.status is Status.completed and state.pivot > 0
    assert state.v_hat.shape == (system.n,) and state.theta_hat.shape == (system.p,)


@contract
def test_estimates_stay_finite_and_adapt_along_the_measurements(name, law):
    _, prior, seen = motion(name)
    states = identify(build(name, law), seen)
    for state, now in zip(states, seen, strict=True):
        assert state.t == now.t and state.status is Status.completed and state.pivot > 0
        assert np.isfinite(state.v_hat).all() and np.isfinite(state.theta_hat).all()
    assert (states[-1].theta_hat != prior).any()


@contract
def test_same_input_same_bits(name, law):
    _, _, seen = motion(name)
    one, again, fresh = build(name, law), build(name, law), build(name, law)
    states = identify(one, seen)
    for k in (20, 3, 20, 39):  # in any order, any number of times, by any instance
        assert_same(one.step(states[k], seen[k], seen[k + 1]), states[k + 1])
    for state, other in zip(states, identify(again, seen), strict=True):
        assert_same(state, other)
    assert_same(fresh.step(states[7], seen[7], seen[8]), states[8])


@contract
def test_step_leaves_its_inputs_alone(name, law):
    _, prior, seen = motion(name)
    identifier = build(name, law)
    state = identify(identifier, seen[:5])[-1]
    inputs = [*seen[4][1:], *seen[5][1:], state.v_hat, state.theta_hat, prior]
    kept = copy.deepcopy(inputs)
    identifier.step(state, seen[4], seen[5])
    for array, before in zip(inputs, kept, strict=True):
        assert (array == before).all()


@systems
def test_identifiers_on_one_system_do_not_disturb_each_other(name):
    _, _, seen = motion(name)
    laws = [law for system, law in ALL if system == name]
    alone = {law: identify(build(name, law), seen)[-1] for law in laws}
    together = {law: build(name, law) for law in laws}
    states = {law: identifier.init(seen[0]) for law, identifier in together.items()}
    for previous, now in pairwise(seen):
        states = {law: together[law].step(states[law], previous, now) for law in laws}
    for law in laws:
        assert_same(states[law], alone[law])


@contract
def test_time_must_increase(name, law):
    _, _, seen = motion(name)
    identifier = build(name, law)
    state = identifier.init(seen[4])
    for back in (0.0, -1e-3, np.nan):
        with pytest.raises(InvalidInput) as caught:
            identifier.step(state, seen[4], seen[5]._replace(t=seen[4].t + back))
        assert caught.value.name == "t" and caught.value.remedy, back


@contract
def test_a_first_measurement_that_is_not_finite_is_refused(name, law):
    _, _, seen = motion(name)
    identifier = build(name, law)
    for field in ("t", "q", "v", "u"):
        good = getattr(seen[0], field)
        for value in (np.asarray(good) * np.nan, np.append(good, 0.0)):
            with pytest.raises(InvalidInput) as caught:
                identifier.init(seen[0]._replace(**{field: value}))
            assert caught.value.name == field


# -- gains -------------------------------------------------------------------------------------


def asymmetric(size: int):
    gain = np.eye(size)
    gain[0, -1] = 1e-3
    return gain


BAD_GAINS = {
    "too short": lambda size: np.ones(size - 1),
    "too long": lambda size: np.ones(size + 1),
    "a number": lambda size: np.float64(1.0),
    "not square": lambda size: np.ones((size, size + 1)),
    "zero": lambda size: np.r_[0.0, np.ones(size - 1)],
    "negative": lambda size: np.r_[np.ones(size - 1), -1.0],
    "singular": lambda size: np.ones((size, size)),
    "indefinite": lambda size: np.eye(size) - 2.0 * np.ones((size, size)) / size,
    "asymmetric": asymmetric,
    "NaN": lambda size: np.r_[np.nan, np.ones(size - 1)],
    "NaN inside": lambda size: np.eye(size) * np.nan,
    "infinite": lambda size: np.r_[np.inf, np.ones(size - 1)],
}


@pytest.mark.parametrize("name", ["double_pendulum", "kinova"])
@pytest.mark.parametrize("gain", ["K", "Gamma"])
@pytest.mark.parametrize("bad", BAD_GAINS)
def test_a_gain_is_positive_definite(name, gain, bad):
    system, prior, _ = motion(name)
    gains: dict[str, Any] = {"K": np.ones(system.n), "Gamma": np.ones(system.p)}
    gains[gain] = BAD_GAINS[bad](len(gains[gain]))
    with pytest.raises(InvalidInput) as caught:
        paper_identifier(system, **gains, prior=prior, dt=1e-3)
    assert caught.value.name == gain and caught.value.remedy


@systems
@pytest.mark.parametrize(
    "change", [lambda x: x[:-1], lambda x: np.append(x, 1.0), lambda x: x * np.nan]
)
def test_a_prior_is_one_number_for_each_parameter(name, change):
    system, prior, _ = motion(name)
    with pytest.raises(InvalidInput) as caught:
        paper_identifier(system, np.ones(system.n), np.ones(system.p), change(prior), 1e-3)
    assert caught.value.name == "prior"


@of_the_package
def test_K_is_within_what_rk4_can_follow(name, law):
    system, prior, _ = motion(name)
    LAWS[law](2.49e3, 1.0).build(system, prior, 1e-3)
    with pytest.raises(InvalidInput, match="K ≤ 2500") as caught:
        LAWS[law](2.51e3, 1.0).build(system, prior, 1e-3)
    assert caught.value.name == "K"
    K = 2e3 * np.eye(system.n) + 600.0 * np.ones((system.n, system.n))  # λ_max = 2000 + 600 n
    with pytest.raises(InvalidInput, match="λ_max"):
        paper_identifier(system, K, np.ones(system.p), prior, 1e-3)


@systems
def test_a_diagonal_gain_and_its_matrix_give_the_same_estimate(name):
    system, prior, seen = motion(name)
    K, Gamma = np.full(system.n, 20.0), system.space.scale**2
    diagonal, full = (
        paper_identifier(system, *gains, prior=prior, dt=1e-3)
        for gains in ((K, Gamma), (np.diag(K), np.diag(Gamma)))
    )
    one, two = identify(diagonal, seen)[-1], identify(full, seen)[-1]
    np.testing.assert_allclose(one.theta_hat, two.theta_hat, rtol=1e-12)
    np.testing.assert_allclose(one.v_hat, two.v_hat, rtol=1e-10, atol=1e-13)
    assert diagonal.conserved(prior) == pytest.approx(full.conserved(prior), rel=1e-9)


# -- bad estimates -----------------------------------------------------------------------------


@constant
def test_an_indefinite_mass_matrix_is_a_status(name, law):
    system, prior, seen = motion(name)
    for theta in (-prior, 0 * prior):
        identifier = LAWS[law](5.0, 0.01).build(system, theta, 1e-3)
        state = identifier.init(seen[0])
        ended = identifier.step(state, seen[0], seen[1])
        assert ended.status is Status.estimate_not_positive_definite and not ended.pivot > 0
        assert (ended.theta_hat == theta).all() and (ended.v_hat == seen[0].v).all()
        assert ended.t == state.t and ended.status.words and ended.status.remedy


@systems
def test_an_indefinite_mass_matrix_within_a_step_ends_it(name):
    """A gain that throws θ̂ out of the cone between two measurements ends with the last good one."""
    system, prior, seen = motion(name)
    wild = NullspaceAID(K=5.0, gain=1e9).build(system, prior, 1e-3)
    states = identify(wild, seen[:2])
    while states[-1].status is Status.completed and len(states) < 40:
        k = len(states) - 1
        states.append(wild.step(states[-1], seen[k], seen[k + 1]))
    assert states[-1].status is Status.estimate_not_positive_definite
    assert np.isfinite(states[-1].theta_hat).all() and np.isfinite(states[-1].v_hat).all()
    np.testing.assert_array_equal(states[-1].theta_hat, states[-2].theta_hat)


# -- symmetry and what is held -----------------------------------------------------------------


@constant
def test_the_scale_of_theta_is_a_symmetry(name, law):
    """W(αθ̂) = W(θ̂) by (29), so θ̂ → αθ̂ with Γ → αΓ leaves v̂(t) and scales θ̂(t)."""
    _, prior, seen = motion(name)
    one = build(name, law)

    def scaled(alpha):
        other = copy.copy(one)
        held = None if one.conserves else one.metric.Gamma == 0
        other.metric = ConstantMetric(alpha * one.metric.Gamma, held)
        other.prior = alpha * one.prior
        return identify(other, seen)

    states = identify(one, seen)
    for state, fourfold in zip(states, scaled(4.0), strict=True):  # √4 is exact in binary
        assert (fourfold.v_hat == state.v_hat).all()
        assert (fourfold.theta_hat == 4.0 * state.theta_hat).all()
    thrice = scaled(3.0)[-1]
    np.testing.assert_allclose(thrice.v_hat, states[-1].v_hat, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(thrice.theta_hat, 3.0 * states[-1].theta_hat, rtol=1e-9)
    assert (states[-1].theta_hat != prior).any()


@systems
def test_the_conserved_quantity_stays_while_the_velocity_error_changes(name):
    _, _, seen = motion(name)
    identifier = build(name, "NullspaceAID")
    states = identify(identifier, seen)
    conserved = identifier.conserved(np.array([state.theta_hat for state in states]))
    assert conserved.shape == (41,)
    np.testing.assert_allclose(conserved, conserved[0], rtol=1e-9)  # (30)
    assert np.abs(states[-1].v_hat - seen[-1].v).max() > 0


@systems
def test_known_parameters_stay_to_the_bit_and_the_others_adapt(name):
    system, prior, seen = motion(name)
    first = system.space.names[0]
    for known in (("actuators",), (first,), (first, "actuators")):
        config = SCENARIOS[name].identifier
        identifier = ConventionalAID(config.K, config.gain, known).build(system, prior, 1e-3)
        held = known_mask(system.space, known)
        actuators = len(system.space.actuators)
        assert held.sum() == (first in known) + ("actuators" in known) * actuators
        for state in identify(identifier, seen)[1:]:
            assert state.theta_hat[held].tobytes() == prior[held].tobytes()
            moved = state.theta_hat[~held] != prior[~held]
        assert moved.mean() > 0.3
        assert not identifier.conserves


@systems
def test_a_whole_block_may_be_declared_known_by_name(name):
    space = motion(name)[0].space
    block, place = next(iter(space))
    mask = known_mask(space, (block.name,))
    assert mask[place].all() and mask.sum() == len(block)


@systems
@pytest.mark.parametrize("known", ["nothing", "everything"])
def test_declaring_nothing_or_everything_known_is_refused(name, known):
    space = motion(name)[0].space
    names = () if known == "nothing" else tuple(space.names)
    with pytest.raises(InvalidInput) as caught:
        known_mask(space, names)
    assert caught.value.name == "known"


@FEW
@given(st.integers(0, 2**32 - 1))
def test_a_zero_velocity_error_is_an_equilibrium_of_theta(seed):
    """Under the true θ, v̂ = v solves (44), so θ̂ moves only by what RK4 misses in a step."""
    system, _, seen = motion("double_pendulum")
    scenario = replace(SCENARIOS["double_pendulum"], initial_error=0.0)
    setup = Setup.of(scenario)
    truth, identifiers = setup.prior, setup.identifiers()
    wrong = truth * (1 + 0.3 * np.random.default_rng(seed).uniform(-1, 1, system.p))
    other = NullspaceAID().build(system, wrong, 1e-3)

    def moved(identifier, prior):
        step = identify(identifier, seen)[-1].theta_hat - prior
        return np.linalg.norm(step / system.space.scale)

    assert moved(identifiers[""], truth) < 1e-4 * moved(other, wrong)


# -- the wall ----------------------------------------------------------------------------------


RUN = {"duration": 0.25, "pe_window": 0.1, "rivals": {"known": ConventionalAID(5.0, 0.01)}}


def record(name: str, folder, **changes) -> bytes:
    run = experiment.run(replace(SCENARIOS[name], **(RUN | changes)), folder)
    assert run.ending.status is Status.completed and len(run.record) == 251
    return (folder / RECORD_FILE).read_bytes()


class Often(experiment.Observer):
    """Looks seven steps after seven steps."""

    period, looks = 7e-3, 0

    def start(self, scenario, robot, first) -> None:
        pass

    def see(self, log, states, levels) -> None:
        self.looks += 1

    def stop(self) -> None:
        pass


@pytest.mark.parametrize("law", ["paper", "cone", "memory", "efficient"])
@pytest.mark.parametrize("sensors", ["ideal", "noisy"])
@pytest.mark.parametrize("name", ["scalar", "continuous", "bluerov2"])
def test_observer_period_does_not_change_the_record(name, sensors, law, tmp_path):
    """A run goes by stretches, as long as nobody wants to look in between."""
    identifier = replace(SCENARIOS[name].identifier, law=law)
    if law in ("memory", "efficient"):
        identifier = replace(identifier, memory=MemoryConfig(block=0.01, interval=0.05))
    changes = {"sensors": sensors, "identifier": identifier}
    alone, often = record(name, tmp_path / "alone", **changes), Often()
    scenario = replace(SCENARIOS[name], **(RUN | changes))
    experiment.run(scenario, tmp_path / "watched", often)
    assert often.looks > 30 * 1e-3 / scenario.dt
    assert (tmp_path / "watched" / RECORD_FILE).read_bytes() == alone


class ReachedError(Exception):
    """Somebody has read the truth."""


def poison(plant: Plant, monkeypatch) -> None:
    """From now on nobody reads what is true of this plant but MuJoCo."""

    def truth(self):
        raise ReachedError

    monkeypatch.setattr(type(plant), "truth", property(truth))
    plant._truth[:] = np.nan  # pyright: ignore


WALLED = [(name, "paper") for name in ["scalar", "double_pendulum", "continuous", *VEHICLES]]
WALLED += [(name, "memory") for name in ["scalar", "double_pendulum", "bluerov2", "f1tenth"]]
WALLED += [(name, "efficient") for name in FILTERED]


@pytest.mark.parametrize("name,law", WALLED)
@pytest.mark.parametrize("sensors", ["ideal", "noisy"])
def test_with_a_poisoned_truth_the_record_is_the_same_to_the_bit(
    name, law, sensors, tmp_path, monkeypatch
):
    identifier = replace(SCENARIOS[name].identifier, law=law)
    if law in ("memory", "efficient"):
        identifier = replace(identifier, memory=MemoryConfig(block=0.01, interval=0.05))
    changes = {"sensors": sensors, "identifier": identifier}
    clean = record(name, tmp_path / "clean", **changes)
    spent = experiment.Record.read(tmp_path / "clean")["spent"]
    assert spent.any() == (law in ("memory", "efficient"))
    honest, poisoned = Setup.of, []

    def poisoned_setup(scenario):
        setup = honest(scenario)
        poison(setup.plant, monkeypatch)  # before driver and identifiers are built
        poisoned.append(setup.plant)
        return setup

    monkeypatch.setattr(Setup, "of", poisoned_setup)
    assert record(name, tmp_path / "poisoned", **changes) == clean
    with pytest.raises(ReachedError):
        _ = poisoned[0].truth


@systems
def test_no_identifier_or_driver_can_reach_the_plant(name):
    """Nothing that an identifier or driver refers to, however far, is the plant or MuJoCo's."""
    scenario = replace(SCENARIOS[name], **RUN)
    setup = Setup.of(scenario)
    plant, driver, identifiers = setup.plant, setup.driver(), setup.identifiers()
    left, seen = [driver, *identifiers.values()], {}
    while left:
        thing = left.pop()
        if id(thing) in seen or isinstance(thing, type | types.ModuleType):
            continue
        seen[id(thing)] = thing  # kept alive, so that no two share an id
        if isinstance(thing, types.FunctionType):
            left += [thing.__closure__, thing.__defaults__, thing.__dict__]  # but no globals
            continue
        assert not isinstance(thing, Plant | mujoco.MjModel | mujoco.MjData | mujoco.MjSpec)
        if isinstance(thing, np.ndarray) and thing.size:
            assert not np.shares_memory(thing, plant.truth)
        left += [*gc.get_referents(thing), *getattr(thing, "__dict__", {}).values()]
    assert any(thing is plant.system for thing in seen.values())


# -- seeds -------------------------------------------------------------------------------------


@runs
@pytest.mark.parametrize("sensors", ["ideal", "noisy"])
def test_one_seed_one_record_another_seed_another(name, sensors, tmp_path):
    one, same = (record(name, tmp_path / part, sensors=sensors) for part in ("one", "same"))
    assert one == same
    record(name, tmp_path / "other", sensors=sensors, seed=1)
    a, b = (experiment.Record.read(tmp_path / part) for part in ("one", "other"))
    for column in ("q", "v", "u", "v_hat", "theta_hat", "theta_hat_known"):
        assert (a[column] != b[column]).any(), column
    assert (a["t"] == b["t"]).all()


@runs
def test_noisy_sensors_have_their_stated_levels(name, tmp_path):
    records = {}
    for sensors in ("ideal", "noisy"):
        record(name, tmp_path / sensors, sensors=sensors)
        records[sensors] = experiment.Record.read(tmp_path / sensors)
    ideal, noisy = records["ideal"], records["noisy"]
    system = motion(name)[0]
    assert (ideal["theta_hat"][0] == noisy["theta_hat"][0]).all()  # one prior
    assert (ideal["theta_hat"][-1] != noisy["theta_hat"][-1]).any()
    noise = SCENARIOS[name].noise
    jitter = np.diff(noisy["v"] - ideal["v"], axis=0)  # white: √2 σ
    assert np.std(jitter) == pytest.approx(2**0.5 * noise.velocity, rel=0.2)
    steps = [system.difference(a, b) for a, b in zip(ideal["q"], noisy["q"], strict=True)]
    assert np.std(np.diff(steps, axis=0)) == pytest.approx(2**0.5 * noise.position, rel=0.2)
