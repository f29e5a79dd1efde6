"""BlueROV2 in MuJoCo agrees with Fossen's equations integrated by scipy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.plant import Plant
from tests.support.fossen import (
    FLOW,
    START,
    apart,
    commands,
    ends,
    flown,
    published,
    true_numbers,
    vehicle,
)
from tests.support.vehicles import acceleration

CURRENT = Mismatch(flow=FLOW)


@pytest.mark.parametrize(
    "kind,mismatch", [("published", Mismatch()), ("full", Mismatch()), ("full", CURRENT)]
)
def test_mujoco_follows_fossens_equations_for_ten_seconds(kind, mismatch):
    true, series = true_numbers(kind), commands(4)
    expected = flown(true, series, 2.5, mismatch)
    p = vehicle(true, 1e-3, mismatch)
    found = ends(p, series, 2.5)
    assert apart(found, expected) <= 1e-8
    assert np.linalg.norm(found[:3] - START[0][:3]) > 0.5  # it has moved
    assert not p.diverged


def test_the_public_configuration_builds_the_tested_plant():
    """The public plant is the one tested here, in the current, too."""
    for mismatch in (Mismatch(), CURRENT):
        p = BlueROV2Plant(mismatch=mismatch).build(2e-3, 8)
        true = published().drawn(0.2, np.random.default_rng(8))
        assert (p.truth == true.theta()).all()
        assert apart(ends(p, commands(1), 1.0), flown(true, commands(1), 1.0, mismatch)) <= 1e-8


STEADY = [np.array([0.5, 0.4, 0.3, 0.6, 0.3, 0.4, 0.3, 0.2])]


@pytest.mark.parametrize("mismatch", [Mismatch(), CURRENT])
def test_mujoco_is_of_fourth_order_with_added_mass(mismatch):
    """Without quadratic drag: |ν| ν has a kink at 0, which costs every integrator its order."""
    true = replace(true_numbers("full"), quadratic=np.zeros(6))
    expected = flown(true, STEADY, 0.64, mismatch)
    steps = np.array([0.04, 0.02, 0.01, 0.005])
    errors = [apart(ends(vehicle(true, dt, mismatch), STEADY, 0.64), expected) for dt in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 3.5 < slope < 4.5, errors


def test_a_thousandth_of_the_added_mass_would_be_seen():
    true = true_numbers("full")
    wrong = replace(true, added=true.added + 1e-3 * np.diag(np.diag(true.added)))
    assert apart(ends(vehicle(wrong, 5e-3), STEADY, 0.64), flown(true, STEADY, 0.64)) > 1e-6


@pytest.mark.parametrize("kind", ["published", "full"])
def test_w_theta_is_zero_along_a_run(kind):
    """W(t, x, v, v̇) θ ≤ 1e-8 of the largest force, on states that MuJoCo reaches."""
    p = vehicle(true_numbers(kind), 0.01)
    system, theta, series = p.system, p.truth, commands(20)
    with p.running():
        p.reset(*START)
        for u in series:
            for _ in range(10):
                p.step(u)
            numbers, v = p.coordinates()
            mujoco.mj_forward(p.model, p.data)
            W = system.regressor(
                0.0, np.r_[p.position(numbers), v], v, p.joints.acceleration(p.data), u
            )
            assert np.abs(W @ theta).max() <= 1e-12 * np.abs(W * theta).max()


def test_theta_is_what_a_physicist_would_measure():
    """Each number of θ by an experiment on MuJoCo's body, not by the code that made it."""
    p = BlueROV2Plant().build(1e-3, 8)
    space, theta, still = p.system.space, p.truth, np.zeros(6)
    idle, up = np.zeros(8), np.array([0.0, 0.0, 1.0])

    def wrench(v: Array, u: Array, numbers: Array = still) -> Array:
        """The force, in body axes, that M v̇ shows."""
        x = np.r_[p.position(numbers), v]
        return p.system.mass_matrix(x, theta) @ acceleration(p, numbers, v, u)

    rest = wrench(still, idle)
    weight, righting = theta[space["net weight"]], theta[space["righting moment"]]
    np.testing.assert_allclose(rest, np.r_[-weight * up, np.cross(righting, up)], atol=1e-12)
    lying = wrench(still, idle, np.array([0, 0, 0, np.pi / 2, 0, 0]))  # y looks up
    np.testing.assert_allclose(lying[:3], [0, -weight[0], 0], atol=1e-12)
    np.testing.assert_allclose(lying[3:], np.cross(righting, [0, 1, 0]), atol=1e-12)
    for i, (d, dq) in enumerate(
        zip(theta[space["linear drag"]], theta[space["quadratic drag"]], strict=True)
    ):
        for speed in (0.5, -2.0):
            lost = (wrench(speed * np.eye(6)[i], idle) - rest)[i]
            assert lost == pytest.approx(-d * speed - dq * abs(speed) * speed, abs=1e-10)
    nominal = published()
    for j, gain in enumerate(theta[space["thruster gain"]]):
        push = wrench(still, np.eye(8)[j]) - rest
        place, direction = nominal.positions[j], nominal.directions[j]
        np.testing.assert_allclose(push[:3], gain * direction, atol=1e-10)
        np.testing.assert_allclose(push[3:], np.cross(place, gain * direction), atol=1e-10)
        assert np.linalg.norm(direction) == pytest.approx(1, abs=1e-12)
    M = p.system.mass_matrix(np.r_[p.position(still), still], theta)
    rigid = np.array([13.5, 13.5, 13.5, 0.26, 0.23, 0.37])
    added = np.array([6.36, 7.12, 18.68, 0.189, 0.135, 0.222])
    np.testing.assert_allclose(M, np.diag(rigid + added), rtol=1e-12, atol=1e-15)


