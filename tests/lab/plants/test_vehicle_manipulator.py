"""Vehicles with an arm satisfy (4)–(10) and (29, 30) and move as MuJoCo does."""

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.log import Log
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.numerics.spatial import unrotate
from nsaid_mj.core.structure.joints import JointScales, JointTree
from nsaid_mj.lab.control.signals import FourierTrajectory, Multisine
from nsaid_mj.lab.control.vehicle_manipulator import HoverAndReach, SwimAndReach
from nsaid_mj.lab.plants.flying_arm import flying_arm
from nsaid_mj.lab.plants.jointed import FlyingArmPlant, UvmsPlant
from nsaid_mj.lab.plants.uvms import published_links
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.robots.assets import published_numbers
from tests.support.dense import Dense, rk4_step, transport
from tests.support.evaluation import Evaluation
from tests.support.matrices import assert_near, coupled
from tests.support.plants import assert_engines_agree, draw_state, drive, plant, wrong_prior
from tests.support.vehicles import acceleration

NAMES = ["uvms", "borinot", "iris"]
vehicles = pytest.mark.parametrize("name", NAMES)


# -- the structure -------------------------------------------------------------------------------


@vehicles
def test_the_regressors_are_linear_and_sum_up(name):
    system, theta = plant(name).system, plant(name).truth
    for seed in range(5):
        x, w, a, u, _ = draw_state(system, seed)
        assert_near(
            system.W_C(x, 2 * w - 3 * a), 2 * system.W_C(x, w) - 3 * system.W_C(x, a), 1e-13
        )
        assert_near(
            system.W_M(x, 2 * w - 3 * a), 2 * system.W_M(x, w) - 3 * system.W_M(x, a), 1e-13
        )
        W = system.regressor(0.0, x, w, a, u)
        assert_near(W, system.W_M(x, a) + system.W_C(x, w) - system.F(0.0, x, u), 1e-13)  # (10)
        M = system.mass_matrix(x, theta)
        assert_near(system.W_M(x, a) @ theta, M @ a, 1e-12)  # (8)
        assert_near(M, M.T, 1e-13)
        assert np.linalg.eigvalsh(M)[0] > 0


@vehicles
def test_evaluate_at_agrees_with_the_definitions(name):
    system, theta = plant(name).system, plant(name).truth
    for seed in range(5):
        x, w, _, u, _ = draw_state(system, seed)
        q, v = system.split(x)
        a, W, pivot = system.evaluate_at(0.0, q, v, u, w, theta)
        assert_near(a, system.acceleration(0.0, x, w, u, theta), 1e-10)  # (29)
        assert_near(W, system.regressor(0.0, x, w, a, u), 1e-12)
        assert np.abs(W @ theta).max() <= 1e-12 * (np.abs(W) @ np.abs(theta)).max()  # (30)
        L = np.linalg.cholesky(system.mass_matrix(x, theta))
        assert pivot == pytest.approx((np.diag(L) ** 2).min(), rel=1e-9)
        a, W, pivot = system.evaluate_at(0.0, q, v, u, w, -theta)
        assert not pivot > 0 and np.isnan(a).all() and np.isfinite(W).all()


def test_without_its_arm_the_uvms_is_the_underwater_vehicle():
    """With the arm's parameters at 0, base and vehicle are one system."""
    p, alone = plant("uvms"), BlueROV2Plant().build(1e-2, 0).system
    system, space = p.system, p.system.space
    theta = np.zeros(system.p)
    own = np.random.default_rng(0).uniform(0.5, 1.5, alone.p) * alone.space.scale
    for block, place in alone.space:
        theta[space[block.name]] = own[place]
    x, w, a, u, _ = draw_state(system, 1)
    q, v = system.split(x)
    push = alone._W(0.0, q[:7], v[:6], w[:6], a[:6], u[4:]) @ own
    assert_near((system._W(0.0, q, v, w, a, u) @ theta)[:6], push, 1e-12)
    assert np.abs((system._W(0.0, q, v, w, a, u) @ theta)[6:]).max() == 0


