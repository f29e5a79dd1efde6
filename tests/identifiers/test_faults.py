"""Detection and isolation of faults by the law `efficient`."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.setup import Setup
from nsaid_mj.identifiers.base import Estimates, Identifier, State
from nsaid_mj.identifiers.efficient.faults.evidence import jumped, posterior, shift_jumps
from nsaid_mj.identifiers.efficient.faults.hypotheses import hypotheses_of
from nsaid_mj.identifiers.efficient.faults.watch import with_jump
from nsaid_mj.identifiers.faults import FaultEvent
from nsaid_mj.log import Log
from nsaid_mj.plants import parse_faults

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


def test_a_log_in_pieces_gives_the_same_faults_and_estimates() -> None:
    setup, log, state, estimates = followed("bluerov2", 31, "loss 0.4 of 3 at 6 s", 10.0)
    identifier, log = setup.identifiers()[""], log.first(700)
    other, rows = identifier.init(log.at(0)), []
    for start in range(0, 699, 7):
        other, piece = identifier.follow(other, log.part(start, min(start + 8, 700)))
        rows.append(piece.after(1).theta_hat)
    assert other.faults == state.faults
    np.testing.assert_array_equal(np.concatenate(rows), estimates.theta_hat[1:700])
