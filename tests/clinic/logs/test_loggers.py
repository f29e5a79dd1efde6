"""Files as common loggers write them are read and matched without a map."""

from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import read_tables
from tests.support.robot_logs import motion, two_joints

T = np.arange(1000) / 100
Q, V, U = motion(T)


def rostopic(k: int) -> str:
    """`rostopic echo -p /joint_states`."""
    stamp = 1_700_000_000_000_000_000 + round(T[k] * 1e9)
    numbers = ",".join(f"{x:.9g}" for x in (*Q[k], *V[k], *U[k]))
    return f"{stamp},{k},{stamp},base,shoulder,elbow,{numbers}"


def rtde(k: int) -> str:
    """Universal Robots' RTDE recorder: blanks, targets beside measurements."""
    wanted = [x + 0.01 for x in (*Q[k], *U[k])]
    measured = [*Q[k], *V[k], *U[k]]
    return " ".join(f"{x:.9g}" for x in (T[k] + 8000, *wanted, *measured, 34.5, 7))


def plotjuggler(k: int) -> str:
    """PlotJuggler's export: commands in rows of their own, blanks elsewhere."""
    positions = ",".join(f"{x:.9g}" for x in (*Q[k], *V[k]))
    commands = ",".join(f"{x:.9g}" for x in motion(T[k : k + 1] + 0.004)[2][0])
    return f"{T[k] + 1.7e9:.4f},{positions},,\n{T[k] + 1.7e9 + 0.004:.4f},,,,,{commands}"


def dated(k: int) -> str:
    """A spreadsheet's export: dates with a zone, semicolons, decimal commas."""
    stamp = np.datetime64("2026-03-01T10:00:00.000") + np.timedelta64(round(T[k] * 1000), "ms")
    numbers = ";".join(f"{x:.9g}" for x in (*Q[k], *V[k], *U[k])).replace(".", ",")
    return f"{stamp}Z;{numbers}"


def united(k: int) -> str:
    """A row of units below the names."""
    numbers = ", ".join(f"{x:.9g}" for x in (T[k], *Q[k], *V[k], *U[k]))
    return f"s, rad, rad, rad/s, rad/s, Nm, Nm\n{numbers}" if k == 0 else numbers


HEADS = {
    rostopic: "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.name0,"
    "field.name1,field.position0,field.position1,field.velocity0,field.velocity1,field.effort0,"
    "field.effort1",
    rtde: "timestamp target_q_0 target_q_1 target_current_0 target_current_1 actual_q_0 actual_q_1 "
    "actual_qd_0 actual_qd_1 actual_current_0 actual_current_1 joint_temperatures_0 robot_mode",
    plotjuggler: "__time,/joint_states/shoulder/position,/joint_states/elbow/position,"
    "/joint_states/shoulder/velocity,/joint_states/elbow/velocity,/motors/shoulder/current,"
    "/motors/elbow/current",
    dated: "Date;q1;q2;dq1;dq2;tau1;tau2",
    united: "time, pos_1, pos_2, vel_1, vel_2, torque_1, torque_2",
}


@pytest.mark.parametrize("row", HEADS, ids=lambda row: row.__name__)
def test_a_loggers_file_needs_no_map(tmp_path: Path, row):
    path = tmp_path / "log.csv"
    lines = [HEADS[row], *(row(k) for k in range(len(T)))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    recordings = prepare(read_tables([path]), None, two_joints())
    (segment,) = recordings.segments
    log = segment.log
    shift = np.argmin([np.abs(motion(log.t[:1] + s)[0][0] - log.q[0]).sum() for s in T]) / 100
    for part, wanted in zip(log[1:], motion(log.t + shift), strict=True):
        assert np.quantile(np.abs(part - wanted), 0.9) < 0.03
    assert all(finding.level == "note" for finding in recordings.findings)
