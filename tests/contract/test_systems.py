"""One contract for all systems: (3), (4), (8–10), (29), Ṁ − 2C skew, no true value inside."""

import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.log import Measurement
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.core.structure.system import checked
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.assets import scenarios
from nsaid_mj.robots.loading import load_robot
from tests.support.matrices import assert_near
from tests.support.plants import plant
from tests.support.strategies import seeds
from tests.support.vehicles import VEHICLES

FEW = settings(deadline=None, max_examples=10)
ARMS = ["ur5", "kinova", "panda", "double_pendulum", "talos_arm", "solo12"]
BY_PINOCCHIO = ["kinova pinocchio", "solo12 pinocchio"]
NAMES = ["scalar_rov", *ARMS, *BY_PINOCCHIO, *VEHICLES]
systems = pytest.mark.parametrize("name", NAMES)
arms = pytest.mark.parametrize("name", ARMS)
vehicles = pytest.mark.parametrize("name", VEHICLES)


def draw(system, rng, batch=()):
    """(t, x, w, a, u) of the size seen in operation, with leading axes `batch`."""
    count = int(np.prod(batch))
    q, v, u = (
        np.array(part)
        for part in zip(*(system.random_state(rng) for _ in range(count)), strict=True)
    )
    w, a = rng.standard_normal((2, count, system.n)) * np.abs(v).max()
    parts = rng.uniform(0, 9, count), np.hstack([q, v]), w, a, u
    return tuple(part.reshape(batch + part.shape[1:]) for part in parts)


# -- shapes ------------------------------------------------------------------------------------


@systems
@pytest.mark.parametrize("batch", [(), (1,), (3,), (2, 3)])
def test_results_have_their_shapes_and_a_batch_equals_a_loop(name, batch):
    system, theta = plant(name).system, plant(name).truth
    n, p = system.n, system.p
    t, x, w, a, u = draw(system, np.random.default_rng(1), batch)
    calls = {
        system.W_M: ((x, a), (n, p)),
        system.W_C: ((x, w), (n, p)),
        system.F: ((t, x, u), (n, p)),
        system.regressor: ((t, x, w, a, u), (n, p)),
        lambda x: system.mass_matrix(x, theta): ((x,), (n, n)),
        lambda x: system.coriolis_matrix(x, theta): ((x,), (n, n)),
        lambda t, x, w, u: system.acceleration(t, x, w, u, theta): ((t, x, w, u), (n,)),
    }
    for call, (arguments, shape) in calls.items():
        whole = call(*arguments)
        assert whole.shape == batch + shape
        for k in np.ndindex(batch):
            np.testing.assert_allclose(whole[k], call(*(part[k] for part in arguments)), rtol=1e-13)


@systems
def test_leading_axes_broadcast(name):
    system = plant(name).system
    t, x, w, a, u = draw(system, np.random.default_rng(2), (4,))
    tiled = system.regressor(t, x, np.tile(w[0], (4, 1)), np.tile(a[0], (4, 1)), u)
    assert (system.regressor(t, x, w[0], a[0], u) == tiled).all()
    crossed = system.regressor(t[:, None], x[:, None], w, a, u)
    assert crossed.shape == (4, 4, system.n, system.p)
    assert (crossed[1, 2] == system.regressor(t[1], x[1], w[2], a[2], u[2])).all()


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum"])
def test_an_empty_batch_has_an_empty_answer(name):
    system = plant(name).system
    x, a = np.zeros((0, system.m + system.n)), np.zeros((0, system.n))
    assert system.W_M(x, a).shape == (0, system.n, system.p)


