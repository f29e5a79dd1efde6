"""The common scale: what moves it, what fixes it, and what is said of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify import calibrate as calibration
from nsaid_mj.clinic.identify.calibrate import _held_out
from nsaid_mj.clinic.identify.choose.columns import BASIC, Choice
from nsaid_mj.clinic.identify.choose.cutoff import filter_for
from nsaid_mj.clinic.identify.choose.joint_search import structured_arm
from nsaid_mj.clinic.identify.export import identified
from nsaid_mj.clinic.identify.fit import ConePrior, minimise
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.joint_checks import expected_gains
from nsaid_mj.clinic.identify.joints import JointRows
from nsaid_mj.clinic.identify.links import file_links, link_blocks, sizes_of_links
from nsaid_mj.clinic.identify.problem import FitProblem, Size
from nsaid_mj.clinic.identify.result import Identification, JointStructure, Options
from nsaid_mj.clinic.identify.verdict import verdict
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.core.parameters import Block, ParameterSpace
from tests.support.robot_logs import two_joints
from tests.support.simulated_logs import HeavyWrist


def problem_of(rows: int, stretch: float = 1.0, noise: float = 0.01, seed: int = 0) -> FitProblem:
    """An arm whose links weigh what the file says, with inertias `stretch` times the file's.

    Gains are 1 and 2; the prior expects 1 and 2 within a factor of seven.
    """
    model, rng = two_joints().model, np.random.default_rng(seed)
    data, own = model.createData(), file_links(model)
    true = own.copy()
    for link in (0, 10):
        true[link + 4 : link + 10] *= stretch
    states = rng.uniform(-1, 1, (rows, 3, 2)) * np.array([3.0, 2.0, 8.0])[:, None]
    links = np.array([pin.computeJointTorqueRegressor(model, data, *s).copy() for s in states])
    rest = np.zeros(2)
    weight = np.concatenate(
        [pin.computeJointTorqueRegressor(model, data, s[0], rest, rest).copy() for s in states[:50]]
    )
    u = (links @ true + 2.0 * states[:, 1]) / np.array([1.0, 2.0])
    u *= 1 + noise * rng.standard_normal(u.shape)
    two = ("1", "2")
    blocks = (
        *link_blocks(two_joints()),
        Block(
            "viscous friction",
            tuple(f"viscous_{i}" for i in two),
            ("N·m·s/rad",) * 2,
            np.ones(2),
            "positive",
        ),
        Block(
            "motor gain",
            tuple(f"gain_{i}" for i in two),
            ("N·m/A",) * 2,
            np.ones(2),
            "positive",
            True,
        ),
    )
    space = ParameterSpace(blocks)
    Y = np.concatenate([links, np.zeros((rows, 2, 4))], axis=2)
    for j in range(2):
        Y[:, j, 20 + j], Y[:, j, 22 + j] = states[:, 1, j], -u[:, j]
    nothing = np.zeros(24, dtype=bool)
    weights = np.pad(sizes_of_links(model, links.reshape(-1, 20), weight), ((0, 0), (0, 4)))
    return FitProblem(
        space,
        Y,
        np.ones((rows, 2), dtype=bool),
        np.arange(rows, dtype=float) * 0.05,
        np.zeros(rows, dtype=np.intp),
        np.concatenate([own, [1.0, 1.0, 1.0, 2.0]]),
        np.concatenate([np.full(20, np.inf), np.full(4, 2.0)]),
        nothing,
        Size(weights, np.zeros(24, dtype=np.intp), 0.25, nothing),
    )


@pytest.mark.parametrize("rows", [100, 1000, 8000])
def test_rows_that_tell_of_shape_alone_do_not_move_the_scale(rows):
    """Ten times the inertia at the same weight: the log-determinant's divergence would shrink it.

    The more rows there are, the closer the shape comes to the true one, and the lower the minimum
    of tr P₀⁻¹P − log det P over all multiples of P.
    """
    problem = problem_of(rows, stretch=10.0)
    assert problem.size is not None
    fit = minimise(problem)
    assert problem.size.weights[0] @ fit.theta == pytest.approx(1.0, abs=2e-3)
    np.testing.assert_allclose(fit.theta[22:], [1.0, 2.0], rtol=0.05)


def in_limbs(number: int) -> FitProblem:
    """A problem of two links as one limb, or as if only the base connected them."""
    problem = problem_of(60)
    assert problem.size is not None
    if number == 1:
        return problem
    limb = np.array([0] * 10 + [1] * 10 + [0, 1] * 2)
    weights = np.where(limb == np.arange(2)[:, None], problem.size.weights, 0.0)
    return replace(problem, size=problem.size._replace(weights=weights, limb=limb))


@pytest.mark.parametrize("limbs", [1, 2])
def test_the_prior_is_the_same_for_all_multiples_of_a_limb_but_for_its_size(limbs):
    problem = in_limbs(limbs)
    assert problem.size is not None
    loose = replace(problem, size=problem.size._replace(deviation=1e9))
    last = problem.size.limb == limbs - 1
    theta, step = problem.prior * np.linspace(0.8, 1.3, 24), np.log(2.0) / 0.25
    values = [ConePrior(loose).value(np.where(last, s, 1.0) * theta) for s in (0.1, 1.0, 10.0)]
    np.testing.assert_allclose(values, values[1], rtol=1e-9)
    twice = np.where(last, 2.0, 1.0) * problem.prior
    assert ConePrior(problem).value(twice) == pytest.approx(0.5 * step**2, rel=1e-9)


@pytest.mark.parametrize("limbs", [1, 2])
def test_the_gradient_of_the_prior_is_its_finite_difference(limbs):
    problem = in_limbs(limbs)
    stated = problem.known.copy()
    stated[22] = True
    assert problem.size is not None
    problem = replace(problem, size=problem.size._replace(stated=stated))
    prior, theta = ConePrior(problem), problem.prior * np.linspace(0.9, 1.2, 24)
    gradient, hessian = prior.derivatives(theta)
    for i, unit in enumerate(np.eye(24)):
        h = 1e-6 * problem.space.scale[i]
        slope = (prior.value(theta + h * unit) - prior.value(theta - h * unit)) / (2 * h)
        assert slope == pytest.approx(gradient[i], rel=1e-4, abs=1e-4 / problem.space.scale[i])
    size = np.outer(problem.space.scale, problem.space.scale)
    assert np.linalg.eigvalsh(hessian * size)[0] > -1e-8


# -- whole identifications ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def log() -> HeavyWrist:
    return HeavyWrist("ur5", 0, 15.0)


@pytest.fixture(scope="module")
def path(log, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return log.write(tmp_path_factory.mktemp("scale") / "log.csv")


@pytest.fixture(scope="module")
def free(log, path) -> Identification:
    return identify_forces(log.robot, path, columns=["viscous"], delay=0.012)


def test_gains_are_guessed_from_torque_and_friction_together(log, path):
    """A wrist whose friction is many times its links' torque."""
    recordings = prepare(read_tables([path]), None, log.robot)
    rows = JointRows(log.robot, recordings, filter_for(recordings, None), np.ones(6))
    gain, spread, _ = expected_gains(rows)
    assert (np.abs(np.log(gain / log.gain)) < np.log(1.4)).all() and (spread > 1).all()
    choice = Choice((BASIC,) * 6, (1,) * 6, np.zeros(6))
    for deviation in (0.15, 2.0):  # commands in N·m hold as they are, guesses over the links' size
        rows.gain, rows.spread = gain, np.full(6, deviation)
        problem = rows.problem(choice)
        assert problem.size is not None
        stated = problem.size.stated
        assert (stated[problem.space.actuators] == (deviation < 1)).all()
        assert stated.sum() == 6 * (deviation < 1)


