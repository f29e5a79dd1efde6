"""A vehicle's velocities in other axes than its pose are named, with lines that mend its map."""

from __future__ import annotations

import tomllib
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.checks import checks
from nsaid_mj.clinic.logs.frames import _other_axes
from nsaid_mj.clinic.logs.mapping import Vehicle, map_of
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.remedies import mended, remedies
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from tests.court.field_causes import VEHICLE_KINDS, Drawn, draw

ROBOT = load_robot_model("bluerov2")


@lru_cache(maxsize=2)
def _drawn(kind: str = "vehicle, healthy") -> Drawn:
    return draw(0, kind, "bluerov2")


def _findings(text: str, *tables: dict[str, np.ndarray]) -> list[Finding]:
    mapping = map_of(tomllib.loads(text))
    logs = []
    for k, table in enumerate(tables, 1):
        t = (mapping.time.scale or 1.0) * table["t"]
        channels = {n: Channel(t, x) for n, x in table.items() if n != "t"}
        logs.append(LogTable(f"log_{k}.csv", channels, 0))
    found = checks(prepare(logs, mapping, ROBOT), ROBOT)
    return [finding for finding in found if finding.level == "refusal"]


@pytest.mark.parametrize("kind", [kind for kind in VEHICLE_KINDS if "of a file" not in kind])
def test_each_cause_is_one_finding_whose_remedy_mends_the_log(kind):
    healthy = _drawn("Euler angles, healthy") if kind.startswith("Euler") else _drawn()
    tables = [dict(table) for table in healthy.tables]
    own = {"names": ROBOT.joints}
    said = VEHICLE_KINDS[kind](np.random.default_rng(1), tables, own)
    found = _findings(healthy.map, tables[0])
    assert tuple(finding.code for finding in found) == said.codes
    for words in said.where:
        assert words in found[0].text
    if found:
        assert _findings(mended(healthy.map, remedies(found)), tables[0]) == []


def test_a_clock_of_one_file_is_named_with_the_file():
    table = dict(_drawn().tables[0])
    (finding,) = _findings(_drawn().map, table, table | {"t": table["t"] / 0.4})
    assert (finding.code, finding.where) == ("clock", "log_2.csv")
    assert finding.data["map"] == {'files."log_2.csv".scale': 0.4}


def test_axes_of_one_file_are_named_with_the_file():
    healthy = _drawn("Euler angles, healthy")
    table = healthy.tables[0]
    radians = {name: np.radians(table[name]) for name in ("roll", "pitch", "yaw")}
    (finding,) = _findings(healthy.map, table | radians, table)
    assert (finding.code, finding.where) == ("frame", "log_1.csv")
    assert "in rad" in finding.text and not remedies([finding])


def test_axes_stated_as_north_east_down_are_mended_in_these():
    """The lines of the map are in the log's own axes."""
    healthy = _drawn()
    tables = [dict(table) for table in healthy.tables]
    VEHICLE_KINDS["all in NED"](np.random.default_rng(0), tables, {})
    text = healthy.map.replace("[vehicle]\n", '[vehicle]\nframe = "NED/FRD"\n')
    assert _findings(text, tables[0]) == []
    table = tables[0] | {"p": tables[0]["q"], "q": -tables[0]["p"]}
    found = _findings(text, table)
    assert 'angular = ["-q", "p", "r"]' in found[0].remedy
    assert "right-backward-down in place of forward-right-down" in found[0].text


def test_rates_in_degrees_per_second_are_named():
    healthy = _drawn()
    table = healthy.tables[0] | {n: np.degrees(healthy.tables[0][n]) for n in "pqr"}
    (finding,) = _findings(healthy.map, table)
    assert finding.data["map"] == {"vehicle.angular_unit": "deg/s"}
    assert _findings(mended(healthy.map, remedies([finding])), table) == []


def test_a_noisy_pose_is_no_other_scale():
    rng = np.random.default_rng(0)
    table = dict(_drawn().tables[0])
    for name in ("qx", "qy", "qz", "qw", "x", "y", "z"):
        table[name] = table[name] + 0.02 * rng.standard_normal(len(table[name]))
    assert _findings(_drawn().map, table) == []


@pytest.mark.parametrize("stated", ["body", "world"])
@pytest.mark.parametrize("truth", ["body", "world"])
def test_a_level_vehicle_of_one_heading_shows_the_axes_of_its_velocities(stated, truth):
    """Both differ by a tenth, which was taken for noise: a Crazyflie's log passed."""
    rng = np.random.default_rng(4)
    t = np.arange(0, 30, 0.01)
    tilt = 0.15 * np.column_stack([np.sin(1.1 * t), np.sin(1.7 * t + 1), 0.1 * np.sin(0.3 * t)])
    turns = Rotation.from_rotvec(tilt)
    path = np.column_stack([np.sin(0.8 * t), np.cos(0.6 * t), 0.3 * np.sin(0.5 * t)])
    world = np.gradient(path, 0.01, axis=0) + 0.01 * rng.normal(size=path.shape)
    rates = np.gradient(tilt, 0.01, axis=0)
    body = turns.inv().apply(world)
    given = world if truth == "world" else body
    linear = turns.inv().apply(given) if stated == "world" else given  # as the map has it read
    noisy = path + 2e-3 * rng.normal(size=path.shape)
    q = np.hstack([noisy, turns.as_quat()])
    names = ("a", "b", "c")
    vehicle = Vehicle(position=names, quaternion=(*names, "d"), linear=names, twist=stated)
    found = _other_axes(q, np.hstack([linear, rates]), 100.0, vehicle)
    assert [f.data["map"] for f in found] == ([{"vehicle.twist": truth}] if stated != truth else [])


def test_a_robot_on_a_bench_has_no_exchanged_commands():
    """Constant forces may be anything: noise and one step made three thrusters exchanged."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 9, 0.1)
    v = rng.normal(size=(len(t), 6)) * [5e-4, 5e-4, 5e-4, 2e-4, 2e-4, 2e-4]
    v += [-2e-3, 0.0, 0.0, -8e-3, 6e-3, -2e-3]  # a gyroscope's bias
    v[:, 1] += 0.009 / (1 + np.exp(-4 * (t - 3.5)))  # and an estimate that drifts
    table = {"t": t, "x": 0 * t, "y": 0 * t, "z": 0 * t, "qw": 1 + 0 * t}
    table |= {name: 1e-5 * rng.normal(size=len(t)) for name in ("qx", "qy", "qz")}
    table |= dict(zip(("vx", "vy", "vz", "p", "q", "r"), v.T, strict=True))
    steps = np.array([-15, 20, 15, -20, 0, 0, 0, 0]) / 1000
    table |= {f"u{k + 1}": np.where(t > 0.3, u, 0.0) for k, u in enumerate(steps)}
    free = _drawn().map.replace('position = ["x", "y", "z"]\n', "")
    assert _findings(free, table) == []