@systems
@pytest.mark.parametrize(
    "call,wrong", [("W_M", (0, 1)), ("W_C", (0, 1)), ("F", (1, 2)), ("regressor", (1, 2, 3, 4))]
)
def test_a_wrong_shape_is_refused_with_the_remedy(name, call, wrong):
    system = plant(name).system
    t, x, w, a, u = draw(system, np.random.default_rng(3))
    right = {"W_M": [x, a], "W_C": [x, w], "F": [t, x, u], "regressor": [t, x, w, a, u]}[call]
    for at in wrong:
        for value in (right[at][:-1], np.append(right[at], 0.0), np.float64(1.0)):
            with pytest.raises(InvalidInput) as caught:
                getattr(system, call)(*right[:at], value, *right[at + 1 :])
            assert caught.value.remedy and str(np.shape(value)) in str(caught.value.got), at


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum"])
@pytest.mark.parametrize("call", ["mass_matrix", "coriolis_matrix", "acceleration"])
def test_a_theta_of_the_wrong_shape_is_refused(name, call):
    system, theta = plant(name).system, plant(name).truth
    t, x, w, _, u = draw(system, np.random.default_rng(3))
    arguments = (t, x, w, u) if call == "acceleration" else (x,)
    for bad in (theta[:-1], np.append(theta, 0.0)):
        with pytest.raises(InvalidInput):
            getattr(system, call)(*arguments, bad)


@systems
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_measurement_or_estimate_that_is_not_finite_is_refused(name, bad):
    system = plant(name).system
    q, v, u = system.random_state(np.random.default_rng(4))
    good = Measurement(0.0, q, v, u)
    for field in ("q", "v", "u"):
        broken = getattr(good, field).copy()
        broken[-1] = bad
        for value in (broken, getattr(good, field)[:-1]):
            with pytest.raises(InvalidInput) as caught:
                checked(system, good._replace(**{field: value}))
            assert caught.value.name == field and caught.value.remedy
    with pytest.raises(InvalidInput, match="finite"):
        checked(system, good._replace(t=bad))
    with pytest.raises(InvalidInput, match="finite"):
        system.space.check(np.full(system.p, bad))


# -- the equations -----------------------------------------------------------------------------


@systems
@FEW
@given(seeds, st.floats(-3, 3), st.floats(-3, 3))
def test_the_regressors_are_linear(name, seed, alpha, beta):
    system, rng = plant(name).system, np.random.default_rng(seed)
    _, x, w, a, _ = draw(system, rng)
    theta, other = system.space.scale * rng.standard_normal((2, system.p))
    speed = np.abs(x[system.m :]).max()  # products of velocities cancel in C
    for linear, one, two, least in (
        (lambda a: system.W_M(x, a), a, w, 0.0),
        (lambda w: system.W_C(x, w), w, a, speed * np.abs([w, a]).max()),
        (lambda theta: system.mass_matrix(x, theta), theta, other, 0.0),
    ):
        both, first, second = linear(alpha * one + beta * two), linear(one), linear(two)
        size = max(np.abs(first).max(), np.abs(second).max(), least)
        assert np.abs(both - alpha * first - beta * second).max() <= 1e-13 * size


@systems
@FEW
@given(seeds)
def test_the_regressor_is_w_m_plus_w_c_minus_f(name, seed):
    system, rng = plant(name).system, np.random.default_rng(seed)
    t, x, w, a, u = draw(system, rng)
    theta = system.space.scale * rng.standard_normal(system.p)
    W = system.regressor(t, x, w, a, u)
    parts = system.W_M(x, a), system.W_C(x, w), -system.F(t, x, u)
    size = sum(np.abs(part) for part in parts).max()
    assert np.abs(W - sum(parts)).max() <= 1e-14 * size  # (10)
    forces = (
        system.mass_matrix(x, theta) @ a
        + system.coriolis_matrix(x, theta) @ w
        - system.F(t, x, u) @ theta
    )
    assert np.abs(W @ theta - forces).max() <= 1e-11 * (np.abs(W) @ np.abs(theta)).max()  # (4)


@systems
@FEW
@given(seeds)
def test_the_acceleration_solves_the_equation(name, seed):
    system, theta = plant(name).system, plant(name).truth
    t, x, w, _, u = draw(system, np.random.default_rng(seed))
    a = system.acceleration(t, x, w, u, theta)  # (29)
    W = system.regressor(t, x, w, a, u)
    assert np.abs(W @ theta).max() <= 1e-11 * (np.abs(W) @ np.abs(theta)).max()  # (30)


