"""The law with a memory: implicit steps that lower V at any size, and stated deviations."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.cli.grammar import RunOptions
from nsaid_mj.core.laws.base import State, Status
from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.memory.implicit import ImplicitMemory
from nsaid_mj.core.laws.memory.statistics import Memory
from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier
from nsaid_mj.core.laws.settings import MemoryConfig
from nsaid_mj.core.log import EXACT, Measurement, SensorLevels
from nsaid_mj.core.log import Log as Measured
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.quotient.cost import Quotient, Remembered
from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.evaluation.confidence import KnownDirections, known
from nsaid_mj.lab.evaluation.lyapunov import energy, rises_of
from nsaid_mj.lab.evaluation.truth import Truth, actuator_ratio_error
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.options import parse_flags
from nsaid_mj.lab.plants.world.noise import SensorNoise
from nsaid_mj.lab.postprocessing import rebuild
from nsaid_mj.lab.record import RECORD_FILE
from nsaid_mj.lab.scenario import Scenario
from tests.support.bench import followed, identify
from tests.support.remembered import Log, driven, noisy, scenario_plant
from tests.support.summaries import summarize

NOISE = SensorNoise()
NAMES = ["bluerov2", "double_pendulum", "f1tenth"]


def inside(log: Log, seed: int, error: float = 0.3) -> Array:
    space, rng = log.plant.system.space, np.random.default_rng(seed)
    return Prior(space, log.plant.truth, error).draw(rng)


def build(
    name: str, prior: Array, levels: SensorLevels = EXACT, interpolation: str = "auto", **memory
) -> NullspaceIdentifier:
    """A packed scenario's identifier with a memory."""
    scenario, log = load(name), driven(name, 0.1)
    assert isinstance(scenario.identifier, NullspaceAID)
    config = replace(
        scenario.identifier,
        law="memory",
        memory=MemoryConfig(**memory),
        interpolation=interpolation,
    )
    law = config.build(log.plant.system, prior, log.dt, levels)
    assert isinstance(law, NullspaceIdentifier)
    return law


def stepper(law: NullspaceIdentifier) -> ImplicitMemory:
    """What takes a law's implicit steps."""
    assert isinstance(law.memory, ImplicitMemory)
    return law.memory


@cache
def nullspace(name: str) -> Nullspace:
    plant = scenario_plant(name)
    return Nullspace.structural(plant.system, plant.truth, np.random.default_rng(0))


def distance(name: str, theta: Array) -> float:
    return float(nullspace(name).ratio(theta / scenario_plant(name).system.space.scale))


@cache
def remembered(name: str, seconds: float = 3.0) -> Memory:
    """A memory of ideal data, from a law that has not used it."""
    log = driven(name, seconds)
    law = build(name, inside(log, 1), interval=1e6)
    memory = followed(law, log.rows)[0].memory
    assert memory is not None
    return stepper(law).recorder.absorb_blocks(memory, log.rows[-1])


# -- an implicit step ----------------------------------------------------------------------------


def decrement(law: NullspaceIdentifier, cost: Quotient, start: Array, theta: Array) -> float:
    """Length of Newton's step from θ, in the metric of what an implicit step makes least."""
    reach, (slope, metric) = (
        stepper(law).config.pace * stepper(law).config.interval,
        law.metric.mirror(theta),
    )
    gradient = reach * cost.gradient(theta) + slope - law.metric.mirror(start)[0]
    hessian = reach * cost.curvature(theta) + metric
    return float(np.sqrt(gradient @ np.linalg.solve(hessian, gradient)))


def rounding(cost: Quotient, theta: Array) -> float:
    """To what R(θ) is known: the terms of θᵀGθ, which cancel, to a unit in their last place."""
    terms = np.einsum("p,ipq,q->i", np.abs(theta), np.abs(cost.gramian), np.abs(theta))
    return 1e-16 * float(cost.weights @ (terms / (cost.effort @ theta**2)))


