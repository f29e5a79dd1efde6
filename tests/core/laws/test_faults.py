"""Detection and isolation of faults by the law `efficient`."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.core.laws.base import Estimates, Identifier, State
from nsaid_mj.core.laws.efficient.law import EfficientIdentifier
from nsaid_mj.core.laws.efficient.signals import Signals
from nsaid_mj.core.laws.faults import FaultEvent
from nsaid_mj.core.log import Log
from nsaid_mj.lab.evaluation.run_misfit import misfit_of
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.plants.world.faults.text import parse_faults
from nsaid_mj.lab.setup import Setup
from nsaid_mj.watch.faults.evidence import jumped, most_evident, posterior, shift_jumps
from nsaid_mj.watch.faults.hypotheses import hypotheses_of
from nsaid_mj.watch.faults.snapshots import with_jump
from nsaid_mj.watch.faults.trial import FaultTrial, onset, started
from nsaid_mj.watch.faults.trials import begin_trials, follow_trials

P = 6


def linear_problem(jump: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P_s, P_t and the shift of the estimate of θ from 200 noisy rows Aθ, under a jump of θ."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((P, P))
    Ps = 1e-2 * root @ root.T + 1e-3 * np.eye(P)
    A, noise = rng.standard_normal((200, P)), 0.05
    error = np.linalg.cholesky(Ps) @ rng.standard_normal(P)  # θ̂_s = 0
    y = A @ (error + jump) + noise * rng.standard_normal(200)
    Pt = np.linalg.inv(np.linalg.inv(Ps) + A.T @ A / noise**2)
    return Ps, Pt, Pt @ A.T @ y / noise**2


def test_the_evidence_names_the_parameter_that_jumped_and_its_size() -> None:
    directions, right, inside = list(0.5 * np.eye(P)[:, :, None]), 0, 0
    for seed in range(40):
        k, size = seed % P, 0.8 * (-1) ** seed
        Ps, Pt, shift = linear_problem(size * np.eye(P)[k], seed)
        jumps = shift_jumps(Ps, Pt, shift, np.zeros(P), directions)
        share = posterior(np.array([jump.evidence for jump in jumps]))
        right += int(np.argmax(share)) == k
        middle, low, high = jumps[k].interval(np.array([0.5]))
        assert low < middle < high
        inside += low <= size <= high
    assert right >= 30  # the prior's own spread hides some
    assert inside >= 35


@pytest.mark.parametrize("size", [0.0, 0.8, 20.0])
def test_no_jump_is_more_evident_than_the_whole_shift(size) -> None:
    rng = np.random.default_rng(0)
    directions = [*(0.5 * np.eye(P)[:, :, None]), *rng.standard_normal((10, P, 3))]
    for seed in range(20):
        given = *linear_problem(size * np.eye(P)[seed % P], seed), 1e-3 * np.ones(P)
        evidence = [jump.evidence for jump in shift_jumps(*given, directions)]
        assert max(evidence) <= most_evident(*given) * (1 + 1e-9)


def test_without_a_jump_the_evidence_is_against_one() -> None:
    directions = list(0.5 * np.eye(P)[:, :, None])
    for seed in range(40):
        jumps = shift_jumps(*linear_problem(np.zeros(P), seed), np.zeros(P), directions)
        assert max(jump.evidence for jump in jumps) < 8


def test_a_jump_accounted_for_afterwards_equals_one_that_was_expected() -> None:
    Ps, Pt, shift = linear_problem(0.8 * np.eye(P)[2], 3)
    D = np.array([[0.0, 0, 0.5, 0, 0, 0], [0, 0.1, 0, 0, 0, 0]]).T
    free = Ps + D @ D.T
    information = np.linalg.inv(Pt) - np.linalg.inv(Ps)
    expected = np.linalg.inv(np.linalg.inv(free) + information)
    moved, covariance = with_jump(Ps, Pt, shift, D)
    np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-10)
    np.testing.assert_allclose(moved, expected @ np.linalg.solve(Pt, shift), rtol=1e-6)
    one = shift_jumps(Ps, Pt, shift, np.zeros(P), [D])[0]
    other = jumped(free, covariance, moved, D)
    np.testing.assert_allclose(one.delta, other.delta, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-5, atol=1e-7)


def test_every_part_of_a_robot_has_its_hypotheses() -> None:
    found = {}
    for name in ("ur5", "bluerov2", "crazyflie"):
        system = Setup.of(load(name)).system
        theta = system.space.scale
        kinds = [h.kind for h in hypotheses_of(system, theta)]
        found[name] = {kind: kinds.count(kind) for kind in sorted(set(kinds))}
        for h in hypotheses_of(system, theta):
            hit = {system.space.names[i] for i in np.flatnonzero(np.abs(h.D).any(axis=1))}
            assert hit <= set(h.names) and len(h.size) == h.D.shape[1]
    arm = {"broken": 6, "friction": 6, "loss": 6, "payload": 5, "reversed": 6, "stuck": 12}
    rov = {"broken": 8, "friction": 6, "loss": 8, "payload": 1, "reversed": 8, "stuck": 16}
    assert found["ur5"] == arm | {"bias": 12} and found["bluerov2"] == rov | {"bias": 12}
    assert found["crazyflie"]["loss"] == found["crazyflie"]["reversed"] == 4


def test_an_event_says_what_is_known() -> None:
    parts = (1.0, 1.2, "loss", "thrust of rotor 1", ("thrust_1",), 0.4, 0.39, 0.41, "1", 0.999)
    event = FaultEvent(*parts)
    assert event.in_words == "thrust of rotor 1 lost 40 % (39 … 41 %)"
    gained = event._replace(size=-0.1, low=-0.12, high=-0.08, slow=True)
    assert gained.in_words == "thrust of rotor 1 slowly rose by 10 % (8 … 12 %)"
    mass = event._replace(kind="payload", part="mass of body", unit="kg", size=2, low=1.5, high=2.5)
    assert mass.in_words == "mass of body changed by 2 kg (1.5 … 2.5 kg)"
    assert FaultEvent.of(event.keys()) == event
    sensor = mass._replace(kind="bias", part="velocity of yaw", names=("velocity 6",), unit="rad/s")
    assert sensor.in_words == "velocity of yaw is off by 2 rad/s (1.5 … 2.5 rad/s)"


def test_a_rotor_that_turns_backwards_pulls_down_and_drags_as_before() -> None:
    system = Setup.of(load("crazyflie")).system
    q, v, u = system.random_state(np.random.default_rng(4))
    back = u * np.array([1, -1, 1, 1])
    ahead, behind = (system.F(0.0, np.concatenate([q, v]), c) for c in (u, back))
    sign = np.ones(system.p)
    sign[[system.space.index("thrust_2"), system.space.index("torque_2")]] = -1
    np.testing.assert_array_equal(behind, ahead * sign)


# -- along runs ------------------------------------------------------------------------------------


@cache
def followed(
    name: str, seed: int, faults: str, duration: float
) -> tuple[Setup, Log, State, Estimates]:
    scenario = load(name)
    law = replace(scenario.identifier, law="efficient", gamma="scale")
    plant = replace(scenario.plant, faults=parse_faults(faults))
    common = {"rivals": {}, "sensors": "noisy", "duration": duration, "seed": seed}
    setup = Setup.of(replace(scenario, plant=plant, identifier=law, **common))
    identifier: Identifier = setup.identifiers()[""]
    with setup.plant.running():
        log = setup.simulate()
    return setup, log, *identifier.follow(identifier.init(log.at(0)), log)


def test_nothing_is_found_where_nothing_has_failed() -> None:
    assert followed("bluerov2", 30, "", 30.0)[2].faults == ()


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("bluerov2", 31),
        pytest.param("ur5", 31, marks=pytest.mark.slow),
        pytest.param("crazyflie", 31, marks=pytest.mark.slow),
    ],
)
def test_a_loss_is_isolated_and_the_others_keep_their_accuracy(name: str, seed: int) -> None:
    setup, _, state, estimates = followed(name, seed, "loss 0.4 of 3 at 6 s", 10.0)
    (event,) = state.faults
    hit = setup.plant.faults[0].affected(setup.system)
    assert event.kind == "loss" and event.confidence > 0.99
    assert event.names == tuple(setup.system.space.names[i] for i in hit)
    assert 6.0 < event.time <= event.found < 8.0
    assert event.size == pytest.approx(0.4, abs=0.02) and event.low < 0.4 < event.high
    others = np.setdiff1d(setup.system.space.actuators, hit)
    gains = setup.system.space.actuators
    ratio = np.ones(setup.system.p)
    ratio[gains] = estimates.theta_hat[-1][gains] / setup.plant.truth_at(10.0)[gains]
    assert np.abs(ratio[others] / ratio[others].mean() - 1).max() < 5e-3
    assert np.abs(ratio[hit] / ratio[others].mean() - 1).max() < 5e-3


def test_a_slow_loss_is_found_before_a_tenth_is_lost() -> None:
    state = followed("bluerov2", 32, "loss 0.3 of 2 rate 1 %/s at 12 s", 26.0)[2]
    (event,) = state.faults
    assert (event.kind, event.names, event.slow) == ("loss", ("thrust_2",), True)
    assert 12.0 < event.found < 22.0 and 0.08 < event.size < 0.16


@pytest.mark.parametrize("text", ["reversed 2", "stuck 5", "broken 7", "friction 20 of d_surge"])
def test_other_faults_are_told_apart(text: str) -> None:
    setup, _, state, estimates = followed("bluerov2", 33, f"{text} at 6 s", 9.0)
    assert [event.kind for event in state.faults] == [text.split(maxsplit=1)[0]]
    hit = setup.plant.faults[0].affected(setup.system)
    names = {setup.system.space.names[i] for i in hit}
    assert names <= set(state.faults[0].names)
    gains = np.intersect1d(hit, setup.system.space.actuators)
    truth = setup.plant.truth_at(9.0)[gains]
    np.testing.assert_allclose(estimates.theta_hat[-1][gains], truth, rtol=0.3, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "name", "error"),
    [
        ("bias 0.01 of position 2", "position 2", 0.01),
        ("bias -0.002 of position 6", "position 6", -0.002),
        ("bias 0.05 of velocity 5", "velocity 5", 0.05),
        ("bias -0.02 of velocity 1", "velocity 1", -0.02),
    ],
)
def test_an_error_of_a_sensor_is_found_and_undone(text: str, name: str, error: float) -> None:
    setup, _, state, estimates = followed("bluerov2", 34, f"{text} at 6 s", 10.0)
    (event,) = state.faults
    assert (event.kind, event.names) == ("bias", (name,))
    assert event.low < error < event.high and event.high - event.low < 0.2 * abs(error) + 3e-4
    gains = setup.system.space.actuators
    ratio = estimates.theta_hat[-1][gains] / setup.plant.truth[gains]
    assert np.abs(ratio / ratio.mean() - 1).max() < 1e-3


def test_the_signature_of_a_sensors_error_is_that_of_the_filter() -> None:
    setup, log, *_ = followed("bluerov2", 34, "bias 0.05 of velocity 5 at 6 s", 10.0)
    system, identifier = setup.system, setup.identifiers()[""]
    before, _ = identifier.follow(identifier.init(log.at(0)), log.until(5.9))
    assert isinstance(identifier, EfficientIdentifier)
    estimator, kalman, late = identifier.estimator, before.own.filter, log.part(570, 640)
    scale = estimator.constants.scale
    k = onset(estimator, kalman, late)
    assert late.t[k] == pytest.approx(6.0)  # the last sample before it
    what = [h for h in hypotheses_of(system, kalman.theta) if h.names == ("velocity 5",)]
    sound = Signals.sound(system)
    trials = begin_trials(estimator, kalman, sound, what, late.first(k + 2), k)
    (trial,) = follow_trials(estimator, trials, late.part(k + 1, 70)).each
    _, (size, low, high) = trial.reported(system.space)
    assert low < 0.05 < high
    start = started(estimator, kalman, late, k)
    direct = FaultTrial.begin(start, sound.biased(10, size), what[0], scale)
    squares = direct.followed(estimator, late.part(k, 70), sound).squares
    assert trial.squares == pytest.approx(squares, abs=0.1)  # of about 470: the parabola is one
    none = FaultTrial.begin(start, sound, what[0], scale)
    assert none.followed(estimator, late.part(k, 70), sound).squares > squares + 100


def test_a_stuck_thruster_is_at_its_last_command_in_spite_of_its_dead_zone() -> None:
    _, log, state, _ = followed("bluerov2", 33, "stuck 5 at 6 s", 9.0)
    (event,) = state.faults
    last = log.u[np.flatnonzero(log.t < 6.0 - 1e-9)[-1], 4]
    assert event.kind == "stuck" and event.size == pytest.approx(last, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.5, 2.0])
def test_a_load_at_an_arms_tool_is_weighed(mass: float) -> None:
    text = f"payload {mass} kg place 0 0.1 0 at 6 s"
    setup, _, state, estimates = followed("ur5", 35, text, 9.0)
    (event,) = state.faults
    assert event.kind == "payload" and event.unit == "kg"
    gains = setup.system.space.actuators
    scale = np.median(estimates.theta_hat[-1][gains] / setup.plant.truth[gains])
    assert event.size == pytest.approx(scale * mass, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("text", ["reversed 2", "stuck 3", "broken 4"])
def test_a_rotor_that_fails_altogether_is_told_apart(text: str) -> None:
    _, _, state, _ = followed("crazyflie", 33, f"{text} at 6 s", 7.0)
    kind, number = text.split()
    assert (state.faults[0].kind, state.faults[0].names) == (
        kind,
        (f"thrust_{number}", f"torque_{number}"),
    )


def test_a_found_fault_is_no_misfit_of_the_structure(tmp_path: Path) -> None:
    scenario = load("bluerov2")
    law = replace(scenario.identifier, law="efficient", gamma="scale")
    plant = replace(scenario.plant, faults=parse_faults("reversed 2 at 6 s"))
    common = {"rivals": {}, "sensors": "noisy", "duration": 9.0, "seed": 36, "held_out": 1.0}
    result = run(replace(scenario, plant=plant, identifier=law, **common), tmp_path)
    (event,) = result.faults
    misfit = misfit_of(result)
    assert event.kind == "reversed" and misfit is not None and misfit.level == "none"


def test_a_log_in_pieces_gives_the_same_faults_and_estimates() -> None:
    setup, log, state, estimates = followed("bluerov2", 31, "loss 0.4 of 3 at 6 s", 10.0)
    identifier, log = setup.identifiers()[""], log.first(700)
    other, rows = identifier.init(log.at(0)), []
    for start in range(0, 699, 7):
        other, piece = identifier.follow(other, log.part(start, min(start + 8, 700)))
        rows.append(piece.after(1).theta_hat)
    assert other.faults == state.faults
    np.testing.assert_array_equal(np.concatenate(rows), estimates.theta_hat[1:700])
