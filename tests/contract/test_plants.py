"""One contract for all plants: MuJoCo moves as the structure says, and failures are reported."""

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import EnginesDisagree, InvalidInput, UnknownName
from nsaid_mj.lab.plants import arm
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.robots.assets import known_robots
from nsaid_mj.robots.errors import BadRobot
from nsaid_mj.robots.loading import load_robot
from tests.support.plants import assert_engines_agree, config_of, plant
from tests.support.strategies import seeds
from tests.support.vehicles import INEXACT, VEHICLES, acceleration, draw_numbers

FEW = settings(deadline=None, max_examples=15)
NAMES = ["scalar_rov", "double_pendulum", "kinova", "panda", "solo12", *VEHICLES]
plants = pytest.mark.parametrize("name", NAMES)
all_plants = pytest.mark.parametrize("name", [*NAMES, *INEXACT])
PENDULUM = ArmPlant(robot="double_pendulum")


def draw(system, rng):
    """Position numbers, velocity and command of the size seen in operation."""
    _, v, u = system.random_state(rng)
    return draw_numbers(system, rng), v, u


def drive(plant: Plant, steps: int, seed: int = 0):
    """(steps + 1, 2 n) states under random commands."""
    rng = np.random.default_rng(seed)
    coordinates, v, _ = draw(plant.system, rng)
    states = []
    with plant.running():
        plant.reset(coordinates, 0.1 * v)
        for _ in range(steps):
            states.append(np.concatenate(plant.coordinates()))
            plant.step(draw(plant.system, rng)[2])
        states.append(np.concatenate(plant.coordinates()))
    return np.array(states)


# -- MuJoCo is the system ----------------------------------------------------------------------


@plants
@FEW
@given(seeds)
def test_mujoco_accelerates_as_the_system_says(name, seed):
    assert_engines_agree(plant(name), seed, 1e-12)


ROBOTS = [
    "alexander",
    "allegro_left_hand",
    "allegro_right_hand",
    "bluevolta_bravo7_no_ee",
    "bolt",
    "borinot",
    "bravo7_no_ee",
    "double_pendulum",
    "double_pendulum_continuous",
    "double_pendulum_simple",
    "falcon_bravo7_no_ee",
    "finger_edu",
    "go2",
    "hextilt",
    "hyq",
    "laikago",
    "panda_collision",
    "pr2",
    "quadruped",
    "simple_humanoid",
    "simple_humanoid_classical",
    "solo8",
    "talos_arm",
    "tiago",
    "tiago_no_hand",
    "ur10",
    "ur10_limited",
    "ur3",
    "ur3_limited",
    "ur5",
    "ur5_limited",
    "xarm7",
]


@pytest.mark.parametrize("robot", ROBOTS)
def test_mujoco_accelerates_as_the_system_says_for_every_catalogued_robot(robot):
    assert robot in known_robots()
    built = ArmPlant(robot=robot).build(1e-5, 1)
    for seed in range(3):
        assert_engines_agree(built, seed, 1e-10)


@plants
def test_a_measurement_is_in_the_systems_coordinates(name):
    """q̇ = v: over two steps of a held command q moves by Simpson's rule of the measured v."""
    p = plant(name, 3, 1e-4)
    coordinates, v, u = draw(p.system, np.random.default_rng(1))
    with p.running():
        p.reset(coordinates, v)
        states = [p.coordinates()]
        for _ in range(20):
            p.step(u)
            states.append(p.coordinates())
    for before, middle, after in zip(states, states[1:], states[2:], strict=False):
        step = p.system.difference(p.position(before[0]), p.position(after[0]))
        assert p.position(middle[0]).shape == (p.system.m,)
        simpson = (before[1] + 4 * middle[1] + after[1]) * p.dt / 3
        np.testing.assert_allclose(step, simpson, rtol=1e-5, atol=1e-6 * np.abs(step).max())