@pytest.mark.parametrize("pace", [1e-2, 1.0, 1e2, 1e4, 1e6])
@pytest.mark.parametrize("name", NAMES)
def test_a_step_lowers_its_objective_and_v_at_any_size(name, pace):
    """D_ψ(θ*‖θ⁺) ≤ D_ψ(θ*‖θ̂) + κh R(θ*), and κh R(θ) + D_ψ(θ‖θ̂) is stationary at θ⁺."""
    log, memory = driven(name, 3.0), remembered(name)
    truth = log.plant.truth
    for seed in range(3):
        law = build(name, inside(log, seed), pace=pace)
        theta, whole = law.prior, float(law.divergence(truth, law.prior))
        reach = stepper(law).config.pace * stepper(law).config.interval
        for k in range(4):
            found = Remembered.of(memory.means, log.plant.system.space)
            assert found is not None
            cost = found.weighted(theta)
            ahead, seen = stepper(law).implicit_step(theta, memory)
            assert seen.scores.view is not None and law.metric.cone.contains(ahead)
            old, new = (
                reach * cost.value(x) + float(law.divergence(x, theta)) / law.metric.mu
                for x in (theta, ahead)
            )
            assert new <= old * (1 + 1e-9) + reach * rounding(cost, theta)
            before, after = (decrement(law, cost, theta, x) for x in (theta, ahead))
            share = max(1e-4, 3e-8 * pace)  # rounding; a step that is not solved is shortened
            assert after < share * max(1.0, before)
            slack = law.metric.mu * reach * cost.value(truth)
            fell = float(law.divergence(truth, theta) - law.divergence(truth, ahead))
            assert fell > -slack - 1e-9 * whole
            if k == 0:
                assert slack < 1e-2 * fell and fell > 0.1 * whole
            theta = ahead
        assert distance(name, theta) < (0.2 if pace < 1 else 2e-6)


