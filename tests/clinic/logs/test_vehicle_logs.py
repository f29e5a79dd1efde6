"""Poses and twists of a vehicle come out in our axes, whatever frame the log is in."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.checks import checks
from nsaid_mj.clinic.logs.layout import layout
from nsaid_mj.clinic.logs.mapping import Battery, ColumnMap, Map, map_of
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from nsaid_mj.clinic.logs.unusable import UnmatchedChannels, UnusableLog
from nsaid_mj.robots.model import RobotModel

T = np.arange(2000) / 200
POSITION = np.column_stack([2 * np.sin(T), np.cos(0.7 * T), 1 + 0.3 * np.sin(1.3 * T)])
LINEAR = np.column_stack([2 * np.cos(T), -0.7 * np.sin(0.7 * T), 0.39 * np.cos(1.3 * T)])
SPIN = np.array([0.3, -0.5, 0.8])  # constant, in the body's axes [rad/s]
TURN = Rotation.from_euler("xyz", [0.2, -0.3, 0.5]) * Rotation.from_rotvec(T[:, None] * SPIN)
BODY = TURN.inv().apply(LINEAR)


@pytest.fixture(scope="module")
def quadrotor() -> RobotModel:
    return load_robot_model("hummingbird")


def table(columns: dict[str, np.ndarray], robot: RobotModel) -> LogTable:
    rng = np.random.default_rng(0)
    commands = {f"m{k}": np.sin((k + 1) * T) + rng.normal(size=len(T)) for k in range(9)}
    names = [f"m{k}" for k in range(len(robot.joints))]
    channels = columns | {name: commands[name] for name in names}
    return LogTable("flight.csv", {n: Channel(T, x) for n, x in channels.items()}, 0)


def named(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{name}{k}": column for k, column in enumerate(values.T)}


def vehicle_map(robot: RobotModel, **parts: object) -> Map:
    vehicle = {"position": ["p0", "p1", "p2"], "quaternion": ["a0", "a1", "a2", "a3"], **parts}
    actuators = {name: {"column": f"m{k}"} for k, name in enumerate(robot.joints)}
    return map_of({"vehicle": vehicle, "actuators": actuators})


TWIST = {"linear": ["v0", "v1", "v2"], "angular": ["w0", "w1", "w2"]}


def assert_ours(recordings, tolerance: float = 1e-9) -> None:
    (segment,) = recordings.segments
    log, inner = segment.log, slice(60, -60)
    np.testing.assert_allclose(log.q[:, :3], POSITION, atol=1e-9)
    error = (Rotation.from_quat(log.q[:, 3:]).inv() * TURN).magnitude()
    assert np.max(error) < 1e-6
    assert np.all(np.sum(log.q[1:, 3:] * log.q[:-1, 3:], axis=1) > 0.9)
    np.testing.assert_allclose(log.v[inner, :3], BODY[inner], atol=tolerance)
    np.testing.assert_allclose(log.v[inner, 3:], np.tile(SPIN, (len(T), 1))[inner], atol=tolerance)
    assert np.all(segment.usable)


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
@pytest.mark.parametrize("twist", ["body", "world"])
def test_enu_flu(quadrotor, order, twist):
    quaternions = TURN.as_quat(scalar_first=order == "wxyz")
    linear = BODY if twist == "body" else LINEAR
    columns = named("p", POSITION) | named("a", quaternions) | named("v", linear)
    columns |= named("w", np.tile(SPIN, (len(T), 1)))
    mapping = vehicle_map(quadrotor, **TWIST, order=order, twist=twist)
    recordings = prepare([table(columns, quadrotor)], mapping, quadrotor)
    assert_ours(recordings)
    assert checks(recordings, quadrotor) == ()


@pytest.mark.parametrize("twist", ["body", "world"])
def test_ned_frd(quadrotor, twist):
    world = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    body = np.diag([1.0, -1, -1])
    turn = Rotation.from_matrix(world @ TURN.as_matrix() @ body)
    linear = BODY @ body if twist == "body" else LINEAR @ world
    columns = named("p", POSITION @ world) | named("a", turn.as_quat(scalar_first=True))
    columns |= named("v", linear) | named("w", np.tile(SPIN, (len(T), 1)) @ body)
    mapping = vehicle_map(quadrotor, **TWIST, order="wxyz", twist=twist, frame="NED/FRD")
    assert_ours(prepare([table(columns, quadrotor)], mapping, quadrotor))


def test_quaternions_that_flip_their_sign(quadrotor):
    quaternions = TURN.as_quat() * np.where(np.arange(len(T)) % 7 < 3, -1.0, 1.0)[:, None]
    made = table(named("p", POSITION) | named("a", quaternions), quadrotor)
    late = T + 0.0013  # the same turn is measured later, so that it is interpolated
    for k in range(4):
        made.channels[f"a{k}"] = Channel(late, made.channels[f"a{k}"].values)
    (segment,) = prepare([made], vehicle_map(quadrotor), quadrotor).segments
    turns = Rotation.from_euler("xyz", [0.2, -0.3, 0.5]) * Rotation.from_rotvec(
        (segment.log.t[:, None] - 0.0013) * SPIN
    )
    error = (Rotation.from_quat(segment.log.q[:, 3:]).inv() * turns).magnitude()
    assert np.max(error) < 1e-5


def test_a_twist_is_derived_where_missing(quadrotor):
    columns = named("p", POSITION) | named("a", TURN.as_quat())
    recordings = prepare([table(columns, quadrotor)], vehicle_map(quadrotor), quadrotor)
    assert_ours(recordings, tolerance=5e-3)
    assert "differentiated" in {finding.code for finding in recordings.findings}


@pytest.mark.parametrize("canonical", [False, True])
def test_a_run_of_ours_needs_no_map(quadrotor, canonical):
    turns = TURN.as_quat(canonical=canonical)  # of positive w: the sign of the rest jumps
    columns = {f"q_{k}": x for k, x in enumerate(np.column_stack([POSITION, turns]).T)}
    spin = np.tile(SPIN, (len(T), 1))
    columns |= {f"v_{k}": x for k, x in enumerate(np.column_stack([BODY, spin]).T)}
    columns |= {f"u_{k}": np.sin((k + 1) * T) for k in range(len(quadrotor.joints))}
    assert_ours(prepare([table(columns, quadrotor)], None, quadrotor))


def test_actuators_may_be_named_with_underscores(quadrotor):
    columns = named("p", POSITION) | named("a", TURN.as_quat())
    made = table(columns, quadrotor)
    mapping = vehicle_map(quadrotor)
    renamed = {name.replace(" ", "_"): column for name, column in mapping.actuators.items()}
    assert set(renamed) != set(mapping.actuators)
    recordings = prepare([made], replace(mapping, actuators=renamed), quadrotor)
    np.testing.assert_array_equal(
        recordings.segments[0].log.u, prepare([made], mapping, quadrotor).segments[0].log.u
    )


def test_what_a_vehicles_map_lacks_is_named(quadrotor):
    columns = named("p", POSITION) | named("a", TURN.as_quat())
    tables = [table(columns, quadrotor)]
    with pytest.raises(UnmatchedChannels, match=r"map\.toml"):
        prepare(tables, None, quadrotor)
    with pytest.raises(InvalidInput, match="no quaternion"):
        prepare(tables, vehicle_map(quadrotor, quaternion=None), quadrotor)
    with pytest.raises(InvalidInput, match="v0, v1, v2"):
        prepare(tables, vehicle_map(quadrotor, linear=["v0", "v1", "v2"]), quadrotor)
    lacking = map_of(
        {"vehicle": {"position": ["p0", "p1", "p2"], "quaternion": ["a0", "a1", "a2", "a3"]}}
    )
    with pytest.raises(InvalidInput, match="actuators"):
        prepare(tables, lacking, quadrotor)


@pytest.mark.parametrize("given", ["linear", "angular"])
def test_the_velocity_that_a_log_lacks_is_derived(quadrotor, given):
    parts = {"linear": named("v", BODY), "angular": named("w", np.tile(SPIN, (len(T), 1)))}
    columns = named("p", POSITION) | named("a", TURN.as_quat()) | parts[given]
    mapping = vehicle_map(quadrotor, **{given: TWIST[given]})
    assert_ours(prepare([table(columns, quadrotor)], mapping, quadrotor), tolerance=5e-3)


def test_a_batterys_voltage_scales_the_motors_commands(quadrotor):
    volts = 16.0 - 0.2 * T
    columns = named("p", POSITION) | named("a", TURN.as_quat()) | {"volt": volts}
    made = table(columns, quadrotor)
    plain = vehicle_map(quadrotor)
    supplied = replace(plain, battery=Battery(voltage="volt", nominal=16.0))
    before, after = (
        prepare([made], mapping, quadrotor).segments[0].log.u for mapping in (plain, supplied)
    )
    np.testing.assert_allclose(after, before * (volts / 16.0)[:, None], atol=1e-9)
    first = {"column": "m0", "unit": "rpm", "ratio": 1e-3}
    actuators = supplied.actuators | {quadrotor.joints[0]: ColumnMap(**first)}
    measured = prepare([made], replace(supplied, actuators=actuators), quadrotor)
    speeds = prepare([made], replace(plain, actuators=actuators), quadrotor)
    np.testing.assert_array_equal(measured.segments[0].log.u[:, 0], speeds.segments[0].log.u[:, 0])


def _ardusub_table(robot: RobotModel, directions: dict[int, float]) -> tuple[LogTable, np.ndarray]:
    """An ArduSub's log of a ROV, whose commands in its sheet's order are also returned."""
    u = 0.5 * np.sin(T[:, None] * (1 + np.arange(8)))
    names = ("ATT/Roll", "ATT/Pitch", "ATT/Yaw", "XKF1/VN", "XKF1/VE", "XKF1/VD")
    still = {name: 0.1 * np.sin(T + k) for k, name in enumerate(names)}
    still |= {f"IMU/Gyr{axis}": np.cos(T) for axis in "XYZ"}
    # all of the sheet's thrusters push against the directions of the frame's motors
    pulses = {
        f"RCOU/C{k + 1}": 1500 - 400 * directions.get(k + 1, 1.0) * x for k, x in enumerate(u.T)
    }
    channels = {n: Channel(T, x) for n, x in (still | pulses).items()}
    for motor, value in directions.items():
        channels[f"PARM/MOT_{motor}_DIRECTION"] = Channel(T[:1], np.array([value]))
    return LogTable("rov.bin", channels, 0), u


@pytest.mark.parametrize("directions", [{}, {1: -1.0, 4: 1.0}])
def test_the_outputs_of_ardusub_are_a_rovs_thrusters(directions):
    robot = load_robot_model("bluerov2")
    made, u = _ardusub_table(robot, directions)
    found = layout(None, robot, [made])
    assert "vectored 6DOF" in found.assumed and ("[1]" in found.assumed) == bool(directions)
    raw = [s.factor * made.channels[s.column.column].values for s in found.commands if s]
    np.testing.assert_allclose(found.u(np.column_stack(raw)), u, atol=1e-12)


def test_outputs_of_another_frame_are_not_taken():
    robot = load_robot_model("bluerov2")
    made, _ = _ardusub_table(robot, {})
    lacking = {name: c for name, c in made.channels.items() if name != "RCOU/C8"}
    with pytest.raises(UnmatchedChannels):
        layout(None, robot, [replace(made, channels=lacking)])


@pytest.mark.parametrize(("stated", "fits"), [(2.0, True), (1.0, False), (7.0, False)])
def test_the_frame_that_a_log_states_is_compared_with_the_sheets(stated, fits):
    """Motors of a six-thruster ROV were taken for those of a heavy one, and ended in an error."""
    robot = load_robot_model("bluerov2")
    made, _ = _ardusub_table(robot, {})
    made = replace(
        made,
        channels=made.channels | {"PARM/FRAME_CONFIG": Channel(T[:1], np.array([stated]))},
    )
    if fits:
        assert "vectored 6DOF" in layout(None, robot, [made]).assumed
        return
    with pytest.raises(UnusableLog) as caught:
        layout(None, robot, [made])
    (finding,) = caught.value.findings
    assert finding.code == "vehicle_frame" and "vectored" in finding.text


@pytest.mark.parametrize("estimator", ["XKF1", "NKF1", "EKF1"])
@pytest.mark.parametrize("outputs", ["RCOU/C{}", "RCOU/Ch{}"])
def test_messages_of_older_ardupilots_are_read(quadrotor, estimator, outputs):
    names = ["ATT/Roll", "ATT/Pitch", "ATT/Yaw", *(f"IMU/Gyr{axis}" for axis in "XYZ")]
    names += [f"{estimator}/V{axis}" for axis in "NED"]
    names += [outputs.format(k + 1) for k in range(4)]
    made = LogTable("a.bin", {name: Channel(T, np.sin(T)) for name in names}, 0)
    found = layout(None, quadrotor, [made])
    assert found.vehicle is not None and found.vehicle.linear is not None
    assert found.vehicle.linear[0] == f"{estimator}/VN"
    used = {source.column.column for source in found.commands if source}
    assert used == {outputs.format(k + 1) for k in range(4)}


def test_rates_of_older_px4s_are_read(quadrotor):
    names = [f"vehicle_attitude/q[{i}]" for i in range(4)]
    names += [f"vehicle_attitude/{axis}speed" for axis in ("roll", "pitch", "yaw")]
    names += [f"vehicle_local_position/v{axis}" for axis in "xyz"]
    names += [f"actuator_outputs/output[{i}]" for i in range(4)]
    made = LogTable("a.ulg", {name: Channel(T, np.sin(T)) for name in names}, 0)
    found = layout(None, quadrotor, [made])
    assert found.vehicle is not None and found.vehicle.angular is not None
    assert found.vehicle.angular[0] == "vehicle_attitude/rollspeed"
