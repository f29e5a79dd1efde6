"""One cause is one finding, its remedy mends the log, and a healthy log raises no alarm."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify.fixing import fix
from nsaid_mj.clinic.logs.causes import velocity_causes
from nsaid_mj.clinic.logs.checks import checks
from nsaid_mj.clinic.logs.clocks import regular
from nsaid_mj.clinic.logs.evidence import LogMotion, driven_joints
from nsaid_mj.clinic.logs.mapping import Map, map_of
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.remedies import composed, mended, remedies
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from nsaid_mj.clinic.logs.unusable import UnusableLog
from tests.support.robot_logs import two_joints, write_csv

NAMES = ("shoulder", "elbow", "wrist")
Table = dict[str, np.ndarray]


@lru_cache(maxsize=4)
def _healthy(seed: int, pace: float = 1.0, masses: tuple[float, ...] = (1, 1, 1)) -> Table:
    """A log of three joints under gravity with friction and rotors, 15 s at 200 Hz.

    Its motion is so many times faster, and its links' masses those of the model times some numbers.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(3000) / 200
    rate = pace * 2 * np.pi * rng.uniform(0.2, 0.9, (3, 3))
    phase = rng.uniform(0, 2 * np.pi, (3, 3))
    angle = t[:, None, None] * rate + phase
    q = 0.35 * np.sin(angle).sum(axis=1)
    v = 0.35 * (rate * np.cos(angle)).sum(axis=1)
    a = -0.35 * (rate**2 * np.sin(angle)).sum(axis=1)
    model = two_joints(NAMES).model.copy()
    for joint, factor in enumerate(masses, 1):
        own = model.inertias[joint]
        model.inertias[joint] = pin.Inertia(factor * own.mass, own.lever, factor * own.inertia)
    data = model.createData()
    u = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    u = u + 0.1 * a + 0.8 * v + np.tanh(v / 0.05)
    table = {"t": t}
    for k in range(3):
        table[f"q{k + 1}"] = q[:, k] + 1e-4 * rng.standard_normal(len(t))
        table[f"dq{k + 1}"] = v[:, k] + 5e-3 * rng.standard_normal(len(t))
        table[f"tau{k + 1}"] = u[:, k] + 0.05 * rng.standard_normal(len(t))
    return table


def _times(table: Table, factor: float, *names: str) -> Table:
    return table | {name: factor * table[name] for name in names}


def _findings(mapping: Map | None, *tables: Table, level: str = "refusal") -> list[Finding]:
    robot = two_joints(NAMES)
    scale = (mapping or Map()).time.scale or 1.0
    logs = []
    for number, table in enumerate(tables, 1):
        t = scale * table["t"]
        channels = {n: Channel(t, x) for n, x in table.items() if n != "t"}
        logs.append(LogTable(f"log_{number}.csv", channels, 0))
    try:
        found = checks(prepare(logs, mapping, robot), robot)
    except UnusableLog as error:
        found = error.findings
    return [finding for finding in found if finding.level == level]


def _mended(found: list[Finding]) -> Map:
    return map_of(tomllib.loads(mended("", remedies(found))))


