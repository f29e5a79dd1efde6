"""Cars in MuJoCo agree with the single-track model; the rover does so approximately."""

from __future__ import annotations

from functools import partial
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.control.driving import Driving
from nsaid_mj.lab.plants.jointed import RoverPlant
from nsaid_mj.lab.plants.rover import STEERED, WHEELS, Rover, ackermann
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant, BMW320iPlant, F1TenthPlant
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.robots.assets import published_numbers
from tests.support.plants import drive, hold, plant, wrong_prior
from tests.support.vehicles import acceleration

CARS: dict[str, type[PlantConfig]] = {"f1tenth": F1TenthPlant, "bmw320i": BMW320iPlant}
cars = pytest.mark.parametrize("name", CARS)
DRIVES = {
    "f1tenth": Driving(variation=0.55),
    "bmw320i": Driving(
        speed=25.0, pace_low=0.02, pace_high=0.08, grip=5.0, steer_high=3.0, ground=1000.0
    ),
    "rover": Driving(
        speed=2.0,
        variation=0.2,
        pace_low=0.1,
        pace_high=0.6,
        grip=0.7,
        steer_low=0.05,
        steer_high=0.4,
        ground=40.0,
    ),
}
car = partial(plant, dt=0.005)


def wheelbase(p: Plant) -> float:
    """Distance between the axles [m]."""
    front, rear = p.system.constants("tyre", "arm")
    return float(front - rear)


def driver(name: str, p: Plant, seed: int = 0) -> Driver:
    return DRIVES[name].build(p.system, wrong_prior(p, seed), np.random.default_rng(seed))


def driven(name: str, p: Plant, seconds: float, seed: int = 0) -> Any:
    """(t, q, v, u) of every sample, driven under a prior 30 % off."""
    return drive(p, driver(name, p, seed), seconds)


# -- the textbook ----------------------------------------------------------------------------------


class SingleTrack:
    """Rajamani, Vehicle Dynamics and Control, 2012, chapter 2, about the centre of mass.

    d/dt of [X, Y, ψ, V_x, V_y, r], with the place of the centre of mass in the world, its velocity
    in the car's axes, and the tyres' angles from the velocity of each wheel.
    """

    def __init__(self, p: Plant, wheelbase: float, u: Array, wind: tuple[float, float] = (0, 0)):
        self.m, h, about_middle, *self.rest = p.truth
        self.offset, self.u, self.wind = h / self.m, u, wind
        self.a, self.b = wheelbase / 2 - self.offset, wheelbase / 2 + self.offset
        self.I = about_middle - self.m * self.offset**2

    def __call__(self, t: float, x: Array) -> Array:
        C_f, C_r, k_d, k_v, c_0, c_D = self.rest
        (_, _, psi, vx, vy, r), (d, delta) = x, self.u
        f_front = C_f * (delta - np.arctan((vy + self.a * r) / vx))
        f_rear = C_r * (0 - np.arctan((vy - self.b * r) / vx))
        air = vx - (np.cos(psi) * self.wind[0] + np.sin(psi) * self.wind[1])
        push = k_d * d - k_v * vx * d - c_0 - c_D * air * np.abs(air)
        return np.array(
            [
                vx * np.cos(psi) - vy * np.sin(psi),
                vx * np.sin(psi) + vy * np.cos(psi),
                r,
                (push - f_front * np.sin(delta)) / self.m + vy * r,
                (f_front * np.cos(delta) + f_rear) / self.m - vx * r,
                (self.a * f_front * np.cos(delta) - self.b * f_rear) / self.I,
            ]
        )

    def end(self, q: Array, v: Array, seconds: float) -> Array:
        """(6,) position and velocity of mid-wheelbase after some seconds."""
        x, c, s = self.offset, np.cos(q[2]), np.sin(q[2])
        centre = [q[0] + c * x, q[1] + s * x, q[2], v[0], v[1] + x * v[2], v[2]]
        done = solve_ivp(self, (0, seconds), centre, method="DOP853", rtol=1e-13, atol=1e-13)
        X, Y, psi, vx, vy, r = done.y[:, -1]
        c, s = np.cos(psi), np.sin(psi)
        return np.array([X - c * x, Y - s * x, psi, vx, vy - x * r, r])


