"""A log's rows are those of Pinocchio and plain numpy, and of the system that its laws follow."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.choose.columns import COLUMNS, FALLS, SPEEDS, Choice
from nsaid_mj.clinic.identify.choose.cutoff import filter_for
from nsaid_mj.clinic.identify.choose.timing import Timing
from nsaid_mj.clinic.identify.identify import files_of, identify_forces, recordings_of
from nsaid_mj.clinic.identify.joints import JointRows
from nsaid_mj.clinic.identify.links import file_links
from nsaid_mj.clinic.identify.loads import Load
from nsaid_mj.clinic.identify.measured import FittedColumn, log_robot
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.rows import with_columns
from nsaid_mj.clinic.identify.smoothing import delayed, refined, smooth_commands
from nsaid_mj.clinic.identify.vehicle_loads import check_place
from nsaid_mj.clinic.identify.vehicles import VehicleRows, smooth_pose
from nsaid_mj.clinic.logs.recordings import LogSegment, Recordings
from nsaid_mj.core import GRAVITY, JointTree
from nsaid_mj.core.log import Log
from nsaid_mj.core.parameters import ParameterSpace
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.model import RobotModel
from tests.support.robot_logs import motion

EVERY = frozenset(COLUMNS)
JOINTS = (
    pin.JointModelRY,
    pin.JointModelRX,
    pin.JointModelPZ,
    pin.JointModelRUBZ,
    pin.JointModelPX,
    pin.JointModelRZ,
    pin.JointModelRUBX,
)
PARENTS = (0, 1, 2, 1, 4, 0, 6)


def random_tree(seed: int) -> RobotModel:
    """Hinges, slides and continuous joints in two limbs, one passive, some gears negative."""
    rng, model, n = np.random.default_rng(seed), pin.Model(), len(JOINTS)
    for k in range(n):
        turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        turn[:, 0] *= np.linalg.det(turn)
        place = pin.SE3(turn, rng.uniform(-0.5, 0.5, 3))
        joint = model.addJoint(PARENTS[k], JOINTS[rng.permutation(n)[k]](), place, f"joint {k}")
        moments = np.diag(rng.uniform(0.05, 0.1, 3))
        body = pin.Inertia(rng.uniform(0.5, 2), rng.uniform(-0.2, 0.2, 3), moments)
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    gear = np.where(np.arange(n) % 2, -1.0, 1.0)
    names, none, free = tuple(model.names)[1:], np.zeros(n), np.full(n, np.inf)
    return RobotModel(
        "tree", None, "urdf", model, names, none, none, none, gear, free, passive=names[3:4]
    )


def invented(robot: RobotModel) -> Recordings:
    """A motion in which continuous joints turn several times."""
    n, t = len(robot.joints), np.arange(0, 8, 0.01)
    q, v, u = motion(t, n)
    u[:, 3] = 0.0
    log = Log(t, 3 * q, 3 * v, u)
    segment = LogSegment(log, np.ones((len(t), n), bool), "log", (0, len(t)))
    return refined(Recordings((segment,), 100.0, ("A",) * n))


def packed(name: str) -> tuple[RobotModel, Recordings]:
    """A packed robot with its log."""
    robot = load_robot_model(name)
    return robot, refined(recordings_of(*files_of(name, [], None), robot))


def reference(rows: JointRows, choice: Choice, space: ParameterSpace) -> np.ndarray:
    """(N, n, p) rows by Pinocchio's torque regressor and by the formulas of docs/theory.md."""
    model, n = rows.robot.model, len(rows.robot.joints)
    data = model.createData()
    found = []
    for segment, (t, coordinates, v, a, _) in zip(rows.segments, rows.motions, strict=True):
        W = np.zeros((len(t), n, len(space)))
        weight = np.empty((len(t), n))
        for k, q in enumerate(JointTree.links(model).position(coordinates)):
            torque = pin.computeJointTorqueRegressor(model, data, q, v[k], a[k])
            W[k, :, : 10 * n] = torque
            weight[k] = pin.computeGeneralizedGravity(model, data, q)
        s = np.array([SPEEDS[index] for index in choice.speed])
        f = np.array([FALLS[choice.fall(j)] for j in range(n)])
        slip = np.tanh(v / s)
        own = {
            "rotor": a,
            "viscous": v,
            "coulomb": slip,
            "stribeck": slip * np.exp(-((v / f) ** 2)),
            "load": slip * np.abs(weight),
            "quadratic": v * np.abs(v),
            "cubic": v**3,
            "spring": coordinates,
            "offset": np.ones(v.shape),
        }
        for j, names in enumerate(choice.columns):
            for name in names:
                W[:, j, space.index(f"{COLUMNS[name].letter}_{j + 1}")] = own[name][:, j]
        for i, j, sign in choice.coupled:
            inertia, viscous, coulomb = (
                space.index(f"coupling_{name}_{i + 1}_{j + 1}")
                for name in ("inertia", "viscous", "coulomb")
            )
            shared = np.tanh((v[:, i] + sign * v[:, j]) / s[j])
            W[:, i, inertia], W[:, j, inertia] = a[:, j], a[:, i]
            W[:, i, viscous], W[:, j, viscous] = v[:, j], v[:, i]
            W[:, i, coulomb], W[:, j, coulomb] = shared, sign * shared
        held = delayed(segment, rows.chosen, smooth_commands(segment, rows.chosen), choice.delay)
        for at in space.actuators:
            j = int(space.names[at].rpartition("_")[2]) - 1
            W[:, j, at] = -held[:, j] * np.sign(rows.robot.gain[j])
        found.append(rows.chosen.rows(W))
    return np.concatenate(found)


