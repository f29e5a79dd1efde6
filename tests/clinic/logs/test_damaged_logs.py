"""Damaged logs end in a table or in a typed error with the file's name; bombs are not unpacked."""

from __future__ import annotations

import time
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import HealthCheck, given, settings

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.logs.formats import FORMATS, TEXT, limited_to, text
from nsaid_mj.clinic.logs.tables import LogTable, read
from nsaid_mj.clinic.logs.unusable import UnusableLog
from tests.support import damaged
from tests.support.damaged import end_of_reading, write_bomb

CORPUS = sorted((Path(__file__).parents[2] / "data" / "damaged").iterdir())
FUZZ = {"deadline": None, "suppress_health_check": list(HealthCheck)}


@pytest.fixture(scope="module")
def desk(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("damaged")


def check_fuzzed(kind: str, desk: Path, capfd, edits: list[damaged.Edit]) -> None:
    path = desk / (kind if kind == "record.arrow" else f"log.{kind}")
    path.write_bytes(damaged.damage(damaged.good(kind), edits))
    if path.stat().st_size:
        end_of_reading(path)
        assert "".join(capfd.readouterr()) == ""


@pytest.mark.parametrize("kind", damaged.FORMATS)
def test_every_good_file_is_read(kind, desk, capfd):
    path = desk / (kind if kind == "record.arrow" else f"log.{kind}")
    path.write_bytes(damaged.good(kind))
    assert isinstance(end_of_reading(path), LogTable)
    assert "".join(capfd.readouterr()) == ""


@pytest.mark.parametrize("kind", damaged.FORMATS)
@settings(max_examples=30, **FUZZ)
@given(damaged.edits())
def test_damaged_files_end_typed(kind, desk, capfd, edits):
    check_fuzzed(kind, desk, capfd, edits)


@pytest.mark.slow
@pytest.mark.parametrize("kind", damaged.FORMATS)
@settings(max_examples=500, **FUZZ)
@given(damaged.edits())
def test_many_damaged_files_end_typed(kind, desk, capfd, edits):
    check_fuzzed(kind, desk, capfd, edits)


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_files_that_once_ended_in_a_traceback_end_typed(path, capfd):
    end_of_reading(path)
    assert "".join(capfd.readouterr()) == ""


@pytest.mark.parametrize(
    "error", [KeyError("x"), RecursionError(), MemoryError(), SystemError("é\x1b")]
)
def test_whatever_a_library_raises_names_file_and_library(error, tmp_path, monkeypatch, capfd):
    def broken(path: Path) -> list:
        print("from Python")
        raise error

    monkeypatch.setattr(text, "read", broken)
    (tmp_path / "log.csv").write_text("t,q\n0,1\n", encoding="utf-8")
    with pytest.raises(UnusableLog, match=TEXT.library) as raised:
        read(tmp_path / "log.csv")
    assert "\x1b" not in str(raised.value) and type(error).__name__ in str(raised.value)
    assert "".join(capfd.readouterr()) == ""


def test_every_format_has_its_own_module():
    modules = Path(text.__file__).parent.glob("[a-z]*.py")
    assert sorted(form.name for form in (*FORMATS, TEXT)) == sorted(path.stem for path in modules)


@pytest.mark.parametrize("kind", ["gz", "npz", "parquet", "arrow"])
def test_a_file_that_would_become_too_large_is_refused_before_it_is_unpacked(kind, tmp_path):
    path = tmp_path / f"log.{kind}"
    write_bomb(kind, path, 2_000_000)
    assert path.stat().st_size < 1_000_000
    before = pa.total_allocated_bytes()
    with limited_to(4e6), pytest.raises(UnusableLog, match=r"--limit") as raised:
        read(path)
    assert "0.004 GB" in str(raised.value)
    assert pa.total_allocated_bytes() - before < 6e6


def test_the_limit_is_of_what_a_file_becomes_and_ends_with_its_context(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q\n" + "".join(f"{k},{k}\n" for k in range(1000)), encoding="utf-8")
    with limited_to(20_000):
        read(path)
    with limited_to(10_000), pytest.raises(UnusableLog, match="--limit"):
        read(path)  # 2000 numbers of 8 bytes
    read(path)


@pytest.mark.parametrize("size", [0.0, -1.0, float("nan")])
def test_a_limit_is_positive(size):
    with pytest.raises(InvalidInput, match="limit"), limited_to(size):
        pass


def test_a_table_of_thousands_of_columns_is_read_in_time_that_grows_with_their_number(tmp_path):
    path = tmp_path / "log.parquet"
    pa.parquet.write_table(pa.table({f"c{k}": [0.0, 1.0] for k in range(6000)}), path)
    begin = time.process_time()
    with pytest.raises(UnusableLog, match="no column looks like the time") as refused:
        read(path)
    assert time.process_time() - begin < 3  # 8 where each column made a new table
    assert len(str(refused.value)) < 1000
