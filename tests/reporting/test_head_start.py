"""The second process that compiles the filter, and what is taken over from it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from nsaid_mj.experiment.library import load
from nsaid_mj.identifiers import NullspaceAID
from nsaid_mj.reporting import head_start


def kernel(folder: Path, name: str, text: str) -> None:
    """Writes an index and two files of data, as numba names them."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in (f"{name}.nbi", f"{name}.1.nbc", f"{name}.2.nbc"):
        (folder / file).write_text(text)


def test_kernels_that_the_first_process_has_are_kept_and_others_are_taken_over(
    tmp_path: Path,
) -> None:
    source, target = tmp_path / "second", tmp_path / "first"
    kernel(source / "a", "own.f-1.py311", "theirs")
    kernel(source / "b", "new.g-2.py311", "theirs")
    kernel(target / "a", "own.f-1.py311", "ours")
    (target / "a" / "own.f-1.py311.2.nbc").unlink()
    head_start.take_over(source, target)
    files = {str(p.relative_to(target)): p.read_text() for p in target.rglob("*") if p.is_file()}
    assert files == {
        "a/own.f-1.py311.nbi": "ours",
        "a/own.f-1.py311.1.nbc": "ours",
        "b/new.g-2.py311.nbi": "theirs",
        "b/new.g-2.py311.1.nbc": "theirs",
        "b/new.g-2.py311.2.nbc": "theirs",
    }


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


def test_a_second_process_that_fails_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(head_start, "_CALL", "import sys; sys.stdin.read(); sys.exit(1)")
    monkeypatch.setattr(head_start, "FOLDER", tmp_path / "nsaid-mj" / "digest")
    with head_start.second_process(load("scalar_rov")):
        pass
    assert list(tmp_path.iterdir()) == []