def test_a_scale_that_rests_on_the_files_masses_is_said_to_do_so(log, free):
    assert free.explains == "partly" and "ratios of parameters hold" in free.verdict
    assert "identified" not in {p.status for p in free.parameters}
    for gain, true in zip(free.of("motor gain"), log.gain, strict=True):
        assert gain.low <= true <= gain.high
        assert 1.5 < gain.high / gain.value < 2.0  # a quarter of doubt of the file's masses
    assert all("over the other gains" in g.combination for g in free.of("motor gain")[:3])


def test_the_exported_model_carries_the_files_weight(log, free):
    exported, data = identified(free).model, log.robot.model.createData()
    poses = log.q[::50]
    weight = [
        np.array([pin.computeGeneralizedGravity(m, data, q).copy() for q in poses])
        for m in (log.robot.model, exported)
    ]
    share = np.sum(weight[0] * weight[1]) / np.sum(weight[0] ** 2)
    assert share == pytest.approx(1.0, abs=0.01)
    assert exported.inertias[1].mass == pytest.approx(3.7, rel=0.01)  # acts on no joint: the file's


def test_a_known_gain_fixes_the_scale(log, path):
    known = {"gain_1": float(log.gain[0])}
    found = identify_forces(log.robot, path, known=known, columns=["viscous"], delay=0.012)
    assert found.explains == "yes" and "known gain_1" in found.anchor
    gain = found.of("motor gain")[1]
    assert gain.status == "identified" and gain.high / gain.low < 1.2
    assert gain.low <= log.gain[1] <= gain.high