def test_added_mass_of_a_link_is_that_of_its_strips():
    """½ vᵀ M v of unit added mass is ½ ∫ |v_⊥|² ds/L along the axis, and drag brakes."""
    system = plant("uvms").system
    c, space = published_links(published_numbers("uvms")), system.space
    x, _, _, u, _ = draw_state(system, 3)
    q, v = system.split(x)
    data = system.model.createData()
    pin.forwardKinematics(system.model, data, q, v)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    for i in range(4):
        twist = pin.getVelocity(system.model, data, 2 + i, pin.ReferenceFrame.LOCAL).vector
        along = c.centres[i] + np.outer(nodes, c.axes[i]) * c.lengths[i] / 2
        flow = twist[:3] + np.cross(twist[3:], along)
        flow -= np.outer(flow @ c.axes[i], c.axes[i])
        unit = np.zeros(system.p)
        unit[space["added mass"].start + i] = 1.0
        energy = v @ system._W_M(q, v) @ unit
        assert energy == pytest.approx(np.sum(weights / 2 * np.sum(flow**2, axis=1)), rel=1e-12)
        power = v @ system._F(0.0, q, v, u)[:, space["link drag"].start + i]
        lost = np.sum(weights * np.linalg.norm(flow, axis=1) ** 3) * c.lengths[i] / 2
        assert power == pytest.approx(-lost, rel=0.05)  # four points instead of twelve


def test_buoyancy_and_weight_point_up_and_down():
    system = plant("uvms").system
    level = system.position(np.zeros(system.n))
    F = system._F(0.0, level, np.zeros(system.n), np.zeros(system.n_u))
    space = system.space
    assert_near(F[:3, space["link buoyancy"]], np.outer([0, 0, 1], np.ones(4)), 1e-12)
    assert F[2, space.index("net weight")] == -1
    assert F[2, space.index("m_3")] == pytest.approx(-9.81)


@vehicles
def test_actuators_act_where_they_are_mounted(name):
    system = plant(name).system
    x, _, _, u, _ = draw_state(system, 2)
    k, joints = system.space.actuators, system.n - 6
    F = system.F(0.0, x, u)
    assert system.mounts is not None and system.mounts.shape == (len(k), 3)
    assert np.isnan(system.mounts[:joints]).all()
    for mount, column in zip(system.mounts[joints:], F[:, k[joints:]].T, strict=True):
        if np.isfinite(mount).all():
            assert_near(np.cross(mount, column[:3]), column[3:6], 1e-12)
            assert np.linalg.norm(column[:3]) > 0
        else:
            assert (column[:3] == 0).all() and np.linalg.norm(column[3:6]) > 0
        assert (column[6:] == 0).all()
    assert (system.F(0.0, x, 0 * u)[:, k] == 0).all()
    others = np.setdiff1d(np.arange(system.p), k)
    assert (system.F(0.0, x, 0 * u)[:, others] == F[:, others]).all()


def test_full_command_gives_the_full_gain():
    for name, block in (("uvms", "thruster gain"), ("borinot", "rotor thrust gain")):
        system = plant(name).system
        q = system.position(np.zeros(system.n))
        F = system._F(0.0, q, np.zeros(system.n), np.ones(system.n_u))
        np.testing.assert_allclose(np.linalg.norm(F[:3, system.space[block]], axis=0), 1.0)


@pytest.mark.parametrize("name,r", [("uvms", 13), ("borinot", 7), ("iris", 1)])
def test_the_nullspace_has_the_expected_dimension(name, r):
    """A common scale, and what a joint's fixed axis hides of the links before and behind it."""
    found = Nullspace.structural(plant(name).system, plant(name).truth, np.random.default_rng(0))
    assert found.r == r
    assert found.gap[0] > 1e-5 and found.gap[1] < 1e-13
    scaled = plant(name).truth / plant(name).system.space.scale
    assert found.ratio(scaled) < 1e-10


@vehicles
def test_every_parameter_has_a_sane_scale(name):
    system, theta = plant(name).system, plant(name).truth
    assert theta.shape == (system.p,)
    for block, place in system.space:
        if block.geometry == "positive":
            ratio = theta[place] / block.scale
            assert (ratio > 0.3).all() and (ratio < 3).all()
    other = plant(name, 8)
    assert (other.system.space.scale == system.space.scale).all()  # a guess knows no seed
    assert (other.truth != theta).any()
    assert (plant(name, dt=5e-4).truth == theta).all()