@pytest.mark.parametrize("name", NAMES)
def test_the_conserved_quantity_falls_by_what_the_memory_steps_cost(name):
    """Q(θ̂) − Q(θ⁺) = D_ψ(θ⁺‖θ̂); Q and all costs together stand to RK4's error."""
    log = driven(name, 5.0)
    law = build(name, inside(log, 2))
    states = identify(law, log.rows)
    theta, spent = (np.array([getattr(s, k) for s in states]) for k in ("theta_hat", "spent"))
    whole = law.conserved(theta) + spent
    assert np.abs(whole / whole[0] - 1).max() < 1e-6
    steps, cost = np.flatnonzero(np.diff(spent)), 0.0
    assert len(steps) == round(5.0 / stepper(law).config.interval)
    for k in steps:
        # without the memory's step the sample's own step would have ended here
        plain, _ = law.along(states[k], Measured.of(log.rows[k : k + 2]))
        once = 2 * float(law.divergence(states[k + 1].theta_hat, plain.theta_hat))
        took = states[k + 1].spent - states[k].spent
        assert took == pytest.approx(once, rel=1e-3, abs=1e-8 * whole[0])
        cost += once
    assert spent[-1] == pytest.approx(cost, rel=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_v_falls_in_every_step_of_a_run(name):
    log = driven(name, 5.0)
    law, truth = build(name, inside(log, 3)), log.plant.truth
    _, made = followed(law, log.rows)
    V = law.divergence(truth, made.theta_hat)
    for k, row in enumerate(log.rows):
        dv = made.v_hat[k] - row.v
        V[k] += 0.5 * dv @ log.plant.system.mass_matrix(np.r_[row.q, row.v], truth) @ dv
    rises, stepped = np.diff(V), np.diff(made.spent) != 0
    assert rises[~stepped].max() < 1e-6 * V[0]
    slacks = law.slacks(Measured.of(log.rows), truth)
    assert (slacks[~stepped] == 0).all() and (slacks[stepped] > 0).any()
    assert (rises[stepped] <= slacks[stepped] + 1e-5 * V[0]).all()
    assert slacks.max() < 0.02 * V[0]
    assert V[-1] < 0.5 * V[0]


@pytest.mark.parametrize("implicit", [False, True])
def test_a_rise_of_v_beyond_its_bound_is_counted(implicit, tmp_path):
    """Thrice the bound in one step is a violation; a bound 100 times wider would hide it."""
    done = run(scenario("bluerov2", duration=6.0), tmp_path)
    truth, record = Truth.of(done), done.record
    rises = rises_of(done, truth)
    assert rises is not None and rises.violations == 0
    own = done.identifiers[""]
    assert isinstance(own, NullspaceIdentifier)
    stepped = own.implicit(record["t"])
    slacks, steps = own.slacks(record.log, truth.theta), np.flatnonzero(stepped == implicit)
    k = int(steps[np.argmin(slacks[steps])])
    V = energy(done, truth)
    conserved = own.conserved(record["theta_hat"]) + record["spent"]
    allowed = np.abs(np.diff(conserved)).max()  # RK4's defect
    if implicit:
        allowed += slacks[k] + 1e-5 * V[0]
    v_hat = record["v_hat"].copy()
    record = replace(record, columns={**record.columns, "v_hat": v_hat})
    done = replace(done, record=record)
    M = done.system.mass_matrix(np.r_[record["q"][k + 1], record["v"][k + 1]], truth.theta)
    v_hat[k + 1] = record["v"][k + 1]
    lacking = 3 * allowed + V[k] - energy(done, truth)[k + 1]
    v_hat[k + 1, 0] += np.sqrt(2 * lacking / M[0, 0])
    rises = rises_of(done, truth)
    assert rises is not None and rises.violations == 1


# -- where it stays ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["bluerov2", "f1tenth"])
@pytest.mark.parametrize("seed", range(3))
def test_a_start_far_off_stays_in_the_cone_and_converges(name, seed):
    """e^{±1} on every block of the cone, 20 s: issue 4 asks for 0.01."""
    log = driven(name, 20.0)
    law = build(name, inside(log, seed, 1.0))
    state, made = followed(law, log.rows)
    assert all(law.metric.cone.contains(theta) for theta in made.theta_hat)
    assert distance(name, law.prior) > 0.1
    assert distance(name, state.theta_hat) < 1e-3


@pytest.mark.parametrize("levels", [EXACT, NOISE.levels], ids=["ideal", "noisy"])
def test_unobserved_directions_keep_their_start(levels):
    """n·∇ψ(θ̂) stands for every n of P_s without an actuator: at any residual, noisy or not."""
    log = driven("double_pendulum", 3.0)
    space, basis = log.plant.system.space, nullspace("double_pendulum").P
    basis = basis * space.scale[:, None]
    _, s, rows = np.linalg.svd(basis[space.actuators] / space.scale[space.actuators, None])
    free = basis @ rows[np.sum(s > 1e-9) :].T
    assert free.shape[1] >= 10 and np.abs(free[space.actuators]).max() < 1e-9
    law = build("double_pendulum", inside(log, 4), levels, anchor=0.0)
    rows = log.rows if levels.exact else noisy(log, NOISE, 1).rows
    memory = followed(build("double_pendulum", law.prior, levels, interval=1e6), rows)[0].memory
    assert memory is not None
    memory, theta, moved = stepper(law).recorder.absorb_blocks(memory, rows[-1]), law.prior, 0.0
    for _ in range(5):
        ahead, _ = stepper(law).implicit_step(theta, memory)
        moved = max(moved, float(np.abs((ahead - theta) / space.scale).max()))
        theta = ahead
    turn = (law.metric.mirror(theta)[0] - law.metric.mirror(law.prior)[0]) @ free
    assert moved > 0.05
    share = 1e-4 if levels.exact else 2e-3  # the hold at the prior is not in the mirror's metric
    assert (
        np.abs(turn).max() < share * np.abs(law.metric.mirror(law.prior)[0][:, None] * free).max()
    )


def test_unobserved_directions_stay_bounded_over_a_long_run():
    """The trap of a normaliser on all of θ: a residual that stays makes the unobserved grow."""
    log = driven("bluerov2", 60.0)
    law = build("bluerov2", inside(log, 5))
    scale = log.plant.system.space.scale
    rng = np.random.default_rng(0)  # an unknown force on every thruster: no θ explains the motion
    rows = [
        row._replace(u=row.u + 0.2 * rng.standard_normal(row.u.shape)) for row in log.rows[:6001]
    ]
    early, late = followed(law, rows)[1].theta_hat[[3000, 6000]]
    for theta in (early, late):
        assert np.abs(theta / scale).max() < 3 * np.abs(law.prior / scale).max()
    change = np.abs(late - early) / scale
    assert change.max() < 1.0  # with the trap, by e^κt


class Heave(Driver):
    """All vertical thrusters together: nothing else moves the vehicle."""

    def __init__(self, plant, seed: int):
        config = load("bluerov2").excitation
        self.driver = config.build(plant.system, plant.truth, np.random.default_rng(seed))

    def start(self):
        return self.driver.start()

    def command(self, t, q, v):
        u = self.driver.command(t, q, v)
        return np.r_[0 * u[:4], np.full(4, u[0])]


class Surge(Heave):
    """The horizontal thrusters in one proportion."""

    def command(self, t, q, v):
        u = self.driver.command(t, q, v)
        return np.r_[0.8 * u[0] * np.array([1.0, 1.0, -1.0, -1.0]), 0 * u[4:]]


@cache
def one_axis(kind: type[Heave], seconds: float) -> Log:
    dt, plant = 0.01, load("bluerov2").plant.build(0.01, 3)
    with plant.running():
        rows = plant.trajectory(kind(plant, 0), round(seconds / dt)).rows  # pyright: ignore
    return Log(plant, dt, rows)


@pytest.mark.parametrize("anchor", [None, 0.0])
def test_unexcited_directions_stay_bounded_under_noise(anchor):
    """Where all that is seen of a direction is noise, its Gramian less N is not ⪰ 0."""
    log = one_axis(Heave, 20.0)
    scale = log.plant.system.space.scale
    for seed in range(3):
        law = build("bluerov2", inside(log, seed), NOISE.levels, anchor=anchor)
        end, made = followed(law, noisy(log, NOISE, seed).rows)
        assert all(law.metric.cone.contains(theta) for theta in made.theta_hat)
        assert np.abs((made.theta_hat - law.prior) / scale).max() < 2.0
        assert law.confidence(end) is not None


def test_no_seed_of_a_noisy_flight_ends_early():
    """Astrobee's drives are weak: much of what is seen is noise."""
    for seed in range(8):
        log = driven("astrobee", 12.0, seed=seed)
        law = build("astrobee", inside(log, seed), NOISE.levels)
        followed(law, noisy(log, NOISE, seed).rows)


def test_v_does_not_rise_under_a_constant_command():
    log = driven("scalar_rov", 20.0)
    plant = log.plant
    rows = []
    with plant.running():
        plant.reset(np.zeros(1), np.zeros(1))
        for k in range(2001):
            coordinates, v = plant.coordinates()
            q, u = plant.position(coordinates), np.array([0.4])
            rows.append(Measurement(k * log.dt, q, v.copy(), u))
            plant.step(rows[-1].u)
    law, truth = build("scalar_rov", inside(log, 1)), plant.truth
    end, made = followed(law, rows)
    V = law.divergence(truth, made.theta_hat)
    assert V[-1] <= V[0] and np.isfinite(end.theta_hat).all()
    assert end.memory is not None and end.memory.scores.view is not None
    t, q, v, u = rows[-1]
    x = np.r_[q, v]
    W, force = plant.system.regressor(t, x, v, 0 * v, u), plant.system.F(t, x, u)
    error = abs(W @ end.theta_hat) / np.abs(force * end.theta_hat).max()
    assert error < 1e-3 < abs(W @ law.prior) / np.abs(force * law.prior).max()


def test_a_sample_may_be_longer_than_a_block_and_an_interval():
    log = driven("scalar_rov", 20.0)
    law = build("scalar_rov", inside(log, 1), block=1e-4, interval=1e-4, pace=1e3)
    state, _ = followed(law, log.rows)
    assert state.memory is not None and state.memory.means.blocks == len(log.rows) - 1
    assert distance("scalar_rov", state.theta_hat) < 1e-4


# -- noise ---------------------------------------------------------------------------------------


def knowledge(law: NullspaceIdentifier, state: State) -> KnownDirections:
    stated = law.confidence(state)
    assert stated is not None
    system, theta = law.system, state.theta_hat
    return known(
        stated, theta, Nullspace.structural(system, theta, np.random.default_rng(0)), system.space
    )


@cache
def confidence_after(seed: int, seconds: float) -> tuple[KnownDirections, float, float]:
    """What a BlueROV2's estimate knows after some time with noise, its coverage and error."""
    log = driven("bluerov2", seconds, seed=seed)
    law = build("bluerov2", inside(log, seed), NOISE.levels)
    state, _ = followed(law, noisy(log, NOISE, seed).rows)
    found, scale, truth = knowledge(law, state), log.plant.system.space.scale, log.plant.truth
    error = actuator_ratio_error(log.plant.system, state.theta_hat, truth)
    return found, found.covered(state.theta_hat / scale, truth / scale), error


def test_the_stated_deviations_cover_the_truth():
    covered = [confidence_after(seed, 20.0)[1] for seed in range(6)]
    assert np.mean(covered) >= 0.9
    assert not any(confidence_after(seed, 20.0)[0].below_noise.any() for seed in range(6))


@pytest.mark.slow
def test_a_deviation_shrinks_with_the_square_root_of_time():
    seeds = range(3)
    short, long = (
        np.median([np.median(confidence_after(s, t)[0].deviation) for s in seeds])
        for t in (20.0, 80.0)
    )
    assert 1.4 < short / long < 2.8  # 2 of fourfold data
    blocks = [np.median(confidence_after(seeds[0], t)[0].blocks) for t in (20.0, 80.0)]
    assert blocks[1] / blocks[0] == pytest.approx(4, rel=0.25)
    assert blocks[0] < 200  # 200 blocks there were, and neighbours are correlated


def test_stated_deviations_are_not_much_wider_than_the_errors():
    """An actuator's error is of the size that is stated: neither 10 times less nor more."""
    for seed in range(6):
        found, _, error = confidence_after(seed, 20.0)
        assert 0.1 < error / found.actuators.max() < 4


def test_a_direction_that_nothing_moves_is_flagged():
    log = one_axis(Surge, 20.0)
    law = build("bluerov2", inside(log, 1), NOISE.levels)
    state, _ = followed(law, noisy(log, NOISE, 1).rows)
    found, space = knowledge(law, state), log.plant.system.space
    assert found.below_noise.any()
    assert (found.deviation[found.below_noise] > found.deviation[~found.below_noise].max()).all()
    vertical = space.actuators[4:]  # never commanded
    weight = np.linalg.norm(found.directions[found.below_noise][:, vertical], axis=0)
    assert (weight > 0.5).all()


def test_confidence_is_absent_until_there_is_data():
    log = driven("bluerov2", 1.0)
    law = build("bluerov2", inside(log, 1))
    assert law.confidence(law.init(log.rows[0])) is None
    rest = [row._replace(u=0 * row.u, v=0 * row.v, q=log.rows[0].q) for row in log.rows]
    state = law.init(rest[0])
    for before, after in pairwise(rest):
        state = law.step(state, before, after)
    assert state.status is Status.completed and state.spent == 0
    assert law.confidence(state) is None


# -- pure ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("levels", [EXACT, NOISE.levels], ids=["ideal", "noisy"])
def test_a_step_is_pure(levels):
    log = driven("f1tenth", 3.0)
    one, other = (build("f1tenth", inside(log, 1), levels) for _ in range(2))
    states = identify(one, log.rows)

    def bits(state: State) -> bytes:
        return pickle.dumps((state[:5], state.memory, state.spent))

    frozen = [bits(state) for state in states]
    every = round(0.5 / log.dt)
    for k in (
        4 * every,
        every - 1,
        2 * every,
        4 * every - 1,
        3,
    ):  # settling, closing a block …
        for law in (one, other):
            again = law.step(states[k], log.rows[k], log.rows[k + 1])
            assert bits(again) == frozen[k + 1]
    assert [bits(state) for state in states] == frozen


def test_a_run_that_ends_early_keeps_its_memory():
    log = driven("f1tenth", 1.0)
    law = build("f1tenth", inside(log, 1))
    state = identify(law, log.rows[:200])[-1]
    broken = log.rows[200]._replace(v=np.nan * log.rows[200].v)
    ended = law.step(state, log.rows[199], broken)
    assert ended.status is Status.measurement_not_finite
    assert ended.memory is state.memory and ended.spent == state.spent
    assert (ended.theta_hat == state.theta_hat).all()


@pytest.mark.parametrize("back", [0.0, -0.1, np.nan])
def test_a_repeated_sample_is_refused(back):
    log = driven("f1tenth", 1.0)
    law = build("f1tenth", inside(log, 1))
    state = identify(law, log.rows[:10])[-1]
    with pytest.raises(InvalidInput, match="t"):
        law.step(state, log.rows[9], log.rows[10]._replace(t=log.rows[9].t + back))


# -- a run ---------------------------------------------------------------------------------------


def scenario(name: str = "f1tenth", **changes) -> Scenario:
    base = load(name)
    assert isinstance(base.identifier, NullspaceAID)
    short = {"duration": 4.0, "held_out": 1.0, "pe_window": 1.0, "record_every": 1}
    return replace(base, identifier=replace(base.identifier, law="memory"), **(short | changes))


@pytest.fixture(scope="module", params=["ideal", "noisy"])
def finished(request, tmp_path_factory):
    return run(scenario(sensors=request.param), tmp_path_factory.mktemp(request.param))


def test_the_record_has_what_was_spent_and_the_summary_the_confidence(finished):
    record, summary = finished.record, summarize(finished, Truth.of(finished))
    steps = np.flatnonzero(np.diff(record["spent"])) + 1
    number = record["t"][steps] / 0.5
    np.testing.assert_allclose(number, np.round(number), atol=1e-9)
    assert 7 <= len(number) <= 8
    assert summary["law"] == "memory" and summary["status"] == "completed"
    assert summary["conserved_drift"] < 1e-4
    stated = summary["confidence"]
    assert stated["directions"] == summary["p"] - summary["r"] == len(stated["worst_known"]) + 3
    assert 0 <= stated["covered"] <= 1 and len(stated["independent_samples"]) == summary["n"]
    if summary["sensors"] == "ideal":
        assert summary["lyapunov_violations"] == 0 and summary["lyapunov_bound"] < 0.01


def test_a_log_is_replayed_to_the_bit(finished):
    record, law = finished.record, finished.identifiers[""]
    rows = [
        Measurement(float(t), q, v, u)
        for t, q, v, u in zip(*(record[k] for k in "tqvu"), strict=True)
    ]
    states = identify(law, rows)
    assert (np.array([s.theta_hat for s in states]) == record["theta_hat"]).all()
    assert (np.array([s.spent for s in states]) == record["spent"]).all()


def test_a_killed_run_is_rebuilt_from_its_record(finished, tmp_path):
    whole = (finished.folder / RECORD_FILE).read_bytes()
    (tmp_path / RECORD_FILE).write_bytes(whole[: round(0.8 * len(whole))])
    summary = rebuild(tmp_path).summary()
    assert summary["status"] == "interrupted" and summary["sim_s"] > 1
    assert summary["confidence"] is None  # a record has no memory
    assert summary["conserved_drift"] < 1e-4  # what was spent is in the record
    if summary["sensors"] == "ideal":
        assert summary["lyapunov_violations"] == 0
    assert (tmp_path / "report.html").is_file() and (tmp_path / "run.rrd").is_file()


# -- as data -------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["paper", "cone", "memory"])
def test_a_law_is_a_flag_and_survives_json(law):
    words = ["--law", law, "--horizon", "30"]
    chosen, _ = parse_flags("bluerov2", load("bluerov2"), words, "run", RunOptions)
    assert isinstance(chosen.identifier, NullspaceAID)
    assert chosen.identifier.law == law == chosen.identifier.name
    assert chosen.identifier.memory == MemoryConfig(horizon=30.0)
    assert Scenario.from_json(chosen.to_json()) == chosen
    assert chosen.identifier.in_cone == (law != "paper")


def test_every_number_of_the_memory_is_a_flag():
    words = [
        "--window",
        "0.2",
        "--block",
        "0.05",
        "--interval",
        "1",
        "--pace",
        "3",
        "--anchor",
        "0.5",
        "--horizon",
        "20",
    ]
    chosen, _ = parse_flags("bluerov2", load("bluerov2"), words, "run", RunOptions)
    assert isinstance(chosen.identifier, NullspaceAID)
    memory = MemoryConfig(window=0.2, block=0.05, interval=1.0, pace=3.0, anchor=0.5, horizon=20.0)
    assert chosen.identifier.memory == memory
    assert chosen.hash != load("bluerov2").hash


def test_without_a_barrier_there_is_no_memory():
    with pytest.raises(InvalidInput) as caught:
        NullspaceAID(law="memory", barrier=0.0)
    assert caught.value.name == "identifier.barrier"