def test_a_known_mass_settles_its_share_of_the_weight(log, path, free):
    """Seen in combination only, it does not fix the scale, and that is said."""
    name = "mass of upper_arm_link"
    known = {name: float(log.true.inertias[2].mass)}
    found = identify_forces(log.robot, path, known=known, columns=["viscous"], delay=0.012)
    gains = [result.of("motor gain")[1] for result in (free, found)]
    assert gains[1].high / gains[1].low < 0.8 * gains[0].high / gains[0].low
    assert abs(np.log(gains[1].value / log.gain[1])) < abs(np.log(gains[0].value / log.gain[1]))
    told = next(f for f in found.findings if f.code == "known_in_combination")
    assert told.where == name and 0.2 < float(str(told.data["share"])) < 0.8
    assert found.explains == "partly" and "identified" not in {p.status for p in found.parameters}


def test_known_masses_of_all_links_fix_the_scale(log, path):
    known = {
        f"mass of {link}": float(log.true.inertias[i].mass)
        for i, link in enumerate(
            (
                "shoulder_link",
                "upper_arm_link",
                "forearm_link",
                "wrist_1_link",
                "wrist_2_link",
                "wrist_3_link",
            ),
            1,
        )
    }
    found = identify_forces(log.robot, path, known=known, columns=["viscous"], delay=0.012)
    assert found.explains == "yes"
    gain = found.of("motor gain")[1]
    assert gain.value == pytest.approx(log.gain[1], rel=0.08)
    assert gain.low <= log.gain[1] <= gain.high


def test_a_known_mass_that_no_joint_feels_changes_nothing_and_is_told(log, path, free):
    known = {"mass of shoulder_link": 2 * float(log.true.inertias[1].mass)}
    found = identify_forces(log.robot, path, known=known, columns=["viscous"], delay=0.012)
    told = next(f for f in found.findings if f.code == "known_in_combination")
    assert "it has no effect in the log; it changes no other parameter" in told.text
    gains = [[g.value for g in result.of("motor gain")] for result in (free, found)]
    np.testing.assert_allclose(gains[1], gains[0], rtol=5e-3)


# -- validation and held-out parts ---------------------------------------------------------------


def test_a_validation_log_has_the_rows_of_training(log, path):
    """Load friction follows the identified weight in both, not the file's in one of them."""
    recordings = prepare(read_tables([path]), None, log.robot)
    options = Options(frozenset({"rotor", "viscous", "coulomb", "load"}), (), np.full(6, 0.012))
    made = structured_arm(log.robot, recordings, recordings, options, lambda _: None)
    assert made.checked is not None
    np.testing.assert_array_equal(made.checked.Y, made.problem.Y)