def assert_same_columns(found: np.ndarray, expected: np.ndarray) -> None:
    """Every column (N, n, p) to 1e-10 of its largest entry; rounding where all entries are 0."""
    size = np.abs(expected).max(axis=(0, 1))
    apart = np.abs(found - expected).max(axis=(0, 1))
    assert (apart <= 1e-10 * size + 1e-14 * size.max()).all()


@pytest.mark.parametrize("name", ["tx40", "tree 0", "tree 1", "tree 2"])
def test_rows_of_every_column_are_those_of_pinocchio_and_numpy(name):
    if name == "tx40":
        (robot, recordings), coupled = packed(name), ((4, 5, 1),)
    else:
        robot = random_tree(int(name[-1]))
        recordings, coupled = invented(robot), ((2, 5, -1), (0, 1, 1))
    n = len(robot.joints)
    speeds = np.random.default_rng(0).integers(0, len(SPEEDS), n)
    falls = tuple(np.random.default_rng(1).integers(0, len(FALLS), n).tolist())
    choice = Choice((EVERY,) * n, tuple(speeds.tolist()), np.full(n, 0.003), coupled, falls)
    rows = JointRows(robot, recordings, filter_for(recordings), np.ones(n), 1.0, coupled=coupled)
    problem = rows.problem(choice)
    expected = reference(rows, choice, problem.space)
    assert problem.Y.shape[2] == 10 * n + 9 * n + 3 * len(coupled) + len(rows.driven)
    assert_same_columns(problem.Y, expected)


def test_friction_follows_the_weight_of_the_links_that_load_it():
    robot, recordings = packed("tx40")
    n = len(robot.joints)
    choice = Choice((frozenset({"load"}),) * n, (2,) * n, np.zeros(n))
    rows = JointRows(robot, recordings, filter_for(recordings), np.ones(n), 1.0)
    before = rows.problem(choice)
    rows.reweigh(3 * file_links(robot.model))
    after = rows.problem(choice)
    at = before.space["load-dependent friction"]
    np.testing.assert_allclose(after.Y[:, :, at], 3 * before.Y[:, :, at], rtol=1e-10, atol=1e-13)


def test_only_dry_friction_turns_before_the_velocity():
    robot = random_tree(0)
    recordings = invented(robot)
    rows = JointRows(robot, recordings, filter_for(recordings), np.ones(len(robot.joints)), 1.0)
    same = rows.turning()
    early = rows.turning(lead=0.01)
    np.testing.assert_array_equal(same.diagonal["coulomb"], rows.diagonal["coulomb"])
    assert np.abs(early.diagonal["coulomb"] - rows.diagonal["coulomb"]).max() > 0.01
    np.testing.assert_array_equal(early.diagonal["viscous"], rows.diagonal["viscous"])


def test_another_clock_changes_inertia_and_friction_but_no_weight():
    robot = random_tree(1)
    recordings = invented(robot)
    rows = JointRows(robot, recordings, filter_for(recordings), np.ones(len(robot.joints)), 1.0)
    endless = rows.retimed(1e6).links
    slow = rows.retimed(2.0)
    np.testing.assert_allclose(slow.links - endless, (rows.links - endless) / 4, atol=1e-9)
    np.testing.assert_allclose(slow.diagonal["viscous"], rows.diagonal["viscous"] / 2)
    np.testing.assert_allclose(slow.diagonal["rotor"], rows.diagonal["rotor"] / 4)


