"""The second process that compiles the filter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.evaluation import summarize, truth_of
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.loop import run
from nsaid_mj.identifiers import NullspaceAID, Status, nullspace_aid
from nsaid_mj.identifiers.efficient import law
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


def test_a_run_without_the_filter_needs_all_but_the_filter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compiled(*_: object) -> None:
        raise AssertionError("the second process compiles this")

    monkeypatch.setattr(law, "follow_filter", compiled)
    monkeypatch.setattr(nullspace_aid, "follow", compiled)
    rov = replace(load("scalar_rov"), duration=2.0)
    assert isinstance(rov.identifier, NullspaceAID)
    whole = replace(rov, identifier=replace(rov.identifier, law="efficient"))
    with pytest.raises(AssertionError, match="second process"):
        run(whole, tmp_path)
    done = run(head_start.without_filter(whole), tmp_path)
    assert done.ending.status is Status.completed
    theta_hat = done.record["theta_hat"]
    assert np.isfinite(theta_hat).all() and (theta_hat[0] != theta_hat[-1]).any()
    assert summarize(done, truth_of(done))["confidence"]


def test_the_run_goes_on_if_the_second_process_fails_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(head_start, "_CALL", "import sys; sys.exit(1)")  # it reads no scenario
    done = []
    with head_start.second_process(load("scalar_rov")):
        done.append("body")
    assert done == ["body"]
