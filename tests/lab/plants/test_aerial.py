"""Quadrotors: MuJoCo and the structure agree with the textbook's equations of motion."""

from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.lab.control.quadrotor import QuadrotorFlight
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant, QuadrotorPlant
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.lab.setup import Setup, draw_prior
from nsaid_mj.robots.assets import published_numbers
from tests.support.matrices import skew
from tests.support.plants import drive, hold, plant
from tests.support.strategies import seeds
from tests.support.vehicles import acceleration

FEW = settings(deadline=None, max_examples=15)
MODELS = ["hummingbird", "crazyflie"]
models = pytest.mark.parametrize("model", MODELS)
HOVER = {"hummingbird": 0.31, "crazyflie": 0.71}  # rotor speeds that about hold the weight
UNEVEN = {"hummingbird": 1e-2, "crazyflie": 1e-3}  # … and how unequal they are flown at
FLIGHT = {
    "hummingbird": QuadrotorFlight(),
    "crazyflie": QuadrotorFlight(
        speed=5.0, climb=2.5, yaw_rate=8.0, tilt=0.6, attitude_bandwidth=3.0, dither=0.2
    ),
}
CALM = QuadrotorFlight(speed=2.0, climb=0.5, yaw_rate=0.5, dither=1e-9)
START = (
    np.array([1.0, -2.0, 3.0, 0.3, -0.2, 0.9]),
    np.array([2.0, -1.5, 0.7, 0.4, -0.3, 0.5]),
)


def command(model):
    return HOVER[model] + UNEVEN[model] * np.array([1.0, -0.5, 0.3, -1.0])


def named(p):
    return dict(zip(p.system.space.names, p.truth, strict=True))


# -- against the textbook, written out about the centre of mass ----------------------------------


def physical(model, p):
    """Mass, centre, inertia about it and the rotors' numbers that θ stands for."""
    k = named(p)
    m, c = k["m"], np.array([k["hx"], k["hy"], k["hz"]]) / k["m"]
    origin = np.array(
        [
            [k["Ixx"], k["Ixy"], k["Ixz"]],
            [k["Ixy"], k["Iyy"], k["Iyz"]],
            [k["Ixz"], k["Iyz"], k["Izz"]],
        ]
    )
    return m, c, origin + m * np.linalg.matrix_power(skew(c), 2), k  # Huygens and Steiner