START = {
    "f1tenth": (np.array([1.0, -2.0, 0.4]), np.array([6.0, 0.3, -0.5]), np.array([0.2, 0.15])),
    "bmw320i": (np.array([9.0, -5.0, 2.4]), np.array([25.0, -0.4, 0.2]), np.array([0.1, 0.03])),
}


@cars
@pytest.mark.parametrize("wind", [(0.0, 0.0), (2.0, -3.0)])
def test_mujoco_moves_as_the_single_track_model(name, wind):
    p = car(name, dt=1e-3, mismatch=Mismatch(flow=(*wind, 0.0)))
    q, v, u = START[name]
    expected = SingleTrack(p, wheelbase(p), u, wind).end(q, v, 3.0)
    np.testing.assert_allclose(hold(p, (q, v), u, 3.0), expected, rtol=0, atol=1e-8)


@cars
def test_the_plant_is_of_fourth_order_in_the_step(name):
    q, v, u = START[name]
    expected = SingleTrack(car(name), wheelbase(car(name)), u).end(q, v, 0.64)
    errors = np.array(
        [
            np.abs(hold(car(name, dt=dt), (q, v), u, 0.64) - expected).max()
            for dt in (0.016, 0.008, 0.004)
        ]
    )
    orders = np.log2(errors[:-1] / errors[1:])
    assert errors[-1] < 1e-6 and (orders > 3.5).all() and (orders < 5).all(), (errors, orders)


@cars
@pytest.mark.parametrize("seed", range(3))
def test_w_theta_is_zero_along_mujocos_motion(name, seed):
    p = car(name, seed)
    system, theta = p.system, p.truth
    t, q, v, u = driven(name, p, 20, seed)
    for k in range(0, len(t), 200):
        x = np.r_[q[k], v[k]]
        W = system.regressor(t[k], x, v[k], acceleration(p, q[k], v[k], u[k]), u[k])
        assert np.abs(W @ theta).max() <= 1e-11 * np.abs(system.F(t[k], x, u[k]) * theta).max()


@cars
def test_m_is_positive_definite_and_c_is_skew(name):
    p, rng = car(name), np.random.default_rng(0)
    q, v, _ = p.system.random_state(rng)
    M = p.system.mass_matrix(np.r_[q, v], p.truth)
    C = p.system.coriolis_matrix(np.r_[q, v], p.truth)
    assert np.linalg.eigvalsh(M)[0] > 0 and (M == M.T).all()
    assert np.abs(C + C.T).max() <= 1e-13 * np.abs(C).max()  # M is constant in the body's axes


# -- the truth is the published car ----------------------------------------------------------------


@pytest.mark.parametrize(
    "name,stiffness", [("f1tenth", (94.274, 100.949)), ("bmw320i", (129.7e3, 105.4e3))]
)
def test_without_spread_theta_is_the_published_car(name, stiffness):
    d, truth = published_numbers(name), car(name, spread=0.0).truth
    off = 0.5 * (d["rear"] - d["front"])  # the heavier end is the nearer one
    expected = [
        d["mass"],
        d["mass"] * off,
        d["inertia"] + d["mass"] * off**2,
        *stiffness,
        d["drive"],
        d["loss"],
        d["rolling"],
        d["drag"],
    ]
    np.testing.assert_allclose(truth, expected, rtol=1e-3)


