"""Intervals of a servo's parameters: few clusters, and backlash in its gear."""

import mujoco
import numpy as np
import pytest

from nsaid_mj.clinic.servos.fit import JointFit, OutputError, ServoPrior, Spread, minimise, spreads
from nsaid_mj.clinic.servos.joint_fits import alone
from nsaid_mj.clinic.servos.simulation import (
    NONE,
    JointLog,
    differentiated,
    simulate,
    with_play,
)

KP, T, F, ARMATURE, INERTIA, DELAY = 12.0, 0.06, 0.012, 0.008, 0.03, 0.015
TICK = 2 * np.pi / 4096


def targets(rng, t):
    """(N,) moves between random places, in .8 s each."""
    places = rng.uniform(-0.8, 0.8, int(t[-1] / 0.8) + 3)
    return np.interp(t, 0.8 * np.arange(len(places)) + 0.3 * rng.random(len(places)), places)


PLACES = ("beyond the motor's encoder", "before the encoder", "within the loop")


def behind_a_gear(seed, play, place, seconds=20.0):
    """A log of a pan joint with play [rad] in its gear, at one of `PLACES`, by MuJoCo."""
    slack = f"""<joint name="slack" axis="0 0 1" limited="true" range="{-play / 2} {play / 2}"
        armature="1e-4" damping=".01" frictionloss=".003" solreflimit=".002 1"/>"""
    mj = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".001"/><compiler angle="radian"/><worldbody><body>
        <joint name="pan" axis="0 0 1" armature="{ARMATURE}" frictionloss="{KP * F}"
        solimpfriction=".9999 .9999 .001 .5 2" solreffriction=".002 1"/>{slack if play else ""}
        <inertial pos="0 0 0" mass="1" diaginertia=".03 .03 {INERTIA}"/></body></worldbody>
        <actuator><position joint="pan" kp="{KP}" kv="{KP * T}"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(mj)
    t = np.arange(0, seconds, 0.02)
    target = np.round(targets(np.random.default_rng(seed), t) / TICK) * TICK
    data.qpos[0] = target[0]
    position = [target[0]]
    held = np.searchsorted(t, np.arange(round(t[-1] / 0.001)) * 0.001 - DELAY, side="right") - 1
    for step, k in enumerate(np.maximum(held, 0).tolist(), 1):
        within = place == PLACES[2]  # the servo's error is that of an encoder behind the gear
        data.ctrl[0] = target[k] - (data.qpos[1:].sum() if within else 0.0)
        mujoco.mj_step(mj, data)
        if step % 20 == 0:
            position.append(data.qpos[0] if place == PLACES[0] else data.qpos.sum())
    ones = np.ones(len(t))
    return JointLog(t, target, np.round(np.array(position) / TICK) * TICK, 0 * ones, INERTIA * ones)


