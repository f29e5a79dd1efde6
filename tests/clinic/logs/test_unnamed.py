"""Columns without names: velocities are those whose integrals are the positions."""

import numpy as np
import pytest

from nsaid_mj.clinic.identify.inspection import inspect
from nsaid_mj.clinic.logs.first_map import first_map
from nsaid_mj.clinic.logs.mapping import read_map
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.clinic.logs.unnamed import unnamed
from tests.support.robot_logs import two_joints

JOINTS = ("a", "b")


def signals(seed: int, rate: float = 200.0, n: int = 2000) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = np.arange(n) / rate
    turn = 2 * np.pi * rng.uniform(0.2, 0.6, (2, 3))
    phase = rng.uniform(0, 6, (2, 3))
    waves = turn[:, :, None] * t + phase[:, :, None]
    q = np.sin(waves).sum(axis=1).T
    v = (turn[:, :, None] * np.cos(waves)).sum(axis=1).T
    a = -(turn[:, :, None] ** 2 * np.sin(waves)).sum(axis=1).T
    u = 2 * a + 3 * v + rng.normal(size=a.shape)
    noise = 1e-3 * rng.normal(size=(2, n, 2))
    return {"t": t[:, None], "q": q + noise[0], "v": v + 20 * noise[1], "a": a, "u": u}


def table(tmp_path, *blocks):
    path = tmp_path / "log.csv"
    np.savetxt(path, np.hstack(blocks), delimiter=",")
    return read_tables([path])


@pytest.mark.parametrize("seed", range(3))
def test_positions_velocities_and_commands_are_told_by_their_values(tmp_path, seed):
    s = signals(seed)
    found = unnamed(table(tmp_path, s["t"], s["u"], s["v"], s["a"], s["q"]), JOINTS)
    assert found["position"] == {"column_8 to column_9": {"a": "column_8", "b": "column_9"}}
    assert found["velocity"] == {"column_4 to column_5": {"a": "column_4", "b": "column_5"}}
    assert found["command"] == {"column_2 to column_3": {"a": "column_2", "b": "column_3"}}


def test_nothing_is_told_without_velocities_or_of_a_log_with_names(tmp_path):
    s = signals(0)
    assert unnamed(table(tmp_path, s["t"], s["q"], s["u"]), JOINTS) == {}
    swapped = s["v"][:, ::-1]
    assert unnamed(table(tmp_path, s["t"], s["q"], swapped, s["u"]), JOINTS) == {}
    path = tmp_path / "named.csv"
    header = "t,q1,q2,dq1,dq2,tau1,tau2"
    every = np.hstack([s["t"], s["q"], s["v"], s["u"]])
    np.savetxt(path, every, delimiter=",", header=header, comments="")
    assert unnamed(read_tables([path]), JOINTS) == {}


def test_the_first_map_holds_what_the_values_tell(tmp_path):
    s = signals(1)
    robot = two_joints(JOINTS)
    tables = table(tmp_path, s["t"], s["q"], s["v"], s["u"])
    (said,) = (f for f in inspect(tables, None, robot).findings if f.code == "unmatched")
    assert "Integrated over time, column_4 to column_5 are column_2 to column_3" in said.text
    path = tmp_path / "map.toml"
    path.write_text(first_map(tables, robot), "utf-8")
    made = read_map(path)
    assert made.joints["b"].velocity.column == "column_5"
    assert made.joints["a"].command.column == "column_6"
