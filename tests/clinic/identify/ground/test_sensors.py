"""Sensors in the feet of robots that walk."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nsaid_mj.clinic.identify.ground import stance as of_feet
from nsaid_mj.clinic.identify.ground.rows import GroundRows
from nsaid_mj.clinic.identify.ground.sensors import sensors_of, with_sensors
from nsaid_mj.clinic.identify.ground.stance import Stance, stance
from nsaid_mj.clinic.logs.imu import foot_columns

from .walking import GAINS, rows_of, walked

Array = np.ndarray
FEET = ["left_foot", "right_foot", "hind_foot"]


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> tuple[GroundRows, Stance]:
    """Rows of a log, and the true robot's stance."""
    log = walked(tmp_path_factory.mktemp("walk"))
    rows = rows_of(log)
    theta = rows.problem(np.zeros(9)).prior
    theta[rows.space.actuators] = GAINS
    return rows, stance(rows, theta, np.zeros(9), log.mass)


def _sensed(known: tuple[GroundRows, Stance], columns: list[int], names: tuple[str, ...]):
    """The rows of a log with sensors of the feet of given numbers; −1 is one that is dead."""
    rows, seen = known
    rng = np.random.default_rng(4)
    segments = []
    for segment, motion, normal in zip(rows.segments, rows.motions, seen.normal, strict=True):
        force = np.column_stack([np.interp(segment.log.t, motion.t, x) for x in normal.T])
        dead = np.zeros(len(force))
        own = np.column_stack([dead if k < 0 else 0.7 * force[:, k] for k in columns])
        own = np.round(20 + own + rng.standard_normal(own.shape))
        assert segment.imu is not None
        segments.append(segment._replace(imu=np.hstack([segment.imu[:, :10], own])))
    contacts = replace(rows.recordings.contacts, force=names)
    recordings = replace(rows.recordings, segments=tuple(segments), contacts=contacts)
    return rows.like(recordings), seen


NUMBERED = ("foot_force[0]", "foot_force[1]", "foot_force[2]")


@pytest.mark.parametrize(
    ("columns", "names", "codes"),
    [
        ([0, 1, 2], NUMBERED, ["foot_sensors"]),
        ([2, 0, 1], ("hind_touch", "left_touch", "right_touch"), ["foot_sensors"]),
        ([1, 0, 2], NUMBERED, ["foot_order", "foot_sensors"]),
        ([0, -1, 2], NUMBERED, ["foot_sensors", "foot_sensor"]),
    ],
    ids=["right", "named", "swapped", "dead"],
)
def test_sensors_are_compared_with_the_implied_forces(
    known: tuple[GroundRows, Stance], columns: list[int], names: tuple[str, ...], codes: list[str]
) -> None:
    rows, seen = _sensed(known, columns, names)
    found = sensors_of(rows, seen)
    assert found is not None
    said = list(found.findings(FEET))
    assert [finding.code for finding in said] == codes
    right = [names[columns.index(k)] for k in range(3) if k in columns]
    assert [n for n, ok in zip(found.names, found.believed, strict=True) if ok] == right
    np.testing.assert_allclose(found.slope[found.believed], 1 / 0.7, rtol=0.1)
    if "foot_sensor" in codes:
        assert said[-1].where == "right_foot"


def test_a_leg_swings_only_where_its_sensor_says_so_too(known: tuple[GroundRows, Stance]) -> None:
    rows, seen = _sensed(known, [0, 1, 2], NUMBERED)
    lifted = seen._replace(touching=tuple(np.zeros_like(x) for x in seen.touching))
    found, _ = with_sensors(rows, lifted)
    assert np.concatenate(found.touching).mean() > 0.5
    assert with_sensors(known[0], seen) == (seen, None)


def test_a_foot_that_is_not_lifted_may_bear_load(
    known: tuple[GroundRows, Stance], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forces too small to be seen act on a foot that drags, and not on one in the air."""
    rows, seen = known
    weight = 9.81 * 9.7 / 3
    unloaded = [np.full(x.shape, weight) for x in seen.normal]
    unloaded[0][:, :2] = 0.0
    monkeypatch.setattr(of_feet, "_normal", lambda _, number, *__: unloaded[number])
    raised = rows.eliminated[0].places.copy()
    raised[:, 1] += 0.1 * rotations(rows)[:, 2]
    monkeypatch.setattr(rows.eliminated[0], "places", raised)
    found = stance(rows, np.zeros(len(rows.space)), np.zeros(9), 9.7)
    touching = found.touching[rows.position(0)]
    assert touching[:, 0].all() and touching[:, 2].all()
    assert not touching[:, 1].any()


def rotations(rows: GroundRows) -> Array:
    """(M, 3, 3) of the base along the first motion, whose rows are the world's axes."""
    return np.asarray(Rotation.from_quat(rows.motions[0].q[:, 3:7]).as_matrix())


def test_sensors_are_found_by_name() -> None:
    own = [f"foot_force[{k}]" for k in range(4)]
    more = [f"foot_force_est[{k}]" for k in range(4)] + [
        "foot_position_body[0]",
        "motor_state[0].q",
    ]
    assert foot_columns([*own, *more]) == tuple(own)
    assert foot_columns(["FL_touch", "FR_touch", "q_1"]) == ("FL_touch", "FR_touch")
    assert foot_columns(["left_foot_force_x", "right_foot_force_x"]) == ()
    assert foot_columns(["footForce[0]", "footForce[1]"]) == ("footForce[0]", "footForce[1]")
