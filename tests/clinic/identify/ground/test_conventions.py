"""Walking logs whose columns mean something else than their names say."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.clinic.identify.ground.conventions import convention_findings, limbs_of, orders
from nsaid_mj.clinic.identify.identify import recordings_of
from nsaid_mj.clinic.identify.models import floating, load_robot_model
from nsaid_mj.clinic.logs.first_map import first_map
from nsaid_mj.clinic.logs.mapping import map_of
from nsaid_mj.clinic.logs.matching import match
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.recordings import Recordings
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.core import Log
from nsaid_mj.robots import RobotModel

from .walking import walked


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> tuple[RobotModel, Recordings]:
    log = walked(tmp_path_factory.mktemp("walk"))
    held = load_robot_model(str(log.model))
    return floating(held), recordings_of([log.log], None, held)


def _changed(recordings: Recordings, joints: list[int], commands: list[int], sign: float = 1.0):
    """Columns of the joints and of the commands in other orders, commands times `sign`."""
    segments = []
    for segment in recordings.segments:
        log = segment.log
        u = sign * log.u[:, commands]
        segments.append(segment._replace(log=Log(log.t, log.q[:, joints], log.v[:, joints], u)))
    return replace(recordings, segments=tuple(segments))


OWN = list(range(9))
DEPTH = [0, 3, 6, 1, 4, 7, 2, 5, 8]  # hips first
SWAPPED = [3, 4, 5, 0, 1, 2, 6, 7, 8]


def test_a_log_that_means_what_it_says_is_not_contradicted(
    known: tuple[RobotModel, Recordings],
) -> None:
    assert convention_findings(*known) == []


@pytest.mark.parametrize(
    ("joints", "commands", "sign", "code", "key"),
    [
        (SWAPPED, SWAPPED, 1.0, "joint_order", "order.joints"),
        (DEPTH, DEPTH, 1.0, "joint_order", "order.joints"),
        (OWN, SWAPPED, 1.0, "swapped", "order.command"),
        (OWN, OWN, -1.0, "reversed_sign", "factors.command"),
    ],
    ids=["legs", "by depth", "commands", "signs"],
)
def test_the_balance_tells_order_and_signs(
    known: tuple[RobotModel, Recordings],
    joints: list[int],
    commands: list[int],
    sign: float,
    code: str,
    key: str,
) -> None:
    robot, recordings = known
    (finding,) = convention_findings(robot, _changed(recordings, joints, commands, sign))
    assert (finding.level, finding.code) == ("refusal", code)
    changes = finding.data["map"]
    assert isinstance(changes, dict)
    if code == "joint_order":  # of the columns as they are
        assert changes[key] == [robot.joints[k] for k in joints]
    elif code == "swapped":
        expected = {robot.joints[j]: robot.joints[int(np.argsort(commands)[j])] for j in range(6)}
        assert changes[key] == expected
    else:
        assert changes[key] == -1


def test_an_imu_that_is_turned_is_seen(known: tuple[RobotModel, Recordings]) -> None:
    robot, recordings = known
    turn = np.diag([-1.0, -1.0, 1.0])  # half a turn about the vertical
    segments = []
    for segment in recordings.segments:
        assert segment.imu is not None
        imu = segment.imu.copy()
        x, y, z, w = segment.imu[:, :4].T
        imu[:, :4] = np.column_stack([y, -x, w, -z])  # q · (0, 0, 1, 0)
        imu[:, 4:7] = imu[:, 4:7] @ turn
        imu[:, 7:] = imu[:, 7:] @ turn
        segments.append(segment._replace(imu=imu))
    (finding,) = convention_findings(robot, replace(recordings, segments=tuple(segments)))
    changes = finding.data["map"]
    assert finding.code == "imu_mount" and isinstance(changes, dict)
    assert np.abs(changes["base.turn"]).tolist() == [0.0, 0.0, 180.0]


def test_limbs_and_their_orders(known: tuple[RobotModel, Recordings]) -> None:
    robot, _ = known
    assert limbs_of(robot) == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    tried = [order for order, _ in orders(robot)]
    assert len(tried) == 12 and np.argsort(DEPTH).tolist() in tried


def test_joints_may_be_listed_in_the_order_of_the_columns(tmp_path: Path) -> None:
    log = walked(tmp_path, seconds=2.0)
    held = load_robot_model(str(log.model))
    joints = [held.joints[k] for k in SWAPPED]
    tables = read_tables([log.log])
    own = prepare(tables, None, held)
    found = prepare(tables, map_of({"order": {"joints": joints}}), held)
    back = np.argsort(SWAPPED)
    np.testing.assert_array_equal(found.segments[0].log.q, own.segments[0].log.q[:, back])


UNITREE = [
    f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf")
]


def test_motors_of_unitrees_messages_are_found_by_their_numbers() -> None:
    """A message has room for twenty motors, and numbers the legs FR, FL, RR, RL."""
    fields = ("q", "dq", "tau_est", "temperature")
    channels = [f"motor_state[{k}].{x}" for k in range(20) for x in fields]
    found = match(channels, UNITREE).joints
    assert found["FL_hip_joint"].position.column == "motor_state[3].q"
    calf = found["RR_calf_joint"]
    assert calf.command is not None and calf.command.column == "motor_state[8].tau_est"
    other = match(channels, [f"joint_{k}" for k in "abcdef"]).joints
    assert other["joint_f"].position.column == "motor_state[5].q"


def test_the_first_map_takes_gains_from_columns_that_never_change(tmp_path: Path) -> None:
    """Unitree's LowCmd: targets, gains and a feed-forward torque of every motor."""
    log = walked(tmp_path, seconds=1.0)
    held = load_robot_model(str(log.model))
    t = np.arange(200) / 200
    table = {"t": t}
    for k in range(len(held.joints)):
        table |= {f"motor_state[{k}].q": np.sin(t + k), f"motor_state[{k}].dq": np.cos(t + k)}
        wanted = {
            "q": np.sin(t),
            "dq": 0 * t,
            "kp": 0 * t + 25 + k,
            "kd": 0 * t + 0.5,
            "tau": 0 * t,
        }
        table |= {f"motor_cmd[{k}].{field}": x for field, x in wanted.items()}
    path = tmp_path / "cmd.csv"
    rows = np.column_stack(list(table.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(table), comments="")
    text = first_map(read_tables([path]), held)
    own = map_of(tomllib.loads(text)).pd
    assert own is not None and own.kd == 0.5
    assert own.kp == {joint: 25.0 + k for k, joint in enumerate(held.joints)}
    joint = map_of(tomllib.loads(text)).joints[held.joints[0]]
    assert joint.command is not None and joint.command.column == "motor_cmd[0].q"
    assert joint.feedforward is not None and joint.feedforward.column == "motor_cmd[0].tau"
