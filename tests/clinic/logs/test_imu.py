"""Names and conventions of the IMU of a robot that walks."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nsaid_mj.clinic.logs.imu import GRAVITY, ImuColumns, imu_columns, read_imu
from nsaid_mj.clinic.logs.mapping import Imu, Map

Array = np.ndarray


def _names(stem: str, axes: str) -> list[str]:
    return [stem.format(x) for x in axes]


@pytest.mark.parametrize(
    ("orientation", "gyro", "accelerometer"),
    [
        ("imu_state.quaternion[{}]|0123", "imu_state.gyroscope[{}]", "imu_state.accelerometer[{}]"),
        ("field.imu.quaternion{}|0123", "field.imu.gyroscope{}", "field.imu.accelerometer{}"),
        ("root_quat_w_{}|0123", "root_ang_vel_b_{}", ""),
        ("projected_gravity_b_{}|012", "root_ang_vel_b_{}", ""),
        ("imu_rpy_{}|012", "ang_vel_{}", "imu_acc_{}"),
    ],
)
def test_names_tell_the_imu(orientation: str, gyro: str, accelerometer: str) -> None:
    stem, _, axes = orientation.partition("|")
    channels = ["motor_state[0].q", "foot_force[0]", *_names(stem, axes), *_names(gyro, "012")]
    channels += _names(accelerometer, "012") if accelerometer else []
    found = imu_columns(Map(), channels, walks=True)
    assert found is not None
    assert found.stated.orientation == tuple(_names(stem, axes))
    assert found.stated.gyro == tuple(_names(gyro, "012"))
    assert bool(found.stated.accelerometer) == bool(accelerometer)


def test_the_state_of_a_free_joint_has_orientation_and_angular_velocity() -> None:
    channels = [f"qpos_{k}" for k in range(19)] + [f"qvel_{k}" for k in range(18)]
    found = imu_columns(Map(), channels, walks=True)
    assert found is not None
    assert found.stated.orientation == ("qpos_3", "qpos_4", "qpos_5", "qpos_6")
    assert found.stated.gyro == ("qvel_3", "qvel_4", "qvel_5")
    assert imu_columns(Map(), channels[:-1], walks=True) is None


T = np.arange(0, 8, 0.005)
ANGLES = np.column_stack(
    [0.1 * np.sin(3 * T), 0.08 * np.cos(4 * T + 1), 0.4 * np.sin(0.8 * T) + 0.2]
)
TURNS = Rotation.from_euler("ZYX", ANGLES[:, ::-1])
_AHEAD = Rotation.from_euler(
    "ZYX", np.gradient(ANGLES, T, axis=0)[:, ::-1] * 1e-4 + ANGLES[:, ::-1]
)
GYRO = (TURNS.inv() * _AHEAD).as_rotvec() / 1e-4
FORCE = TURNS.inv().apply([0, 0, GRAVITY]) + 0.8 * np.column_stack(
    [np.sin(17 * T), np.cos(13 * T), np.sin(19 * T)]
)
QUATERNION = TURNS.as_quat()


def _read(orientation: Array, gyro: Array = GYRO, force: Array | None = FORCE, **said: object):
    imu = Imu(
        tuple("wxyz"[: orientation.shape[1]]),
        ("gx", "gy", "gz"),
        ("ax", "ay", "az") if force is not None else None,
        **said,  # type: ignore[arg-type]
    )
    raw = np.hstack([orientation, gyro] + ([force] if force is not None else []))
    return read_imu(ImuColumns((), imu, "found"), T, raw)


WXYZ = np.roll(QUATERNION, 1, axis=1)


@pytest.mark.parametrize("measured", [True, False], ids=["with forces", "without"])
@pytest.mark.parametrize(
    ("orientation", "factor"),
    [
        (WXYZ, 1.0),
        (QUATERNION, 1.0),
        (WXYZ * [1, -1, -1, -1], 1.0),
        (ANGLES, 180 / np.pi),
        (np.degrees(ANGLES), 1.0),
        (TURNS.inv().apply([0.0, 0.0, -1.0]), 1.0),
    ],
    ids=["wxyz", "xyzw", "inverse", "rad and deg/s", "deg", "gravity"],
)
def test_sensors_tell_each_others_conventions(
    orientation: Array, factor: float, measured: bool
) -> None:
    readings, findings = _read(orientation, factor * GYRO, FORCE if measured else None)
    assert [finding.level for finding in findings] == ["note"]
    up = Rotation.from_quat(readings[:, :4]).as_matrix()[:, 2]
    np.testing.assert_allclose(up, TURNS.as_matrix()[:, 2], atol=1e-9)
    np.testing.assert_allclose(readings[:, 4:7], GYRO, atol=1e-9)


@pytest.mark.parametrize(
    ("gyro", "force", "mended"),
    [
        ((1, 1, 1), (-1, -1, -1), {"accelerometer": ["-ax", "-ay", "-az"]}),
        ((1, -1, -1), (1, 1, 1), {"gyro": ["gx", "-gy", "-gz"]}),
        (
            (1, -1, -1),
            (1, -1, -1),
            {"gyro": ["gx", "-gy", "-gz"], "accelerometer": ["ax", "-ay", "-az"]},
        ),
    ],
    ids=["gravity's sign", "axes of the gyroscope", "axes of both"],
)
def test_axes_that_contradict_each_other_are_refused_with_their_signs(
    gyro: Array, force: Array, mended: dict[str, list[str]]
) -> None:
    _, (finding,) = _read(WXYZ, GYRO * gyro, FORCE * force)
    assert finding.level == "refusal"
    changes = finding.data["map"]
    assert isinstance(changes, dict)
    for key, value in mended.items():
        assert changes[f"base.{key}"] == value


@pytest.mark.parametrize("said", [{"order": "xyzw"}, {"order": "wxyz", "inverse": True}])
def test_a_wrongly_stated_order_is_refused(said: dict[str, object]) -> None:
    _, (finding,) = _read(WXYZ, **said)
    assert finding.data["map"] == {"base.order": "wxyz", "base.inverse": False}


def test_gravity_that_was_taken_out_is_seen() -> None:
    _, findings = _read(WXYZ, force=FORCE - TURNS.inv().apply([0, 0, GRAVITY]))
    assert [finding.code for finding in findings] == ["no_gravity"]