CHANGES: dict[str, tuple[str, Callable[[Table], Table], dict[str, object]]] = {
    "fast clock": ("clock", lambda x: _times(x, 0.5, "t"), {"time.scale": 2.0}),
    "slow clock": ("clock", lambda x: _times(x, 1 / 0.6, "t"), {"time.scale": 0.6}),
    "clock in ms": ("clock", lambda x: _times(x, 1e-3, "t"), {"time.scale": 1000.0}),
    "all commands": (
        "reversed_sign",
        lambda x: _times(x, -1.0, "tau1", "tau2", "tau3"),
        {"factors.command": -1},
    ),
    "two commands": (
        "reversed_sign",
        lambda x: _times(x, -1.0, "tau1", "tau3"),
        {"factors.command": {"shoulder": -1, "wrist": -1}},
    ),
    "velocities": (
        "velocity_mismatch",
        lambda x: _times(x, -1.0, "dq1", "dq2", "dq3"),
        {"factors.velocity": -1.0},
    ),
    "positions": (
        "velocity_mismatch",
        lambda x: _times(x, -1.0, "q1", "q2", "q3"),
        {"factors.position": -1.0},
    ),
    "deg/s": (
        "degrees",
        lambda x: _times(x, 180 / np.pi, "dq1", "dq2", "dq3"),
        {"factors.velocity": "deg/s"},
    ),
    "degrees": (
        "degrees",
        lambda x: _times(x, 180 / np.pi, *(f"{v}{k}" for v in ("q", "dq") for k in (1, 2, 3))),
        {"factors.position": "deg", "factors.velocity": "deg/s"},
    ),
    "swapped commands": (
        "swapped",
        lambda x: x | {"tau1": x["tau2"], "tau2": x["tau1"]},
        {"order.command": {"shoulder": "elbow", "elbow": "shoulder"}},
    ),
    "swapped positions": (
        "swapped_columns",
        lambda x: x | {"q1": x["q2"], "q2": x["q3"], "q3": x["q1"]},
        {"order.position": {"elbow": "shoulder", "wrist": "elbow", "shoulder": "wrist"}},
    ),
}


@pytest.mark.parametrize("seed", [0, 1])
def test_a_healthy_log_raises_no_alarm(seed):
    table = _healthy(seed)
    assert _findings(None, table) == []
    assert _findings(None, {n: x for n, x in table.items() if not n.startswith("dq")}) == []


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("kind", CHANGES)
def test_one_cause_is_one_finding_whose_remedy_mends_the_log(kind, seed):
    code, change, changes = CHANGES[kind]
    table = change(_healthy(seed))
    (finding,) = _findings(None, table)
    assert (finding.code, dict(finding.data["map"])) == (code, changes)  # type: ignore[call-overload]
    assert _findings(_mended([finding]), table) == []


def test_a_clock_without_velocities_is_seen_by_weight_and_inertia():
    table = {n: x for n, x in _healthy(0).items() if not n.startswith("dq")}
    (finding,) = _findings(None, _times(table, 0.5, "t"))
    assert (finding.code, finding.data["factor"]) == ("clock", 2.0)


@pytest.mark.parametrize("scale", [0.4, 1.0])
def test_links_that_are_off_are_no_wrong_clock_and_hide_none(scale):
    table = _healthy(2, masses=(1.25, 0.75, 1.2))
    table = _times({n: x for n, x in table.items() if not n.startswith("dq")}, 1 / scale, "t")
    factors = [finding.data["factor"] for finding in _findings(None, table)]
    assert factors == ([] if scale == 1 else [pytest.approx(scale, rel=0.08)])


def test_on_slow_motion_nothing_checks_the_clock_and_it_is_said():
    table = {n: x for n, x in _healthy(0, pace=0.05).items() if not n.startswith("dq")}
    assert _findings(None, table) == []
    (said,) = (f for f in _findings(None, table, level="note") if f.code == "clock_unchecked")
    assert said.data["low"] < 0.7
    assert said.data["high"] > 2.0
    right = map_of({"time": {"scale": 1}})  # the user knows it
    assert "clock_unchecked" not in [f.code for f in _findings(right, table, level="note")]


def _with_factor(factor: float, noise: float = 0.0) -> LogMotion:
    """A motion in which dq/dt of the last joint is so many times its velocity, beside noise."""
    table = _healthy(1)
    q, v, u = (np.column_stack([table[f"{x}{k}"] for k in (1, 2, 3)]) for x in ("q", "dq", "tau"))
    slopes = v.copy()
    v[:, 2] = (v[:, 2] + noise * np.random.default_rng(0).standard_normal(len(v))) / factor
    still = np.zeros(len(q), int)
    return LogMotion(q, slopes, v, 0 * v, u, np.ones(q.shape, bool), still, still, 200.0)


