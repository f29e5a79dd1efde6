"""Output folders that are reused, foreign or unwritable, and machines without a display."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj import NsaidError
from nsaid_mj.base.errors import FolderInUse
from nsaid_mj.base.signatures import SIGNATURES
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.record import RECORD_FILE, Record
from nsaid_mj.lab.recording import live
from nsaid_mj.lab.recording.live import LiveRecording
from tests.support.faulty import FILES, ROV, script, strict

SHORT = replace(ROV, duration=0.5, held_out=0.2, pe_window=0.2)


def test_a_run_replaces_the_one_that_was_there_only_by_force(tmp_path: Path) -> None:
    postprocessing.finish(run(replace(SHORT, seed=1, duration=0.7), tmp_path))
    before = {name: (tmp_path / name).read_bytes() for name in FILES}
    with pytest.raises(FolderInUse, match=r"it holds a run\. Give force=True"):
        run(replace(SHORT, seed=2), tmp_path)
    assert before == {name: (tmp_path / name).read_bytes() for name in FILES}
    postprocessing.finish(run(replace(SHORT, seed=2), tmp_path, force=True))
    after = {name: (tmp_path / name).read_bytes() for name in FILES}
    assert all(before[name] != after[name] for name in FILES)
    assert strict(after[postprocessing.SUMMARY].decode())["seed"] == 2
    assert strict(after[postprocessing.SCENARIO].decode())["seed"] == 2
    assert Record.read(tmp_path)["t"] == pytest.approx(0.01 * np.arange(51))
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


def test_other_files_in_the_folder_are_kept(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    postprocessing.finish(run(SHORT, tmp_path))
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_rebuilt_run_has_the_same_summary(tmp_path: Path) -> None:
    before = postprocessing.finish(run(SHORT, tmp_path)).summary()
    record = (tmp_path / RECORD_FILE).read_bytes()
    for name in FILES:
        if name not in (SIGNATURES, RECORD_FILE, postprocessing.SUMMARY):
            (tmp_path / name).unlink()
    after = postprocessing.rebuild(tmp_path).summary()
    assert after["status"] == "completed"
    cost = ("wall_s", "real_time_factor", "identifier_us_per_step", "plant_us_per_step")
    assert {key: after[key] for key in cost} == pytest.approx({key: before[key] for key in cost})
    assert {k: v for k, v in after.items() if k not in cost} == {
        k: v for k, v in before.items() if k not in cost
    }
    assert (tmp_path / RECORD_FILE).read_bytes() == record
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


def test_a_complete_record_without_summary_is_a_completed_run(tmp_path: Path) -> None:
    run(SHORT, tmp_path)
    assert postprocessing.rebuild(tmp_path).ending.status == "completed"


def test_an_empty_summary_is_ignored(tmp_path: Path) -> None:
    run(SHORT, tmp_path)
    (tmp_path / postprocessing.SUMMARY).touch()
    assert postprocessing.rebuild(tmp_path).ending.status == "completed"


@pytest.mark.parametrize("summary", ["not JSON", '{"status": "plant diverged"}', "[]"])
def test_another_summary_is_neither_believed_nor_replaced(summary: str, tmp_path: Path) -> None:
    run(SHORT, tmp_path)
    (tmp_path / postprocessing.SUMMARY).write_text(summary)
    with pytest.raises(NsaidError, match=r"summary\.json.*Move it elsewhere"):
        postprocessing.rebuild(tmp_path)
    assert (tmp_path / postprocessing.SUMMARY).read_text() == summary


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_record_that_ends_in_zeros_is_cut_where_they_begin(share: float, tmp_path: Path) -> None:
    run(replace(SHORT, duration=8.0), tmp_path)
    whole = Record.read(tmp_path)
    data = (tmp_path / RECORD_FILE).read_bytes()
    at = int(share * len(data))
    (tmp_path / RECORD_FILE).write_bytes(data[:at] + bytes(len(data) - at))
    found = Record.read(tmp_path)
    assert 0 < len(found) < len(whole) and not found.complete
    assert all(np.array_equal(found[key], whole[key][: len(found)]) for key in found.columns)
    assert postprocessing.rebuild(tmp_path).ending.status == "interrupted"


@pytest.mark.parametrize("seed", [0, 7])
def test_an_earlier_runs_summary_is_not_taken_for_this_runs(seed: int, tmp_path: Path) -> None:
    postprocessing.finish(run(replace(SHORT, seed=seed, duration=2.0), tmp_path))
    whole = (tmp_path / RECORD_FILE).read_bytes()
    run(replace(SHORT, duration=5.0), tmp_path, force=True)
    (tmp_path / RECORD_FILE).write_bytes((tmp_path / RECORD_FILE).read_bytes()[: len(whole)])
    assert postprocessing.rebuild(tmp_path).ending.status == "interrupted"


@pytest.mark.parametrize("out", ["file", "file/below", "folder"])
def test_an_unwritable_folder_is_refused_in_one_line(out: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder" / RECORD_FILE).mkdir(parents=True)
    with pytest.raises(NsaidError, match=out):
        run(SHORT, tmp_path / out)
    code, said = script(SHORT, "--out", tmp_path / out, "--quiet")
    assert code == 2
    assert said.err.startswith("nsaid: ") and out in said.err and "Traceback" not in said.err
    assert len(said.err.splitlines()) == 1
    assert (tmp_path / "file").read_text() == "in the way"


# -- no display ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_display")
def test_live_without_a_display_prints_one_line_and_continues(tmp_path: Path) -> None:
    code, said = script(SHORT, "--out", tmp_path, "--live", "--json")
    assert code == 0
    lines = said.err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("nsaid: no display here; watch the run at http://127.0.0.1:")
    assert strict(said.out)["status"] == "completed"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


@pytest.mark.usefixtures("no_display")
def test_live_without_a_viewer_prints_one_line_and_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "program", lambda: [str(tmp_path / "no" / "such" / "program")])
    code, said = script(SHORT, "--out", tmp_path, "--live", "--json")
    assert code == 0
    lines = said.err.splitlines()
    assert len(lines) == 1 and lines[0].startswith("nsaid: continuing without the viewer: ")


def test_watching_a_run_does_not_change_its_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "program", lambda: ["/no/such/program"])
    run(SHORT, tmp_path / "alone")
    run(SHORT, tmp_path / "watched", LiveRecording("x"))
    one, two = ((tmp_path / name / RECORD_FILE).read_bytes() for name in ("alone", "watched"))
    assert one == two
