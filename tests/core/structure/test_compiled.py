"""The compiled backend gives the same regressors, steps and runs as Pinocchio, for any θ."""

import gc
import weakref
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import get_args

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.core.laws.base import State, Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.nullspace_aid import paper_identifier
from nsaid_mj.core.laws.settings import MemoryConfig
from nsaid_mj.core.log import Log, Measurement
from nsaid_mj.core.structure import pinocchio_links
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.plants.arm import nominal_scales
from nsaid_mj.lab.plants.jointed import ArmPlant, Backend
from nsaid_mj.robots.assets import known_robots
from nsaid_mj.robots.errors import BadRobot
from nsaid_mj.robots.loading import Base, load_robot
from tests.support.dense import Dense
from tests.support.dense import transport as transported

FEW = [
    "double_pendulum held",
    "kinova held",
    "panda held",
    "xarm7 held",
    "borinot free",
    "solo12 free",
]
robots = pytest.mark.parametrize("robot", FEW)
BAR = 1e-12


@cache
def model(robot: str) -> pin.Model:
    name, base = robot.split()
    found: Base = "free" if base == "free" else "held"
    return load_robot(name, found).model


@cache
def pair(robot: str) -> tuple[JointTree, JointTree]:
    """(Pinocchio's, ours); every other robot has no rotors."""
    scales = nominal_scales(model(robot), ArmPlant(armature=None if len(robot) % 2 else 0.0))
    friction_speed = np.full(len(scales.gain), 0.05)
    return (
        JointTree.by_pinocchio(model(robot), scales, friction_speed),
        JointTree.checked(model(robot), scales, friction_speed),
    )


def draw(robot: str, seed: int):
    """(q, v, w, a, u) of the size seen in operation."""
    rng = np.random.default_rng(seed)
    q, v, u = pair(robot)[0].random_state(rng)
    w, a = rng.standard_normal((2, len(v)))
    return q, v, w, a, u


def true_theta(robot: str) -> np.ndarray:
    """A robot's own inertias, and its joints as guessed."""
    links = [inertia.toDynamicParameters() for inertia in list(model(robot).inertias)[1:]]
    theta = pair(robot)[0].space.scale.copy()
    theta[: 10 * len(links)] = np.concatenate(links)
    return theta


def odd_theta(robot: str, rng: np.random.Generator) -> np.ndarray:
    """Numbers of no body at all: of either sign, and some of them, and a whole mass, 0."""
    theta = pair(robot)[0].space.scale * rng.standard_normal(pair(robot)[0].p)
    theta[rng.random(len(theta)) < 0.1] = 0
    theta[0] = 0
    return theta


def near(one, other, tolerance=BAR):
    """Rows (the last axis) agree to `tolerance` of their size; where they vanish, of others'."""
    one, other = np.asarray(one), np.asarray(other)
    size = np.abs(other).max(axis=-1, keepdims=True)
    size = np.maximum(size, 1e-3 * size.max())
    assert np.max(np.abs(one - other) / size) <= tolerance


def check_regressors(robot: str, seeds) -> None:
    """Every regressor of ours is Pinocchio's, and so is C."""
    theirs, ours = pair(robot)
    for seed in seeds:
        q, v, w, a, u = draw(robot, seed)
        theta = odd_theta(robot, np.random.default_rng(seed))
        near(ours._W_M(q, a), theirs._W_M(q, a))
        near(ours._W_C(q, v, w), theirs._W_C(q, v, w))
        near(ours._F(0.0, q, v, u), theirs._F(0.0, q, v, u))
        near(ours._W(0.0, q, v, w, a, u), theirs._W(0.0, q, v, w, a, u))
        near(ours._mass_tensor(q).reshape(ours.n, -1), theirs._mass_tensor(q).reshape(ours.n, -1))
        x = np.r_[q, v]
        near(ours.mass_matrix(x, theta), theirs.mass_matrix(x, theta))
        # Cᵀv from Pinocchio's C, without differences; ours knows of no C: C + Cᵀ = Ṁ along v
        transport = np.stack([v @ theirs._W_C(q, v, e) for e in np.eye(ours.n)])
        size = np.abs(v) @ np.abs([theirs._W_C(q, v, e) for e in np.eye(ours.n)])
        assert (np.abs(transported(ours, q, v) - transport) <= BAR * size.max()).all()