def textbook(model, p, seconds, u, start=START, wind=(0.0, 0.0, 0.0)):
    """(3,) place of the origin, (3, 3) attitude, (6,) twist: Newton and Euler, DOP853."""
    m, c, inertia, k = physical(model, p)
    d = published_numbers(model)["rotors"]
    lever = d["arm"] / 2**0.5

    def wrench(R, through_air, omega):
        """Force and torque about the origin, body axes, rotor by rotor."""
        speed = np.linalg.norm(through_air)
        force = -speed * np.array([k["drag_x"], k["drag_y"], k["drag_z"]]) * through_air
        torque = np.zeros(3)
        for i, ((x, y), spin) in enumerate(zip(d["places"], d["spin"], strict=True)):
            arm = np.array([x * lever, y * lever, 0.0])
            local = through_air + skew(omega) @ arm
            drag = np.diag([k["rotor_drag_h"], k["rotor_drag_h"], k["rotor_drag_z"]])
            thrust = k[f"thrust_{i + 1}"] * u[i] ** 2 + k["lift"] * (local[:2] @ local[:2])
            push = np.array([0, 0, thrust]) - u[i] * drag @ local
            force = force + push
            torque = torque + skew(arm) @ push + [0, 0, spin * k[f"torque_{i + 1}"] * u[i] ** 2]
        return force, torque

    def rate(_, s):
        velocity, R, omega = s[3:6], s[6:15].reshape(3, 3), s[15:]  # of the centre of mass
        at_origin = R.T @ (velocity - wind) - np.cross(omega, c)
        force, torque = wrench(R, at_origin, omega)
        moment = torque - np.cross(c, force)
        return np.concatenate(
            [
                velocity,
                R @ force / m - [0, 0, 9.81],
                (R @ skew(omega)).ravel(),
                np.linalg.solve(inertia, moment - np.cross(omega, inertia @ omega)),
            ]
        )

    R = Rotation.from_rotvec(start[0][3:]).as_matrix()
    omega = start[1][3:]
    first = np.concatenate(
        [start[0][:3] + R @ c, R @ (start[1][:3] + np.cross(omega, c)), R.ravel(), omega]
    )
    end = solve_ivp(rate, (0, seconds), first, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    R, omega = end[6:15].reshape(3, 3), end[15:]
    twist = np.concatenate([R.T @ end[3:6] - np.cross(omega, c), omega])
    return end[:3] - R @ c, R, twist


def apart(p, model, seconds, u, **options):
    """Largest difference of MuJoCo's pose and twist to the textbook's."""
    place, R, twist = textbook(model, p, seconds, u, **options)
    end = hold(p, START, u, seconds)
    turn = (Rotation.from_matrix(R).inv() * Rotation.from_rotvec(end[3:6])).as_rotvec()
    return np.abs(np.concatenate([end[:3] - place, turn, end[6:] - twist])).max()


@models
@pytest.mark.parametrize("seed", range(2))
def test_mujoco_moves_as_the_textbooks_equations_integrated_by_scipy(model, seed):
    assert apart(plant(model, seed, 5e-4), model, 3.0, command(model)) <= 1e-8


@models
def test_mujoco_moves_as_the_textbooks_equations_in_wind(model):
    wind = (3.0, -1.0, 0.5)
    p = plant(model, dt=5e-4, mismatch=Mismatch(flow=wind))
    assert apart(p, model, 2.0, command(model), wind=wind) <= 1e-8
    assert apart(p, model, 2.0, command(model)) > 1e-3


@models
def test_the_error_of_mujocos_steps_is_of_fourth_order(model):
    steps, u = np.array([0.02, 0.01, 0.005]), command(model)
    errors = np.array([apart(plant(model, 1, float(dt)), model, 1.0, u) for dt in steps])
    assert errors[-1] > 1e-12
    assert 3.6 < np.polyfit(np.log(steps), np.log(errors), 1)[0] < 4.6, errors


# -- θ -------------------------------------------------------------------------------------------


@models
@FEW
@given(seeds)
def test_the_truth_leaves_no_residual(model, seed):
    p = plant(model)
    system, rng = p.system, np.random.default_rng(seed)
    q, v, u = system.random_state(rng)
    place = np.r_[q[:3], rng.normal(size=3)]
    W = system.regressor(0.0, np.r_[system.position(place), v], v, acceleration(p, place, v, u), u)
    assert np.abs(W @ p.truth).max() <= 1e-11 * np.abs(W * p.truth).max()
    assert np.abs(W @ (p.truth * np.r_[1.01, np.ones(23)])).max() > 1e-4 * np.abs(W * p.truth).max()


@models
def test_without_spread_theta_is_the_published_numbers(model):
    d, p = published_numbers(model), plant(model, spread=0.0)
    k, rotors = named(p), d["rotors"]
    top = rotors["top_speed"]
    assert k["m"] == d["mass"] and k["lift"] == rotors["lift"]
    for i in range(1, 5):
        assert k[f"thrust_{i}"] == pytest.approx(rotors["thrust"] * top**2, rel=1e-14)
        assert k[f"torque_{i}"] == pytest.approx(rotors["torque"] * top**2, rel=1e-14)
    assert k["rotor_drag_h"] == pytest.approx(rotors["drag"][0] * top, rel=1e-14)
    assert k["rotor_drag_z"] == pytest.approx(rotors["drag"][1] * top, rel=1e-14)
    assert [k[f"drag_{axis}"] for axis in "xyz"] == d["body_drag"]
    m, c, inertia, _ = physical(model, p)
    np.testing.assert_allclose(inertia, np.diag(d["inertia"]), atol=1e-9 * d["inertia"][2])
    assert np.abs(c).min() > 0 and (np.abs(c) <= d["centre_of_mass"]).all()
    mujoco.mj_forward(p.model, p.data)
    assert p.data.subtree_com[0] == pytest.approx(c, abs=1e-12)
    assert p.model.body_mass[1] == m


@models
def test_mujocos_mass_matrix_is_the_systems(model):
    p = plant(model)
    place, v = START
    M = np.zeros((6, 6))
    with p.running():
        p.reset(place, v)
        mujoco.mj_forward(p.model, p.data)
        mujoco.mj_fullM(p.model, p.data, M)
    T = np.eye(6)
    T[:3, :3] = Rotation.from_rotvec(place[3:]).as_matrix()
    found = p.system.mass_matrix(np.r_[p.system.position(place), v], p.truth)
    np.testing.assert_allclose(found, T.T @ M @ T, atol=1e-12 * np.abs(M).max())
    assert np.linalg.eigvalsh(found)[0] > 0


@models
@FEW
@given(seeds)
def test_c_is_skew(model, seed):
    """M is constant in the body, so Ṁ − 2C is skew if C is."""
    p = plant(model)
    q, v, _ = p.system.random_state(np.random.default_rng(seed))
    C = p.system.coriolis_matrix(np.r_[q, v], p.truth)
    assert np.abs(C + C.T).max() <= 1e-14 * np.abs(C).max()


@models
@pytest.mark.parametrize("spread", [0.1, 0.9])
def test_every_drawn_inertia_is_physical(model, spread):
    """However far it is drawn from the published one, a moment is less than the other two."""
    for seed in range(20):
        _, _, inertia, _ = physical(model, plant(model, seed, spread=spread))
        moments = np.linalg.eigvalsh(inertia)
        assert moments[0] > 0 and moments[2] < moments[0] + moments[1]


def test_the_published_inertia_of_the_crazyflie_is_not_physical():
    x, y, z = published_numbers("crazyflie")["inertia"]
    assert z < x + y < 2.89e-5


@models
def test_hidden_numbers_differ_by_seed_and_do_not_enter_the_scale(model):
    one, other, nominal = plant(model, 1), plant(model, 2), plant(model, 1, spread=0.0)
    scale = one.system.space.scale
    assert (scale == other.system.space.scale).all() and (scale == nominal.system.space.scale).all()
    free = np.r_[0, 10:24] if model == "hummingbird" else np.r_[0, 11:24]
    ratio = one.truth[free] / nominal.truth[free]
    assert (np.abs(ratio - 1) <= 0.1).all() and len(set(ratio)) == len(ratio)
    assert (np.abs(ratio[-4:] - 1) <= 0.05).all()  # torques
    assert np.abs(ratio[-8:-4] - 1).max() > 0.05  # thrusts
    assert (one.truth[free] != other.truth[free]).all()
    assert (one.truth[1:4] != other.truth[1:4]).all()


@models
def test_only_the_common_scale_is_unobservable(model):
    p = plant(model)
    nullspace = Nullspace.structural(p.system, p.truth, np.random.default_rng(0))
    assert p.system.p == 24 and nullspace.r == 1
    (direction,) = nullspace.directions(p.system.space)
    assert direction.words.startswith("common scale of everything")
    assert nullspace.gap[0] > 1e-4 and nullspace.gap[1] < 1e-12


@models
def test_the_mounts_are_where_thrust_acts_and_a_torque_has_none(model):
    system = plant(model).system
    at = system.mounts
    assert at is not None and at.shape == (len(system.space.actuators), 3)
    assert np.isnan(at[4:]).all() and (at[:4] == system.constants("rotor", "point")).all()
    np.testing.assert_allclose(
        np.linalg.norm(at[:4], axis=1), published_numbers(model)["rotors"]["arm"]
    )
    q, v, u = system.random_state(np.random.default_rng(0))
    F = system.F(0.0, np.r_[q, v], u)[:, system.space["rotor thrust gain"]]
    np.testing.assert_allclose(np.cross(at[:4], F[:3].T), F[3:].T, atol=1e-15)
    spun = plant(model).model
    for i in range(4):
        place = spun.geom(f"rotor_{i + 1}").pos
        np.testing.assert_allclose(place[:2], at[i, :2], atol=1e-4)


# -- signs ---------------------------------------------------------------------------------------


@models
@pytest.mark.parametrize(
    "faster,axis,sign",
    [
        ((0, 3), 3, 1),  # left rotors: rolls to the right, about +x
        ((2, 3), 4, 1),  # rear rotors: nose down, about +y
        ((0, 2), 5, 1),  # those whose torque is about +z
        ((1, 3), 5, -1),
    ],
)
def test_faster_rotors_turn_the_vehicle_about_the_documented_axis(model, faster, axis, sign):
    p, rest = plant(model, spread=0.0), (np.zeros(6), np.zeros(6))
    u = np.full(4, HOVER[model])
    level = acceleration(p, *rest, u)
    u[list(faster)] *= 1.05
    more = acceleration(p, *rest, u) - level
    assert sign * more[axis] > 0 and more[2] > 0
    assert np.argmax(np.abs(more[3:])) + 3 == axis


@models
def test_thrust_equal_to_the_weight_hovers(model):
    d = published_numbers(model)
    u = np.full(
        4, np.sqrt(d["mass"] * 9.81 / (4 * d["rotors"]["thrust"])) / d["rotors"]["top_speed"]
    )
    a = acceleration(plant(model, spread=0.0), np.zeros(6), np.zeros(6), u)
    c = physical(model, plant(model, spread=0.0))[1]
    lifted = a[2] + np.cross(a[3:], c)[2]  # the centre of mass
    assert lifted == pytest.approx(0.0, abs=1e-9)
    assert HOVER[model] == pytest.approx(u[0], rel=0.02)


@models
@FEW
@given(seeds)
def test_all_drag_brakes_and_no_rotor_drag_acts_on_rotors_that_stand(model, seed):
    system = plant(model).system
    q, v, u = system.random_state(np.random.default_rng(seed))
    drag = np.r_[system.space["rotor drag"], system.space["body drag"]]
    power = v @ system.F(0.0, np.r_[q, v], u)[:, drag]
    assert (power < 0).all()
    still = system.F(0.0, np.r_[q, v], 0 * u)
    assert (still[:, system.space["rotor drag"]] == 0).all()
    assert (still[:, system.space.actuators] == 0).all()


# -- mismatch ------------------------------------------------------------------------------------


@models
@pytest.mark.parametrize(
    "field,value",
    [("lag", 0.05), ("delay", 0.05), ("flow", (2.0, -1.0, 0.3)), ("fluid", "ellipsoid")],
)
def test_each_mismatch_changes_the_motion_and_is_reported(model, field, value):
    off = plant(model, mismatch=Mismatch(**{field: value}))
    assert off.mismatches and not plant(model).mismatches
    difference = hold(off, START, command(model), 1.0) - hold(
        plant(model), START, command(model), 1.0
    )
    assert np.abs(difference).max() > 1e-3 and np.isfinite(difference).all()


@models
def test_lag_acts_on_the_rotors_speed(model):
    """Released with its rotors at rest it falls as a stone, and thrust grows as (1 − e^(−t/τ))²."""
    tau = 0.1
    p = plant(model, mismatch=Mismatch(lag=tau), spread=0.0)
    u, rest = np.full(4, HOVER[model]), (np.zeros(6), np.zeros(6))
    assert acceleration(p, *rest, u)[2] == pytest.approx(-9.81, rel=1e-12)
    hold(p, rest, u, 0.05)
    np.testing.assert_allclose(p.data.act, u * (1 - np.exp(-0.05 / tau)), rtol=1e-6)


@models
def test_the_ellipsoid_fluid_model_leaves_the_rotors_out(model):
    """Else their discs would brake like plates; only what is a body does."""
    p = plant(model, mismatch=Mismatch(fluid="ellipsoid"))
    names = [p.model.geom(i).name for i in range(p.model.ngeom)]
    wet = p.model.geom_fluid[:, 0] > 0
    dry = {name for name, is_wet in zip(names, wet, strict=True) if not is_wet}
    assert dry == {name for name in names if name.startswith("rotor_")} and len(dry) >= 4
    down = np.array([0, 0, -5.0, 0, 0, 0])
    exact = acceleration(plant(model), np.zeros(6), down, np.zeros(4))[2]
    found = acceleration(p, np.zeros(6), down, np.zeros(4))[2]
    assert found > -9.81 and found != exact


# -- the flight ----------------------------------------------------------------------------------


@cache
def flight(model, seed, seconds=40.0, **switches):
    """Path, poses, twists and commands of a flight under a prior 30 % off; dt 2.5 ms."""
    scenario = Scenario(
        plant=QuadrotorPlant(vehicle=model, mismatch=Mismatch(**switches)),
        excitation=FLIGHT[model],
        dt=2.5e-3,
        seed=seed,
    )
    setup = Setup.of(scenario)
    p = setup.plant
    driver = scenario.excitation.build(p.system, setup.prior, np.random.default_rng(seed))
    t, q, v, u = drive(p, driver, seconds)
    return np.array([driver._path(time)[0] for time in t]), q, v, u


def airborne(model, way, q, u) -> None:
    """Asserts that a flight stayed near its path, upright, with its rotors within their range."""
    settled = len(q) // 2
    off = np.abs(q - np.pad(way[:, :3], ((0, 0), (0, 4))))[settled:, :3].max()
    assert off < {"hummingbird": 12.0, "crazyflie": 3.0}[model]
    upright = 1 - 2 * (q[:, 3] ** 2 + q[:, 4] ** 2)
    assert upright.min() > {"hummingbird": 0.0, "crazyflie": 0.5}[model]
    assert (u >= 0.1).all() and (u <= 1.0).all()


@pytest.mark.parametrize(
    ("model", "seed"),  # of the first 24 the hardest are among them
    [
        ("crazyflie", 3),
        ("hummingbird", 4),
        pytest.param("crazyflie", 4, marks=pytest.mark.slow),
        pytest.param("hummingbird", 3, marks=pytest.mark.slow),
    ],
)
def test_the_controller_stays_airborne_with_every_gain_wrong(model, seed):
    way, q, v, u = flight(model, seed)
    airborne(model, way, q, u)
    speed = np.linalg.norm(v[:, :3], axis=1)
    assert np.percentile(speed, 90) > {"hummingbird": 7.0, "crazyflie": 4.5}[model]
    assert np.abs(v[:, 5]).max() > 2.0  # it turns against its way
    assert u.std(axis=0).min() > 0.05 * HOVER[model]  # every rotor is dithered


@pytest.mark.slow
@models
@pytest.mark.parametrize("seed", range(24))
def test_the_controller_stays_airborne_for_five_minutes(model, seed):
    way, q, _, u = flight(model, seed, 300.0)
    airborne(model, way, q, u)


@pytest.mark.parametrize(
    "model",  # both have the same controller
    ["crazyflie", pytest.param("hummingbird", marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("name,value", [("lag", 0.02), ("delay", 0.01), ("flow", (3.0, -2.0, 0.5))])
def test_the_controller_stays_airborne_under_unmodelled_lag_delay_and_wind(model, name, value):
    way, q, _, u = flight(model, 0, 20.0, **{name: value})
    airborne(model, way, q, u)


@pytest.mark.parametrize("seed", range(3))
def test_the_reference_path_is_smooth_and_reaches_its_stated_speeds(seed):
    p = plant("hummingbird")
    config = QuadrotorFlight(radius=5.0, speed=6.0, climb=3.0, yaw_rate=2.0)
    driver = config.build(p.system, p.truth, np.random.default_rng(seed))
    t, step = np.linspace(0, 120, 6001), 1e-4
    path = np.array([driver._path(time) for time in t])
    before, after = (np.array([driver._path(time + h) for time in t]) for h in (-step, step))
    for k in range(3):  # each row is the rate of the one above
        slope = (after[:, k] - before[:, k]) / (2 * step)
        np.testing.assert_allclose(slope, path[:, k + 1], atol=1e-6 * np.abs(slope).max())
    level = np.linalg.norm(path[:, 1, :2], axis=1)
    assert 1.9 < level.min() < 2.5 and 5.5 < level.max() < 6.1
    assert np.abs(path[:, 1, 2]).max() == pytest.approx(3.0, rel=0.01)
    assert 1.5 < np.abs(path[:, 1, 3]).max() < 2.01
    assert path[:, 0, 2].min() > 0.99  # above the ground
    numbers_, twist = driver.start()
    assert (numbers_[:3] == path[0, 0, :3]).all() and (numbers_[3:5] == 0).all()
    turned = Rotation.from_rotvec(numbers_[3:]).as_matrix() @ twist[:3]
    np.testing.assert_allclose(turned, path[0, 1, :3], atol=1e-12)


def test_with_the_true_prior_and_no_dither_the_path_is_tracked_closely():
    """Gains right, no dither, slow: what is left is drag, and the integral takes that."""
    p = plant("hummingbird", dt=2.5e-3)
    driver = CALM.build(p.system, p.truth, np.random.default_rng(0))
    with p.running():
        rows = p.trajectory(driver, 12000).rows
    off = [row.q[:3] - driver._path(row.t)[0, :3] for row in rows[6000:]]
    assert np.abs(off).max() < 0.15


@pytest.mark.parametrize("astray", [0.0, 1.0, 2.0, 3.0])
def test_tilt_is_corrected_at_any_heading_error(astray):
    """A heading far off must not turn the tilt's correction about."""
    p = plant("hummingbird", dt=2.5e-3)
    driver = CALM.build(p.system, p.truth, np.random.default_rng(1))
    place, _ = driver.start()
    tilted = Rotation.from_euler("z", place[5] + astray) * Rotation.from_euler("x", 1.0)
    upright = []
    with p.running():
        p.reset(np.r_[place[:3], tilted.as_rotvec()], np.zeros(6))
        for k in range(800):
            coordinates, v = p.coordinates()
            p.step(driver.command(k * p.dt, p.position(coordinates), v))
            upright.append(Rotation.from_rotvec(coordinates[3:6]).as_matrix()[2, 2])
    assert min(upright) > 0.5 and max(upright) > 0.95  # it started at 0.54


def test_restarting_a_driver_resets_its_state():
    p = plant("crazyflie", dt=2.5e-3)
    driver = FLIGHT["crazyflie"].build(p.system, p.truth, np.random.default_rng(0))
    first, again = ([], [])
    for seen in (first, again):
        with p.running():
            seen += [row.u for row in p.trajectory(driver, 200).rows]
    assert (np.array(first) == np.array(again)).all()


def test_the_controller_uses_only_the_prior():
    """Other hidden numbers and the same prior: the same command."""
    one, other = plant("hummingbird", 1), plant("hummingbird", 2)
    prior = draw_prior(one.truth, one.system.space, 0.3, None, np.random.default_rng(0))
    q, v, commands = one.system.position(START[0]), START[1], []
    for p in (one, other):
        driver = QuadrotorFlight().build(p.system, prior, np.random.default_rng(0))
        commands.append([*driver.start(), *(driver.command(t, q, v) for t in (0.0, 0.5))])
    for a, b in zip(*commands, strict=True):
        assert (a == b).all()


# -- bad input -----------------------------------------------------------------------------------


def test_the_controller_refuses_other_vehicles():
    rov = BlueROV2Plant().build(0.01, 0)
    with pytest.raises(InvalidInput) as caught:
        QuadrotorFlight().build(rov.system, rov.truth, np.random.default_rng(0))
    assert caught.value.name == "excitation" and "quadrotor" in caught.value.expected


@pytest.mark.parametrize("vehicle", ["phantom", "Hummingbird", "no/such/folder", "no.toml"])
def test_an_unknown_vehicle_is_refused_with_near_names(vehicle):
    with pytest.raises(UnknownName) as caught:
        QuadrotorPlant(vehicle=vehicle).build(2.5e-3, 0)
    assert caught.value.name == vehicle and "hummingbird" in caught.value.choices