# -- the callback ----------------------------------------------------------------------------------


class CrashError(Exception):
    pass


def path(p: Plant, steps: int = 50) -> Array:
    """(steps, 2 n) states under a fixed command."""
    rows = []
    with p.running():
        p.reset(np.full(p.system.n, 0.2), np.full(p.system.n, 0.3))
        for _ in range(steps):
            p.step(np.full(p.system.n_u, 0.2))
            rows.append(np.concatenate(p.coordinates()))
    return np.array(rows)


@pytest.mark.parametrize("how", [CrashError, KeyboardInterrupt, SystemExit, "forgotten"])
def test_a_crashed_run_does_not_affect_the_next(how):
    arm, rov = ArmPlant("double_pendulum").build(1e-3, 1), BlueROV2Plant().build(1e-2, 1)
    clean = path(arm), path(rov)
    if how == "forgotten":
        running = rov.running()
        running.__enter__()
        rov.step(np.ones(8))
        del running
    else:
        with pytest.raises(how), rov.running():
            rov.step(np.ones(8))
            raise how
    assert mujoco.get_mjcb_passive() is None
    for p, before in zip((arm, rov), clean, strict=True):
        assert (path(p) == before).all()
    fresh = BlueROV2Plant().build(1e-2, 1)
    assert (path(fresh) == clean[1]).all()


def test_a_foreign_mujoco_callback_is_reported_and_kept():
    rov = BlueROV2Plant().build(1e-2, 1)

    def foreign(model: Any, data: Any) -> None:
        pass

    mujoco.set_mjcb_passive(foreign)
    try:
        with pytest.raises(RuntimeError, match="another plant"), rov.running():
            pass
        assert mujoco.get_mjcb_passive() is foreign
    finally:
        mujoco.set_mjcb_passive(None)
    path(rov)


def test_a_nonfinite_state_is_not_hidden():
    """The callback neither stops the process nor hides a NaN."""
    rov = BlueROV2Plant().build(1e-2, 1)
    for bad in (np.nan, np.inf, 1e200):
        with rov.running():
            rov.reset(np.zeros(6), np.zeros(6))
            rov.data.qvel[0] = bad
            for _ in range(3):
                rov.step(np.zeros(8))
            assert rov.diverged
    assert np.isfinite(path(rov)).all()