def check_evaluate(robot: str, seeds) -> None:
    """â, W and the pivot are those of Pinocchio's regressors, M̂ positive definite or not."""
    theirs, ours = pair(robot)
    definite = 0
    for seed in seeds:
        q, v, w, _, u = draw(robot, seed)
        rng = np.random.default_rng(seed)
        spread = 0.3 if seed % 2 else 0.0
        theta = true_theta(robot) * (1 + spread * rng.uniform(-1, 1, ours.p))
        if seed % 3 == 0:
            theta = odd_theta(robot, rng)
        elif seed % 3 == 1:
            light = 10 * rng.integers(ours.bodies)  # hidden among heavier ones, or not
            theta[light : light + 10] *= rng.choice([-0.1, 0.0])
        a, W, pivot = ours.evaluate_at(0.0, q, v, u, w, theta)
        expected, W_expected, pivot_expected = Dense(theirs).evaluate_at(0.0, q, v, u, w, theta)
        M = theirs.mass_matrix(np.r_[q, v], theta)
        if pivot_expected > 0:
            definite += 1
            near(W, W_expected, max(BAR, 1e-15 * np.linalg.cond(M)))  # it holds â
            force = np.abs(W_expected) @ np.abs(theta)
            assert (np.abs(M @ (a - expected)) <= BAR * force.max()).all()
            assert pivot == pytest.approx(pivot_expected, rel=1e-12 * np.linalg.cond(M))
        else:
            near(W, W_expected)
            assert not pivot > 0 and np.isnan(a).all() and np.isnan(expected).all()
    assert definite, "no M̂ was positive definite"


@robots
def test_every_regressor_equals_pinocchios(robot):
    check_regressors(robot, range(3))


@pytest.mark.parametrize("joint", [pin.JointModelRY(), pin.JointModelPX()])
def test_a_tree_of_one_joint_equals_pinocchios(joint):
    """Of which Pinocchio makes vectors where others have matrices."""
    alone, rng = pin.Model(), np.random.default_rng(1)
    place = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, -0.3]))
    alone.addJoint(0, joint, place, "joint")
    alone.inertias[1] = pin.Inertia.FromSphere(2.0, 0.1)
    scales = nominal_scales(alone, ArmPlant())
    theirs, ours = (
        structure(alone, scales, np.array([0.05]))
        for structure in (JointTree.by_pinocchio, JointTree.checked)
    )
    q, v, u = theirs.random_state(rng)
    w, a = rng.standard_normal((2, 1))
    near(ours._W(0.0, q, v, w, a, u), theirs._W(0.0, q, v, w, a, u))
    near(ours._F(0.0, q, v, u), theirs._F(0.0, q, v, u))
    one, other = (
        system.evaluate_at(0.0, q, v, u, w, theirs.space.scale) for system in (ours, theirs)
    )
    assert other[2] > 0
    for found, expected in zip(one, other, strict=True):
        near(np.atleast_1d(found), np.atleast_1d(expected))


@robots
def test_evaluate_equals_pinocchios_for_any_estimate(robot):
    check_evaluate(robot, range(9))


@robots
def test_c_is_pinocchios_and_m_dot_minus_2c_is_skew(robot):
    ours, h = pair(robot)[1], 1e-5
    own = pin.Model(model(robot))
    own.armature[:] = 0
    theta = true_theta(robot)
    q, v, _, _, _ = draw(robot, 5)
    C = ours.coriolis_matrix(np.r_[q, v], theta)
    theirs = pin.computeCoriolisMatrix(own, own.createData(), q, v)
    assert np.abs(C - theirs).max() <= BAR * np.abs(theirs).max()

    def mass(step):
        return ours.mass_matrix(np.r_[ours.integrate(q, step * v), v], theta)

    M_dot = (mass(h) - mass(-h)) / (2 * h)
    assert np.abs(M_dot - C - C.T).max() <= 1e-6 * max(np.abs(C).max(), np.abs(mass(0)).max())


