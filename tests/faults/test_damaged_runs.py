"""A run's folder whose files are damaged, or of another program, ends in a typed error."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from nsaid_mj import Record, run
from nsaid_mj.base.errors import BadRun, InvalidInput, NsaidError
from nsaid_mj.clinic.logs.formats.run import read as read_log
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.evaluation.page import brief
from nsaid_mj.lab.evaluation.summary import result_from
from nsaid_mj.lab.evaluation.verify import Verification
from tests.support.faulty import ROV

READERS: dict[str, Callable[[Path], object]] = {
    "read": read_log,
    "rebuild": postprocessing.rebuild,
    "verify": Verification.of_folder,
}


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "out"
    postprocessing.finish(run(ROV, folder))
    return folder


@pytest.fixture
def out(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "out"))


def rewritten(folder: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """Changes the table of a record."""
    file = folder / "record.arrow"
    with pa.ipc.open_stream(file.read_bytes()) as stream:
        table = change(stream.read_all())
    with pa.ipc.new_stream(str(file), table.schema) as stream:
        stream.write_table(table)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("column", ["t", "q", "v", "u", "v_hat", "theta_hat", "pe"])
def test_a_record_without_one_of_its_columns_is_refused(reader, column, out):
    rewritten(out, lambda table: table.drop_columns([column]))
    if reader == "read" and column not in "tqvu":
        READERS[reader](out)
        return
    with pytest.raises(NsaidError):
        READERS[reader](out)


@pytest.mark.parametrize("column", ["q", "theta_hat"])
def test_a_record_of_another_width_is_refused(column, out):
    def wider(table: pa.Table) -> pa.Table:
        rows = [row + row for row in table.column(column).to_pylist()]
        kind = pa.list_(pa.float64(), len(rows[0]))
        index = table.column_names.index(column)
        return table.set_column(index, column, pa.array(rows, kind))

    rewritten(out, wider)
    with pytest.raises(NsaidError, match="not that of its scenario"):
        postprocessing.rebuild(out)


@pytest.mark.parametrize("metadata", [{}, {"scenario": 3}, [], 3, {"scenario": "{}"}])
@pytest.mark.parametrize("reader", ["rebuild", "verify"])
def test_metadata_that_are_no_runs_are_refused(metadata, reader, out):
    given = {"nsaid": json.dumps(metadata)}
    rewritten(out, lambda table: table.replace_schema_metadata(given))
    with pytest.raises(NsaidError):
        READERS[reader](out)


@pytest.mark.parametrize("value", [None, [], {}, "x", -1, [["x"]]])
def test_a_summary_of_another_record_is_ignored(value: Any, out: Path):
    changed(out, "scenario_hash", value)
    again = postprocessing.reopen(out, Record.read(out))
    assert postprocessing._earlier(again) is None


@pytest.mark.parametrize("key", ["status", "status_time", "rivals", "wall_s"])
@pytest.mark.parametrize("value", [None, [], "x", [["x"]]])
def test_a_wrong_value_in_a_summary_is_refused_by_name(key: str, value: Any, out: Path):
    changed(out, key, value)
    with pytest.raises(InvalidInput, match=rf"summary\.json, {key}: expected .+, got .+Delete"):
        postprocessing.rebuild(out)


def test_a_missing_value_in_a_summary_is_refused_by_name(out: Path):
    file = out / "summary.json"
    summary = json.loads(file.read_text(encoding="utf-8"))
    del summary["wall_s"]
    file.write_text(json.dumps(summary), encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"summary\.json, wall_s: expected a value, got none"):
        postprocessing.rebuild(out)


def changed(folder: Path, key: str, value: Any) -> None:
    """Changes a value of a run's summary.json."""
    file = folder / "summary.json"
    summary = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(summary | {key: value}), encoding="utf-8")


def variants(found: Any) -> Iterator[Any]:
    """JSON values with one value, at any depth, missing or replaced by another one."""
    if isinstance(found, dict):
        for key, value in found.items():
            yield {name: other for name, other in found.items() if name != key}
            yield from ({**found, key: variant} for variant in variants(value))
    elif isinstance(found, list) and found:
        yield from ([variant, *found[1:]] for variant in variants(found[0]))
    yield from (None, [], {}, "x", -1, 0.5, True, [["x"]], {"x": 1})


def test_no_changed_value_of_a_summary_ends_in_a_traceback(made: Path):
    """Each is refused with the value's name, or gives a result that can be shown and written."""
    summary = json.loads((made / "summary.json").read_text(encoding="utf-8"))
    refused, taken = 0, 0
    for variant in variants(summary):
        try:
            result = result_from(variant)
        except InvalidInput as error:
            refused += 1
            assert error.name.startswith("summary.json") and error.remedy
            continue
        taken += 1
        assert result.verdict
        json.dumps(result.summary(), allow_nan=False)
        brief("robot", result).markdown()
    assert refused > 500 and taken > 50


@pytest.mark.parametrize("content", ["", "3", "[3]", '[{"time": "x"}]', "[" * 100_000])
def test_damaged_faults_are_refused_by_name(content, out):
    (out / "faults.json").write_text(content, encoding="utf-8")
    with pytest.raises(BadRun, match=r"faults\.json: not a list of faults"):
        postprocessing.rebuild(out)
