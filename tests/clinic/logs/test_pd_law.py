"""Targets of motors with a PD law of known gains become the motors' torques."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.clinic.identify.inspection import inspect
from nsaid_mj.clinic.logs.mapping import ColumnMap, Joint, Map, Pd, map_of
from nsaid_mj.clinic.logs.matching import match, named
from nsaid_mj.clinic.logs.pd_law import feedback_in, held_mean, known_gains
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.recordings import LogSegment, Recordings
from nsaid_mj.clinic.logs.signals import Signal
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from nsaid_mj.clinic.logs.unusable import UnmatchedChannels
from nsaid_mj.core import Log
from tests.support.robot_logs import motion, two_joints

KP, KD, RATE = np.array([20.0, 30.0]), np.array([0.5, 1.5]), 100.0
NAMED = two_joints(("FL_hip_joint", "FL_knee_joint"))


def _log(**groups):
    t = np.arange(1000) / RATE
    return LogTable(
        "log.csv",
        {
            f"{name}_{k + 1}": Channel(t, x)
            for name, own in groups.items()
            for k, x in enumerate(own.T)
        },
        0,
    )


def _targets():
    q, v, u = motion(np.arange(1000) / RATE)
    return q, v, u, q + (u + KD * v) / KP


@pytest.mark.parametrize("kp", [(20.0, 30.0), {"shoulder": 20.0, "elbow": 30.0}])
def test_torques_follow_from_targets(kp):
    q, v, _, target = _targets()
    law = Map(pd=Pd(kp=kp, kd=(0.5, 1.5)))
    found = prepare([_log(q=q, dq=v, q_des=target)], law, two_joints())
    log = found.segments[0].log
    early = np.searchsorted(np.arange(1000) / RATE, log.t[0])
    held = np.vstack([target[:1], 0.5 * (target[1:] + target[:-1])])  # half a row later
    expected = (KP * (held - q) - KD * v)[early:][: len(log.t)]
    np.testing.assert_allclose(log.u[1:-1], expected[1:-1], atol=1e-9)
    assert found.command_units == ("N·m", "N·m")
    np.testing.assert_allclose(found.feedback, [KP, KD])


def test_target_velocities_and_forward_torques_are_found():
    q, v, u = _targets()[:3]
    law = Map(pd=Pd(kp=20.0, kd=1.0))
    found = prepare([_log(q=q, dq=v, q_des=q, dq_des=v, tau_ff=u)], law, two_joints())
    log = found.segments[0].log
    inner = slice(5, -5)
    half = [np.vstack([x[:1], 0.5 * (x[1:] + x[:-1])]) for x in (q, v, u)]  # held from row to row
    torque = 20.0 * (half[0] - q) + 1.0 * (half[1] - v) + half[2]
    first = round(log.t[0] * RATE)
    np.testing.assert_allclose(log.u[inner], torque[first:][: len(log.t)][inner], atol=1e-9)


def test_rows_at_the_limit_are_not_used():
    q, v, _, target = _targets()
    limit = 8.0
    robot = two_joints(limit=limit)
    found = prepare([_log(q=q, dq=v, q_des=target)], Map(pd=Pd(kp=20.0, kd=0.5)), robot)
    one = found.segments[0]
    assert not one.usable[np.abs(one.log.u) >= limit].any() and one.usable.any()


def test_gains_come_from_the_file_where_the_map_has_none():
    servos = _servos(two_joints())
    kp, kd = known_gains(Pd(), servos)
    assert kp.tolist() == [7.0, 8.0] and kd.tolist() == [0.1, 0.2]
    assert known_gains(Pd(kp=5.0), servos)[1].tolist() == [0.0, 0.0]


def _servos(robot):
    from nsaid_mj.robots.model import Servos

    gains = np.array([7.0, 8.0]), np.array([0.1, 0.2])
    return replace(robot, servos=Servos(*gains, np.zeros((2, 2)), np.zeros(2), np.zeros((2, 3))))


@pytest.mark.parametrize(
    ("given", "error"),
    [
        (Pd(), InvalidInput),
        (Pd(kp=(1.0, 2.0, 3.0)), InvalidInput),
        (Pd(kp={"shoulder": 1.0}), InvalidInput),
        (Pd(kp={"shoulder": 1.0, "wrist": 2.0}), UnknownName),
    ],
)
def test_wrong_gains_are_refused(given, error):
    with pytest.raises(error):
        known_gains(given, two_joints())


def test_a_motor_with_targets_is_told_what_to_add():
    q, v, _, target = _targets()
    table = _log(q=q, dq=v, q_des=target)
    found = inspect([table], None, two_joints())
    said = " ".join(str(finding) for finding in found.findings)
    assert "`[pd]`: `kp = 20`, `kd = 1.5`" in said
    with pytest.raises(UnmatchedChannels, match="position targets"):
        match(list(table.channels), ("shoulder", "elbow"))
    joint = Joint(ColumnMap(column="q_1"), ColumnMap(column="q_des_1", unit="rad"))
    with pytest.raises(InvalidInput, match="PD law of known gains"):
        prepare([table], Map(joints={"shoulder": joint, "elbow": joint}), two_joints())


def test_a_torque_log_needs_no_law():
    q, v, u, target = _targets()
    found = match([*_log(q=q, dq=v, tau=u, q_des=target).channels], ("shoulder", "elbow"))
    assert found.joints["elbow"].command == ColumnMap(column="tau_2")


def test_held_values_count_from_their_row_on():
    t = np.arange(5.0)
    signal = Signal(t, np.array([0.0, 1.0, 1.0, 3.0, 3.0]), np.arange(5), np.zeros((0, 2)))
    np.testing.assert_allclose(held_mean(signal, t), [0.0, 0.5, 1.0, 2.0, 3.0])


@pytest.mark.parametrize("motors", [(), ("FL_hip", "FL_knee")])
def test_joints_answer_to_their_motors_names(motors):
    names = [f"{quantity}_FL_{part}" for quantity in ("q", "tau") for part in ("hip", "knee")]
    robot = replace(NAMED, motors=motors)
    found = match(names, named(robot)).joints
    assert found["FL_hip_joint"].position.column == "q_FL_hip"
    assert found["FL_knee_joint"].command == ColumnMap(column="tau_FL_knee")


def test_a_motors_own_name_counts_though_the_joints_is_another():
    robot = replace(two_joints(("abduction", "swing")), motors=("FL_hip", "FL_thigh"))
    found = match(["q_FL_hip", "q_FL_thigh", "tau_FL_hip", "tau_FL_thigh"], named(robot)).joints
    assert found["swing"].command == ColumnMap(column="tau_FL_thigh")


def test_a_name_of_two_joints_or_of_a_quantity_counts_for_none():
    robot = replace(two_joints(), motors=("motor", "motor"))
    assert all(("motor",) not in joint.others for joint in named(robot))
    robot = replace(two_joints(("joint1", "joint2")), motors=("torque", "2"))
    assert [joint.others for joint in named(robot)] == [(), ()]


def test_numbers_of_the_law_in_a_map():
    assert map_of({"pd": {"kp": 20, "kd": [1.5, 2]}}).pd == Pd(kp=20, kd=(1.5, 2))


def _torques(u_of):
    """Recordings of two joints at 200 Hz with noise, and the torques `u_of` t, q and v."""
    rng = np.random.default_rng(4)
    t = np.arange(4000) / 200
    q = 0.3 * np.sin(np.outer(t, [9.0, 7.0])) + 0.02 * np.sin(np.outer(t, [60.0, 80.0]))
    v = np.gradient(q, t, axis=0)
    u = u_of(t, q, v)
    q = q + 1e-4 * rng.standard_normal(q.shape)
    log = Log(t, q, v + 0.02 * rng.standard_normal(v.shape), u)
    segment = LogSegment(log, np.ones(u.shape, bool), "log.csv", (0, len(t) - 1))
    return Recordings((segment,), 200.0, ("N·m", "N·m"))


def test_steps_of_targets_tell_the_pd_law_of_measured_torques():
    def held(t, q, v):
        row = np.arange(len(t)) // 10 * 10
        return KP * (q[row] + 0.05 * np.cos(np.outer(t[row], [20.0, 15.0])) - q) - KD * v

    np.testing.assert_allclose(feedback_in(_torques(held)), [KP, KD], rtol=0.15)


def test_torques_of_a_heavy_joint_are_no_pd_law():
    def heavy(t, q, v):
        return 0.1 * np.gradient(v, t, axis=0) + 0.3 * np.tanh(v / 0.05) + np.sin(q)

    assert feedback_in(_torques(heavy)) is None