@systems
@FEW
@given(seeds)
def test_evaluate_at_agrees_with_the_definitions(name, seed):
    system, theta = plant(name).system, plant(name).truth
    t, x, w, _, u = draw(system, np.random.default_rng(seed))
    q, v = system.split(x)
    a, W, pivot = system.evaluate_at(float(t), q, v, u, w, theta)
    expected = system.acceleration(t, x, w, u, theta)
    assert_near(a, expected, 1e-8)
    assert_near(W, system.regressor(t, x, w, a, u))
    L = np.linalg.cholesky(system.mass_matrix(x, theta))
    assert pivot == pytest.approx((np.diag(L) ** 2).min(), rel=1e-6)


@systems
def test_evaluate_at_accepts_estimates_of_no_physical_body(name):
    """Massless and negative links, as an estimate passes them: no exception, no wrong number."""
    system, truth = plant(name).system, plant(name).truth
    t, x, w, _, u = draw(system, np.random.default_rng(8))
    q, v = system.split(x)
    massless, negative = truth.copy(), -truth
    massless[0] = 0.0
    for theta in (massless, negative, 0 * truth):
        a, W, pivot = system.evaluate_at(float(t), q, v, u, w, theta)
        M = system.mass_matrix(x, theta)
        if np.linalg.eigvalsh(M)[0] > 1e-9 * np.abs(M).max():
            assert pivot > 0
            assert_near(a, system.acceleration(t, x, w, u, theta), 1e-8)
        else:
            assert not pivot > 0 and np.isnan(a).all()
            assert np.isfinite(W).all()


@systems
@pytest.mark.parametrize("each", [False, True])
def test_evaluate_is_acceleration_and_regressor_of_many_samples(name, each):
    system, truth = plant(name).system, plant(name).truth
    rng = np.random.default_rng(4)
    t, x, w, _, u = draw(system, rng, (5,))
    theta = truth * rng.uniform(0.9, 1.1, (5, 1)) if each else truth
    a, W = system.evaluate(t, x, w, u, theta)
    thetas = np.broadcast_to(theta, (5, system.p))
    wanted = np.array([system.acceleration(t[k], x[k], w[k], u[k], thetas[k]) for k in range(5)])
    assert_near(a, wanted, 1e-9)
    assert_near(W, system.regressor(t, x, w, wanted, u), 1e-9)


@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum", "bluerov2"])
def test_evaluate_solves_for_the_acceleration_where_m_is_not_positive_definite(name):
    system, theta = plant(name).system, -plant(name).truth
    t, x, w, _, u = draw(system, np.random.default_rng(5), (3,))
    a, W = system.evaluate(t, x, w, u, theta)
    wanted = system.acceleration(t, x, w, u, theta)
    assert_near(a, wanted)
    assert_near(W, system.regressor(t, x, w, wanted, u))


@systems
def test_actuators_are_in_f_alone(name):
    system = plant(name).system
    t, x, w, a, u = draw(system, np.random.default_rng(6), (5,))
    k = system.space.actuators
    assert not system.W_M(x, a)[..., k].any() and not system.W_C(x, w)[..., k].any()
    assert (system.regressor(t, x, w, a, u)[..., k] == -system.F(t, x, u)[..., k]).all()
    assert system.F(t, x, u)[..., k].any()


@systems
@FEW
@given(seeds)
def test_the_mass_matrix_is_symmetric_positive_definite(name, seed):
    system, theta = plant(name).system, plant(name).truth
    _, x, _, a, _ = draw(system, np.random.default_rng(seed))
    M = system.mass_matrix(x, theta)
    assert_near(M, M.T, 1e-13)
    assert np.linalg.eigvalsh(M)[0] > 0
    assert_near(system.W_M(x, a) @ theta, M @ a)  # (8)