def test_one_velocity_that_noise_weakens_too_has_no_other_unit():
    """On a real arm's log of 1.8 s: correlation .988, and dq/dt .845 times the velocity."""
    robot = two_joints(NAMES)
    size = np.std(_with_factor(1.0).v[:, 2])
    noisy = velocity_causes(_with_factor(0.845, 0.16 * size), robot, [0, 1, 2])[0]
    clear = velocity_causes(_with_factor(0.75, 0.02 * size), robot, [0, 1, 2])[0]
    assert noisy == []
    assert [f.data["joints"] for f in clear] == [["wrist"]]


def test_a_joint_that_settles_between_the_rows_of_its_target_has_no_other_unit():
    """Seen at 50 Hz: velocities at the rows were 1.29 times too small."""
    motion = _with_factor(1.29)
    robot = two_joints(NAMES)
    (refused,), _ = velocity_causes(motion, robot, [0, 1, 2])
    (said,), _ = velocity_causes(motion, robot, [0, 1, 2], held=True)
    assert (refused.code, refused.level) == ("velocity_mismatch", "refusal")
    assert (said.code, said.level, said.where) == ("settles_between_rows", "warning", "wrist")


def test_milliseconds_without_velocities_are_a_clock_at_which_no_robot_is_recorded():
    table = {n: x for n, x in _healthy(0).items() if not n.startswith("dq")}
    table = _times(table, 1e-3, "t")
    (finding,) = _findings(None, table)
    assert (finding.code, finding.data["map"]) == ("clock", {"time.scale": 1000.0})
    assert _findings(_mended([finding]), table) == []


@pytest.mark.parametrize(("ratio", "masses"), [(9, (1, 1, 1)), (50, (1.25, 0.75, 1.2))])
def test_angles_before_gears_are_told_by_the_weight(ratio, masses):
    """57.3 stays degrees, see `CHANGES`; masses that are off do not make them of a gear of 50."""
    names = [f"{v}{k}" for v in ("q", "dq") for k in (1, 2, 3)]
    (finding,) = _findings(None, _times(_healthy(2, masses=masses), ratio, *names))
    assert finding.code == "motor_side"
    assert finding.data["ratio"] == pytest.approx(ratio, rel=0.03)


def test_two_causes_are_two_findings_whose_remedies_mend_the_log_at_once():
    table = _times(_times(_healthy(0), 0.5, "t"), -1.0, "tau2")
    found = _findings(None, table)
    assert [finding.code for finding in found] == ["clock", "reversed_sign"]
    assert _findings(_mended(found), table) == []


def test_files_with_other_clocks_signs_or_dead_commands_are_named():
    one, other = _healthy(0), _healthy(1)
    (clock,) = _findings(None, one, _times(other, 0.5, "t"))
    assert (clock.code, clock.where) == ("clock", "log_2.csv")
    assert clock.data["map"] == {'files."log_2.csv".scale': 2.0}
    (dead,) = _findings(None, one, other | {"tau2": 0 * other["t"]})
    assert (dead.code, dead.where, dead.data["joint"]) == ("dead_channel", "log_2.csv", "elbow")
    (sign,) = _findings(None, one, _times(other, -1.0, "tau1", "tau2", "tau3"))
    assert (sign.code, sign.where) == ("reversed_sign", "log_2.csv")


def test_a_value_of_several_lines_is_replaced_as_a_whole():
    text = '[vehicle]\nangular = [\n  "p", # roll\n  "q",\n  "r",\n]\norder = "xyzw"\n'
    text += '[time]\nunit = "ms"\n'
    new = tomllib.loads(mended(text, {"vehicle.angular": ["-p", "q", "-r"]}))
    assert new["vehicle"] == {"angular": ["-p", "q", "-r"], "order": "xyzw"}
    assert new["time"] == {"unit": "ms"}


def test_a_map_that_cannot_be_changed_is_kept_and_said(tmp_path):
    """A table in one line has no room for a further one."""
    table = dict(_healthy(0))
    table["t"] = table["t"] / 2
    log = write_csv(tmp_path / "log.csv", table)
    tried = fix([log], 'time = { unit = "s" }\n', two_joints(NAMES))
    assert tried.changes and not tried.kept and "cannot be changed" in tried.withdrawn


