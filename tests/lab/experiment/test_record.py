"""The record: data written are read back, also from a truncated file."""

import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import BadRun
from nsaid_mj.lab.record import RECORD_FILE, Record, RecordWriter

FEW = settings(deadline=None, max_examples=25)
WIDTHS = {"t": 0, "q": 3, "v": 2, "one": 1}
METADATA = {"scenario": "{}", "names": ["Trägheit", "θ"], "scale": [1.0, 0.1], "r": 3}


def rows(count: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    return [(0.1 * k, *(rng.standard_normal(width) for width in (3, 2, 1))) for k in range(count)]


def write(path, values, batch=4, close=True):
    writer = RecordWriter(path, WIDTHS, METADATA, batch)
    for row in values:
        writer.extend(*(np.array([part]) for part in row))
    if close:
        writer.close()
    return writer


def expect(record: Record, values) -> None:
    """The record's rows are exactly these, to the bit."""
    assert len(record) == len(values)
    for i, (name, width) in enumerate(WIDTHS.items()):
        shape = (len(values), width) if width else (len(values),)
        expected = np.array([row[i] for row in values]).reshape(shape)
        assert record[name].shape == shape and record[name].dtype == np.float64
        assert record[name].tobytes() == expected.tobytes()


@FEW
@given(st.integers(0, 20), st.integers(1, 8), st.integers(0, 99))
def test_data_written_is_read_back_unchanged(tmp_path_factory, count, batch, seed):
    path = tmp_path_factory.mktemp("record") / RECORD_FILE
    write(path, rows(count, seed), batch)
    record = Record.read(path)
    expect(record, rows(count, seed))
    assert record.complete and record.metadata == METADATA


@pytest.mark.parametrize(
    "chosen",
    [0, -1, slice(None), slice(None, None, -3), slice(3, 9), slice(5, 5), np.array([8, 3, 3, -1])],
)
def test_an_opened_record_reads_the_rows_asked_for(tmp_path, chosen):
    write(tmp_path / RECORD_FILE, rows(11))
    opened, whole = Record.opened(tmp_path), Record.read(tmp_path)
    for name in WIDTHS:
        part = opened.rows(name, chosen)
        assert np.array_equal(part, whole[name][chosen]) and part.shape == whole[name][chosen].shape
        assert np.array_equal(part, whole.rows(name, chosen))
    expect(opened, rows(11))


def test_an_opened_record_is_not_read_from_a_file_that_has_changed(tmp_path):
    write(tmp_path / RECORD_FILE, rows(11))
    opened = Record.opened(tmp_path)
    assert "q" in opened.columns and opened.rows("q", 0).shape == (3,)
    (tmp_path / RECORD_FILE).unlink()
    write(tmp_path / RECORD_FILE, rows(9, seed=1))
    with pytest.raises(BadRun, match="changed"):
        opened["q"]


def test_a_record_lies_in_a_folder_of_any_name(tmp_path):
    folder = Path(os.fsdecode(os.fsencode(tmp_path / "odd") + b"\xff"))
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("names are text here")
    write(folder / RECORD_FILE, rows(11))
    expect(Record.read(folder), rows(11))
    assert Record.metadata_of(folder) == METADATA


@FEW
@given(st.lists(st.floats(width=64), min_size=1, max_size=9))
def test_every_float_is_read_back_to_the_bit(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("record") / RECORD_FILE
    writer = RecordWriter(path, {"t": 0}, METADATA, 4)
    for value in values:
        writer.extend(np.array([value]))
    writer.close()
    assert Record.read(path)["t"].tobytes() == np.array(values).tobytes()


def test_a_record_can_be_read_by_its_folder(tmp_path):
    write(tmp_path / RECORD_FILE, rows(5))
    expect(Record.read(tmp_path), rows(5))


def test_equal_runs_write_equal_bytes(tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        write(tmp_path / name, rows(11, seed))
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b and a != c


def test_a_record_is_overwritten(tmp_path):
    write(tmp_path / RECORD_FILE, rows(30))
    write(tmp_path / RECORD_FILE, rows(2, 5))
    expect(Record.read(tmp_path), rows(2, 5))


def test_a_truncated_record_gives_whole_batches_or_BadRun(tmp_path):
    batch, values = 4, rows(14)
    write(tmp_path / "whole", values, batch)
    whole = (tmp_path / "whole").read_bytes()
    lengths = []
    for cut in range(0, len(whole), 3):  # all remainders of 8, to which Arrow aligns
        (tmp_path / "cut").write_bytes(whole[:cut])
        try:
            record = Record.read(tmp_path / "cut")
        except BadRun as error:
            assert not lengths, f"unreadable at {cut} bytes, readable before: {error}"
            continue
        assert not record.complete, f"complete at {cut} of {len(whole)} bytes"
        assert record.metadata == METADATA
        expect(record, values[: len(record)])
        lengths.append(len(record))
    assert lengths == sorted(lengths), "more bytes, fewer rows"
    assert set(lengths) == {0, 4, 8, 12, 14}


def test_batches_written_before_a_kill_are_on_disk(tmp_path):
    """Nothing is closed: whole batches are readable, and only a part of one is lost."""
    writer = write(tmp_path / RECORD_FILE, rows(11), close=False)
    record = Record.read(tmp_path)
    expect(record, rows(11)[:8])
    assert not record.complete
    writer.close()
    assert Record.read(tmp_path).complete


def test_a_record_without_rows_is_empty(tmp_path):
    writer = write(tmp_path / RECORD_FILE, [], close=False)
    record = Record.read(tmp_path)
    expect(record, [])
    assert not record.complete
    writer.close()


def test_a_read_record_survives_replacement_of_its_file(tmp_path):
    write(tmp_path / RECORD_FILE, rows(9))
    record = Record.read(tmp_path)
    write(tmp_path / RECORD_FILE, rows(9, 1))
    expect(record, rows(9))


OTHERS = {
    "empty": b"",
    "zeros": b"\0" * 64,
    "ones": b"\xff" * 64,
    "text": b"not arrow at all",
    "end mark": b"\xff\xff\xff\xff\0\0\0\0",
    "arrow file": b"ARROW1\0\0",
}


@pytest.mark.parametrize("content", OTHERS)
def test_another_file_is_a_bad_run(tmp_path, content):
    (tmp_path / RECORD_FILE).write_bytes(OTHERS[content])
    with pytest.raises(BadRun) as caught:
        Record.read(tmp_path)
    assert caught.value.path == tmp_path / RECORD_FILE and caught.value.remedy


@pytest.mark.parametrize("metadata", [None, {"other": "1"}, {"nsaid": "not json"}])
def test_another_arrow_stream_is_a_bad_run(tmp_path, metadata):
    schema = pa.schema([("t", pa.float64())], metadata=metadata)
    with pa.ipc.new_stream(str(tmp_path / RECORD_FILE), schema) as stream:
        stream.write_batch(pa.record_batch([pa.array([1.0])], schema=schema))
    with pytest.raises(BadRun):
        Record.read(tmp_path)


@pytest.mark.parametrize("there", [True, False])
def test_a_folder_without_a_record_is_a_bad_run(tmp_path, there):
    with pytest.raises(BadRun, match=r"no record\.arrow"):
        Record.read(tmp_path if there else tmp_path / "nowhere")


def test_a_row_has_one_value_for_each_column(tmp_path):
    writer = write(tmp_path / RECORD_FILE, [], close=False)
    with pytest.raises(ValueError, match="zip"):
        writer.extend(*(np.array([part]) for part in rows(1)[0][:-1]))
    writer.close()


def test_rivals_are_found_by_their_columns(tmp_path):
    writer = RecordWriter(
        tmp_path / RECORD_FILE,
        {"t": 0, "theta_hat": 2, "v_hat_other": 1, "theta_hat_other": 2},
        {},
        1,
    )
    writer.close()
    assert Record.read(tmp_path).rivals == ["other"]
