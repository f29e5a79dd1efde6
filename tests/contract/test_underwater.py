"""BlueROV2 in MuJoCo against Fossen's equations, written out here and integrated by scipy."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from numpy.polynomial import polynomial
from scipy.integrate import solve_ivp

from nsaid_mj.parameters import Array
from nsaid_mj.plants import ArmPlant, BlueROV2Plant, Mismatch, Plant
from nsaid_mj.plants.underwater import (
    UnderwaterSheet,
    drawn,
    nominal_numbers,
    scales_of,
    theta_of,
)
from nsaid_mj.plants.world.body import Vehicle, command_inputs, vehicle_spec
from nsaid_mj.plants.world.hydrodynamics import Hydrodynamics, fossen
from nsaid_mj.systems.underwater import UnderwaterVehicle
from tests.support.vehicles import acceleration

START = np.array([0.3, -0.2, 0.5, 0.4, -0.3, 0.8]), np.array([0.7, 0.4, -0.5, 0.5, 0.6, -0.4])
SHEET = UnderwaterSheet.of("bluerov2")
FLOW = (0.3, -0.2, 0.1)


# -- Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2021 -----------------------


def S(a: Array) -> Array:
    """(3, 3) with S(a) b = a × b."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def coriolis(M: Array, nu: Array) -> Array:
    """(6, 6) C(ν) of a symmetric M, equation (3.62) of Theorem 3.2."""
    one = M[:3, :3] @ nu[:3] + M[:3, 3:] @ nu[3:]
    two = M[3:, :3] @ nu[:3] + M[3:, 3:] @ nu[3:]
    C = np.zeros((6, 6))
    C[:3, 3:] = C[3:, :3] = -S(one)
    C[3:, 3:] = -S(two)
    return C


def attitude(quaternion: Array) -> Array:
    """(3, 3) R of (η, ε), equation (2.68): 1 + 2 η S(ε) + 2 S(ε)²."""
    eta, eps = quaternion[0], quaternion[1:]
    return np.eye(3) + 2 * eta * S(eps) + 2 * S(eps) @ S(eps)


class Fossen:
    """d/dt of [position, (η, ε), ν, what the thrusters do] under a constant command.

    Args:
        true: the numbers.
        u: (k,) command.
        lag: of the thrusters [s].
    """

    def __init__(self, true: Hydrodynamics, u: Array, lag: float = 0.0):
        self.true, self.u, self.lag = true, u, lag
        self.curve = np.zeros(2 * len(true.curve))
        self.curve[1::2] = true.curve
        self.M_inverse = np.linalg.inv(true.rigid + true.added)
        self.B = np.vstack([true.directions.T, np.cross(true.positions, true.directions).T])
        self.held = self.thrust(u)

    def thrust(self, command: Array) -> Array:
        """(6,) τ of the thrusters."""
        return self.B @ (self.true.thrust * polynomial.polyval(command, self.curve))

    def __call__(self, t: float, x: Array) -> Array:
        h, (quaternion, nu, act) = self.true, (x[3:7], x[7:13], x[13:])
        quaternion = quaternion / np.sqrt(quaternion @ quaternion)
        R = attitude(quaternion)
        nu_c, nu_c_dot = np.zeros(6), np.zeros(6)
        nu_c[:3] = R.T @ h.flow
        nu_c_dot[:3] = -S(nu[3:]) @ nu_c[:3]
        nu_r, up = nu - nu_c, R[2]
        tau = self.thrust(act) if self.lag else self.held
        g = np.concatenate([h.net_weight * up, -S(h.righting) @ up])
        nu_dot = self.M_inverse @ (
            tau
            - g
            - coriolis(h.rigid, nu) @ nu
            - coriolis(h.added, nu_r) @ nu_r
            - (h.linear + h.quadratic * np.abs(nu_r)) * nu_r
            + h.added @ nu_c_dot
        )
        eta, eps, omega = quaternion[0], quaternion[1:], nu[3:]
        turning = 0.5 * np.concatenate([[-eps @ omega], eta * omega + S(eps) @ omega])
        act_dot = (self.u - act) / self.lag if self.lag else 0 * act
        return np.concatenate([R @ nu[:3], turning, nu_dot, act_dot])


def flown(true: Hydrodynamics, commands: list[Array], each: float, lag: float = 0.0) -> Array:
    """(13 + k,) the state after commands of `each` seconds, from START."""
    numbers, v = START
    angle = np.linalg.norm(numbers[3:])
    quaternion = np.r_[np.cos(angle / 2), np.sin(angle / 2) * numbers[3:] / angle]
    x = np.concatenate([numbers[:3], quaternion, v, np.zeros(len(commands[0]))])
    for u in commands:
        x = solve_ivp(
            Fossen(true, u, lag), (0, each), x, method="DOP853", rtol=1e-13, atol=1e-14
        ).y[:, -1]  # fmt: skip
    return x


# -- MuJoCo ----------------------------------------------------------------------------------------


