"""Floating bases satisfy (4)–(10) and (29, 30) and move as MuJoCo does."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.base.errors import EnginesDisagree, InvalidInput
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.lab.control.tracking import FourierTracking
from nsaid_mj.lab.plants import arm
from nsaid_mj.lab.plants.arm import true_model
from nsaid_mj.lab.plants.jointed import FloatingBasePlant
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.robots.assets import known_robots
from nsaid_mj.robots.errors import BadRobot
from nsaid_mj.robots.loading import load_robot
from tests.support.dense import Dense
from tests.support.matrices import assert_near
from tests.support.plants import draw_state, plant

ROBOTS = [
    "alexander",
    "anymal_c",
    "bluevolta_bravo7_no_ee",
    "bolt",
    "borinot",
    "falcon_bravo7_no_ee",
    "go2",
    "hextilt",
    "hyq",
    "laikago",
    "pr2",
    "quadruped",
    "simple_humanoid",
    "simple_humanoid_classical",
    "so100",
    "solo12",
    "solo8",
    "talos",
]
robots = pytest.mark.parametrize("robot", ROBOTS)
FEW = pytest.mark.parametrize("robot", ["borinot", "pr2", "solo12"])


def afloat(robot: str) -> Plant:
    """A floating robot; a small step, which the fastest joints need."""
    return plant(f"{robot} free", dt=1e-5)


def mass_and_coriolis(plant: Plant, q, v):
    """Pinocchio's own M with the rotors, and its C."""
    model = true_model(plant.system.model, plant.truth)  # pyright: ignore
    data = model.createData()
    M = pin.crba(model, data, q) + np.diag(np.r_[np.zeros(6), rotors(plant)])
    return M, pin.computeCoriolisMatrix(model, data, q, v)


def rotors(plant: Plant):
    return plant.truth[plant.system.space["rotor inertia"]]


def test_at_least_fifteen_robots_have_a_floating_base():
    assert len(ROBOTS) >= 15
    assert all(afloat(robot).system.group == 6 for robot in ROBOTS)


@robots
def test_the_regressors_are_linear_and_sum_up(robot):
    system, theta = afloat(robot).system, afloat(robot).truth
    for seed in range(3):
        x, w, a, u, _ = draw_state(system, seed)
        assert_near(
            system.W_C(x, 2 * w - 3 * a), 2 * system.W_C(x, w) - 3 * system.W_C(x, a), 1e-13
        )
        assert_near(
            system.W_M(x, 2 * w - 3 * a), 2 * system.W_M(x, w) - 3 * system.W_M(x, a), 1e-13
        )
        W = system.regressor(0.0, x, w, a, u)
        assert_near(W, system.W_M(x, a) + system.W_C(x, w) - system.F(0.0, x, u), 1e-13)  # (10)
        assert_near(system.W_M(x, a) @ theta, system.mass_matrix(x, theta) @ a, 1e-12)  # (8)


@robots
def test_m_and_c_equal_pinocchios(robot):
    system, theta = afloat(robot).system, afloat(robot).truth
    for seed in range(3):
        x, w, _, _, _ = draw_state(system, seed)
        M, C = mass_and_coriolis(afloat(robot), *system.split(x))
        assert_near(system.mass_matrix(x, theta), M, 1e-12)
        assert_near(system.W_C(x, w) @ theta, C @ w, 1e-11)
        assert np.linalg.eigvalsh(system.mass_matrix(x, theta))[0] > 0
        assert np.abs(system.W_C(x, w)[:, 10 * system.bodies :]).max() == 0  # links only


@robots
def test_m_dot_minus_2c_is_skew(robot):
    system, theta, h = afloat(robot).system, afloat(robot).truth, 1e-5
    x, _, _, _, _ = draw_state(system, 1)
    q, v = system.split(x)

    def mass(step):
        return system.mass_matrix(np.r_[system.integrate(q, step * v), v], theta)

    M_dot = (mass(h) - mass(-h)) / (2 * h)
    C = system.coriolis_matrix(x, theta)
    assert np.abs(M_dot - C - C.T).max() <= 1e-6 * max(np.abs(C).max(), np.abs(mass(0)).max())