@cars
def test_mujocos_own_inertia_is_that_of_the_truth(name):
    p = car(name)
    full = np.zeros((3, 3))
    with p.running():
        p.reset(np.zeros(3), np.zeros(3))
        mujoco.mj_forward(p.model, p.data)
        mujoco.mj_fullM(p.model, p.data, full)
    np.testing.assert_allclose(full, p.system.mass_matrix(np.zeros(6), p.truth), rtol=1e-12)


@cars
def test_hidden_numbers_differ_by_seed_and_do_not_enter_the_scale(name):
    one, other, nominal = car(name, 1), car(name, 2), car(name, spread=0.0)
    assert (one.system.space.scale == other.system.space.scale).all()
    ratio = one.truth / nominal.truth
    assert (np.abs(np.delete(ratio, [1, 2]) - 1) <= 0.2).all() and len(set(ratio)) == 9
    assert (one.truth != other.truth).all()
    assert (one.system.space.scale / nominal.truth < 6).all()
    assert (nominal.truth / one.system.space.scale < 2).all()


@pytest.mark.parametrize("name", [*CARS, "rover"])
def test_only_the_common_scale_is_unobservable(name):
    p = car(name)
    nullspace = Nullspace.structural(p.system, p.truth, np.random.default_rng(0))
    assert nullspace.r == 1
    counts, does_not = nullspace.gap
    assert counts > 3e-3 and does_not < 1e-12
    mounts = p.system.mounts
    assert mounts is not None and mounts.shape == (len(p.system.space.actuators), 3)


# -- the signs -------------------------------------------------------------------------------------


@cars
def test_a_car_turns_as_steered_and_slows_down_when_coasting(name):
    p = car(name)
    q, v = np.zeros(3), np.array([START[name][1][0], 0.0, 0.0])
    left = hold(p, (q, v), np.array([0.0, 0.02]), 1.0)
    right = hold(p, (q, v), np.array([0.0, -0.02]), 1.0)
    assert left[1] > 0.02 and left[5] > 0
    np.testing.assert_allclose(left[[1, 2, 4, 5]], -right[[1, 2, 4, 5]], rtol=1e-9)
    pushed = hold(p, (q, v), np.array([0.3, 0.0]), 1.0)
    assert left[3] < v[0] < pushed[3]


@cars
def test_a_gentle_bend_has_the_radius_of_the_understeer_gradient(name):
    """u/r = R, δ = L/R + K_us a_y with K_us = W_f/C_f − W_r/C_r: Rajamani, (3.22)."""
    p = car(name)
    m, h, _, C_f, C_r = p.truth[:5]
    L, speed, delta = wheelbase(p), START[name][1][0], 2e-3
    front, rear = (m * (0.5 + sign * h / m / L) for sign in (1, -1))
    gradient = front / C_f - rear / C_r
    _, _, _, _, _, k_d, k_v, c_0, c_D = p.truth
    throttle = (c_0 + c_D * speed**2) / (k_d - k_v * speed)  # keeps the speed
    end = hold(p, (np.zeros(3), np.array([speed, 0, 0])), np.array([throttle, delta]), 3.0)
    expected = end[3] * delta / (L + gradient * end[3] ** 2)
    assert end[5] == pytest.approx(expected, rel=1e-3)


# -- mismatch --------------------------------------------------------------------------------------


@cars
@pytest.mark.parametrize(
    "switch", [{"lag": 0.05}, {"delay": 0.05}, {"flow": (3.0, 1.0, 0.0)}], ids=str
)
def test_every_switch_changes_the_motion(name, switch):
    q, v, u = START[name]
    one, other = car(name), car(name, mismatch=Mismatch(**switch))
    assert (one.truth == other.truth).all()
    assert np.abs(hold(one, (q, v), u, 0.5) - hold(other, (q, v), u, 0.5)).max() > 1e-4
    assert not one.mismatches and len(other.mismatches) == 1


