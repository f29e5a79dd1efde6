"""Identification of robots that stand and walk, from logs of joints and IMU."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base import NsaidError
from nsaid_mj.clinic.identify.dry_mass import off_file, with_dry_mass
from nsaid_mj.clinic.identify.export import write_models
from nsaid_mj.clinic.identify.ground.feet import feet_of, imu_pose
from nsaid_mj.clinic.identify.ground.offsets import _lengths, at_rest, entries_of
from nsaid_mj.clinic.identify.ground.rows import BANDS, BASE, Ground, GroundRows, turning
from nsaid_mj.clinic.identify.ground.search import expected_gains, filter_of
from nsaid_mj.clinic.identify.identify import (
    identify,
    identify_forces,
    recordings_of,
    servos_of,
)
from nsaid_mj.clinic.identify.inspection import inspect
from nsaid_mj.clinic.identify.models import floating, load_robot_model
from nsaid_mj.clinic.logs.first_map import first_map
from nsaid_mj.clinic.logs.mapping import ContactMap, Imu, map_of, read_map
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.clinic.logs.unusable import UnusableLog
from nsaid_mj.core import Log, Sums
from nsaid_mj.lab import INTERVAL
from nsaid_mj.robots import BadRobot, load_tree
from tests.court.walking import drawn_walk

from .walking import GAINS, Walked, model_text, rows_of, walked


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Walked:
    return walked(tmp_path_factory.mktemp("walk"))


@pytest.fixture(scope="module")
def rows(log: Walked) -> GroundRows:
    return rows_of(log)


@pytest.mark.parametrize(("grain", "noise"), [(1e-5, 0.05), (5e-3, 0.002)])
def test_dry_friction_turns_by_the_sensor_with_less_noise(
    rows: GroundRows, grain: float, noise: float
) -> None:
    rng = np.random.default_rng(0)
    t = np.arange(2000) / rows.chosen.rate
    q = 0.3 * np.sin(4 * t)[:, None]
    v = 1.2 * np.cos(4 * t)[:, None]
    log = Log(t, grain * np.round(q / grain), v + noise * rng.standard_normal(v.shape), 0 * v)
    segment = rows.segments[0]._replace(log=log)
    error = turning(segment, rows.chosen, BANDS[-1]) - v
    assert error[50:-50].std() < 0.01


def test_the_free_joint_is_kept_on_request(log: Walked) -> None:
    robot = load_tree(str(log.model), floating=True)
    assert robot.floating and not robot.held
    assert robot.system.n == BASE + len(robot.joints)
    assert not any(finding.code == "base_held" for finding in robot.findings)


def test_the_root_of_a_urdf_floats_beside_the_joints_that_move(tmp_path: Path) -> None:
    file = tmp_path / "hopper.urdf"
    link = '<link name="{}"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" '
    link += 'ixy="0" ixz="0" iyz="0"/></inertial></link>'
    joint = '<joint name="knee" type="revolute"><parent link="trunk"/><child link="foot"/>'
    joint += '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
    links = link.format("trunk") + link.format("foot")
    file.write_text(f'<robot name="hopper">{links}{joint}</robot>')
    robot = floating(load_robot_model(str(file)))
    assert robot.floating and robot.joints == ("knee",)
    assert robot.system.n == BASE + 1


def test_a_fixed_base_cannot_float(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(
        '<mujoco><worldbody><body><joint axis="0 1 0"/><geom size="0.1"/></body></worldbody>'
        "</mujoco>"
    )
    with pytest.raises(BadRobot, match="freejoint"):
        load_tree(str(file), floating=True)


def test_feet_and_imu_come_from_the_model(rows: GroundRows) -> None:
    feet = rows.ground.feet
    assert [foot.name for foot in feet] == ["left_foot", "right_foot", "hind_foot"]
    assert [foot.radius for foot in feet] == [0.02] * 3
    assert not any(foot.flat for foot in feet)
    np.testing.assert_allclose(rows.ground.imu.translation, [0.05, 0, 0.03])


def test_the_first_map_names_imu_and_feet(log: Walked, tmp_path: Path) -> None:
    held = load_robot_model(str(log.model))
    tables = read_tables([log.log])
    path = tmp_path / "map.toml"
    path.write_text(first_map(tables, held), encoding="utf-8")
    own = read_map(path)
    assert own.base is not None and own.base.orientation[0] == "imu_quat_0"
    assert "# feet = " in path.read_text(encoding="utf-8")
    found = inspect(tables, own, held)
    roles = {channel.name: channel.role for channel in found.channels}
    assert roles["imu_gyro_x"] == "angular velocity" and roles["imu_acc_z"] == "specific force"


def test_the_damping_of_a_pd_law_is_part_of_viscous_friction(log: Walked) -> None:
    """Whatever kd is stated, the rows are the same: only the sum of both acts on the motion."""
    held = load_robot_model(str(log.model))
    robot = floating(held)
    header = log.log.read_text().partition("\n")[0].split(",")
    each = {}
    for joint in held.joints:
        own = [{"column": name} for name in header if joint in name]
        each[joint] = dict(zip(("position", "velocity", "command"), own, strict=True))
    problems = []
    for kd in (0.5, 5.0):
        mapping = map_of({"pd": {"kp": 20, "kd": kd}, "joints": each})
        recordings = recordings_of([log.log], mapping, held)
        assert recordings.imu is not None
        ground = Ground(feet_of(robot, recordings.contacts)[0], imu_pose(robot, recordings.imu)[0])
        rows = GroundRows(robot, recordings, filter_of(recordings, 20.0), ground, 4)
        problems.append(rows.problem(np.zeros(len(GAINS))))
    few, much = problems
    np.testing.assert_allclose(few.Y, much.Y, atol=1e-9)
    at = few.space.index("viscous_1")
    assert few.space.labels[at] == "controller's damping and viscous friction of left_tilt"
    assert much.prior[at] - few.prior[at] == pytest.approx(4.5)


def test_friction_may_turn_before_the_velocity(rows: GroundRows) -> None:
    """Early friction acts in phase with acceleration, as a larger rotor does."""
    none = np.zeros(len(GAINS))
    early = rows.problem(none, lead=0.01)
    plain = rows.problem(none)
    at = plain.space.index("coulomb_1")
    rotor = plain.space.index("rotor_1")
    used = plain.usable[:, :BASE].all(axis=1)
    changed = (early.Y - plain.Y)[used]
    others = ["coulomb" not in name for name in plain.space.names]
    assert not changed[:, :, others].any()
    own = plain.Y[used][:, :BASE, rotor].ravel()
    assert np.corrcoef(changed[:, :BASE, at].ravel(), own)[0, 1] > 0.3


def test_trials_of_commands_and_friction_have_the_gramians_of_their_rows(rows: GroundRows) -> None:
    late = np.full(len(rows.gain), 0.003)
    found = rows.sums(late, 2, 0.005, 1)
    problem = rows.problem(late, 2, 0.005, 1)
    expected = Sums.of(problem.Y, problem.usable)
    assert np.array_equal(found.counts, expected.counts)
    assert np.allclose(found.sums, expected.sums, rtol=1e-9, atol=1e-9 * expected.sums.max())
    other = rows.sums(late, 2, 0.005, len(BANDS) - 1).sums
    assert not np.allclose(other, expected.sums, rtol=1e-3, atol=1e-6 * other.max())


def test_what_feet_share_is_a_doubt_along_the_shanks_alone(rows: GroundRows) -> None:
    entries = entries_of(rows)
    information = np.zeros((len(entries), len(entries)))
    feet = [k for k, entry in enumerate(entries) if entry.foot >= 0]
    information[feet, feet] = 1e9
    lower = np.array([-0.005 * (entry.foot >= 0 and entry.axis == 2) for entry in entries])
    beside = np.array([0.005 * (entry.foot >= 0 and entry.axis == 0) for entry in entries])
    one = lower * [entry.foot == 1 for entry in entries]
    for error, expected in ((lower, lower), (beside, 0 * lower), (one, lower / 3)):
        found = _lengths(rows, entries, information, -information @ error)
        assert found == pytest.approx(expected, abs=1e-4)


def test_an_unknown_foot_is_named(rows: GroundRows) -> None:
    with pytest.raises(NsaidError, match="left_fot"):
        feet_of(rows.robot, ContactMap(feet=("left_fot",)))


def test_of_a_foot_that_is_a_site_the_sphere_beside_it_touches(tmp_path: Path) -> None:
    text = model_text()
    for leg in ("left", "right", "hind"):
        ball = f'<geom name="{leg}_foot"'
        site = f'<site name="{leg}_foot" pos="0.03 0 -0.1"/>'
        text = text.replace(ball, f'{site}<geom name="{leg}_ball"')
    (tmp_path / "sites.xml").write_text(text)
    feet = feet_of(floating(load_robot_model(str(tmp_path / "sites.xml"))), ContactMap())[0]
    assert [foot.radius for foot in feet] == [0.02] * 3
    for foot in feet:
        np.testing.assert_allclose(foot.centre, [0, 0, -0.2], atol=1e-9)


def test_the_imu_is_recognised_and_touch_downs_are_no_outliers(rows: GroundRows) -> None:
    recordings = rows.recordings
    assert recordings.imu is not None and recordings.imu.accelerometer is not None
    said = [f for f in recordings.findings if f.code == "imu"]
    assert len(said) == 1 and "wxyz" in said[0].text
    assert not [f for f in recordings.findings if f.code == "outliers" and "dq" in f.where]


def test_the_true_robot_leaves_no_residual_whatever_the_feet_do(rows: GroundRows) -> None:
    """With the true θ, E W θ is far below the motors' part; the contact forces are as large."""
    problem = rows.problem(np.zeros(len(GAINS)))
    theta = problem.prior.copy()
    theta[0] = 6.2
    theta[problem.space.actuators] = GAINS
    used = problem.usable[:, :BASE].all(axis=1)
    left = problem.residual(theta)[used, :BASE].std(axis=0)
    effort = problem.actuation(theta)[used, :BASE].std(axis=0)
    moved = effort > 0.02 * effort.max()
    assert (left[moved] < 0.12 * effort[moved]).all()


