"""A validation log has its own map, and what is wrong with it is said to be of its file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nsaid_mj.clinic.identify.calibrate import _validated
from nsaid_mj.clinic.identify.fit import minimise
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.logs.unusable import UnusableLog
from tests.clinic.identify.test_fit import problem_of
from tests.support.robot_logs import columns, two_joints, write_csv

MAP = """
[joints.shoulder]
position = { column = "a", unit = "deg" }
command = { column = "c" }
[joints.elbow]
position = { column = "b" }
command = { column = "d" }
"""


def write(path: Path, names: dict[str, str], scale: float = 1.0) -> Path:
    """A log of four seconds with columns by other names; the first position is scaled."""
    values = columns(4.0)
    values["q1"] = values["q1"] * scale
    table = np.column_stack([values[name] for name in names])
    np.savetxt(path, table, delimiter=",", header=",".join(names.values()), comments="")
    return path


OWN = {name: name for name in ("t", "q1", "q2", "dq1", "dq2", "tau1", "tau2")}
OTHER = {"t": "t", "q1": "a", "q2": "b", "tau1": "c", "tau2": "d"}


class Seen(Exception):
    """What the fit is given has been seen."""


def test_a_validation_log_has_its_own_map(tmp_path, monkeypatch):
    given: list[Any] = []

    def seen(*arguments: Any, **_: Any) -> None:
        given.extend(arguments)
        raise Seen

    monkeypatch.setattr("nsaid_mj.clinic.identify.calibrate.calibrate", seen)
    log = write(tmp_path / "log.csv", OWN)
    other = write(tmp_path / "other.csv", OTHER, 180 / np.pi)
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    with pytest.raises(Seen):
        identify_forces(two_joints(), log, validate=other, validate_mapping=tmp_path / "map.toml")
    (fitted,), (judged,) = given[1].segments, given[2].segments
    np.testing.assert_allclose(judged.log.q, fitted.log.q, atol=1e-6)


def test_faults_of_a_validation_log_are_of_its_file(tmp_path):
    log = write(tmp_path / "log.csv", OWN)
    other = write(tmp_path / "other.csv", OWN, 180 / np.pi)
    with pytest.raises(UnusableLog, match=r"validation log other\.csv, shoulder"):
        identify_forces(two_joints(), log, validate=other)
    with pytest.raises(UnusableLog) as raised:
        identify_forces(two_joints(), other, validate=log)
    assert "validation" not in str(raised.value)


def test_a_validation_log_at_rest_in_one_direction_is_judged_by_the_training_logs_motion():
    problem = problem_of(0.02, 1000)
    theta = minimise(problem).theta
    Y = problem_of(0.02, 1000, 1).Y
    Y[:, 1, :] *= 0.01
    noise = np.random.default_rng(0).standard_normal(len(Y))
    Y[:, 1, 6] += 0.02 * noise * problem.forces(theta)[1] / theta[6]
    checked = replace(problem, Y=Y)
    assert checked.nrmse(theta)[1] > 0.7
    judged = _validated(problem, checked, theta)
    assert judged[1] == pytest.approx(0.02, rel=0.2)
    assert judged[0] == checked.nrmse(theta)[0]


def test_findings_about_a_joint_of_a_validation_log_name_that_log(tmp_path):
    log = write(tmp_path / "log.csv", OWN)
    still = columns(4.0)
    still["q1"] = 0.5 + 1e-5 * np.random.default_rng(0).standard_normal(len(still["t"]))
    still["dq1"] = 0 * still["q1"]
    other = write_csv(tmp_path / "other.csv", still)
    found = identify_forces(two_joints(), log, validate=other)
    (said,) = [f for f in found.findings if f.code == "at_rest"]
    assert said.where == "validation log other.csv, shoulder"