@cars
def test_head_wind_adds_its_speed_to_the_cars(name):
    p, calm = car(name, mismatch=Mismatch(flow=(-4.0, 0.0, 0.0))), car(name)
    u, still = np.zeros(2), np.zeros(3)
    q, v = still, np.array([10.0, 0.0, 0.0])
    less = acceleration(p, q, v, u)[0] - acceleration(calm, q, v, u)[0]
    m, c_D = p.truth[0], p.truth[8]
    assert less == pytest.approx(-c_D * (14.0**2 - 10.0**2) / m, rel=1e-9)


@pytest.mark.parametrize("config", [*CARS.values(), RoverPlant])
@pytest.mark.parametrize("switch", [{"fluid": "ellipsoid"}, {"flow": (0.0, 0.0, 1.0)}])
def test_a_mismatch_no_car_has_is_refused(config, switch):
    with pytest.raises(InvalidInput) as caught:
        config(mismatch=Mismatch(**switch))
    assert caught.value.name == f"mismatch.{next(iter(switch))}"


# -- the driver ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_the_driver_stays_on_its_ground_and_within_the_tyres_speeds(name, seed):
    p = car(name, seed + 3)
    _, q, v, u = driven(name, p, 60 if name == "rover" else 120, seed)
    config, speed = DRIVES[name], v[:, 0]
    assert speed.min() > 0.4 * config.speed and speed.max() < 1.7 * config.speed
    assert np.ptp(speed) > 1.2 * config.variation * config.speed
    assert np.hypot(q[:, 0], q[:, 1]).max() < config.ground
    assert np.abs(v[:, 0] * v[:, 2]).max() < 1.5 * config.grip
    assert (np.abs(u) <= [1.0, p.system.operation.command[1][1]]).all()
    assert np.abs(np.arctan2(v[:, 1] - 0.5 * wheelbase(p) * v[:, 2], speed)).max() < 0.15


def test_the_driver_uses_only_the_prior():
    one, other = car("f1tenth", 1), car("f1tenth", 2)
    commands = [
        DRIVES["f1tenth"]
        .build(p.system, wrong_prior(one), np.random.default_rng(0))
        .command(1.0, np.array([60.0, 5.0, 0.3]), np.array([7.0, 0.1, 0.2]))
        for p in (one, other)
    ]
    assert (commands[0] == commands[1]).all()


def test_the_driver_refuses_other_vehicles():
    system = BlueROV2Plant().build(0.01, 0).system
    with pytest.raises(InvalidInput) as caught:
        Driving().build(system, system.space.scale, np.random.default_rng(0))
    assert caught.value.name == "excitation" and caught.value.remedy


# -- the rover -------------------------------------------------------------------------------------


def rover(seed: int = 1, **options: Any) -> Rover:
    p = car("rover", seed, **options)
    assert isinstance(p, Rover)
    return p


def test_the_rover_stands_on_its_wheels():
    p = rover()
    weight = p.truth[0] * 9.81
    end = hold(p, (np.array([1.0, 2.0, 0.5]), np.zeros(3)), np.zeros(2), 2.0)
    np.testing.assert_allclose(end, [1.0, 2.0, 0.5, 0, 0, 0], rtol=0, atol=1e-3)
    mujoco.mj_forward(p.model, p.data)
    normal = [p.data.efc_force[contact.efc_address] for contact in p.data.contact]
    assert sum(normal) == pytest.approx(weight, rel=1e-4) and min(normal) > 0
    touching = {p.model.geom(int(i)).name for c in p.data.contact for i in c.geom} - {"ground"}
    assert touching == {f"tyre_{wheel}" for wheel in WHEELS}


