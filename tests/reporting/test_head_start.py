"""The second process that compiles the filter."""

from __future__ import annotations

from dataclasses import replace

import pytest

from nsaid_mj.experiment.library import load
from nsaid_mj.identifiers import NullspaceAID
from nsaid_mj.reporting import head_start


@pytest.mark.parametrize(
    "law, cores, wanted", [("efficient", 2, True), ("efficient", 1, False), ("memory", 2, False)]
)
def test_it_pays_off_for_the_filter_where_there_is_a_second_core(
    law: str, cores: int, wanted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(head_start.os, "cpu_count", lambda: cores)
    scenario = load("scalar_rov")
    assert isinstance(scenario.identifier, NullspaceAID)
    changed = replace(scenario, identifier=replace(scenario.identifier, law=law))
    assert head_start.pays_off(changed) is wanted


def test_the_run_goes_on_if_the_second_process_fails_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(head_start, "_CALL", "import sys; sys.exit(1)")  # it reads no scenario
    done = []
    with head_start.second_process(load("scalar_rov")):
        done.append("body")
    assert done == ["body"]