@vehicles
def test_the_system_holds_no_inertia(name):
    model = plant(name).system.model
    assert all((inertia.toDynamicParameters() == 0).all() for inertia in model.inertias)
    assert (np.array(model.armature) == 0).all()


# -- the compiled stages are the system ----------------------------------------------------------


def branching() -> JointTree:
    """A base with a tree of every kind of joint: an angle, on it a turn without end and a slide."""
    model, place = pin.Model(), pin.SE3.Random
    pin.seed(3)
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    arm = model.addJoint(base, pin.JointModelRevoluteUnaligned(0.6, 0.0, 0.8), place(), "arm")
    model.addJoint(arm, pin.JointModelRUBX(), place(), "wheel")
    model.addJoint(arm, pin.JointModelPY(), place(), "slide")
    model.addJoint(base, pin.JointModelRZ(), place(), "tail")
    ones = np.ones(4)
    scales = JointScales(np.ones(5), np.ones(5), ones, ones, ones, ones, ones, rotor=ones)
    rotors = {"positions": [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]], "spins": [1.0, -1.0]}
    sheet = rotors | {"thrust": 1.0, "torque": 1.0, "speed": [1.0] * 6}
    return flying_arm(model, scales, 0.2, sheet)


SYSTEMS = {**{name: lambda name=name: plant(name).system for name in NAMES}, "tree": branching}
systems = pytest.mark.parametrize("name", SYSTEMS)


def possible(name: str, system) -> np.ndarray:
    """(p,) parameters of real bodies."""
    if name in NAMES:
        return plant(name).truth
    theta = np.random.default_rng(6).uniform(0.5, 1.5, system.p)
    pin.seed(6)
    for i in range(system.bodies):
        theta[10 * i : 10 * i + 10] = pin.Inertia.Random().toDynamicParameters()
    return theta


@systems
def test_compiled_stages_equal_the_regressors(name):
    system = SYSTEMS[name]()
    evaluation = Evaluation(system.structure)
    for seed in range(10):
        x, w, _, u, _ = draw_state(system, seed)
        q, v = system.split(x)
        theta = possible(name, system)
        for sign in (1, -1):
            a, gradient, pivot = evaluation.stage(q, v, w, u, sign * theta)
            dense, W, smallest = Dense(system).evaluate_at(0.0, q, v, u, w, sign * theta)
            assert pivot == pytest.approx(smallest, rel=1e-9)
            if sign > 0:
                assert_near(a, dense, 1e-11)
                scale = system.space.scale
                assert_near(gradient * scale, (w - v) @ W * scale, 1e-11)
        assert not pivot > 0


@systems
def test_the_mass_matrix_is_pinocchios(name):
    """Of the rigid bodies; added mass is not known to Pinocchio."""
    system = SYSTEMS[name]()
    rng, model = np.random.default_rng(5), pin.Model(system.model)
    theta = np.zeros(system.p)
    for i in range(1, model.njoints):
        model.inertias[i] = pin.Inertia.Random()
        at = 21 + 10 * (i - 2) if name == "uvms" else 10 * (i - 1)
        if at < 0 or (name == "uvms" and i == 1):
            rows, columns = np.triu_indices(6)
            theta[:21] = model.inertias[i].matrix()[rows, columns]
        else:
            theta[at : at + 10] = model.inertias[i].toDynamicParameters()
    for _ in range(3):
        q, v, _ = system.random_state(rng)
        M = pin.crba(model, model.createData(), q)
        M = np.triu(M) + np.triu(M, 1).T
        assert_near(system.mass_matrix(np.r_[q, v], theta), M, 1e-13)


@cache
def driven(name: str) -> tuple[Any, Log]:
    p = plant(name, 2, 5e-3)
    driver = (SwimAndReach if name == "uvms" else HoverAndReach)().build(
        p.system, wrong_prior(p, 2), np.random.default_rng(2)
    )
    return p, drive(p, driver, 0.75)