def test_the_truth_of_a_rover_is_its_parts():
    """Mass, first moment and inertia by MuJoCo's own composite body; the rest by the numbers."""
    p = rover(spread=0.0)
    d = published_numbers("rover")
    m, h, about_middle, C_f, C_r, k_d, k_v, c_0, c_D = p.truth
    assert m == pytest.approx(mujoco.mj_getTotalmass(p.model))
    with p.running():
        p.reset(np.zeros(3), np.zeros(3))
        mujoco.mj_forward(p.model, p.data)
        full = np.zeros((p.model.nv, p.model.nv))
        mujoco.mj_fullM(p.model, p.data, full)
    assert h == pytest.approx(full[1, 5], rel=1e-6) and about_middle == pytest.approx(full[5, 5])
    assert k_d == pytest.approx(2 * d["torque"] / d["radius"])
    assert k_v == pytest.approx(k_d / d["top_speed"])
    assert c_0 == pytest.approx(4 * d["bearing"] / d["radius"])
    assert 0.05 < c_D < 0.5 and 0.5 < C_f / C_r < 2


def test_straight_ahead_a_rovers_mass_is_that_of_its_parts_and_wheel_spin():
    """k_d, k_v and c_0 are right and m along x is I/r² a wheel more, to a few percent."""
    p, d = rover(spread=0.0), published_numbers("rover")
    m, _, _, _, _, k_d, k_v, c_0, c_D = p.truth
    heavier = m + 4 * d["wheel_inertia"][1] / d["radius"] ** 2
    start = np.zeros(3), np.array([1.5, 0.0, 0.0])
    ends = {command: hold(p, start, np.array([command, 0.0]), 2.0)[3] for command in (0.0, 0.2)}

    def speed(command: float) -> float:
        def rate(t: float, u: Array) -> Array:
            return ((k_d - k_v * u) * command - c_0 - c_D * u * u) / heavier

        return float(solve_ivp(rate, (0, 2.0), [1.5], rtol=1e-9).y[0, -1])

    for command, end in ends.items():
        assert end - 1.5 == pytest.approx(speed(command) - 1.5, rel=0.05)


def test_a_rovers_measurement_is_its_planar_motion():
    p = rover(dt=2.5e-3)
    with p.running():
        p.reset(np.array([3.0, -1.0, 3.0]), np.array([2.0, 0.1, 0.4]))
        states = [p.coordinates()]
        np.testing.assert_allclose(np.concatenate(states[0]), [3, -1, 3, 2, 0.1, 0.4], atol=1e-12)
        for _ in range(400):
            p.step(np.array([0.3, 0.3]))
            states.append(p.coordinates())
    for before, middle, after in zip(states[100:], states[101:], states[102:], strict=False):
        step = p.system.difference(before[0], after[0])
        simpson = (before[1] + 4 * middle[1] + after[1]) * p.dt / 3
        np.testing.assert_allclose(step, simpson, rtol=1e-4, atol=1e-7)


def test_a_rover_turns_at_its_kinematic_yaw_rate():
    p = rover(spread=0.0)
    for delta in (-0.3, 0.1, 0.3):
        end = hold(p, (np.zeros(3), np.array([1.0, 0, 0])), np.array([0.12, delta]), 4.0)
        assert end[5] == pytest.approx(end[3] * np.tan(delta) / wheelbase(p), rel=0.05)


def test_the_rack_turns_each_wheel_by_its_own_angle():
    p = rover(spread=0.0)
    hold(p, (np.zeros(3), np.array([1.0, 0, 0])), np.array([0.12, 0.3]), 3.0)
    left, right = (float(p.data.joint(name).qpos[0]) for name in STEERED)
    track = published_numbers("rover")["track"]
    assert 1 / np.tan(right) - 1 / np.tan(left) == pytest.approx(track / wheelbase(p), rel=0.03)
    angle = np.linspace(-0.4, 0.4, 9)
    curve = np.polynomial.polynomial.polyval(angle, ackermann(0.3, 0.4))
    np.testing.assert_allclose(
        curve, np.arctan(np.tan(angle) / (1 - 0.3 * np.tan(angle))), atol=1e-3
    )