@pytest.mark.slow
@pytest.mark.parametrize("base,least", [("held", 25), ("free", 25)])
def test_compiled_regressors_equal_pinocchios_for_every_robot(base, least):
    checked = 0
    for name in known_robots():
        try:
            if len(model(f"{name} {base}").joints) - 1 <= (base == "free"):
                continue  # no joint for a motor
        except BadRobot:
            continue
        check_regressors(f"{name} {base}", range(10, 12))
        check_evaluate(f"{name} {base}", range(3))
        checked += 1
    assert checked >= least


# -- the step --------------------------------------------------------------------------------------


def motion(robot: str, steps: int, dt: float) -> list[Measurement]:
    """Samples of a smooth motion, whose velocities are those of its positions to dt²."""
    ours, rng = pair(robot)[1], np.random.default_rng(3)
    q, v, _ = ours.random_state(rng)
    w, phase, samples = rng.uniform(1, 5, ours.n), rng.uniform(0, 6, ours.n), []
    for i in range(steps + 1):
        speed = v * np.cos(w * i * dt + phase)
        u = ours.scales.command * rng.uniform(-1, 1, ours.n_u)
        samples.append(Measurement(i * dt, q, speed, u))
        q = ours.integrate(q, dt * v * np.cos(w * (i + 0.5) * dt + phase))
    return samples


@robots
@pytest.mark.parametrize("interpolation", ["hermite", "linear"])
@pytest.mark.parametrize("law", ["paper", "cone", "memory"])
def test_the_compiled_step_equals_the_step_by_pinocchio(robot, law, interpolation):
    config = NullspaceAID(
        law=law, interpolation=interpolation, memory=MemoryConfig(block=0.004, interval=0.01)
    )
    samples, ends = motion(robot, 30, 1e-3), []
    for system in pair(robot):
        identifier = config.build(system, true_theta(robot), 1e-3)
        state = identifier.init(samples[0])
        state = state._replace(v_hat=state.v_hat + 1e-3)
        for one, other in pairwise(samples):
            state = identifier.step(state, one, other)
            assert state.status is Status.completed
        ends.append(state)
    theirs, ours = ends
    scale, start = pair(robot)[0].space.scale, true_theta(robot)
    moved = np.abs((theirs.theta_hat - start) / scale).max()
    assert moved > 1e-9
    assert (
        np.abs((ours.theta_hat - theirs.theta_hat) / scale).max()
        <= (1e-4 if law == "memory" else 1e-8) * moved
    )
    # a memory's differences by Pinocchio are good to 1e-10, and Newton steps magnify that
    near(ours.v_hat, theirs.v_hat, 1e-5 if law == "memory" else 1e-9)
    assert ours.pivot == pytest.approx(theirs.pivot, rel=1e-5 if law == "memory" else 1e-8)


def stepped_by_pinocchio(monkeypatch, change) -> State:
    """A step with all regressors of Pinocchio's changed."""
    robot, right = "kinova held", pin.computeJointTorqueRegressor
    samples = motion(robot, 1, 1e-3)
    identifier = NullspaceAID().build(pair(robot)[0], true_theta(robot), 1e-3)
    monkeypatch.setattr(
        pinocchio_links.pin, "computeJointTorqueRegressor", lambda *args: change(right(*args))
    )
    state = identifier.init(samples[0])
    return identifier.step(state._replace(v_hat=state.v_hat + 1e-3), *samples)


def test_the_step_by_pinocchio_takes_pinocchios_regressors(monkeypatch):
    right, wrong = (stepped_by_pinocchio(monkeypatch, lambda Y, k=k: k * Y) for k in (1.0, 2.0))
    links = slice(0, 10 * pair("kinova held")[0].bodies)
    assert right.status is wrong.status is Status.completed
    assert (right.theta_hat[links] != wrong.theta_hat[links]).any()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of ctypes
