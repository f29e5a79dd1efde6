"""Astrobee in MuJoCo agrees with Newton's and Euler's equations integrated by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.plants.vehicles import AstrobeePlant
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.robots.assets import published_numbers
from tests.support.vehicles import acceleration

START = np.array([0.3, -0.2, 0.5, 0.4, -0.3, 0.8]), np.array([0.2, -0.1, 0.15, 0.5, 0.6, -0.4])
UP = np.array([1.0, -1.0, -1.0])  # published with z down


def nozzle_forces(p: Plant) -> tuple[Array, Array]:
    """(12, 3) places [m] and (12, 3) forces [N] at full command, from the published table."""
    table = published_numbers("astrobee")["nozzles"]
    places, jets = np.array(table["positions"]) * 0.0254, np.array(table["directions"])
    half_turn = np.array([-1.0, -1.0, 1.0])
    places = np.vstack([places, half_turn * places]) * UP
    jets = np.vstack([jets, half_turn * jets]) * UP
    return places, -jets * p.truth[p.system.space["nozzle gain"]][:, None]


def flown(p: Plant, u: Array, seconds: float) -> Array:
    """(13,) place, quaternion (x, y, z, w) and body twist after a held command."""
    d = published_numbers("astrobee")
    m, centre, inertia = d["mass"], UP * d["centre"], np.array(d["inertia"])
    places, forces = nozzle_forces(p)
    push = u @ forces
    torque = (np.cross(places - centre, forces) * u[:, None]).sum(axis=0)
    rotation, (v, omega) = Rotation.from_rotvec(START[0][3:]), np.split(START[1], 2)

    def rate(t: float, x: Array) -> Array:
        R, w = Rotation.from_quat(x[6:10]), x[10:]
        spin = 0.5 * (Rotation.from_quat(x[6:10]).as_matrix() @ w)  # half ω in the world
        a, b = x[6:9], x[9]
        turning = np.r_[b * spin + np.cross(spin, a), -spin @ a]
        return np.r_[
            x[3:6], R.apply(push) / m, turning, (torque - np.cross(w, inertia * w)) / inertia
        ]

    place = START[0][:3] + rotation.apply(centre)
    start = np.r_[place, rotation.apply(v + np.cross(omega, centre)), rotation.as_quat(), omega]
    x = solve_ivp(rate, (0, seconds), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    R = Rotation.from_quat(x[6:10])
    v = R.inv().apply(x[3:6]) - np.cross(x[10:], centre)
    return np.r_[x[:3] - R.apply(centre), R.as_quat(), v, x[10:]]


def ends(dt: float, u: Array, seconds: float) -> tuple[Plant, Array]:
    p = AstrobeePlant().build(dt, 3)
    with p.running():
        p.reset(*START)
        for _ in range(round(seconds / dt)):
            p.step(u)
        numbers, v = p.coordinates()
    return p, np.r_[p.position(numbers), v]


def apart(found: Array, expected: Array) -> float:
    sign = np.sign(found[3:7] @ expected[3:7])
    return float(np.abs(found - np.r_[expected[:3], sign * expected[3:7], expected[7:]]).max())


U = np.random.default_rng(1).uniform(0, 1, 12)


def test_mujoco_follows_newton_and_euler_for_ten_seconds():
    p, found = ends(5e-3, U, 10.0)
    assert apart(found, flown(p, U, 10.0)) <= 1e-8


def test_mujoco_is_of_fourth_order():
    steps, errors = np.array([0.16, 0.08, 0.04, 0.02]), []
    for dt in steps:
        p, found = ends(dt, U, 3.2)
        errors.append(apart(found, flown(p, U, 3.2)))
    assert 3.5 < np.polyfit(np.log(steps), np.log(errors), 1)[0] < 4.5, errors


def test_theta_is_the_published_body_about_its_own_origin():
    p = AstrobeePlant().build(1e-2, 3)
    d, space = published_numbers("astrobee"), p.system.space
    m, c = d["mass"], UP * d["centre"]
    about = np.diag(d["inertia"]) + m * (c @ c * np.eye(3) - np.outer(c, c))
    expected = [
        m,
        *(m * c),
        about[0, 0],
        about[0, 1],
        about[1, 1],
        about[0, 2],
        about[1, 2],
        about[2, 2],
    ]
    np.testing.assert_allclose(p.truth[space["body"]], expected, rtol=1e-12, atol=1e-16)


@pytest.mark.parametrize("nozzle", range(12))
def test_a_nozzle_acts_where_the_published_table_says(nozzle):
    p = AstrobeePlant().build(1e-2, 3)
    places, forces = nozzle_forces(p)
    M = p.system.mass_matrix(np.r_[p.position(np.zeros(6)), np.zeros(6)], p.truth)
    wrench = M @ acceleration(p, np.zeros(6), np.zeros(6), np.eye(12)[nozzle])
    expected = np.r_[forces[nozzle], np.cross(places[nozzle], forces[nozzle])]
    np.testing.assert_allclose(wrench, expected, atol=1e-12)
    assert p.system.mounts is not None
    np.testing.assert_array_equal(p.system.mounts[nozzle], places[nozzle])