@pytest.mark.parametrize(
    "held_out,validation,explains",
    [
        (0.1, None, "yes"),
        (0.1, 0.1, "yes"),
        (0.1, 0.3, "partly"),
        (0.1, 0.9, "no"),
        (0.9, 0.1, "no"),
        (0.1, np.nan, "yes"),
    ],
)
def test_the_verdict_is_that_of_the_worse_log(held_out, validation, explains):
    joint = JointStructure("elbow", 0.1, held_out, 0.1, validation, None, (), 0.05, 0.0)
    assert verdict((joint,))[0] == explains


def test_a_validation_log_that_is_not_predicted_widens_its_joint(log, path, tmp_path):
    rng = np.random.default_rng(0)
    other = HeavyWrist("ur5", 0, 15.0)
    other.u[:, 3] = rng.standard_normal(len(other.u)) * other.u[:, 3].std()
    bad = other.write(tmp_path / "other.csv")
    found = identify_forces(log.robot, path, validate=bad, columns=["viscous"], delay=0.012)
    assert found.joints[3].held_out < 0.2 and "wrist_1_joint" in found.verdict
    gain = found.of("motor gain")[3]
    assert gain.high / gain.low > 10


def test_a_joint_that_idles_in_one_part_is_judged_by_all_of_the_log():
    problem = problem_of(1000, noise=0.0)
    rng, Y = np.random.default_rng(1), problem.Y.copy()
    Y[:200, 1, :22] *= 0.01  # at 1 % of its motion, the noise that is left is all of the command
    Y[:200, 1, 23] = -(Y[:200, 1, :22] @ np.append(file_links(two_joints().model), [2, 2])) / 2
    Y[:, 1, 23] += 0.01 * Y[200:, 1, 23].std() * rng.standard_normal(1000)
    errors = _held_out(replace(problem, Y=Y), np.ones(2), problem.prior)
    for error in errors:
        assert error[1] == pytest.approx(0.011, rel=0.2)


def test_held_out_rows_take_no_part_in_their_prediction():
    """Few rows a column: least squares predicts new rows worse than its own."""
    problem = problem_of(40, noise=0.3)
    errors, fit = _held_out(problem, np.ones(2), problem.prior), minimise(problem)
    assert (errors[0] > 1.05 * problem.nrmse(fit.theta)).all()


def test_a_velocity_that_nothing_drives_and_that_hardly_moves_is_not_judged():
    problem, units = problem_of(100), ("m/s", "m/s")
    Y = problem.Y.copy()
    Y[:, 0, 22] = 0.0
    moved = replace(problem, Y=Y)
    assert not moved.hardly_moved(problem.prior, units).any()
    Y = Y.copy()
    Y[:, 0] *= 0.01
    still = replace(problem, Y=Y)
    assert still.hardly_moved(problem.prior, units).tolist() == [True, False]
    assert not still.hardly_moved(problem.prior, ("rad/s", "m/s")).any()


def test_a_doubted_structure_leaves_masses_positive_and_no_parameter_identified(
    log, path, monkeypatch
):
    def doubted(names, errors):
        return [Finding("warning", "unexplained", name, "") for name in names]

    monkeypatch.setattr(calibration, "structure_checks", doubted)
    monkeypatch.setattr(calibration, "_doubted", lambda problem, *_: np.ones(len(problem.space)))
    found = identify_forces(log.robot, path, columns=["viscous"], delay=0.012)
    masses = [p for p in found.parameters if p.unit == "kg"]
    assert masses and all(0 < p.low < p.value < p.high for p in masses)
    assert "identified" not in {p.status for p in found.parameters}
    assert all(g.relative is not None and g.relative > 0.5 for g in found.of("motor gain"))