def test_a_rovers_cornering_stiffness_grows_with_speed():
    """What the linear tyre misses first: the cornering stiffness grows with the speed."""
    p = rover(spread=0.0)
    stiffness = []
    for speed, throttle in ((1.0, 0.08), (2.0, 0.12)):
        end = hold(p, (np.zeros(3), np.array([speed, 0, 0])), np.array([throttle, 0.05]), 4.0)
        slip = np.arctan2(end[4] - 0.5 * wheelbase(p) * end[5], end[3])
        stiffness.append(-end[3] * end[5] / slip / end[3])
    assert stiffness[0] == pytest.approx(stiffness[1], rel=0.1)  # per speed, not per angle


def test_a_rovers_mismatch_is_reported():
    p = rover()
    assert len(p.mismatches) >= 4 and "slip" in " ".join(p.mismatches)
    blown = rover(mismatch=Mismatch(flow=(5.0, 0.0, 0.0), lag=0.05))
    assert len(blown.mismatches) == len(p.mismatches) + 2
    q, v, u = np.zeros(3), np.array([2.0, 0, 0]), np.array([0.1, 0.1])
    assert np.abs(hold(p, (q, v), u, 1.0) - hold(blown, (q, v), u, 1.0)).max() > 1e-3


def test_a_rover_has_meshes_in_their_places():
    p = rover()
    meshes = p.visuals()
    q = np.array([[1.0, 2.0, np.pi / 2], [0.0, 0.0, 0.0]])
    places, turns = p.poses(q)
    assert places.shape == (2, len(meshes), 3) and turns.shape == (2, len(meshes), 4)
    k = [mesh.name for mesh in meshes].index("tyre_front_left")
    np.testing.assert_allclose(places[1, k], [0.2742, 0.25, 0.123], atol=2e-3)
    np.testing.assert_allclose(places[0, k], [1.0 - 0.25, 2.0 + 0.2742, 0.123], atol=2e-3)


def predicted(p: Plant, samples: Any, theta: Array) -> float:
    """rms of W θ with v̇ by central differences, over rms of the drive force under θ."""
    t, q, v, u = samples
    k, system = slice(100, -1, 5), p.system
    a = ((v[2:] - v[:-2]) / (t[2:] - t[:-2])[:, None])[k.start - 1 :: 5][: len(t[k])]
    held_u = 0.5 * (u[:-1] + u[1:])[k.start - 1 :: 5][: len(t[k])]  # half of either hold
    x = np.hstack([q, v])[k]
    residual = system.regressor(t[k], x, v[k], a, held_u) @ theta
    actuators = system.space.actuators
    force = system.F(t[k], x, held_u)[..., actuators] @ theta[actuators]
    return float(np.sqrt(np.mean(residual**2) / np.mean(force**2)))


def test_the_prediction_error_is_small_where_the_structure_is_exact():
    p = car("f1tenth")
    assert predicted(p, driven("f1tenth", p, 10, 7), p.truth) < 0.02


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_under_the_rovers_mismatch_the_estimate_stays_bounded_and_predicts_better(seed):
    """No θ fits, so nothing converges; yet θ̂ stays on its sphere, and beats prior and parts."""
    p = rover(seed)
    prior = wrong_prior(p, seed)
    law = NullspaceAID(K=10.0, gain=0.05).build(p.system, prior, p.dt)
    later = driven("rover", p, 30, seed + 50)
    with p.running():
        samples = p.trajectory(driver("rover", p, seed), round(120 / p.dt))
        state, _ = law.follow(law.init(samples.at(0)), samples)
    assert state.status is Status.completed
    start, end = (float(law.conserved(theta)) for theta in (prior, state.theta_hat))
    assert end == pytest.approx(start, rel=1e-6)
    errors = {
        name: predicted(p, later, theta)
        for name, theta in (("prior", prior), ("parts", p.truth), ("estimate", state.theta_hat))
    }
    assert 0.05 < errors["estimate"] < 0.9 * errors["prior"], errors
    assert errors["estimate"] < errors["parts"], errors