def test_the_mean_upward_specific_force_tells_the_accelerometers_bias(rows: GroundRows) -> None:
    up, excess = at_rest(rows)
    assert abs(excess) < 0.02
    biased = rows.like(ground=replace(rows.ground, force=np.array([0.0, 0.0, 0.3])))
    assert at_rest(biased)[1] - excess == pytest.approx(-0.3 * up[2])


def test_gains_in_unknown_units_are_guessed_from_the_weight(rows: GroundRows) -> None:
    gain, spread = expected_gains(rows)
    assert ((gain > 0.3 * GAINS) & (gain < 3 * GAINS)).all()
    assert (spread > 0).all()


def test_wrong_axes_of_the_imu_are_refused(log: Walked) -> None:
    wrong = {
        "orientation": [f"imu_quat_{k}" for k in range(4)],
        "gyro": [f"imu_gyro_{x}" for x in "xyz"],
        "accelerometer": ["imu_acc_z", "imu_acc_y", "imu_acc_x"],
    }
    with pytest.raises(UnusableLog, match="from the vertical"):
        recordings_of([log.log], map_of({"base": wrong}), load_robot_model(str(log.model)))


def test_a_site_on_a_leg_is_no_place_of_the_imu(rows: GroundRows) -> None:
    imu = rows.recordings.imu
    assert imu is not None
    with pytest.raises(BadRobot, match="not on the base"):
        imu_pose(rows.robot, Imu(imu.orientation, imu.gyro, imu.accelerometer, site="left_foot"))