@plants
def test_momentum_changes_as_the_forces_say(name):
    """d/dt(M v) = F θ + Cᵀ v, the momentum form, over two of MuJoCo's steps by Simpson's rule.

    No acceleration is needed: Ṁ v = C v + Cᵀ v takes it out of the acceleration form.
    """
    p = plant(name, 4, 1e-4)
    system, theta = p.system, p.truth
    coordinates, v, u = draw(system, np.random.default_rng(2))
    momentum, rate = [], []
    with p.running():
        p.reset(coordinates, v)
        for _ in range(3):
            numbers, v = p.coordinates()
            x = np.r_[p.position(numbers), v]
            C = system.coriolis_matrix(x, theta)
            momentum.append(system.W_M(x, v) @ theta)
            rate.append(system.F(0.0, x, u) @ theta + C.T @ v)
            p.step(u)
    change = (rate[0] + 4 * rate[1] + rate[2]) * p.dt / 3
    lost = np.abs(momentum[2] - momentum[0] - change).max()
    assert lost <= 1e-6 * np.abs(change).max() + 1e-13 * np.abs(momentum).max()


@all_plants
def test_reset_sets_the_given_state(name):
    p = plant(name)
    coordinates, v, u = draw(p.system, np.random.default_rng(3))
    for _ in range(2):
        with p.running():
            p.reset(coordinates, v)
            assert p.t == 0.0
            for given_, read in zip((coordinates, v), p.coordinates(), strict=True):
                if p.system.group:  # there are rotations in between
                    np.testing.assert_allclose(read, given_, rtol=1e-14, atol=1e-14)
                else:
                    assert (given_ == read).all()
            p.step(u)
            assert p.t == p.dt == 1e-3
            assert (p.coordinates()[0] != coordinates).any()


@all_plants
def test_arrays_from_the_plant_are_copies(name):
    p = plant(name)
    coordinates, v, u = draw(p.system, np.random.default_rng(4))
    with p.running():
        p.reset(coordinates, v)
        handed = [*p.coordinates(), p.position(p.coordinates()[0])]
        kept = [part.copy() for part in handed]
        p.step(u)
        assert all((one == two).all() for one, two in zip(handed, kept, strict=True))
        moved = p.coordinates()
        for part in (*handed, *p.coordinates()):
            part[:] = 99.0
        assert all((one == two).all() for one, two in zip(moved, p.coordinates(), strict=True))


@plants
def test_the_integrator_is_rk4_without_silent_resets(name):
    option = plant(name).model.opt
    assert option.integrator == mujoco.mjtIntegrator.mjINT_RK4
    for flag in ("AUTORESET", "CONTACT", "CONSTRAINT"):
        assert option.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")