@FEW
def test_without_the_bracket_of_twists_c_is_not_pinocchios(robot):
    """Without it Ṁ − 2C would not be skew: the test above can fail."""
    ours, theta = afloat(robot).system, afloat(robot).truth
    system = JointTree.by_pinocchio(
        load_robot(robot, "free").model, ours.scales, ours.friction_speed
    )
    x, w, _, _, _ = draw_state(system, 1)
    _, C = mass_and_coriolis(afloat(robot), *system.split(x))
    assert np.abs(system.W_C(x, w) @ theta - C @ w).max() <= 1e-9 * np.abs(C @ w).max()
    system.group = 0
    assert np.abs(system.W_C(x, w) @ theta - C @ w).max() > 1e-2 * np.abs(C @ w).max()


@robots
def test_the_acceleration_solves_the_equation_and_an_instant_agrees(robot):
    system, theta = afloat(robot).system, afloat(robot).truth
    for seed in range(3):
        x, w, _, u, _ = draw_state(system, seed)
        a = system.acceleration(0.0, x, w, u, theta)  # (29)
        W = system.regressor(0.0, x, w, a, u)
        assert np.abs(W @ theta).max() <= 1e-11 * (np.abs(W) @ np.abs(theta)).max()  # (30)
        q, v = system.split(x)
        fast = system.evaluate_at(0.0, q, v, u, w, theta)
        dense = Dense(system).evaluate_at(0.0, q, v, u, w, theta)
        for one, other in zip(fast, dense, strict=True):
            assert_near(np.asarray(one), np.asarray(other), 1e-9)
        assert_near(fast.a, a, 1e-9)


@robots
def test_mujoco_moves_as_the_system_says(robot):
    p = afloat(robot)
    system, theta = p.system, p.truth
    for seed in range(3):
        x, _, _, u, numbers = draw_state(system, seed)
        _, v = system.split(x)
        with p.running():
            p.reset(numbers, v)
            for given, read in zip((numbers, v), p.coordinates(), strict=True):
                assert_near(read, given, 1e-12)
            p.data.ctrl[:] = u
            mujoco.mj_forward(p.model, p.data)
            a = p.joints.acceleration(p.data)
        assert_near(a, system.acceleration(0.0, x, v, u, theta), 1e-10)
        W = system.regressor(0.0, x, v, a, u)
        assert np.abs(W @ theta).max() <= 1e-8 * np.abs(W * theta).max()
        assert np.abs(W @ theta).max() <= 1e-12 * (np.abs(W) @ np.abs(theta)).max()


@FEW
def test_a_measurement_is_in_the_systems_coordinates(robot):
    """q̇ = v: over two steps q moves by Simpson's rule of the measured v, and v by that of v̇."""
    p = FloatingBasePlant(robot=robot).build(1e-4, 3)
    _, v, u = p.system.random_state(np.random.default_rng(0))
    states, rates = [], []
    with p.running():
        p.reset(0.3 * np.random.default_rng(1).uniform(*p.system.limits), 0.3 * v)
        for _ in range(3):
            states.append(p.coordinates())
            p.data.ctrl[:] = 0.1 * u
            mujoco.mj_forward(p.model, p.data)
            rates.append(p.joints.acceleration(p.data))
            p.step(0.1 * u)
    q, v = (np.array(part) for part in zip(*states, strict=True))
    step = p.system.difference(p.position(q[0]), p.position(q[2]))
    simpson = (v[0] + 4 * v[1] + v[2]) * p.dt / 3
    np.testing.assert_allclose(step, simpson, rtol=1e-5, atol=1e-6 * np.abs(step).max())
    simpson = (rates[0] + 4 * rates[1] + rates[2]) * p.dt / 3
    np.testing.assert_allclose(v[2] - v[0], simpson, rtol=1e-4, atol=1e-5 * np.abs(simpson).max())