def in_numpy(law: Any, log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N−1, n) v̂, (N−1, p) θ̂ and (N−1,) pivots of a law along a log of N measurements."""
    state, rows = law.init(log.at(0)), []
    v_hat, theta_hat = state.v_hat, state.theta_hat
    for pair in pairwise(log.rows):
        rows.append(rk4_step(law, v_hat, theta_hat, *pair))
        v_hat, theta_hat, _ = rows[-1]
    n, p = len(v_hat), len(theta_hat)
    parts = [np.array([row[i] for row in rows]) for i in range(3)]
    return parts[0].reshape(-1, n), parts[1].reshape(-1, p), parts[2]


@vehicles
@pytest.mark.parametrize("law", ["paper", "cone"])
@pytest.mark.parametrize("interpolation", ["hermite", "linear"])
def test_the_compiled_loop_equals_the_generic_one(name, law, interpolation):
    """150 steps; what differs is the order of sums."""
    p, log = driven(name)
    prior, scale = p.truth.copy(), p.system.space.scale
    for i, (_, place) in enumerate(p.system.space):
        prior[place] *= 0.8 + 0.1 * (i % 4)  # every block on its own stays possible
    config = NullspaceAID(law=law, interpolation=interpolation)
    identifier: Any = config.build(p.system, prior, 5e-3)
    state, estimates = identifier.follow(identifier.init(log.at(0)), log)
    assert state.status is Status.completed and len(estimates.v_hat) == 151
    v_hats, theta_hats, pivots = in_numpy(identifier, log)
    assert_near(estimates.v_hat[1:], v_hats, 1e-11)
    assert_near(estimates.theta_hat[1:] / scale, theta_hats / scale, 1e-11)
    assert_near(estimates.pivot[1:], pivots, 1e-11)
    assert np.abs((state.theta_hat - prior) / scale).max() > 1e-6  # it has moved


@vehicles
def test_full_gains_and_endings_equal_the_generic_ones(name):
    p, log = driven(name)
    rng, scale = np.random.default_rng(1), p.system.space.scale
    gains = coupled(np.full(p.system.n, 20.0), rng), coupled(0.1 * scale**2, rng)
    lost = np.where(np.arange(len(log.v))[:, None] == 20, np.nan, log.v)
    broken = Log.unchecked(log.t, log.q, lost, log.u)
    for prior, measured, status, end in (
        (p.truth, log, Status.completed, 150),
        (-p.truth, log, Status.estimate_not_positive_definite, 0),
        (p.truth, broken, Status.measurement_not_finite, 19),
    ):
        law = paper_identifier(p.system, *gains, prior, 5e-3)
        state, estimates = law.follow(law.init(log.at(0)), measured)
        assert state.status is status and state.t == log.t[end]
        assert len(estimates.theta_hat) == end + 1
        if end:
            theta_hats = in_numpy(law, log.first(end + 1))[1]
            assert_near(estimates.theta_hat[1:] / scale, theta_hats / scale, 1e-11)


@systems
def test_transport_is_the_rate_of_momentum_along_the_motion(name):
    """Cᵀ v = Ṁ v − C v, by differences along the motion."""
    system = SYSTEMS[name]()
    for seed in range(3):
        q, v = system.split(draw_state(system, seed)[0])
        assert_near(transport(system, q, v), Dense(system).transport(q, v), 1e-8)


@systems
@pytest.mark.parametrize("leak", [2.0, 0.0])
def test_the_momentum_balance_equals_the_generic_one(name, leak):
    system = SYSTEMS[name]()
    rng = np.random.default_rng(4)
    q, v, u = (
        np.array(part) for part in zip(*(system.random_state(rng) for _ in range(5)), strict=True)
    )
    log, qm, vm = Log(np.array([0.0, 0.1, 0.2, 0.3]), q[:4], v[:4], u[:4]), q[1:4], v[2:]
    fast = system.momentum_balance(leak, log, qm, vm)
    for one, other in zip(fast, Dense(system).momentum_balance(leak, log, qm, vm), strict=True):
        assert one.shape == other.shape
        assert_near(one * system.space.scale, other * system.space.scale, 1e-12)


@vehicles
def test_interpolated_midpoints_equal_the_generic_ones(name):
    p, log = driven(name)
    for hermite in (True, False):
        middle = p.system.midpoints(log, hermite)
        for k in (0, 70, 149):
            one = Dense(p.system).midpoints(log.part(k, k + 2), hermite)
            q, v = one.q[0], one.v[0]
            assert_near(middle.q[k], q, 1e-12)
            assert_near(middle.v[k], v, 1e-11)


# -- MuJoCo is the system ------------------------------------------------------------------------


@vehicles
def test_mujoco_moves_as_the_system_says(name):
    for seed in range(10):
        assert_engines_agree(plant(name), seed, acceleration_tolerance=1e-11)


@pytest.mark.parametrize(
    "config", [UvmsPlant(spread=0.9), UvmsPlant(spread=0.0), FlyingArmPlant(spread=0.5)]
)
def test_mujoco_agrees_for_any_hidden_numbers(config):
    p = config.build(1e-3, 3)
    for seed in range(3):
        assert_engines_agree(p, seed)


@pytest.mark.parametrize("name", ["uvms", "borinot"])
def test_every_parameter_changes_the_motion(name):
    """A parameter that is off by a tenth is seen: the agreement above is no accident."""
    p = plant(name)
    system = p.system
    seen = np.zeros(system.p)
    for seed in range(5):
        x, _, _, u, numbers = draw_state(system, seed)
        v = x[system.m :]
        W = system.regressor(0.0, x, v, acceleration(p, numbers, v, u), u)
        seen = np.maximum(seen, np.abs(0.1 * W * system.space.scale).max(axis=0))
    assert (seen > 1e-6).all(), [system.space.names[i] for i in np.flatnonzero(seen <= 1e-6)]


def test_hydrodynamic_forces_depend_on_the_velocity_relative_to_the_water():
    """Added mass, drag and thrust see the velocity relative to the water only (Galilei)."""
    still, flow = plant("uvms"), np.array([0.3, -0.2, 0.1])
    moved = plant("uvms", mismatch=Mismatch(flow=(0.3, -0.2, 0.1)))
    _, _, _, u, numbers = draw_state(still.system, 4)
    v = draw_state(still.system, 5)[0][still.system.m :]
    turned = unrotate(still.position(numbers)[3:7], flow)
    along = v.copy()
    along[:3] += turned
    expected, got = (acceleration(still, numbers, v, u), acceleration(moved, numbers, along, u))
    got[:3] += np.cross(v[3:6], turned)  # the body's axes turn against the flow's velocity
    assert_near(got, expected, 1e-12)
    assert np.abs(acceleration(moved, numbers, v, u) - expected).max() > 1e-2


def test_thruster_lag_delays_the_force():
    prompt, late = plant("uvms"), plant("uvms", mismatch=Mismatch(lag=0.1))
    gained = []
    for p in (prompt, late):
        speeds = []
        for u in (np.zeros(12), np.r_[np.zeros(4), np.full(8, 0.5)]):
            with p.running():
                p.reset(np.zeros(10), np.zeros(10))
                for _ in range(20):
                    p.step(u)
                speeds.append(p.coordinates()[1][:6])
        gained.append(np.linalg.norm(speeds[1] - speeds[0]))
    assert 0.02 < gained[1] / gained[0] < 0.2  # about half of 20 ms in 100 ms


@pytest.mark.parametrize("name", ["uvms", "borinot"])
def test_steps_are_of_fourth_order_with_the_callback(name):
    _, v, u = plant(name).system.random_state(np.random.default_rng(0))

    def end(dt):
        p = plant(name, 5, dt)
        with p.running():
            p.reset(np.zeros(p.system.n), 0.3 * v)
            for _ in range(round(0.16 / dt)):
                p.step(0.5 * u)
            return np.concatenate(p.coordinates())

    exact = end(1e-3 / 8)
    errors = np.array([np.abs(end(dt) - exact).max() for dt in (4e-3, 2e-3, 1e-3)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert errors[-1] < 1e-4 and (orders > 3.3).all(), (errors, orders)


@vehicles
def test_a_diverging_plant_reports_it(name, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    p = plant(name, 0)
    with p.running():
        p.reset(np.zeros(p.system.n), np.full(p.system.n, 1e9))
        for _ in range(200):
            p.step(np.zeros(p.system.n_u))
        assert p.diverged in {"qpos", "qvel", "qacc"}
    assert capfd.readouterr() == ("", "")


@vehicles
def test_meshes_move_with_their_bodies(name):
    p = plant(name)
    meshes = p.visuals()
    assert meshes and len({mesh.name for mesh in meshes}) == len(meshes)
    numbers = np.zeros((2, p.system.n))
    numbers[1, :3] = 1.0, 2.0, 3.0
    translations, quaternions = p.poses(p.system.position(numbers))
    assert translations.shape == (2, len(meshes), 3) and quaternions.shape == (2, len(meshes), 4)
    assert_near(
        translations[1] - translations[0], np.tile([1.0, 2.0, 3.0], (len(meshes), 1)), 1e-12
    )
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=-1), 1, atol=1e-9)


# -- drivers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["borinot", "iris"])
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_a_flying_arm_stays_in_the_air_in_spite_of_wrong_gains(name, seed):
    p = plant(name, seed, 4e-3)
    system = p.system
    driver = HoverAndReach().build(system, wrong_prior(p, seed), np.random.default_rng(seed))
    with p.running():
        p.reset(*driver.start())
        for k in range(2500):
            numbers, v = p.coordinates()
            u = driver.command(k * p.dt, p.position(numbers), v)
            assert np.isfinite(u).all() and (u[system.n - 6 :] >= 0.1 - 1e-12).all()
            assert (u[system.n - 6 :] <= 1).all()
            assert np.abs(numbers[:3]).max() < 2.0 and np.linalg.norm(numbers[3:5]) < 0.8
            p.step(u)
    assert not p.diverged
    path = driver._path(2500 * p.dt)[0]  # pyright: ignore
    numbers, _ = p.coordinates()
    assert np.linalg.norm(numbers[:3] - path[:3]) < 0.15
    assert np.abs(numbers[6:] - path[4:]).max(initial=0) < 0.2


def test_an_arm_in_water_follows_its_path_while_the_base_swims():
    p = UvmsPlant().build(5e-3, 1)
    config, rng = SwimAndReach(), np.random.default_rng(1)
    driver = config.build(p.system, wrong_prior(p, 1), np.random.default_rng(1))
    Multisine(8, config.low, config.high, config.tones, config.amplitude, rng)  # is drawn first
    path = FourierTrajectory.within(config, p.system, rng)
    errors, travelled = [], np.zeros(6)
    with p.running():
        p.reset(*driver.start())
        for k in range(2000):
            numbers, v = p.coordinates()
            u = driver.command(k * p.dt, p.position(numbers), v)
            assert (np.abs(u) <= 1).all()
            errors.append(np.abs(numbers[6:] - path(k * p.dt)[0]).max())
            travelled = np.maximum(travelled, np.abs(v[:6]))
            p.step(u)
    assert max(errors) < 0.2 and (travelled > 0.1).all()


def test_drivers_refuse_what_they_cannot_drive():
    rng = np.random.default_rng(0)
    for driver, name in ((SwimAndReach(), "borinot"), (HoverAndReach(), "uvms")):
        with pytest.raises(InvalidInput) as caught:
            driver.build(plant(name).system, plant(name).truth, rng)
        assert caught.value.name == "excitation" and caught.value.remedy


# -- refusals ------------------------------------------------------------------------------------


def test_a_robot_without_known_rotors_is_refused():
    with pytest.raises(UnknownName) as caught:
        FlyingArmPlant(robot="borino").build(1e-3, 0)
    assert caught.value.near == ("borinot",) and "assets/flying_arm" in str(caught.value)


@pytest.mark.parametrize("config", [UvmsPlant, FlyingArmPlant])
@pytest.mark.parametrize("spread", [-0.1, 1.0, np.nan])
def test_a_spread_outside_0_to_1_is_refused(config, spread):
    with pytest.raises(InvalidInput, match="spread"):
        config(spread=spread)


@pytest.mark.parametrize(
    "config,mismatch",
    [
        (UvmsPlant, Mismatch(fluid="ellipsoid")),
        (FlyingArmPlant, Mismatch(flow=(1.0, 0.0, 0.0))),
    ],
)
def test_an_unsupported_mismatch_is_refused(config, mismatch):
    with pytest.raises(InvalidInput, match="mismatch"):
        config(mismatch=mismatch)