@pytest.mark.parametrize("place", [None, *PLACES])
def test_play_is_found_and_widens_what_it_makes_wrong(place):
    play = 0.007 if place else 0.0
    of = JointFit([behind_a_gear(seed, play, place) for seed in range(3, 7)], np.ones(4000))
    first, prior = alone(of.logs)
    kp = np.arange(5) == 2  # gravity does not tell it
    prior = ServoPrior(np.where(kp, -np.log(KP), prior.mean), np.where(kp, 0.0, prior.deviation))
    fit = minimise(of, first, prior)
    (found,) = spreads([fit], np.arange(4000) // 500, [np.array([2e-3])])
    off = np.abs(fit.x - np.log([T, F, 1 / KP, ARMATURE / KP, DELAY]))
    half = np.array([found.quantile(one) for one in np.eye(5)])
    half *= np.sqrt(np.diag(found.covariance))
    assert (off[[0, 1, 3, 4]] < half[[0, 1, 3, 4]]).all(), (off, half)
    assert half[0] < (0.5 if play else 0.1)
    assert off[0] < 0.02 or play
    if place:
        told, width = found.play
        assert PLACES[told] == place and 0.5 < width / play < 1.3
    else:
        assert found.play[1] == 0.0 and (found.size[2:5] < 2e-4).all()


def test_a_gear_without_play_moves_as_a_joint():
    t = np.arange(0, 10, 0.02)
    target = targets(np.random.default_rng(1), t)
    log = JointLog(t, target, target, 0.3 * np.cos(target), np.full(len(t), 0.01))
    theta = np.array([0.06, 0.01, 0.08, 1e-3, 0.015])
    rigid = simulate(log, theta)
    motor, link = with_play(log, theta, 0.0, behind=False)
    np.testing.assert_array_equal(motor, link)
    assert np.abs(motor - rigid).max() < 0.02 * np.ptp(rigid)
    motor, link = with_play(log, theta, 2e-3, behind=False)
    assert 2e-3 <= np.abs(motor - link).max() < 2e-3 + 1e-9  # weight presses it to a side


@pytest.mark.parametrize(("share", "least", "most"), [(1.0, 2.30, 2.31), (50.0, 2.4, 2.78)])
def test_a_variance_that_one_log_decides_gives_a_wide_interval(share, least, most):
    """Of five logs, of which one says `share` times as much of the parameter as another."""
    information = np.array([share, 1, 1, 1, 1]).reshape(5, 1, 1)
    one = np.ones((1, 1))
    inverse = 1 / information.sum(axis=0)
    spread = Spread(
        np.arange(1), inverse, information, one.repeat(5, 0), 0 * one, one, one, one, one, 1.0
    )
    assert least < spread.quantile(np.ones(1)) < most  # 4 degrees of freedom are the arm's
    certain = spread._replace(rest=100 * one)  # all but a hundredth is not from the logs
    assert certain.quantile(np.ones(1)) == pytest.approx(1.96, abs=1e-3)


def test_few_clusters_borrow_from_the_arm_s_other_numbers():
    """One number's clusters agree by accident, the others' scatter ten times as much."""
    rng, clusters = np.random.default_rng(0), 5
    cluster = np.repeat(np.arange(clusters), 40)
    fits = []
    for size in (0.3, 3.0, 3.0, 3.0):
        level = rng.standard_normal(clusters)
        level = size * (level - level.mean()) / level.std()
        of = JointFit.__new__(JointFit)
        of.used, of.spacing, of.unit = np.ones(200), np.ones(200), np.zeros(1) + 1e-9
        of.moved = lambda x, zero: np.zeros((200, 7))
        prior = ServoPrior(np.zeros(1), np.full(1, 1e6))
        residual = level[cluster]
        fits.append(OutputError(of, prior, np.zeros(1), residual, np.ones((200, 1)), 10.0))
    found = spreads(fits, cluster, [np.ones(1)] * 4)
    (first,), (second,) = (np.sqrt(np.diag(one.between)) for one in found[:2])
    own = np.sqrt(0.3**2 * clusters / (clusters - 1) / clusters)
    assert own < first < second  # 8 degrees of freedom in the place of 4
    assert found[0].quantile(np.ones(1)) == pytest.approx(2.306, abs=0.01)
    assert second == pytest.approx(np.sqrt(3.0**2 / (clusters - 1)), rel=0.2)


@pytest.mark.parametrize("limit", [np.inf, 0.3])
def test_derivatives_are_those_of_the_simulation(limit):
    t = np.arange(0, 10, 0.02)
    target = targets(np.random.default_rng(1), t)
    log = JointLog(t, target, 0 * t, 0.3 * np.cos(target), np.full(len(t), 0.01), limit)
    theta, own = np.array([0.06, 0.01, 0.08, 1e-3, 0.015]), NONE._replace(stribeck=0.01, load=0.1)
    q, slope = differentiated(log, theta, own)
    np.testing.assert_array_equal(q, simulate(log, theta, own))
    step = 1e-5
    for k, column in enumerate(slope.T):
        sides = []
        for side in (step, -step):
            scale = np.exp(side * (np.arange(5) == k))
            effects = own._replace(
                stribeck=own.stribeck + side * (k == 5), load=own.load + side * (k == 6)
            )
            sides.append(simulate(log, theta * scale, effects))
        change = (sides[0] - sides[1]) / (2 * step)
        assert np.sqrt(np.mean((column - change) ** 2)) < 0.02 * np.sqrt(np.mean(change**2)), k