def test_gains_under_unknown_contact_forces(log: Walked) -> None:
    found = identify_forces(str(log.model), [log.log], known={"mass": log.mass})
    gains = np.array([p.value for p in found.gains])
    ratio = gains / GAINS
    assert np.log(ratio).std() < 0.01
    assert abs(ratio.mean() - 1) < 0.02  # its feet never leave the ground: their mass is the file's
    assert all(p.low < g < p.high for p, g in zip(found.gains, GAINS, strict=True))
    assert any(f.code == "stance" for f in found.findings)
    folder = log.log.parent / "exported"
    folder.mkdir()
    files, (replayed,) = write_models(found, folder)
    assert folder / "tripod.xml" in files
    own, nominal = (replayed.data[key] for key in ("exported", "nominal"))
    assert own[0] < 0.2  # type: ignore[index]
    assert nominal[0] > 0.5  # type: ignore[index]
    assert "not simulated: a foot that touches down" in replayed.text


def test_damping_acts_on_what_the_joints_travelled(rows: GroundRows) -> None:
    """Between samples a stiff loop moves otherwise than sampled velocities say."""
    (segment,) = rows.recordings.segments
    log = segment.log._replace(v=segment.log.v + 0.1)
    other = rows.like(replace(rows.recordings, segments=(segment._replace(log=log),)))
    at = [rows.space.index(f"viscous_{k + 1}") for k in range(len(GAINS))]
    rubbed = [rows.space.index(f"coulomb_{k + 1}") for k in range(len(GAINS))]
    none = np.zeros(len(GAINS))
    changed = other.problem(none).Y - rows.problem(none).Y
    assert np.abs(changed[:, :, rubbed]).max() > 0.1
    np.testing.assert_allclose(changed[:, :, at], 0.0, atol=1e-12)