def test_a_step_without_pinocchios_regressors_fails(monkeypatch):
    state = stepped_by_pinocchio(monkeypatch, lambda _: 1 / 0)
    assert state.status is not Status.completed and np.isfinite(state.theta_hat).all()


def test_a_motion_by_pinocchio_is_freed():
    robot = "kinova held"
    samples = Log.of(motion(robot, 3, 1e-3))
    found = weakref.ref(pair(robot)[0].motion(samples, True).outside.leading)
    gc.collect()
    assert found() is None


def test_a_dense_gain_equals_the_diagonal_one():
    ours = pair("kinova held")[1]

    K, Gamma, samples = (
        np.full(ours.n, 20.0),
        0.1 * ours.space.scale**2,
        motion("kinova held", 2, 1e-3),
    )
    ends = []
    for gains in ((K, Gamma), (np.diag(K), np.diag(Gamma))):
        law = paper_identifier(ours, *gains, true_theta("kinova held"), 1e-3)
        state = law.init(samples[0])
        for one, other in pairwise(samples):
            state = law.step(state, one, other)
        ends.append(state)
    near(ends[0].theta_hat, ends[1].theta_hat)
    near(ends[0].v_hat, ends[1].v_hat)


@pytest.mark.parametrize("part", ["q", "v", "u"])
@pytest.mark.parametrize("law", ["paper", "cone"])
def test_nan_in_a_measurement_is_not_hidden(part, law):
    robot = "kinova held"
    ours, samples = pair(robot)[1], motion(robot, 1, 1e-3)
    identifier = NullspaceAID(law=law).build(ours, true_theta(robot), 1e-3)
    state = identifier.init(samples[0])
    broken = getattr(samples[1 if part != "u" else 0], part).copy()
    broken[0] = np.nan
    if part == "u":
        samples[0] = samples[0]._replace(u=broken)
    else:
        samples[1] = samples[1]._replace(**{part: broken})
    after = identifier.step(state, *samples)
    assert not after.pivot > 0 and after.status is Status.measurement_not_finite
    a, W, _ = ours.evaluate_at(0.0, *samples[1][1:3], samples[0].u, state.v_hat, state.theta_hat)
    assert np.isnan(a).any() or np.isnan(W).any()


def test_an_indefinite_estimate_ends_the_compiled_step_as_the_generic_one():
    robot = "kinova held"
    samples, ends = motion(robot, 1, 1e-3), []
    for system in pair(robot):
        identifier = NullspaceAID().build(system, true_theta(robot), 1e-3)
        state = identifier.init(samples[0])._replace(theta_hat=-true_theta(robot))
        ends.append(identifier.step(state, *samples))
    assert {end.status for end in ends} == {Status.estimate_not_positive_definite}
    assert ends[1].pivot == pytest.approx(ends[0].pivot, rel=1e-9)
    assert (ends[1].theta_hat == -true_theta(robot)).all()


def test_runs_with_both_backends_end_alike(tmp_path):
    scenario = replace(load("double_pendulum"), duration=1.0)
    assert isinstance(scenario.plant, ArmPlant)
    theirs, ours = (
        run(
            replace(scenario, plant=replace(scenario.plant, backend=backend)), tmp_path / backend
        ).record["theta_hat"]
        for backend in get_args(Backend)
    )
    assert np.abs(theirs[-1] - theirs[0]).max() > 0
    near(ours, theirs, 1e-9)


# -- the backend as a field ------------------------------------------------------------------------


def test_the_backend_chooses_the_structure_and_compiled_is_the_default():
    assert set(get_args(Backend)) == {"pinocchio", "compiled"}
    for plant, compiled in (
        (ArmPlant(), True),
        (ArmPlant(backend="pinocchio"), False),
        (ArmPlant(backend="compiled"), True),
    ):
        assert (plant.build(1e-3, 0).system.reference is None) is compiled
