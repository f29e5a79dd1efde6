"""The packed log of a real arm: motor side in the file, joint side in the recordings."""

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.clinic.logs.mapping import read_map
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.recordings import Recordings
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.robots.assets import asset
from nsaid_mj.robots.model import RobotModel


def robot() -> RobotModel:
    model = pin.buildModelFromUrdf(str(asset("tx40", "tx40.urdf")))
    zero = np.zeros(6)
    limits = np.array(model.effortLimit)
    parts = (zero, zero, zero, np.ones(6), limits)
    return RobotModel("tx40", None, "urdf", model, tuple(model.names)[1:], *parts)


@pytest.fixture(scope="module")
def recordings() -> Recordings:
    mapping = read_map(asset("tx40", "map.toml"))
    return prepare(read_tables([asset("tx40", "log.csv.gz")], mapping), mapping, robot())


def test_the_arm_is_one_segment_at_1_khz_without_its_rest(recordings):
    (segment,) = recordings.segments
    assert recordings.rate == 1000
    assert segment.log.t[0] == pytest.approx(0.07, abs=0.02)
    assert segment.log.t[-1] == pytest.approx(7.45, abs=0.05)
    assert segment.rows[0] == round(segment.log.t[0] * 5000) + 1
    assert np.all(np.mean(segment.usable, axis=0) > 0.9)


def test_positions_are_joint_angles_within_the_urdf(recordings):
    log, model = recordings.segments[0].log, robot().model
    assert np.all(log.q > model.lowerPositionLimit - 0.01)
    assert np.all(log.q < model.upperPositionLimit + 0.01)
    assert np.all(np.abs(log.v) < 1.02 * model.velocityLimit)


def test_coupling_is_that_of_the_readme(recordings):
    table = read_tables([asset("tx40", "log.csv.gz")])[0]
    segment = recordings.segments[0]
    rows = np.round(segment.log.t * 5000).astype(int)
    motor = [table.channels[f"motor_angle_{k}_rad"].values[rows] for k in range(1, 7)]
    torque = [table.channels[f"motor_torque_{k}_Nm"].values for k in range(1, 7)]
    q = segment.log.q
    np.testing.assert_allclose(q[:, 1], motor[1] / 32 - np.pi / 2, atol=2e-4)
    np.testing.assert_allclose(q[:, 3], -motor[3] / 48, atol=3e-4)
    np.testing.assert_allclose(q[:, 5], (motor[5] - 32 * motor[4] / 45) / 32, atol=3e-4)
    tau = 45 * torque[4] + 32 * torque[5]
    smooth = np.convolve(tau, np.ones(25) / 25, mode="same")[rows]
    own = np.convolve(segment.log.u[:, 4], np.ones(5) / 5, mode="same")
    assert np.sqrt(np.mean((smooth - own) ** 2)) < 0.02 * np.std(tau)
    assert recordings.command_units == ("N·m",) * 6


def test_velocities_are_derivatives_without_phase(recordings):
    log = recordings.segments[0].log
    moved = np.cumsum(log.v, axis=0)[1000:-1000] / 1000
    there = log.q[1000:-1000]
    shift = np.mean(there - moved, axis=0)
    assert np.max(np.abs(there - moved - shift)) < 0.01


def test_what_was_done_is_said(recordings):
    codes = [finding.code for finding in recordings.findings]
    assert {"decimated", "differentiated", "rest", "rest_limits"} <= set(codes)
    assert not {"outliers", "gap", "duplicates"} & set(codes)
    assert all(finding.level == "note" for finding in recordings.findings)