def test_an_accelerometer_beside_the_bases_origin_feels_it_turn_at_steps(rows: GroundRows) -> None:
    """Else the fit moves the IMU by centimetres to explain what a step's turn does there."""
    (motion,) = rows.motions
    answer = np.zeros((len(motion.t), BASE))
    answer[:, 3:] = np.random.default_rng(0).normal(size=(len(motion.t), 3))
    ground = replace(rows.ground, answer=(answer,), at_step=0.4)
    changed = rows.smoothed(0, ground).a - motion.a
    expected = -0.4 * np.cross(answer[:, 3:], (0.05, 0.0, 0.03))
    np.testing.assert_allclose(changed[:, :3], expected, atol=1e-12)
    np.testing.assert_array_equal(changed[:, 3:], 0.0)


def test_servos_of_a_robot_that_walks_make_torques(log: Walked, tmp_path: Path) -> None:
    """Their targets are not simulated, as those of a servo arm are: contact forces are unknown."""
    (tmp_path / "tripod.xml").write_text(model_text(servos=True))
    table = tmp_path / "walk.csv"
    table.write_text(log.log.read_text().replace("current", "target", len(GAINS)))
    robot = load_robot_model(str(tmp_path / "tripod.xml"))
    recordings = recordings_of([table], None, robot)
    assert recordings.feedback is not None
    np.testing.assert_allclose(recordings.feedback, [[150] * 9, [4] * 9])
    assert servos_of(robot, [table]) is None


@pytest.mark.slow
def test_targets_of_held_servos_identify_stiffness_and_damping(tmp_path: Path) -> None:
    """Stiff servos follow each step of a held target between the rows, of which sensors miss part.

    The accelerometer is read right after the steps: about half of each step's answer is too much.
    The feet never leave the ground and hide part of the mass, so ratios are judged.
    """
    log = walked(tmp_path, rate=200, servos=True)
    found = identify(str(log.model), [log.log], known={"mass": log.mass})
    ratio = np.array([p.value for p in found.gains]) / GAINS
    assert np.log(ratio).std() < 0.01
    damping = np.array([p.value for p in found.of("viscous friction")]) / ratio
    np.testing.assert_allclose(damping, 4 * GAINS + 0.1, rtol=0.05)
    (said,) = [f for f in found.findings if f.code == "offset_at_step"]
    assert 0.2 < said.data["value"][0] < 0.8


def test_a_torque_without_feedback_is_not_late_by_the_law_of_other_joints(rows: GroundRows) -> None:
    k = len(rows.robot.joints)
    law = np.zeros((2, k))
    law[:, 0] = 3.0, 0.1
    plain = rows.acting(0, np.zeros(k))
    found = rows.like(ground=replace(rows.ground, law=law)).acting(0, np.zeros(k))
    np.testing.assert_array_equal(found[:, 1:], plain[:, 1:])
    assert np.abs(found[:, 0] - plain[:, 0]).max() > 0


@pytest.mark.slow
def test_torques_sampled_at_steps_of_targets_do_not_pass_for_rotors_and_friction(
    tmp_path: Path,
) -> None:
    """Targets of a policy hold for 20 ms; a row has the torque after the step, as rows often do.

    The loop follows between rows, so sampled torques differ from the mean ones by kp q̇ + kd q̈ times
    half a row, as rotors of twice the size and fourfold friction would.
    """
    walk = drawn_walk(905, tmp_path, robot="go2", rate=200.0, hold=0.02, seconds=30.0)
    mass = float(walk.truth["total_mass"])
    found = identify(str(walk.model), [walk.log], known={"mass": mass})
    assert "implied_law" in {finding.code for finding in found.findings}
    for block, name in (("rotor inertia", "armature"), ("viscous friction", "viscous")):
        parameters = found.of(block)
        pairs = zip(parameters, walk.truth[name], strict=True)
        assert sum(p.low <= true <= p.high for p, true in pairs) >= 11
        excess = np.mean([p.value for p in parameters] / np.array(walk.truth[name])) - 1
        assert abs(excess) < {"armature": 0.3, "viscous": 1.0}[name]


def test_a_told_mass_far_from_the_files_is_said(log: Walked) -> None:
    robot = floating(load_robot_model(str(log.model)))
    mass = sum(float(inertia.mass) for inertia in list(robot.model.inertias)[1:])
    assert off_file(robot, 1.1 * mass) == 0
    assert off_file(robot, 1.5 * mass) == pytest.approx(np.log(1.5) / INTERVAL)
    (said,) = with_dry_mass(robot, 1.5 * mass).findings[len(robot.findings) :]
    assert said.code == "told_mass" and "1.5 times" in said.text