@systems
@FEW
@given(seeds)
def test_m_dot_minus_2c_is_skew(name, seed):
    system, theta = plant(name).system, plant(name).truth
    _, x, w, _, _ = draw(system, np.random.default_rng(seed))
    q, v = system.split(x)
    h = 1e-5

    def mass(step):
        return system.mass_matrix(np.r_[system.integrate(q, step * v), v], theta)

    M_dot = (mass(h) - mass(-h)) / (2 * h)
    C = system.coriolis_matrix(x, theta)
    terms = np.abs(mass(0)).max() * np.abs(v).max() * np.abs(w).max()  # cancel
    assert_near(system.W_C(x, w) @ theta, C @ w, floor=terms)  # (9)
    size = max(np.abs(C).max(), np.abs(mass(0)).max())
    assert np.abs(M_dot - C - C.T).max() <= 1e-6 * size


# -- kinematics --------------------------------------------------------------------------------


@systems
@FEW
@given(seeds)
def test_integrate_and_difference_are_inverse(name, seed):
    system, rng = plant(name).system, np.random.default_rng(seed)
    q0, q1 = system.random_state(rng)[0], system.random_state(rng)[0]
    step = rng.uniform(-1, 1, system.n)
    assert_near(system.difference(q0, system.integrate(q0, step)), step, 1e-11)
    reached = system.integrate(q0, system.difference(q0, q1))
    assert np.abs(system.difference(reached, q1)).max() <= 1e-11  # one pose has many numbers
    assert_near(system.integrate(q0, 0 * step), q0, 1e-14)
    assert np.abs(system.difference(q0, q0)).max() <= 1e-12
    twice = system.integrate(system.integrate(q0, step), step)
    assert np.abs(system.difference(twice, system.integrate(q0, 2 * step))).max() <= 1e-11


@systems
@FEW
@given(seeds)
def test_j_is_the_derivative_of_integrate(name, seed):
    system, rng = plant(name).system, np.random.default_rng(seed)
    q = system.random_state(rng)[0]
    v, h = rng.standard_normal(system.n), 1e-6
    slope = (system.integrate(q, h * v) - system.integrate(q, -h * v)) / (2 * h)
    J = system.J(q)
    assert J.shape == (system.m, system.n)
    np.testing.assert_allclose(J @ v, slope, atol=1e-8)  # (3)


@systems
def test_random_states_are_in_the_operating_range_and_seeded(name):
    system = plant(name).system
    states = [system.random_state(np.random.default_rng(seed)) for seed in range(200)]
    for part, size in zip(states[0], (system.m, system.n, system.n_u), strict=True):
        assert part.shape == (size,)
    q, v, u = (np.array(part) for part in zip(*states, strict=True))
    assert np.isfinite(q).all() and (v.std(0) > 0).all() and (u.std(0) > 0).all()
    again = system.random_state(np.random.default_rng(0))
    assert all((one == other).all() for one, other in zip(states[0], again, strict=True))


@arms
def test_a_random_configuration_is_within_the_limits(name):
    system = plant(name).system
    low, high = system.limits
    assert (low < high).all()
    model = system.model
    for seed in range(200):
        q, v, u = system.random_state(np.random.default_rng(seed))
        for joint in list(model.joints)[1:]:
            place = slice(joint.idx_q, joint.idx_q + joint.nq)
            if joint.nq == 2:
                assert np.linalg.norm(q[place]) == pytest.approx(1, abs=1e-14)
            else:
                assert low[joint.idx_v] <= q[joint.idx_q] <= high[joint.idx_v]
                if model.lowerPositionLimit[place] < model.upperPositionLimit[place]:
                    assert model.lowerPositionLimit[place] <= q[place]
                    assert q[place] <= model.upperPositionLimit[place]
        assert (np.abs(v) <= system.scales.speed).all()
        assert (np.abs(u) <= system.scales.command).all()


@arms
def test_a_position_has_one_number_for_each_joint(name):
    system, rng = plant(name).system, np.random.default_rng(5)
    numbers, step = rng.uniform(*system.limits, size=(2, 4, system.n)), 0.1 * np.ones(system.n)
    q = system.position(numbers)
    assert q.shape == (2, 4, system.m)
    assert_near(system.difference(q[1, 2], system.position(numbers[1, 2] + step)), step, 1e-11)


