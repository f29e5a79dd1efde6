"""Walking logs without an accelerometer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nsaid_mj.clinic.identify.ground.feet import feet_of, imu_pose
from nsaid_mj.clinic.identify.ground.odometry import with_odometry
from nsaid_mj.clinic.identify.ground.rows import Ground, GroundRows
from nsaid_mj.clinic.identify.ground.search import filter_of
from nsaid_mj.clinic.identify.ground.stance import stance
from nsaid_mj.clinic.identify.identify import identify_forces, recordings_of
from nsaid_mj.clinic.identify.models import floating, load_robot_model
from nsaid_mj.core import zero_phase

from .walking import GAINS, Walked, walked


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Walked:
    return walked(tmp_path_factory.mktemp("walk"))


def without_accelerometer(log: Walked) -> Path:
    """The log without the columns of specific force."""
    names = log.log.read_text().partition("\n")[0].split(",")
    kept = [k for k, name in enumerate(names) if "acc" not in name]
    rows = np.loadtxt(log.log, delimiter=",", skiprows=1)[:, kept]
    path = log.log.with_name("without.csv")
    header = ",".join(names[k] for k in kept)
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path


def test_standing_feet_tell_the_acceleration_of_the_base(log: Walked) -> None:
    held = load_robot_model(str(log.model))
    robot = floating(held)
    measured = recordings_of([log.log], None, held)
    recordings = recordings_of([without_accelerometer(log)], None, held)
    assert recordings.imu is not None and recordings.imu.accelerometer is None
    feet, _ = feet_of(robot, recordings.contacts)
    pose, _ = imu_pose(robot, recordings.imu)
    rows = GroundRows(robot, recordings, filter_of(recordings, 4.0), Ground(feet, pose), 4)
    theta = rows.problem(np.zeros(9)).prior
    found = with_odometry(rows, stance(rows, theta, np.zeros(9), log.mass))
    own = found.segments[0].imu
    true = measured.segments[0].imu
    assert own is not None and true is not None
    up = 9.81 * Rotation.from_quat(true[:, :4]).as_matrix()[:, 2]
    slow = [zero_phase(x, 3.0, recordings.rate)[250:-250] for x in (own[:, 7:], true[:, 7:], up)]
    error = np.sqrt(np.mean((slow[0] - slow[1]) ** 2))
    at_rest = np.sqrt(np.mean((slow[2] - slow[1]) ** 2))
    assert error < 0.4 * at_rest
    assert replace(found, segments=recordings.segments) == recordings


@pytest.mark.slow
def test_gains_without_an_accelerometer(log: Walked) -> None:
    found = identify_forces(str(log.model), [without_accelerometer(log)], known={"mass": log.mass})
    gains = np.array([gain.value for gain in found.gains])
    np.testing.assert_allclose(gains, GAINS, rtol=0.1)
    assert all(g.low <= true <= g.high for g, true in zip(found.gains, GAINS, strict=True))
    assert "no_accelerometer" in {finding.code for finding in found.findings}
