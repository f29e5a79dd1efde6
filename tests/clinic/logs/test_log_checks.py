"""Every fault that data alone can show is named, and a clean log raises no alarm."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.clinic.logs.checks import checked, checks
from nsaid_mj.clinic.logs.mapping import ColumnMap, Joint, Map, read_map
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.recordings import Recordings
from nsaid_mj.clinic.logs.tables import Channel, LogTable, read_tables
from nsaid_mj.clinic.logs.unusable import UnusableLog
from nsaid_mj.robots.assets import asset
from tests.clinic.logs.test_tx40_log import robot as tx40
from tests.support.robot_logs import JOINTS, columns, two_joints


def recorded(values: dict[str, np.ndarray], mapping: Map | None = None) -> Recordings:
    channels = {n: Channel(values["t"], column) for n, column in values.items() if n != "t"}
    return prepare([LogTable("log.csv", channels, 0)], mapping, two_joints())


def in_units(unit: str) -> Map:
    return Map(
        joints={
            name: Joint(
                position=ColumnMap(column=f"q{k}"),
                velocity=ColumnMap(column=f"dq{k}"),
                command=ColumnMap(column=f"tau{k}", unit=unit),  # pyright: ignore[reportArgumentType]
            )
            for k, name in enumerate(JOINTS, 1)
        }
    )


def found(values: dict[str, np.ndarray], mapping: Map | None = None) -> list[tuple[str, str, str]]:
    result = checks(recorded(values, mapping), two_joints())
    return [(f.level, f.code, f.where) for f in result]


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_clean_log_raises_no_alarm(noise):
    values = columns()
    rng = np.random.default_rng(0)
    values |= {f"dq{k}": values[f"dq{k}"] + noise * rng.standard_normal(2000) for k in (1, 2)}
    assert found(values) == []
    assert found(values, in_units("A")) == []


def test_commands_without_signs_are_refused_for_that_alone():
    values = columns()
    sizes = {f"tau{k}": np.round(np.abs(values[f"tau{k}"])) for k in (1, 2)}
    with pytest.raises(UnusableLog) as error:
        recorded(values | {name: -size for name, size in sizes.items()})
    assert [f.code for f in error.value.findings if f.level == "refusal"] == ["unsigned"]
    one = {"tau1": np.abs(values["tau1"])}  # a joint that weight pulls to one side
    recorded(values | one)


def test_a_real_log_raises_no_alarm():
    mapping = read_map(asset("tx40", "map.toml"))
    recordings = prepare(read_tables([asset("tx40", "log.csv.gz")], mapping), mapping, tx40())
    assert checks(recordings, tx40()) == ()


def test_motor_angles_without_a_map_are_refused():
    recordings = prepare(read_tables([asset("tx40", "log.csv.gz")]), None, tx40())
    with pytest.raises(UnusableLog, match="ratio"):
        checked(recordings, tx40())


@pytest.mark.parametrize("value", [0.0, 1.5])
def test_a_dead_command_is_refused(value):
    assert found(columns() | {"tau2": np.full(2000, value)}) == [
        ("refusal", "dead_channel", "elbow")
    ]


def test_a_dead_position_is_refused():
    values = columns() | {"q2": np.full(2000, 0.3), "dq2": np.zeros(2000)}
    assert ("refusal", "dead_channel", "elbow") in found(values)


def test_a_joint_that_only_trembles_is_a_warning():
    rng = np.random.default_rng(0)
    values = columns()
    values |= {"q2": 1e-4 * rng.standard_normal(2000), "dq2": 1e-2 * rng.standard_normal(2000)}
    assert found(values) == [("warning", "at_rest", "elbow")]


def test_degrees_against_rad_per_second():
    values = columns()
    values["q1"] = np.degrees(values["q1"])
    assert found(values) == [("refusal", "degrees", "shoulder")]
    values = columns()
    values["dq1"] = np.degrees(values["dq1"])
    assert found(values) == [("refusal", "degrees", "shoulder")]


@pytest.mark.parametrize("measured", [True, False])
def test_degrees_of_both_are_seen_by_the_limits(measured):
    values = columns()
    values |= {n: np.degrees(values[n]) for n in ("q1", "q2", "dq1", "dq2")}
    if not measured:
        del values["dq1"], values["dq2"]
    (finding,) = checks(recorded(values), two_joints())
    assert (finding.level, finding.code, finding.where) == ("refusal", "degrees", "")
    assert finding.data["joints"] == list(JOINTS)


@pytest.mark.parametrize("factor", [-1.0, 0.5, 100.0])
def test_a_velocity_of_another_sign_or_scale(factor):
    values = columns()
    values["dq2"] = factor * values["dq2"]
    (finding,) = checks(recorded(values), two_joints())
    assert (finding.level, finding.code) == ("refusal", "velocity_mismatch")
    assert finding.data["factor"] == pytest.approx(1 / factor, rel=0.02)


@pytest.mark.parametrize("what", ["q", "dq"])
def test_swapped_columns(what):
    values = columns()
    values[f"{what}1"], values[f"{what}2"] = values[f"{what}2"], values[f"{what}1"]
    (finding,) = checks(recorded(values), two_joints())
    assert (finding.level, finding.code) == ("refusal", "swapped_columns")
    assert set(finding.data["joints"]) == set(JOINTS)  # pyright: ignore[reportArgumentType]


def test_a_velocity_that_is_something_else():
    values = columns()
    values["dq2"] = 3 * np.sin(40 * values["t"] + np.sin(7 * values["t"]))
    assert found(values) == [("refusal", "velocity_mismatch", "elbow")]


def test_a_travel_beyond_the_limits_is_in_metres():
    model = pin.Model()
    parent = model.addJoint(
        0,
        pin.JointModelPZ(),
        pin.SE3.Identity(),
        JOINTS[0],
        np.array([100.0]),
        np.array([3.0]),
        np.array([0.0]),
        np.array([0.05]),
    )
    model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), JOINTS[1])
    robot = replace(two_joints(), model=model)
    refusals = [f for f in checks(recorded(columns()), robot) if f.level == "refusal"]
    assert [f.code for f in refusals] == ["beyond_limits"]
    assert "the model's 0 to 0.05 m" in refusals[0].text


def test_a_position_slightly_beyond_the_limits_is_a_warning():
    values = columns()
    values["q1"] = values["q1"] + 2.4
    assert found(values) == [("warning", "beyond_limits", "shoulder")]


def test_milliamperes():
    values = columns()
    values |= {n: 1000 * values[n] for n in ("tau1", "tau2")}
    assert found(values, in_units("A")) == [("refusal", "milliamps", "")]
    assert found(values, in_units("N·m")) == [("refusal", "milliamps", "")]
    assert found(values) == [("warning", "milliamps", "")]
    assert found(values, in_units("mA")) == []


@pytest.mark.parametrize("seconds,level", [(0.8, "refusal"), (3.0, "warning")])
def test_a_short_log(seconds, level):
    assert (level, "short_log", "") in found(columns(seconds))


def test_refusals_end_the_identification():
    recordings = recorded(columns() | {"tau2": np.zeros(2000)})
    with pytest.raises(UnusableLog) as caught:
        checked(recordings, two_joints())
    assert [f.code for f in caught.value.findings if f.level == "refusal"] == ["dead_channel"]
    clean = recorded(columns())
    assert checked(clean, two_joints()) == replace(clean)