@pytest.mark.parametrize(
    "config", [ScalarRovPlant(), ArmPlant("double_pendulum", friction_speed=0.5)]
)
def test_steps_are_of_fourth_order_with_the_friction_callback(config):
    def end(dt):
        p = config.build(dt, 5)
        u = 0.3 * p.system.random_state(np.random.default_rng(0))[2]
        with p.running():
            p.reset(np.full(p.system.n, 0.5), np.full(p.system.n, 1.0))
            for _ in range(round(0.32 / dt)):
                p.step(u)
            return np.concatenate(p.coordinates())

    exact = end(1e-3 / 16)
    errors = [np.abs(end(dt) - exact).max() for dt in (4e-3, 2e-3, 1e-3)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-6 and (orders > 3.5).all() and (orders < 5).all(), (errors, orders)


# -- friction ----------------------------------------------------------------------------------


@FEW
@given(seeds, st.floats(-6, 2))
def test_coulomb_friction_is_tanh_exactly(seed, exponent):
    p = plant("double_pendulum")
    rng = np.random.default_rng(seed)
    v = 10.0**exponent * rng.standard_normal(2)
    acceleration(p, rng.standard_normal(2), v, np.zeros(2))
    viscous, coulomb = (
        p.truth[p.system.space[f"{kind} friction"]] for kind in ("viscous", "Coulomb")
    )
    expected = -viscous * v - coulomb * np.tanh(v / p.system.friction_speed)
    np.testing.assert_allclose(p.data.qfrc_passive, expected, rtol=1e-14, atol=1e-300)


ONE_JOINT = """<robot name="one"><link name="base"/><link name="arm"><inertial>
<origin xyz="0.3 0 0"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/></joint></robot>"""


def one_joint(tmp_path, dt=1e-3, **numbers) -> Plant:
    """An upright axis: gravity does nothing."""
    path = tmp_path / "one.urdf"
    path.write_text(ONE_JOINT)
    return ArmPlant(robot=str(path), armature=0.0, spread=0.0, **numbers).build(dt, 0)


def test_a_joint_at_rest_stays_at_rest(tmp_path):
    p = one_joint(tmp_path)
    with p.running():
        p.reset(np.array([0.4]), np.zeros(1))
        for _ in range(200):
            p.step(np.zeros(1))
        assert p.coordinates()[0] == 0.4 and p.coordinates()[1] == 0.0


def test_below_coulomb_friction_a_joint_creeps_as_tanh_says_and_no_faster(tmp_path):
    p = one_joint(tmp_path, friction=1.0, damping=0.1, friction_speed=0.01, gain=1.0)
    with p.running():
        p.reset(np.zeros(1), np.zeros(1))
        for _ in range(2000):
            p.step(np.array([0.9]))
        (v,) = p.coordinates()[1]
    assert 0.1 * v + np.tanh(v / 0.01) == pytest.approx(0.9, rel=1e-10)


def test_friction_takes_as_much_energy_as_the_motion_loses():
    p = ArmPlant("double_pendulum", friction_speed=0.5).build(1e-3, 2)
    place = p.system.space
    viscous, coulomb = p.truth[place["viscous friction"]], p.truth[place["Coulomb friction"]]
    energy, power = [], []
    with p.running():
        p.reset(np.array([1.0, -0.5]), np.array([2.0, -1.0]))
        for _ in range(600):
            v = p.coordinates()[1]
            mujoco.mj_forward(p.model, p.data)
            mujoco.mj_energyPos(p.model, p.data)
            mujoco.mj_energyVel(p.model, p.data)
            energy.append(p.data.energy.sum())
            power.append(viscous @ v**2 + coulomb @ (v * np.tanh(v / 0.5)))
            p.step(np.zeros(2))
    assert (np.diff(energy) < 0).all()
    assert energy[0] - energy[-1] == pytest.approx(np.trapezoid(power, dx=1e-3), rel=1e-5)


def test_friction_too_stiff_for_the_step_names_the_joint_and_a_step_that_works(tmp_path):
    with pytest.raises(BadRobot, match="joint turn") as caught:
        one_joint(tmp_path, friction=100.0, friction_speed=1e-3)
    assert "dt ≤" in caught.value.remedy
    one_joint(
        tmp_path,
        dt=float(caught.value.remedy.split("≤ ")[1].split(" s")[0]),
        friction=100.0,
        friction_speed=1e-3,
    )


# -- callbacks are global ----------------------------------------------------------------------


class ThrownError(Exception):
    pass


@all_plants
def test_callback_and_warning_handler_are_restored_after_an_exception(name):
    heard = []
    mujoco.set_mju_user_warning(heard.append)
    handler = mujoco.get_mju_user_warning()
    try:
        with pytest.raises(ThrownError), plant(name).running():
            installed = mujoco.get_mjcb_passive()
            assert (installed is None) == (plant(name).passive is None)
            raise ThrownError
        assert mujoco.get_mjcb_passive() is None
        assert mujoco.get_mju_user_warning() is handler
    finally:
        mujoco.set_mju_user_warning(None)
        mujoco.set_mjcb_passive(None)


@pytest.mark.parametrize("outer", ["double_pendulum", "scalar_rov", "bluerov2", "astrobee"])
@pytest.mark.parametrize("inner", ["double_pendulum", "scalar_rov", "kinova", "remus100"])
def test_running_a_plant_inside_another_is_refused(outer, inner):
    refused = pytest.raises(RuntimeError, match="one after another")
    with refused, plant(outer).running(), plant(inner).running():
        pass
    assert mujoco.get_mjcb_passive() is None
    with plant(inner).running():  # and afterwards it may
        pass


# -- seeds -------------------------------------------------------------------------------------


@plants
def test_one_seed_one_plant_another_seed_another(name):
    one, same, other = (config_of(name).build(1e-4, seed) for seed in (1, 1, 2))
    assert (one.truth == same.truth).all()
    assert (drive(one, 30) == drive(same, 30)).all()
    assert (drive(one, 30) == drive(one, 30)).all()  # and again, by itself
    assert (one.truth != other.truth).any()
    assert (drive(one, 30) != drive(other, 30)).any()
    assert (one.system.space.scale == other.system.space.scale).all()  # a guess knows no seed


@plants
def test_the_step_does_not_change_the_truth(name):
    assert (plant(name, dt=1e-4).truth == plant(name, dt=5e-5).truth).all()


@FEW
@given(seeds, st.floats(0, 0.9))
def test_hidden_numbers_are_within_the_spread(seed, spread):
    scalar = ScalarRovPlant(spread=spread)
    nominal = np.array([scalar.mass, scalar.drag, scalar.net_weight, scalar.gain])
    ratio = scalar.build(1e-3, seed).truth / nominal
    assert (np.abs(ratio - 1) <= spread * (1 + 1e-12)).all()
    assert spread < 1e-9 or np.unique(ratio).size == 4


def test_hidden_numbers_are_drawn_about_the_data_sheet():
    numbers: dict[str, Any] = {"damping": 0.02, "friction": 0.01, "armature": 0.03, "gain": 2.0}
    blocks = ("viscous friction", "Coulomb friction", "rotor inertia", "motor gain")
    exact = ArmPlant("double_pendulum", **numbers, spread=0.0).build(1e-4, 3)
    drawn = ArmPlant("double_pendulum", **numbers, spread=0.1).build(1e-4, 3)
    for block, nominal in zip(blocks, numbers.values(), strict=True):
        assert (exact.truth[exact.system.space[block]] == nominal).all()
        ratio = drawn.truth[drawn.system.space[block]] / nominal
        assert (np.abs(ratio - 1) <= 0.1).all() and ratio[0] != ratio[1]


def test_a_negative_gain_reverses_the_motor():
    """A negative data-sheet gain is a negative gain, or refused; never silently positive."""
    try:
        p = ArmPlant("double_pendulum", gain=-1.0).build(1e-4, 0)
    except InvalidInput as error:
        assert error.name == "plant.gain"
    else:
        assert (p.truth[p.system.space["motor gain"]] < 0).all()


def test_without_rotors_theta_has_none(tmp_path):
    p = one_joint(tmp_path)
    assert p.system.p == 13 and "rotor_1" not in p.system.space.names
    assert_engines_agree(p, 0, 1e-12)


DIVERSE = [PENDULUM, ScalarRovPlant(), *(VEHICLES[name] for name in ("bluerov2", "f1tenth"))]


@pytest.mark.parametrize("config", DIVERSE)
@pytest.mark.parametrize("dt", [0.0, -1e-3, np.nan, np.inf])
def test_a_time_step_that_is_not_positive_is_refused(config, dt):
    with pytest.raises(InvalidInput) as caught:
        config.build(dt, 0)
    assert caught.value.name == "dt"


# -- divergence --------------------------------------------------------------------------------


@pytest.mark.parametrize("config", DIVERSE)
def test_a_diverging_plant_reports_it_once_and_prints_nothing(config, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo would write MUJOCO_LOG.TXT here
    p = config.build(1e-3, 0)
    before = drive(p, 20)
    assert p.diverged == ""
    with p.running():
        p.reset(np.zeros(p.system.n), np.full(p.system.n, 1e9))
        for _ in range(1000):
            p.step(np.zeros(p.system.n_u))
        assert p.diverged in {"qpos", "qvel", "qacc"}
    out, err = capfd.readouterr()
    assert out == err == "" and not list(tmp_path.iterdir())
    assert (drive(p, 20) == before).all()  # a reset forgets it
    assert p.diverged == ""


@pytest.mark.parametrize("config", DIVERSE)
def test_a_command_is_applied_or_reported(config):
    """MuJoCo sets every command to 0 if one is beyond 1e10; an identifier would not know."""
    p = config.build(1e-3, 0)
    ends = []
    for u in (0.0, 2e10):
        with p.running():
            p.reset(np.zeros(p.system.n), np.zeros(p.system.n))
            p.step(np.full(p.system.n_u, u))
            ends.append(p.coordinates()[1])
    assert p.diverged or (ends[0] != ends[1]).any()


# -- robots that cannot be ---------------------------------------------------------------------


def test_an_unknown_robot_gives_near_names():
    with pytest.raises(UnknownName) as caught:
        load_robot("ur55")
    assert caught.value.kind == "robot" and caught.value.near[0] == "ur5"
    assert "Did you mean ur5" in str(caught.value) and ".urdf" in str(caught.value)


def test_an_unknown_robot_without_near_names_lists_some_and_the_command_for_all():
    with pytest.raises(UnknownName) as caught:
        load_robot("§§§")
    assert caught.value.near == () and "a1, " in str(caught.value)
    assert "`nsaid list` shows all" in str(caught.value)


@pytest.mark.parametrize("where", ["nowhere.urdf", "a/folder", "."])
def test_a_missing_file_is_a_bad_robot(tmp_path, where):
    with pytest.raises(BadRobot, match="no such file") as caught:
        load_robot(f"{tmp_path}/{where}")
    assert caught.value.remedy


@pytest.mark.parametrize("text", ["", "no xml", "<robot/>", "<robot name='x'><link/></robot>"])
def test_a_file_that_is_no_urdf_is_a_bad_robot(tmp_path, text):
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    with pytest.raises(BadRobot) as caught:
        load_robot(str(path))
    assert caught.value.robot == str(path) and caught.value.remedy


def chain(kind: str = "revolute", inertial: str | None = None) -> str:
    """A valid link on a hinge, then a second one as given."""
    sound = """<inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    return f"""<robot name="chain"><link name="base"/><link name="one">{sound}</link>
    <link name="two">{sound if inertial is None else inertial}</link>
    <joint name="first" type="revolute"><parent link="base"/><child link="one"/>
    <axis xyz="0 0 1"/>{limit}</joint>
    <joint name="second" type="{kind}"><parent link="one"/><child link="two"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/>{limit}</joint></robot>"""


def body(mass: float, xx: float, yy: float, zz: float) -> str:
    return f"""<inertial><mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}"
    ixy="0" ixz="0" iyz="0"/></inertial>"""


@pytest.mark.parametrize(
    "urdf,part,reason",
    [
        (chain(inertial=""), "link of joint second", "mass is 0"),
        (chain(inertial=body(-1, 0.1, 0.1, 0.1)), "link two", "mass is -1"),
        (chain(inertial=body(1, 0.1, 0.1, 0.3)), "link of joint second", "principal moments"),
        (chain(inertial=body(1, 0, 0, 0)), "link of joint second", "principal moments"),
        (chain(inertial=body(1, -0.1, 0.1, 0.1)), "link two", "moments of inertia are -0.1"),
        (chain("floating"), "joint second", "6 degrees of freedom"),
        (chain("planar"), "joint second", "3 degrees of freedom"),
        ('<robot name="rock"><link name="base"/></robot>', "", "no joint moves"),
    ],
)
def test_an_impossible_robot_is_refused_with_the_part_and_the_remedy(tmp_path, urdf, part, reason):
    path = tmp_path / "bad.urdf"
    path.write_text(urdf)
    with pytest.raises(BadRobot) as caught:
        load_robot(str(path))
    error = caught.value
    assert error.part == part and reason in error.reason and error.remedy
    assert str(path) in str(error) and part in str(error)


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "continuous", "fixed"])
def test_every_joint_type_of_one_degree_of_freedom_is_supported(tmp_path, kind):
    path = tmp_path / "good.urdf"
    path.write_text(chain(kind))
    p = ArmPlant(robot=str(path)).build(1e-4, 0)
    assert p.system.n == (1 if kind == "fixed" else 2)
    assert_engines_agree(p, 0, 1e-12)


def test_a_missing_mesh_does_not_matter(tmp_path):
    path = tmp_path / "plain.urdf"
    mesh = '<visual><geometry><mesh filename="package://gone/mesh.dae"/></geometry></visual>'
    path.write_text(ONE_JOINT.replace("<inertial>", f"{mesh}<inertial>"))
    assert load_robot(str(path)).visuals.parts == []


@st.composite
def trees(draw):
    """A URDF of 1 to 5 links in a tree: any joint, any axis, any body."""
    rng = np.random.default_rng(draw(seeds))
    parts = ['<link name="link0"/>']
    for i in range(1, draw(st.integers(2, 6))):
        kind = draw(st.sampled_from(["revolute", "prismatic", "continuous"]))
        axis = draw(st.sampled_from([np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], rng.normal(size=3)]))
        spread = rng.uniform(0.1, 1, 3)  # ∫x², ∫y², ∫z²
        moments = np.sum(spread) - spread
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        x, y, z = axes @ np.diag(moments**0.5)
        vectors = rng.normal(size=3), rng.normal(size=3), axis, 0.3 * rng.normal(size=3)
        words = [" ".join(str(float(x)) for x in vector) for vector in vectors]
        parts.append(f"""<link name="link{i}"><inertial><origin xyz="{words[3]}"/>
        <mass value="{rng.uniform(1, 5)}"/>
        <inertia ixx="{x @ x}" iyy="{y @ y}" izz="{z @ z}" ixy="{x @ y}" ixz="{x @ z}"
        iyz="{y @ z}"/></inertial></link><joint name="joint{i}" type="{kind}">
        <parent link="link{draw(st.integers(0, i - 1))}"/><child link="link{i}"/>
        <origin xyz="{words[0]}" rpy="{words[1]}"/><axis xyz="{words[2]}"/>
        <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>""")
    return f'<robot name="tree">{"".join(parts)}</robot>'


@FEW
@given(trees(), seeds)
def test_any_kinematic_tree_is_a_plant(tmp_path_factory, urdf, seed):
    path = tmp_path_factory.mktemp("tree") / "tree.urdf"
    path.write_text(urdf)
    assert_engines_agree(ArmPlant(robot=str(path)).build(1e-4, seed), seed, 1e-11)


# -- engines that disagree ---------------------------------------------------------------------


UR5_JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]


@pytest.mark.parametrize("joint", [f"{name}_joint" for name in UR5_JOINTS])
def test_a_link_that_differs_between_the_engines_is_named(monkeypatch, joint):
    honest = arm.arm_spec

    def corrupt(*arguments):
        spec = honest(*arguments)
        body = spec.body(joint)
        body.mass, body.inertia = 1.01 * body.mass, 1.01 * np.array(body.inertia)
        return spec

    monkeypatch.setattr(arm, "arm_spec", corrupt)
    with pytest.raises(EnginesDisagree) as caught:
        ArmPlant("ur5").build(1e-3, 0)
    error = caught.value
    assert error.robot == "ur5" and error.quantity in {"mass matrix", "bias force"}
    assert error.difference > error.tolerance
    assert error.link == f"link of joint {joint}"


# -- looks -------------------------------------------------------------------------------------


@all_plants
def test_meshes_have_names_triangles_and_poses(name):
    p = plant(name)
    meshes = p.visuals()
    q = p.position(np.array([draw(p.system, np.random.default_rng(k))[0] for k in range(3)]))
    translations, quaternions = p.poses(q)
    assert translations.shape == (3, len(meshes), 3)
    assert quaternions.shape == (3, len(meshes), 4)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=-1), 1, atol=1e-9)
    assert len({mesh.name for mesh in meshes}) == len(meshes)
    for mesh in meshes:
        assert mesh.vertices.shape[1] == mesh.triangles.shape[1] == 3
        assert mesh.triangles.min() >= 0 and mesh.triangles.max() < len(mesh.vertices)
        assert len(mesh.color) == 4 and all(0 <= c <= 1 for c in mesh.color)


@all_plants
def test_reading_meshes_and_poses_does_not_change_the_motion(name):
    """A live viewer does so; neither state nor callback may be touched."""
    p = plant(name)
    coordinates, v, u = draw(p.system, np.random.default_rng(5))
    q = p.position(coordinates)[None]
    ends = []
    for look in (False, True):
        with p.running():
            p.reset(coordinates, v)
            for _ in range(5):
                p.step(u)
                if look:
                    p.visuals()
                    p.poses(q)
            ends.append(np.concatenate(p.coordinates()))
    assert (ends[0] == ends[1]).all()
