"""Scenarios are loaded by name, from a script, or from the scenario.json of a run."""

from pathlib import Path

import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.cli.commands import _name_of
from nsaid_mj.lab.library import load
from tests.support.faulty import ROV


def test_a_runs_scenario_is_run_again_under_the_runs_name(tmp_path: Path) -> None:
    path = tmp_path / "rov-paper" / "scenario.json"
    path.parent.mkdir()
    path.write_text(ROV.to_json(), encoding="utf-8")
    again = load(str(path))
    assert again == ROV and again.hash == ROV.hash
    assert _name_of(path, again) == "rov"


def test_json_that_is_no_scenario_is_a_typed_error(tmp_path: Path) -> None:
    path = tmp_path / "scenario.json"
    path.write_text('{"plant": 1}', encoding="utf-8")
    with pytest.raises(InvalidInput):
        load(str(path))
