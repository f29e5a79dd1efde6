"""A validation log has its own map, and what is wrong with it is said to be of its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.logs.unusable import UnusableLog
from tests.support.robot_logs import columns, two_joints

MAP = """
[joints.shoulder]
position = { column = "a", unit = "deg" }
command = { column = "c" }
[joints.elbow]
position = { column = "b" }
command = { column = "d" }
"""


def write(path: Path, names: dict[str, str], scale: float = 1.0) -> Path:
    """A log of two seconds with columns by other names; the first position is scaled."""
    values = columns(2.0)
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
