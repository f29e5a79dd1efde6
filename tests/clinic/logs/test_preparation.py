"""What a log suffers from is repaired and told with row numbers; a clean log passes unchanged."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.logs import preparation, signals
from nsaid_mj.clinic.logs.mapping import ColumnMap, File, Joint, Map, MotorCoupling, map_of
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.recordings import Recordings
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from nsaid_mj.clinic.logs.unusable import UnusableLog
from tests.support.robot_logs import JOINTS, columns, motion, two_joints


def table_of(values: dict[str, np.ndarray], source: str = "log.csv", origin: int = 0) -> LogTable:
    t = values["t"]
    channels = {name: Channel(t, column) for name, column in values.items() if name != "t"}
    return LogTable(source, channels, origin)


def prepared(values: dict[str, np.ndarray], mapping: Map | None = None, **robot) -> Recordings:
    return prepare([table_of(values)], mapping, two_joints(**robot))


def findings(recordings: Recordings, code: str) -> list:
    return [finding for finding in recordings.findings if finding.code == code]


def without_rest_dropped(**parts) -> Map:
    return Map(drop_rest=False, **parts)


def test_a_clean_log_passes_unchanged():
    values = columns()
    recordings = prepared(values, without_rest_dropped())
    (segment,) = recordings.segments
    assert recordings.rate == 200
    assert recordings.findings == ()
    assert segment.rows == (1, len(values["t"]))
    for part, wanted in zip(segment.log, (values["t"], *motion(values["t"])), strict=True):
        np.testing.assert_allclose(part, wanted, atol=1e-9)
    assert np.all(segment.usable)


def test_velocities_are_derived_where_missing_and_this_is_told():
    values = {name: x for name, x in columns(rate=500).items() if not name.startswith("dq")}
    recordings = prepared(values)
    assert findings(recordings, "differentiated")
    log = recordings.segments[0].log
    inner = slice(50, -50)
    np.testing.assert_allclose(log.v[inner], motion(log.t)[1][inner], atol=2e-3)


def test_a_gap_cuts_the_log():
    values = {name: np.delete(x, slice(800, 1400)) for name, x in columns().items()}
    recordings = prepared(values, without_rest_dropped())
    first, second = recordings.segments
    assert first.rows == (1, 800) and second.rows == (801, 1400)
    (gap,) = findings(recordings, "gap")
    assert gap.data["row"] == 800 and "3" in gap.text
    np.testing.assert_allclose(second.log.q, motion(second.log.t)[0], atol=1e-9)


def test_a_short_drop_out_is_interpolated_and_not_used():
    values = {name: np.delete(x, slice(800, 805)) for name, x in columns().items()}
    recordings = prepared(values, without_rest_dropped())
    (segment,) = recordings.segments
    assert len(segment.log.t) == 2000
    assert np.flatnonzero(~segment.usable.all(axis=1)).tolist() == [800, 801, 802, 803, 804]


def test_jitter_is_resampled_to_a_constant_rate():
    rng = np.random.default_rng(0)
    t = columns()["t"] + rng.uniform(-1e-3, 1e-3, 2000)
    q, v, u = motion(t)
    values = {"t": t} | {
        f"{name}{k}": part[:, k]
        for name, part in zip("qvu", (q, v, u), strict=True)
        for k in range(2)
    }
    recordings = prepared(values, without_rest_dropped())
    log = recordings.segments[0].log
    assert recordings.rate == 200 and log.step == pytest.approx(0.005)
    assert len(findings(recordings, "jitter")) == 1
    np.testing.assert_allclose(log.q, motion(log.t)[0], atol=3e-4)


def test_duplicates_and_backward_times_are_dropped_and_told():
    values = columns()
    order = np.r_[0:500, 499, 499, 500:900, 895, 900:2000]
    recordings = prepared({name: x[order] for name, x in values.items()}, without_rest_dropped())
    assert findings(recordings, "duplicates")[0].data["rows"] == [501, 502]
    assert findings(recordings, "backward_times")[0].data["rows"] == [903]
    np.testing.assert_allclose(recordings.segments[0].log.q, motion(values["t"])[0], atol=1e-9)


def test_whole_seconds_are_refused_as_a_coarse_clock():
    values = columns()
    recordings = prepared(values | {"t": np.floor(values["t"])}, without_rest_dropped())
    (coarse,) = findings(recordings, "coarse_clock")
    assert coarse.level == "refusal" and "steps of 1 s" in coarse.text
    thrice = {name: np.repeat(x, 3) for name, x in values.items()}  # a logger that repeats rows
    assert not findings(prepared(thrice, without_rest_dropped()), "coarse_clock")


def test_a_clock_that_restarts_begins_a_new_segment():
    values = columns()
    values["t"] = np.where(np.arange(2000) < 1200, values["t"], values["t"] - 6.0)
    recordings = prepared(values, without_rest_dropped())
    assert findings(recordings, "clock_reset")[0].data["rows"] == [1201]
    assert [s.rows for s in recordings.segments] == [(1, 1200), (1201, 2000)]


def test_rows_without_a_number_are_dropped():
    values = columns()
    values["q1"][[100, 101]] = np.nan
    values["tau2"][300] = np.nan
    recordings = prepared(values, without_rest_dropped())
    assert [f.data["rows"] for f in findings(recordings, "missing_values")] == [[101, 102], [301]]
    np.testing.assert_allclose(recordings.segments[0].log.q, motion(values["t"])[0], atol=1e-3)


@settings(max_examples=25, deadline=None)
@given(
    st.sets(st.integers(20, 1970), min_size=1, max_size=8),
    st.floats(0.1, 50).filter(lambda size: abs(size / (2 * np.pi) - 1) > 0.15),  # no turns
)
def test_outliers_are_found_and_interpolated(rows, size):
    values = columns()
    kept = [row for row in sorted(rows) if not rows & {row + k for k in range(1, 8)}]
    values["q1"][kept] += size
    recordings = prepared(values, without_rest_dropped())
    told = findings(recordings, "outliers")
    assert (told[0].data["rows"] if told else []) == [row + 1 for row in kept]
    log = recordings.segments[0].log
    np.testing.assert_allclose(log.q, motion(log.t)[0], atol=2e-3)


@given(st.floats(0, 1e-3), st.floats(0, 2e-3), st.integers(0, 100))
@settings(max_examples=25, deadline=None)
def test_noise_and_quantisation_are_no_outliers(noise, step, seed):
    values = columns()
    rng = np.random.default_rng(seed)
    q = values["q1"] + noise * rng.standard_normal(2000)
    values["q1"] = np.round(q / step) * step if step > 1e-6 else q
    assert len(signals.outliers(values["t"], values["q1"])) <= 1


def test_an_angle_that_wraps_is_continued():
    values = columns()
    q = 3 * values["q1"] + 2
    values |= {"q1": np.angle(np.exp(1j * q)), "dq1": 3 * values["dq1"]}
    recordings = prepared(values, without_rest_dropped())
    assert findings(recordings, "wrapped_angle")
    turns = (recordings.segments[0].log.q[:, 0] - q) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-9)


def test_a_fast_log_is_decimated_without_aliasing_and_without_delay():
    values = columns(rate=5000)
    values["tau1"] = values["tau1"] + np.sin(2 * np.pi * 990 * values["t"])
    recordings = prepared(values, without_rest_dropped())
    assert recordings.rate == 1000 and findings(recordings, "decimated")
    log = recordings.segments[0].log
    inner = slice(20, -20)
    np.testing.assert_allclose(log.q[inner], motion(log.t)[0][inner], atol=1e-4)
    assert np.std((log.u - motion(log.t)[2])[inner, 0]) < 0.05


def test_a_large_log_is_decimated_but_not_a_slow_one(monkeypatch):
    monkeypatch.setattr(preparation, "MOST_ROWS", 900)
    for rate, left in ((1000, 200), (500, 250), (250, 250), (100, 100)):
        values = columns(rate=rate)
        recordings = prepared(values, without_rest_dropped())
        assert recordings.rate == left and bool(findings(recordings, "decimated")) == (rate > left)
        log = recordings.segments[0].log
        inner = slice(20, -20)
        np.testing.assert_allclose(log.q[inner], motion(log.t)[0][inner], atol=1e-4)


def test_rest_before_within_and_after_the_motion_is_not_used():
    t = np.arange(2400) / 200
    q, v, u = motion(np.clip(t - 2, 0, 8))
    moving = (t >= 2) & (t < 10)
    rng = np.random.default_rng(1)
    v = np.where(moving[:, None], v, 0) + 1e-3 * rng.standard_normal(v.shape)
    values = {"t": t} | {
        f"{name}{k}": part[:, k]
        for name, part in zip("qvu", (q, v, u), strict=True)
        for k in range(2)
    }
    recordings = prepared(values)
    (segment,) = recordings.segments
    assert segment.log.t[0] == pytest.approx(2, abs=0.02)
    assert segment.log.t[-1] == pytest.approx(10, abs=0.02)
    assert [f.data["rows"][0] for f in findings(recordings, "rest")] == [1, segment.rows[1] + 1]
    slow = np.abs(segment.log.v) < 2e-3
    assert not np.any(segment.usable & slow)
    assert np.mean(segment.usable) > 0.95


def test_a_map_sets_a_higher_limit_of_rest():
    joints = {
        name: Joint(
            position=ColumnMap(column=f"q{k}"),
            velocity=ColumnMap(column=f"dq{k}"),
            command=ColumnMap(column=f"tau{k}"),
            rest=1.0 if k == 1 else 0.0,
        )
        for k, name in enumerate(JOINTS, 1)
    }
    (segment,) = prepared(columns(), Map(joints=joints)).segments
    assert np.all(np.abs(segment.log.v[segment.usable[:, 0], 0]) >= 1.0)
    assert np.mean(segment.usable[:, 1]) > 0.95


def test_a_command_at_the_models_limit_is_not_used():
    values = columns()
    top = 0.9 * np.max(np.abs(values["tau1"]))
    values["tau1"] = np.clip(values["tau1"], -top, top)
    recordings = prepared(values, without_rest_dropped(), limit=top)
    (finding,) = findings(recordings, "saturated")
    assert finding.level == "warning" and "limit" in finding.text
    segment = recordings.segments[0]
    assert not np.any(segment.usable[np.abs(segment.log.u[:, 0]) >= top * (1 - 1e-9), 0])
    assert np.all(segment.usable[:, 1])


def test_a_command_at_its_own_flat_extreme_is_not_used():
    values = columns()
    top = 0.8 * np.max(np.abs(values["tau1"]))
    values["tau1"] = np.clip(values["tau1"], -top, top)
    (finding,) = findings(prepared(values, without_rest_dropped()), "saturated")
    assert "flat" in finding.text


@pytest.mark.parametrize("step", [0.05, 0.5, 4.0])
def test_a_coarse_current_is_not_saturated(step):
    values = columns()
    values["tau1"] = np.round(values["tau1"] / step) * step
    assert not findings(prepared(values, without_rest_dropped()), "saturated")
    assert [signals.quantum(values[f"tau{k}"]) for k in (1, 2)] == pytest.approx([step, 0.0])


def test_units_signs_gears_and_offsets_end_in_joint_coordinates():
    values = columns()
    mapping = map_of(
        {
            "drop_rest": False,
            "joints": {
                "shoulder": {
                    "position": {"column": "p1", "unit": "deg", "sign": -1, "offset": 0.3},
                    "velocity": {"column": "w1", "unit": "rpm", "ratio": 100},
                    "command": {"column": "i1", "unit": "mA"},
                },
                "elbow": {
                    "position": {
                        "column": "p2",
                        "unit": "ticks",
                        "counts_per_turn": 4096,
                        "ratio": 50,
                    },
                    "command": {"column": "m2", "unit": "Nm", "ratio": 50},
                },
            },
        }
    )
    given = {
        "t": values["t"],
        "p1": -np.degrees(values["q1"] - 0.3),
        "w1": values["dq1"] * 100 * 60 / (2 * np.pi),
        "i1": values["tau1"] * 1e3,
        "p2": values["q2"] * 50 * 4096 / (2 * np.pi),
        "m2": values["tau2"] / 50,
    }
    recordings = prepared(given, mapping)
    log = recordings.segments[0].log
    q, v, u = motion(values["t"])
    np.testing.assert_allclose(log.q, q, atol=1e-9)
    np.testing.assert_allclose(log.v[:, 0], v[:, 0], atol=1e-9)
    np.testing.assert_allclose(log.u, u, atol=1e-9)
    assert recordings.command_units == ("A", "N·m")


def test_coupled_joints():
    R = np.array([[32.0, 0], [16, 32]])
    values = columns()
    q, v, u = motion(values["t"])
    motor_q, motor_v = q @ R.T, v @ R.T
    motor_u = u @ np.linalg.inv(R.T).T
    given = {"t": values["t"]}
    for k in range(2):
        given |= {f"q{k}": motor_q[:, k], f"v{k}": motor_v[:, k], f"u{k}": motor_u[:, k]}
    coupling = MotorCoupling(position=R.tolist(), torque=R.T.tolist())  # pyright: ignore[reportArgumentType]
    log = prepared(given, without_rest_dropped(coupling=coupling)).segments[0].log
    for part, wanted in zip(log[1:], (q, v, u), strict=True):
        np.testing.assert_allclose(part, wanted, atol=1e-9)


def test_a_singular_coupling_is_refused():
    with pytest.raises(InvalidInput, match="invertible"):
        prepared(columns(), Map(coupling=MotorCoupling(position=((1.0, 1.0), (1.0, 1.0)))))


def split(origin: int, shift: float = 0.0, rate: int = 2) -> list[LogTable]:
    """Positions and commands in two files with their own rates."""
    values = columns()
    q = {name: x for name, x in values.items() if name[0] in "tqd" and name[:3] != "tau"}
    u = {name: x[::rate] for name, x in values.items() if name == "t" or name[:3] == "tau"}
    u["t"] = u["t"] + shift
    return [table_of(q, "joints.csv"), table_of(u, "currents.csv", origin)]


def test_files_with_parts_of_a_log_share_a_clock():
    tables = split(origin=1_000_000_000, shift=-1.0)
    recordings = prepare(tables, without_rest_dropped(), two_joints())
    log = recordings.segments[0].log
    assert findings(recordings, "joined")
    assert np.quantile(np.abs(log.u - motion(log.t)[2]), 0.9) < 0.01


def test_files_without_a_common_time_are_refused_unless_an_offset_is_given():
    tables = split(origin=1_700_000_000_000_000_000)
    with pytest.raises(InvalidInput, match="offset"):
        prepare(tables, None, two_joints())
    mapping = without_rest_dropped(files={"currents.csv": File(offset=-1.7e9)})
    log = prepare(tables, mapping, two_joints()).segments[0].log
    assert np.quantile(np.abs(log.u - motion(log.t)[2]), 0.9) < 0.01


def test_held_commands_are_not_interpolated():
    values = columns()
    recordings = prepare(split(0, rate=4), without_rest_dropped(hold=True), two_joints())
    log = recordings.segments[0].log
    assert set(np.unique(log.u[:, 0])) <= set(values["tau1"].tolist())


def test_several_complete_files_are_several_segments():
    recordings = prepare(
        [table_of(columns(5.0), "one.csv"), table_of(columns(4.0), "two.csv")], None, two_joints()
    )
    assert [s.source for s in recordings.segments] == ["one.csv", "two.csv"]


def test_a_column_that_does_not_exist_is_refused():
    joints = {
        name: Joint(position=ColumnMap(column="q"), command=ColumnMap(column="tau1"))
        for name in JOINTS
    }
    with pytest.raises(InvalidInput, match="a column of the log"):
        prepared(columns(), Map(joints=joints))


def test_a_map_of_other_joints_is_refused():
    joint = Joint(position=ColumnMap(column="q1"), command=ColumnMap(column="tau1"))
    with pytest.raises(InvalidInput, match="actuated joints are shoulder, elbow"):
        prepared(columns(), Map(joints={"shoulder": joint}))


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_velocity_that_reads_zero_or_nothing_is_replaced(value):
    values = columns()
    values["dq2"] = np.full(2000, value)
    recordings = prepared(values, without_rest_dropped())
    (finding,) = findings(recordings, "dead_channel")
    assert finding.level == "warning"
    log = recordings.segments[0].log
    np.testing.assert_allclose(log.v[50:-50], motion(log.t)[1][50:-50], atol=0.02)


@pytest.mark.parametrize("rows", [20, 90])
def test_a_log_that_is_too_short_is_refused(rows):
    values = {name: x[:rows] for name, x in columns().items()}
    with pytest.raises(UnusableLog) as caught:
        prepared(values)
    assert caught.value.findings[-1].code == "short_log"


def test_a_log_in_which_nothing_moves_is_told():
    values = columns()
    rng = np.random.default_rng(0)
    values |= {n: 1e-4 * rng.standard_normal(2000) for n in ("q1", "q2", "dq1", "dq2")}
    with pytest.raises(UnusableLog, match="no joint moves faster than its noise"):
        prepared(values)


def test_a_channel_without_numbers_is_refused():
    values = columns()
    values["tau1"] = np.full(2000, np.nan)
    with pytest.raises(UnusableLog) as caught:
        prepared(values)
    assert caught.value.findings[-1].code == "dead_channel"
    assert "no row has a number" in str(caught.value)


@given(st.floats(1e-6, 1e-2), st.integers(0, 20))
@settings(max_examples=20)
def test_noise_is_measured_by_fourth_differences(sigma, seed):
    t = np.arange(4000) / 500
    x = np.sin(3 * t) + sigma * np.random.default_rng(seed).standard_normal(4000)
    assert signals.noise(x) == pytest.approx(sigma, rel=0.15)


def test_few_rows_of_a_fast_motion_are_not_taken_for_rest():
    recordings = prepared(columns(rate=25))
    assert np.all(np.mean(recordings.segments[0].usable, axis=0) > 0.85)


def test_a_run_with_continuous_joints_becomes_angles():
    robot = two_joints()
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), "shoulder")
    model.addJoint(first, pin.JointModelRZ(), pin.SE3.Identity(), "elbow")
    t = np.arange(2000) / 200
    q, v, u = motion(t)
    q[:, 0] *= 4
    parts = (np.cos(q[:, 0]), np.sin(q[:, 0]), q[:, 1])
    values = {"t": t} | {f"q_{k}": x for k, x in enumerate(parts)}
    values |= {f"{name}_{k}": x[:, k] for name, x in (("v", v), ("u", u)) for k in range(2)}
    recordings = prepare([table_of(values)], without_rest_dropped(), replace(robot, model=model))
    found = recordings.segments[0].log.q
    turns = (found - q) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.tile(np.round(turns[0]), (2000, 1)), atol=1e-9)


@pytest.mark.parametrize("rate", [100, 300])
def test_the_noise_of_a_derivative_is_that_of_positions_on_a_faster_clock(rate):
    sigma, t = 1e-3, np.arange(60_000) / 300
    x = sigma * np.random.default_rng(0).standard_normal(len(t))
    grid = np.arange(int(t[-1] * rate)) / rate
    own = signals.Signal(t, x, np.arange(len(t)), np.empty((0, 2)))
    on_grid = signals.resample(own, grid)
    found = signals.derivative(on_grid[:, None], rate)[rate:-rate]
    assert 1.0 <= signals.derivative_noise(sigma, 300, rate) / found.std() < 1.5  # no less


def test_rest_is_below_the_noise_of_positions_on_their_own_clock():
    """A joint that hardly moves, on a clock three times as fast as the grid's, has its noise."""
    slow, fast = np.arange(1000) / 100, np.arange(3000) / 300
    names = ("shoulder", "elbow", "wrist")
    q, _, u = motion(slow, 3)
    still = 1e-3 * np.random.default_rng(3).standard_normal(len(fast))
    channels = {f"q{k + 1}": Channel(slow, q[:, k]) for k in range(2)} | {
        "q3": Channel(fast, still)
    }
    channels |= {f"tau{k + 1}": Channel(slow, u[:, k]) for k in range(3)}
    recordings = prepare([LogTable("log.csv", channels, 0)], None, two_joints(names))
    (finding,) = findings(recordings, "rest_limits")
    speeds = np.concatenate([segment.log.v[20:-20, 2] for segment in recordings.segments])
    assert 4.0 <= finding.data["limits"][2] / speeds.std() < 6.0