def test_remedies_add_to_what_a_map_states():
    text = '[time]\nunit = "ms"\nscale = 2\n[factors]\ncommand = { elbow = -1 }\n'
    text += '[order]\nvelocity = { a = "b", b = "a" }\n[files."a.csv"]\nscale = 3.0\n'
    changes = {
        "time.scale": 5.0,
        "factors.command": {"elbow": -1, "wrist": -1},
        'files."a.csv".scale': 2.0,
        "order.velocity": {"a": "c", "c": "a"},
    }
    new = tomllib.loads(mended(text, composed(changes, tomllib.loads(text))))
    assert new["time"] == {"unit": "ms", "scale": 10.0}
    assert new["factors"] == {"command": {"elbow": 1, "wrist": -1}}
    assert new["files"]["a.csv"] == {"scale": 6.0}
    assert new["order"]["velocity"] == {"a": "c", "b": "a", "c": "b"}


@pytest.mark.parametrize("rate,late", [(250, 2e-3), (500, 2e-3), (100, 4e-3)])
def test_stamps_that_scatter_are_put_on_their_regular_clock(rate, late):
    rng = np.random.default_rng(0)
    rows = np.arange(20 * rate)[rng.random(20 * rate) > 0.01]
    t = rows / rate
    q = [np.sin(2 * np.pi * f * t) + 2e-5 * rng.standard_normal(len(t)) for f in (0.3, 0.8, 1.1)]
    found = regular(t + rng.uniform(-late, late, len(t)), q)
    assert found is not None
    assert found.lost == 20 * rate - len(t)
    np.testing.assert_allclose(found.t, t, atol=3e-4)


def test_rows_written_before_the_next_reading_do_not_make_a_clock_faster():
    """A logger at about the sensor's rate writes some readings twice and misses others.

    The robot pauses for a second, in which repeated readings cannot be told.
    """
    rng = np.random.default_rng(0)
    written = np.cumsum(1e-3 * rng.uniform(0.7, 1.33, 8000))
    read = np.floor(written * 1000) / 1000
    going = read - np.clip(read - 4, 0, 1)
    q = [np.sin(2 * np.pi * f * going) for f in (0.3, 0.8, 1.1)]
    found = regular(written, q)
    assert found is not None
    assert found.period == pytest.approx(1e-3, rel=2e-3)
    np.testing.assert_allclose(np.diff(found.t)[:3000], np.diff(read)[:3000], atol=1e-5)


@pytest.mark.filterwarnings("error")
def test_a_coarse_encoder_has_a_regular_clock_without_warnings():
    rng = np.random.default_rng(0)
    t = np.arange(3000) / 190
    q = [np.round(0.4 * np.sin(2 * np.pi * f * t) / 1.5e-3) * 1.5e-3 for f in (0.1, 0.02)]
    found = regular(t + rng.uniform(-1e-3, 1e-3, len(t)), [*q, np.zeros(len(t))])
    assert found is None or found.lost == 0


def test_irregular_sampling_keeps_its_times():
    rng = np.random.default_rng(0)
    t = np.arange(5000) / 250 + rng.uniform(-2e-3, 2e-3, 5000)
    q = [np.sin(2 * np.pi * f * t) + 1e-4 * rng.standard_normal(len(t)) for f in (0.3, 0.8)]
    assert regular(np.sort(t), q) is None


def test_a_command_whose_squares_underflow_does_not_change() -> None:
    """Its deviation is 0, so that no share of it is explained: such shares were NaN."""
    u = np.column_stack([np.sin(np.arange(100.0)), np.resize([0.0, 5e-324], 100)])
    robot: Any = SimpleNamespace(joints=("a", "b"), passive=())
    motion: Any = SimpleNamespace(u=u, usable=np.ones((100, 2), bool))
    assert driven_joints(robot, motion) == [0]
