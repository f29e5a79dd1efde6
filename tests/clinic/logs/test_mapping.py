"""Names of channels and map.toml decide what is what, or a typed error says what is missing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.logs import mapping, matching
from nsaid_mj.clinic.logs.mapping import ColumnMap, map_of, read_map
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from nsaid_mj.clinic.logs.unusable import UnmatchedChannels
from tests.support.robot_logs import motion, two_joints

JOINTS = ("shoulder_pan_joint", "elbow_joint", "wrist_1_joint")


def chosen(channels: list[str], joints: tuple[str, ...] = JOINTS) -> list[list[str | None]]:
    """The columns of position, velocity and command of each joint."""
    found = matching.match(channels, joints)
    return [
        [column and column.column for column in (j.position, j.velocity, j.command)]
        for j in (found.joints[name] for name in joints)
    ]


@pytest.mark.parametrize(
    "patterns",
    [
        ("q{}", "dq{}", "tau{}"),
        ("q_{}", "qd_{}", "i_{}"),
        ("joint_{}_position", "joint_{}_velocity", "joint_{}_effort"),
        ("position_{}", "velocity_{}", "torque_{}"),
        ("pos[{}]", "vel[{}]", "cur[{}]"),
        ("actual_q_{}", "actual_qd_{}", "actual_current_{}"),
        ("state/position{}", "state/v{}", "cmd{}"),
        ("q{}_rad", "q_dot{}", "u{}"),
        ("jointPos{}", "jointVel{}", "jointTorque{}"),
        ("motor_angle_{}_rad", "motor_speed_{}_rpm", "motor_torque_{}_Nm"),
        ("theta{} [deg]", "omega{} (deg/s)", "current{} [mA]"),
        ("present_position_{}", "present_velocity_{}", "present_current_{}"),
    ],
)
@pytest.mark.parametrize("first", [0, 1])
def test_channels_match_by_index(patterns, first):
    rows = [[p.format(k + first) for p in patterns] for k in range(3)]
    channels = [name for column in zip(*rows, strict=True) for name in column]
    assert chosen([*channels, "temperature_1", "mode"]) == rows


@pytest.mark.parametrize(
    "patterns",
    [
        ("joint_states/position/{}", "joint_states/velocity/{}", "joint_states/effort/{}"),
        ("{}_pos", "{}_vel", "{}_tau"),
        ("{}.q", "{}.dq", "{}.current"),
        ("q_{}", "v_{}", "u_{}"),
    ],
)
def test_channels_match_by_joint_name_in_any_order(patterns):
    rows = [[p.format(j) for p in patterns] for j in JOINTS]
    others = [p.format("gripper") for p in patterns]
    channels = [name for row in reversed(rows) for name in row] + others
    assert chosen(channels) == rows


def test_measurements_take_precedence_over_setpoints():
    names = [
        f"{kind}_{what}_{k}"
        for kind in ("target", "actual")
        for what in ("q", "current")
        for k in range(3)
    ]
    assert chosen(names)[1] == ["actual_q_1", None, "actual_current_1"]


def test_switches_and_limits_of_torques_are_no_commands():
    names = [f"{what}_{k}" for what in ("q", "torque_enable", "max_torque") for k in range(3)]
    with pytest.raises(UnmatchedChannels, match="torque or current"):
        matching.match(names, JOINTS)


def test_an_ambiguous_command_is_refused_with_all_channels():
    channels = [f"{what}{k}" for what in ("q", "tau", "current") for k in range(3)]
    with pytest.raises(UnmatchedChannels, match="nsaid inspect LOG --model M") as caught:
        matching.match(channels, JOINTS)
    assert caught.value.channels == tuple(channels)
    assert "tau * or current *" in str(caught.value)


@pytest.mark.parametrize("missing", ["q", "tau"])
def test_a_missing_quantity_is_refused(missing):
    channels = [f"{what}{k}" for what in {"q", "tau"} - {missing} for k in range(3)]
    with pytest.raises(UnmatchedChannels):
        matching.match(channels, JOINTS)


def test_names_of_joints_take_precedence_over_numbers():
    arms = [f"{side}_j{k}" for side in ("left", "right") for k in range(3)]
    channels = [f"{joint}_{what}" for what in ("position", "current") for joint in arms]
    rows = [[f"left_j{k}_position", None, f"left_j{k}_current"] for k in range(3)]
    assert chosen(channels, ("left_j0", "left_j1", "left_j2")) == rows


def test_joints_that_the_log_lacks_are_named_and_those_it_has_offered():
    channels = [f"{joint}_{what}" for what in ("position", "effort") for joint in JOINTS[:2]]
    with pytest.raises(UnmatchedChannels, match="names a position of wrist_1_joint") as caught:
        matching.match(channels, JOINTS)
    assert "`--joints shoulder_pan_joint,elbow_joint`" in str(caught.value)
    channels.append("wrist_1_joint_position")  # it moves, so that locking it is no remedy
    with pytest.raises(UnmatchedChannels, match="names a torque or current of wrist_1") as caught:
        matching.match(channels, JOINTS)
    assert "--joints" not in str(caught.value)


def test_numbers_of_another_count_than_the_joints_are_told():
    channels = [f"{what}{k}" for what in ("q", "tau") for k in range(1, 4)]
    with pytest.raises(UnmatchedChannels, match=r"3 channels \(q1 … q3\).*joints are 2"):
        matching.match(channels, JOINTS[:2])


def test_more_indices_than_joints_are_not_guessed():
    channels = [f"{what}{k}" for what in ("q", "tau") for k in range(8)]
    with pytest.raises(UnmatchedChannels):
        matching.match(channels, JOINTS)


@given(
    st.sampled_from([(q, unit) for q, known in mapping.FACTORS.items() for unit in known]),
    st.floats(-1e3, 1e3),
    st.sampled_from([-1, 1]),
    st.floats(0.01, 200),
)
def test_conversion_is_sign_times_unit_over_or_times_ratio(kind, value, sign, ratio):
    quantity, unit = kind
    counts = 4096.0 if unit.startswith("ticks") else None
    column = ColumnMap(column="x", unit=unit, sign=sign, ratio=ratio, counts_per_turn=counts)
    geared = value * ratio if quantity == "command" else value / ratio
    expected = sign * geared * mapping.FACTORS[quantity][unit] / (counts or 1)
    assert column.factor(quantity) * value == pytest.approx(expected, rel=1e-12, abs=1e-300)


def test_a_turn_in_every_unit_is_two_pi():
    for unit, value in (("rad", 2 * np.pi), ("deg", 360), ("turns", 1), ("ticks", 1000)):
        entry = {"column": "q", "unit": unit, "counts_per_turn": 1000}
        joint = {"position": entry, "command": {"column": "u"}}
        column = map_of({"joints": {"a": joint}}).joints["a"].position
        assert column.factor("position") * value == pytest.approx(2 * np.pi)


@pytest.mark.parametrize(
    "name,bare,unit",
    [
        ("q1_deg", "q1", "deg"),
        ("q1 [deg]", "q1", "deg"),
        ("q1 (°)", "q1", "deg"),
        ("angle/rad", "angle", "rad"),
        ("q1", "q1", ""),
    ],
)
def test_units_at_the_end_of_a_name(name, bare, unit):
    assert mapping.of_name(name, mapping.FACTORS["position"]) == (bare, unit)


@pytest.mark.parametrize("text", ["Nm", "N·m", "N.m", "n*m", "N·m"])
def test_a_unit_has_many_spellings(text):
    assert mapping.canonical(text) == "N·m"


def test_milli_and_mega_are_not_confused():
    assert mapping.canonical("mA") == "mA" and mapping.canonical("A") == "A"


JOINT = {"position": {"column": "q"}, "command": {"column": "u"}}


@pytest.mark.parametrize(
    "content,field",
    [
        ({"joint": {}}, "joint"),
        ({"joints": {"a": {"command": {"column": "u"}}}}, "joints.a.position"),
        ({"joints": {"a": JOINT | {"position": {"column": "q", "unit": "degr"}}}}, "unit"),
        ({"joints": {"a": JOINT | {"position": {"column": "q", "ratio": 0}}}}, "ratio"),
        ({"joints": {"a": JOINT | {"position": {"column": "q", "sign": 2}}}}, "sign"),
        ({"joints": {"a": JOINT | {"rest": -1}}}, "rest"),
        ({"time": {"unit": "h"}}, "time.unit"),
    ],
)
def test_a_wrong_field_of_a_map_is_named(content, field):
    with pytest.raises(InvalidInput, match=r"log\.toml") as caught:
        map_of(content, "log.toml")
    assert field in str(caught.value)


def test_whole_numbers_need_no_decimal_point(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text(
        '[joints.a]\nposition = { column = "q", ratio = 100, sign = -1 }\n'
        'command = { column = "u", unit = "mA" }\n[coupling]\nposition = [[1]]\n',
        encoding="utf-8",
    )
    found = read_map(path)
    joint = found.joints["a"]
    assert joint.position.factor("position") == -0.01
    assert joint.command is not None and joint.command.factor("command") == 1e-3


def test_a_unit_of_another_quantity_is_refused():
    with pytest.raises(InvalidInput, match="one of rad, deg"):
        ColumnMap(column="q", unit="A").factor("position")


def test_ticks_need_counts_per_turn():
    with pytest.raises(InvalidInput, match="counts_per_turn"):
        ColumnMap(column="q", unit="ticks").factor("position")


@pytest.mark.parametrize("text", [None, "a = ", "\x00"])
def test_an_unreadable_map_is_refused(tmp_path, text):
    path = tmp_path / "map.toml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInput, match="nsaid inspect"):
        read_map(path)


@pytest.mark.parametrize(
    "text",
    [
        f'[joints.a]\nposition = {{column = "x", ratio = {"9" * 400}}}\ncommand = {{column = "y"}}',
        f"[files.x]\noffset = {'9' * 5000}",
        f"hold = {'[' * 5000}{']' * 5000}",
        f"{'a.' * 3000}b = 1",
        "[files.x]\noffset = 1e400",
    ],
    ids=["400 digits", "5000 digits", "lists", "tables", "infinity"],
)
def test_numbers_and_nesting_beyond_measure_are_refused(tmp_path, text):
    (tmp_path / "map.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInput):
        read_map(tmp_path / "map.toml")


def test_a_robots_only_joint_needs_no_name_in_its_columns():
    found = matching.match(["time", "position", "velocity", "torque", "temperature"], ["hinge"])
    joint = found.joints["hinge"]
    assert joint.velocity is not None and joint.command is not None
    columns = joint.position.column, joint.velocity.column, joint.command.column
    assert columns == ("position", "velocity", "torque")
    with pytest.raises(UnmatchedChannels):
        matching.match(["position", "velocity", "torque"], ["hinge", "knee"])


def _of_each_joint(names):
    t = np.arange(1000) / 100
    q, _, u = motion(t)
    parts = zip(names, q.T, u.T, strict=True)
    return [
        LogTable(f"{name}.csv", {"position": Channel(t, x), "torque": Channel(t, y)}, 0)
        for name, x, y in parts
    ]


@pytest.mark.parametrize("names", [("shoulder", "elbow"), ("motor_1", "motor_2")])
def test_files_called_after_joints_are_parts_of_one_log(names):
    found = prepare(_of_each_joint(names), None, two_joints())
    (segment,) = found.segments
    np.testing.assert_allclose(segment.log.q, motion(segment.log.t)[0], atol=1e-9)


def test_files_of_two_runs_are_no_parts_of_one_log():
    with pytest.raises(UnmatchedChannels):
        prepare(_of_each_joint(("run_1", "run_2")), None, two_joints())


def test_a_map_may_name_the_file_of_a_column():
    joints = {
        joint: {"position": {"column": f"{file}/position"}, "command": {"column": f"{file}/torque"}}
        for joint, file in (("shoulder", "b"), ("elbow", "a"))
    }
    found = prepare(_of_each_joint(("a", "b")), map_of({"joints": joints}), two_joints())
    (segment,) = found.segments
    np.testing.assert_allclose(segment.log.q[:, ::-1], motion(segment.log.t)[0], atol=1e-9)