@FEW
def test_integrate_difference_and_J_are_consistent(robot):
    system = afloat(robot).system
    rng, h = np.random.default_rng(2), 1e-6
    q, v, u = system.random_state(rng)
    other, step = system.random_state(rng)[0], rng.uniform(-1, 1, system.n)
    assert (q.shape, v.shape, u.shape) == ((system.m,), (system.n,), (system.n - 6,))
    assert_near(system.difference(q, system.integrate(q, step)), step, 1e-11)
    reached = system.integrate(q, system.difference(q, other))
    reached[3:7] *= np.sign(reached[3:7] @ other[3:7])  # both quaternions are the attitude
    assert_near(reached, other, 1e-11)
    slope = (system.integrate(q, h * v) - system.integrate(q, -h * v)) / (2 * h)
    np.testing.assert_allclose(system.J(q) @ v, slope, atol=1e-8)  # (3)
    low, high = system.limits
    assert np.linalg.norm(high[3:6]) < np.pi and (low < high).all()
    assert system.velocity_units[:6] == ("m/s",) * 3 + ("rad/s",) * 3
    assert len(system.velocity_units) == system.n
    batch = rng.uniform(low, high, (2, 3, system.n))
    assert (system.position(batch)[1, 2] == system.position(batch[1, 2])).all()


def test_every_joint_has_a_motor_and_the_base_has_none():
    system = afloat("solo12").system
    assert system.n_u == len(system.space.actuators) == 12
    assert system.space.names[:2] == ["m_0", "hx_0"] and system.space.blocks[0].name == "base"
    x, _, _, u, _ = draw_state(system, 0)
    assert (system.F(0.0, x, u)[:6, system.space.actuators] == 0).all()


def test_the_system_holds_no_inertia():
    given = load_robot("solo12", "free").model
    assert any(i.toDynamicParameters().any() for i in given.inertias)
    for structure in (JointTree.by_pinocchio, JointTree.checked):
        system = structure(given, afloat("solo12").system.scales, np.full(12, 0.05))
        models = [part for part in vars(system).values() if isinstance(part, pin.Model)]
        assert models
        for model in models:
            assert all((i.toDynamicParameters() == 0).all() for i in model.inertias)


@pytest.mark.slow
def test_all_robots_that_float_build_or_say_why():
    """Building compares MuJoCo's M and bias forces with Pinocchio's.

    Two of 32 are left out: `talos_legs` has no file of its own, and `so101` is the packed arm.
    """
    built, refused = [], []
    for name in known_robots():
        try:
            built.append(FloatingBasePlant(robot=name).build(1e-3, 0).system.n)
        except BadRobot as error:
            refused.append(str(error))
    assert len(built) >= 30, refused


# -- refusals ----------------------------------------------------------------------------------


def test_a_fixed_base_robot_cannot_float():
    with pytest.raises(BadRobot, match="fixed"):
        FloatingBasePlant(robot="ur5").build(1e-3, 0)


def test_a_robot_without_joints_has_no_motor():
    with pytest.raises(BadRobot, match="no joint for a motor") as caught:
        FloatingBasePlant(robot="iris").build(1e-3, 0)
    assert "FlyingArmPlant" in caught.value.remedy
    assert load_robot("iris", "free").model.nv == 6


def test_a_urdf_file_may_have_a_floating_base(tmp_path):
    body = """<inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""
    path = tmp_path / "two.urdf"
    path.write_text(f"""<robot name="two"><link name="one">{body}</link><link name="two">{body}
    </link><joint name="turn" type="continuous"><parent link="one"/><child link="two"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/></joint></robot>""")
    assert load_robot(str(path)).model.nv == 1
    p = FloatingBasePlant(robot=str(path)).build(1e-4, 0)
    assert (p.system.n, p.system.m, p.system.n_u) == (7, 9, 1)
    assert p.reading.group == 6


def test_a_body_that_differs_between_the_engines_is_named(monkeypatch):
    honest = arm.arm_spec

    def corrupt(*given):
        spec = honest(*given)
        spec.body("root_joint").mass *= 1.01
        return spec

    monkeypatch.setattr(arm, "arm_spec", corrupt)
    with pytest.raises(EnginesDisagree) as caught:
        FloatingBasePlant("solo12").build(1e-3, 0)
    assert caught.value.link == "link of joint root_joint"


def test_joints_alone_cannot_track_a_trajectory_of_the_base():
    p = afloat("solo12")
    with pytest.raises(InvalidInput, match="fixed base"):
        FourierTracking().build(p.system, p.truth, np.random.default_rng(0))