# -- θ -------------------------------------------------------------------------------------------


_FACTOR = "(?:kg|N|m|s|rad|unit)[²³]?"
UNIT = re.compile(f"{_FACTOR}(?:·{_FACTOR})*(?:/{_FACTOR}(?:·{_FACTOR})*)?(?:/{_FACTOR})?")


@systems
def test_every_parameter_has_a_name_a_unit_and_a_scale(name):
    system, theta = plant(name).system, plant(name).truth
    space = system.space
    assert system.p == len(space) == len(theta)
    assert len(space.names) == len(set(space.names)) == len(space.units) == system.p
    assert all(space.names) and all(UNIT.fullmatch(unit) for unit in space.units), space.units
    assert all(UNIT.fullmatch(unit) for unit in system.velocity_units)
    assert len(system.velocity_units) == system.n
    assert (space.scale > 0).all() and space.scale.shape == (system.p,)
    assert np.isfinite(space.scale).all()
    if name in VEHICLES:  # some actuators have several parameters
        mounts = system.mounts
        assert mounts is not None and mounts.shape == (len(space.actuators), 3)
        assert len(space.actuators) >= system.n_u
    else:
        assert len(space.actuators) == system.n_u
    for block, place in space:
        if block.geometry == "positive":
            assert (theta[place] > 0).all()
            ratio = theta[place] / space.scale[place]
            assert (ratio > 0.3).all() and (ratio < 3).all()  # a guess of its size


def test_a_prismatic_joint_has_units_of_newtons():
    space = plant("panda").system.space
    units = dict(zip(space.names, space.units, strict=True))
    assert (units["gain_8"], units["viscous_8"], units["rotor_9"]) == ("N/unit", "N·s/m", "kg")
    assert (units["gain_1"], units["viscous_1"], units["rotor_1"]) == (
        "N·m/unit",
        "N·m·s/rad",
        "kg·m²",
    )


COMMANDED = {  # what a command moves besides the actuators' own parameters
    "hummingbird": {"rotor_drag_h", "rotor_drag_z"},
    "crazyflie": {"rotor_drag_h", "rotor_drag_z"},
    "f1tenth": {"C_f"},
    "bmw320i": {"C_f"},
}
ALWAYS = {
    "remus100": "fin lift",
    "catamaran": "fin_lift",
}  # an actuator that acts without a command, too


@systems
@FEW
@given(seeds)
def test_an_actuators_column_depends_on_its_own_command_only(name, seed):
    """A motor's column is its own command; no parameter of an actuator acts without one."""
    system = plant(name).system
    t, x, _, _, u = draw(system, np.random.default_rng(seed))
    space = system.space
    F, idle = system.F(t, x, u), system.F(t, x, 0 * u)
    moved = {space.names[k] for k in np.flatnonzero((idle != F).any(axis=0))}
    assert moved == {space.names[k] for k in space.actuators} | COMMANDED.get(name, set())
    for k in space.actuators:
        always = name in ALWAYS and space.names[k].startswith(ALWAYS[name])
        assert bool((idle[:, k] == 0).all()) != always


# -- no true value inside ------------------------------------------------------------------------


def models(system: JointTree):
    """Every Pinocchio model that a system and its reference hold."""
    values = [*vars(system).values(), *vars(system.reference).values()]
    held = [part for value in values for part in (value if isinstance(value, tuple) else [value])]
    found = [part for part in held if isinstance(part, pin.Model)]
    assert len(found) >= 2
    return found


def inertias(model):
    return np.array([model.inertias[i].toDynamicParameters() for i in range(model.njoints)])