@cache
def true_numbers(kind: str) -> Hydrodynamics:
    """A BlueROV2's hidden numbers; `full` ones have a CG offset and couplings of every kind."""
    true = drawn(nominal_numbers(SHEET), 0.2, np.random.default_rng(3))
    if "full" in kind:
        rng = np.random.default_rng(4)
        body = pin.Inertia(13.5, np.array([0.03, -0.02, -0.04]), _spd(rng, [0.26, 0.23, 0.37], 0.1))
        root = np.sqrt(np.diag(true.added))
        added = np.outer(root, root) * _spd(rng, np.ones(6), 0.25)
        true = replace(true, rigid=body.matrix(), added=added,
                       righting=np.array([0.5, -0.4, 2.0]))  # fmt: skip
    return replace(true, flow=np.array(FLOW)) if "current" in kind else true


def _spd(rng: np.random.Generator, diagonal: Any, coupling: float) -> Array:
    root = np.sqrt(diagonal)
    A = coupling * rng.uniform(-1, 1, (len(root), len(root)))
    np.fill_diagonal(A, 1.0)
    return np.outer(root, root) * (A + A.T) / 2


def vehicle(true: Hydrodynamics, dt: float, mismatch: Mismatch = Mismatch()) -> Vehicle:  # noqa: B008
    """The plant with these numbers, its centre of gravity where M_RB has it."""
    nominal = nominal_numbers(SHEET)
    system = UnderwaterVehicle(
        scales_of(nominal, SHEET.guess), nominal.positions, nominal.directions, nominal.curve
    )
    m, S_c = true.rigid[0, 0], true.rigid[3:, :3] / true.rigid[0, 0]
    centre = np.array([S_c[2, 1], S_c[0, 2], S_c[1, 0]])
    spec = vehicle_spec("bluerov2", dt, m, centre, true.rigid[3:, 3:] + m * S_c @ S_c)
    command_inputs(spec, system.n_u)
    return Vehicle(system, theta_of(true), spec, true.numbers(mismatch.lag > 0), fossen(), mismatch)


def ends(p: Plant, commands: list[Array], each: float) -> Array:
    """(13 + k,) the same state, of MuJoCo."""
    with p.running():
        p.reset(*START)
        for u in commands:
            for _ in range(round(each / p.dt)):
                p.step(u)
        _, v = p.coordinates()
    return np.concatenate([p.data.qpos, v, p.data.act])


def apart(found: Array, expected: Array) -> float:
    """Largest difference of place [m], quaternion and twist [m/s, rad/s]."""
    sign = np.sign(found[3:7] @ expected[3:7])
    quaternion = expected[3:7] / np.linalg.norm(expected[3:7])
    return max(
        np.abs(found[:3] - expected[:3]).max(),
        np.abs(sign * found[3:7] - quaternion).max(),
        np.abs(found[7:13] - expected[7:13]).max(),
    )


def commands(count: int) -> list[Array]:
    return list(np.random.default_rng(5).uniform(-0.6, 0.6, (count, 8)))


@pytest.mark.parametrize("kind", ["published", "full", "full current"])
def test_ten_seconds_of_mujoco_are_ten_seconds_of_fossen(kind):
    true, series = true_numbers(kind), commands(4)
    expected = flown(true, series, 2.5)
    p = vehicle(true, 1e-3)
    found = ends(p, series, 2.5)
    assert apart(found, expected) <= 1e-8
    assert np.linalg.norm(found[:3] - START[0][:3]) > 0.5  # it has moved
    assert not p.diverged


def test_the_config_builds_the_same_plant():
    """The public plant is the one tested here, in the current, too."""
    for flow in ((0.0, 0.0, 0.0), FLOW):
        p = BlueROV2Plant(mismatch=Mismatch(flow=flow)).build(2e-3, 8)
        true = replace(
            drawn(nominal_numbers(SHEET), 0.2, np.random.default_rng(8)), flow=np.array(flow)
        )
        assert (p.truth == theta_of(true)).all()
        assert apart(ends(p, commands(1), 1.0), flown(true, commands(1), 1.0)) <= 1e-8


STEADY = [np.array([0.5, 0.4, 0.3, 0.6, 0.3, 0.4, 0.3, 0.2])]


@pytest.mark.parametrize("kind", ["full", "full current"])
def test_mujoco_is_of_fourth_order_with_added_mass(kind):
    """Without quadratic drag: |ν| ν has a kink at 0, which costs every integrator its order."""
    true = replace(true_numbers(kind), quadratic=np.zeros(6))
    expected = flown(true, STEADY, 0.64)
    steps = np.array([0.04, 0.02, 0.01, 0.005])
    errors = [apart(ends(vehicle(true, dt), STEADY, 0.64), expected) for dt in steps]
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
            W = system.regressor(0.0, np.r_[p.position(numbers), v], v,
                                 p.body.acceleration(p.data), u)  # fmt: skip
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
    nominal = nominal_numbers(SHEET)
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
def test_a_crashed_run_leaves_nothing_to_the_next(how):
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


def test_somebody_elses_callback_is_told_and_left_alone():
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


def test_a_state_that_is_not_finite_stays_visible():
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