def test_a_law_follows_the_system_whose_rows_were_fitted():
    """Positions of continuous joints are (cos, sin) to a law, and angles in the rows."""
    found = identify_forces("tx40", columns=["load", "stribeck", "offset"], delay=0.0)
    system, problem = log_robot(found).robot_of(found.robot).system, found.fitted.problem
    recordings = refined(found.recordings)
    rows = JointRows(found.robot, recordings, filter_for(recordings, found.cutoff), np.ones(6))
    u = [
        delayed(segment, rows.chosen, smooth_commands(segment, rows.chosen), np.zeros(6))
        * np.sign(found.robot.gain)
        for segment in rows.segments
    ]
    W = rows.regressor(system, lambda W: W, u)
    assert_same_columns(W, problem.Y)


@pytest.mark.parametrize("name", ["hummingbird", "bluerov2"])
def test_a_load_of_a_vehicle_has_the_columns_of_a_point_mass_where_it_is_carried(name):
    robot = load_robot_model(name)
    logs = []
    for seed in (1, 2):
        setup = Setup.of(replace(load(name), duration=2.0, sensors="ideal", seed=seed))
        with setup.plant.running():
            log = setup.simulate()
        logs.append(LogSegment(log, np.ones(log.v.shape, bool), f"{seed}.csv", (0, len(log.t))))
    recordings = Recordings(tuple(logs), 1 / log.step, ("",) * log.u.shape[1])
    place = (0.1, 0.05, -0.2)
    loads = (Load("2.csv", 0.5, "body", place),)
    rows = VehicleRows(robot, recordings, filter_for(recordings), loads)
    problem = rows.problem(frozenset(), Timing())
    at = problem.space["payload"]
    masses = robot.system.point_masses
    mass = masses.change(1.0, np.array(place))
    own = problem.Y[:, :, : len(mass)]
    carrying = (rows.segment == 1)[:, None]
    np.testing.assert_allclose(problem.Y[:, :, at.start], own @ mass * carrying, atol=1e-9)
    if masses.submerged:  # the weight of the same mass, upwards
        pull = np.zeros(len(mass))
        for block in ("net weight", "righting moment"):
            pull[robot.system.space[block]] = -mass[robot.system.space[block]] / GRAVITY
        np.testing.assert_allclose(problem.Y[:, :, at.stop - 1], own @ pull * carrying, atol=1e-9)
    with pytest.raises(InvalidInput, match="body:X,Y,Z"):
        check_place([Load("2.csv", 0.5)])


@pytest.mark.parametrize("name", ["hummingbird", "catamaran", "uvms", "scalar_rov"])
def test_further_columns_of_a_vehicle_are_damping_and_constant_forces(name):
    setup = Setup.of(replace(load(name), duration=4.0, sensors="ideal", seed=1))
    with setup.plant.running():
        log = setup.simulate()
    robot = load_robot_model(name)
    segment = LogSegment(log, np.ones(log.v.shape, bool), "log", (0, len(log.t)))
    recordings = Recordings((segment,), 1 / log.step, ("",) * log.u.shape[1])
    rows = VehicleRows(robot, recordings, filter_for(recordings))
    names = frozenset({"damping", "offset"})
    system, timing = robot.system, Timing(0.01)
    problem = rows.problem(names, timing)
    motion = smooth_pose(system, segment, rows.chosen)
    u = rows.chosen.low_pass(log.u)
    held = np.column_stack([np.interp(motion.t - 0.01, log.t, x) for x in u.T])
    W = system.regressor(motion.t, np.hstack([motion.q, motion.v]), motion.v, motion.a, held)
    one = np.eye(system.n)
    expected = np.concatenate(
        [W, motion.v[:, :, None] * one, -np.ones(motion.v.shape)[:, :, None] * one], axis=2
    )
    assert_same_columns(problem.Y, rows.chosen.rows(expected))
    stored = [FittedColumn.of(column).column for column in rows.further(names)]  # as a law's
    followed = with_columns(system, stored, [], len(problem.space))
    assert_same_columns(rows.regressor(followed, lambda W: W, [held]), problem.Y)
