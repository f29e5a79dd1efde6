"""Identification of robots that stand and walk, from logs of joints and IMU."""

from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base import NsaidError
from nsaid_mj.clinic.identify.ground.feet import feet_of, imu_pose
from nsaid_mj.clinic.identify.ground.rows import BASE, Ground, GroundRows
from nsaid_mj.clinic.identify.ground.search import expected_gains, filter_of
from nsaid_mj.clinic.identify.identify import identify_forces, recordings_of
from nsaid_mj.clinic.identify.models import floating, load_robot_model
from nsaid_mj.clinic.logs.mapping import ContactMap, Imu, map_of
from nsaid_mj.clinic.logs.unusable import UnusableLog
from nsaid_mj.robots import BadRobot, load_tree

from .walking import GAINS, Walked, walked


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Walked:
    return walked(tmp_path_factory.mktemp("walk"))


@pytest.fixture(scope="module")
def rows(log: Walked) -> GroundRows:
    held = load_robot_model(str(log.model))
    recordings = recordings_of([log.log], None, held)
    robot = floating(held)
    feet, _ = feet_of(robot, recordings.contacts)
    assert recordings.imu is not None
    pose, _ = imu_pose(robot, recordings.imu)
    return GroundRows(robot, recordings, filter_of(recordings, 20.0), Ground(feet, pose), 4)


def test_the_free_joint_is_kept_on_request(log: Walked) -> None:
    robot = load_tree(str(log.model), floating=True)
    assert robot.floating and not robot.held
    assert robot.system.n == BASE + len(robot.joints)
    assert not any(finding.code == "base_held" for finding in robot.findings)


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


def test_an_unknown_foot_is_named(rows: GroundRows) -> None:
    with pytest.raises(NsaidError, match="left_fot"):
        feet_of(rows.robot, ContactMap(feet=("left_fot",)))


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
    assert (left[moved] < 0.2 * effort[moved]).all()


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


@pytest.mark.slow
def test_gains_under_unknown_contact_forces(log: Walked) -> None:
    found = identify_forces(str(log.model), [log.log], known={"mass": log.mass})
    gains = np.array([p.value for p in found.gains])
    ratio = gains / GAINS
    assert np.log(ratio).std() < 0.01
    assert abs(ratio.mean() - 1) < 0.03  # its feet never leave the ground: their mass is the file's
    assert all(p.low < g < p.high for p, g in zip(found.gains, GAINS, strict=True))
    assert any(f.code == "stance" for f in found.findings)