@vehicles
def test_other_true_numbers_leave_a_vehicles_system_bit_identical(name):
    """Plants of two seeds differ in the truth; their structure is the same."""
    one, other = (plant(name, seed) for seed in (1, 2))
    assert (one.truth != other.truth).any()
    t, x, w, a, u = draw(one.system, np.random.default_rng(11))
    answers = []
    for system in (one.system, other.system):
        theta, (q, v) = one.truth, system.split(x)
        seen = system.evaluate_at(float(t), q, v, u, w, theta)
        drawn = system.random_state(np.random.default_rng(0))
        answers.append(
            (
                system.regressor(t, x, w, a, u),
                system.mass_matrix(x, theta),
                *seen,
                *drawn,
                system.space.scale,
                system.mounts,
            )
        )
        assert system.space.names == one.system.space.names
    for first, second in zip(*answers, strict=True):
        assert np.array_equal(first, second, equal_nan=True)
    assert not np.isclose(one.system.space.scale, one.truth, rtol=1e-9).all()


@arms
def test_a_system_is_built_without_any_inertia(name):
    robot, old = load_robot(name), plant(name).system
    system = JointTree.by_pinocchio(robot.model, old.scales, old.friction_speed)
    for model in models(system):
        assert (inertias(model) == 0).all()
        assert (np.array(model.armature) == 0).all()
    assert np.abs(inertias(robot.model)[1:]).max() > 0, "the plant has lost its own"


@arms
def test_evaluate_leaves_only_estimates_in_the_model(name):
    robot, old = load_robot(name), plant(name).system
    system = JointTree.by_pinocchio(robot.model, old.scales, old.friction_speed)
    rng = np.random.default_rng(9)
    theta = plant(name).truth * (1 + 0.2 * rng.uniform(-1, 1, system.p))
    t, x, w, _, u = draw(system, rng)
    q, v = system.split(x)
    before = system.regressor(t, x, w, w, u)
    system.evaluate_at(float(t), q, v, u, w, theta)
    links = theta[: 10 * system.n].reshape(-1, 10)
    for model in models(system):
        held = inertias(model)[1:]
        if (held != 0).any():
            assert_near(held, links, 1e-12)
    assert (system.regressor(t, x, w, w, u) == before).all()


@arms
def test_other_true_inertias_leave_the_system_bit_identical(name):
    robot, old = load_robot(name), plant(name).system
    other = pin.Model(robot.model)
    for i in range(1, other.njoints):
        numbers = 1.7 * robot.model.inertias[i].toDynamicParameters()
        other.inertias[i] = pin.Inertia.FromDynamicParameters(numbers)
    other.armature[:] = 3.0
    t, x, w, a, u = draw(old, np.random.default_rng(10), (3,))
    answers = []
    for model in (robot.model, other):
        system = JointTree.by_pinocchio(model, old.scales, old.friction_speed)
        theta = plant(name).truth
        q, v = system.split(x[0])
        seen = system.evaluate_at(t[0], q, v, u[0], w[0], theta)
        drawn = system.random_state(np.random.default_rng(0))
        answers.append(
            (
                system.regressor(t, x, w, a, u),
                system.mass_matrix(x, theta),
                *seen,
                *drawn,
                *system.limits,
                system.space.scale,
            )
        )
    for one, two in zip(*answers, strict=True):
        assert np.array_equal(one, two)


@pytest.mark.parametrize("name", scenarios())
def test_every_parameter_has_a_label_of_its_own_that_is_no_symbol(name):
    space = Setup.of(load(name)).system.space
    assert len(set(space.labels)) == len(space.labels)
    assert not [label for label in space.labels if "_" in label.split(" of ")[0]]


def test_an_arms_labels_are_its_models_joint_and_link_names():
    space = Setup.of(load("ur5")).system.space
    label = dict(zip(space.names, space.labels, strict=True))
    assert label["gain_2"] == "gain of shoulder_lift_joint"
    assert label["viscous_2"] == "viscous friction of shoulder_lift_joint"
    assert label["m_2"] == "mass of upper_arm_link"
    assert label["Ixx_2"] == "Ixx of upper_arm_link"


def test_a_floating_base_is_named_first_and_links_without_a_name_are_numbered():
    borinot, uvms = (Setup.of(load(name)).system for name in ("borinot", "uvms"))
    assert borinot.space.labels[0] == "mass of borinot__base_link"
    assert "mass of link 3" in uvms.space.labels
    assert "buoyancy of link 4" in uvms.space.labels
