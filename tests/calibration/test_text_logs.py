"""Text files of every dialect give the same numbers."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nsaid_mj.calibration.logs import read_tables
from nsaid_mj.calibration.logs.errors import UnreadableLog
from nsaid_mj.calibration.logs.formats import text
from nsaid_mj.calibration.logs.tables import Table, read

VALUES = np.array([[0.0, 1.5, -2.0], [0.01, 1.25, -2.5e-3], [0.02, 1.0, 3.0], [0.03, 0.75, 1e3]])


def read_text(folder: Path, content: str | bytes, name: str = "log.csv") -> Table:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read(path)


def rows(delimiter: str, values: np.ndarray = VALUES) -> str:
    return "".join(delimiter.join(f"{x:.9g}" for x in row) + "\n" for row in values)


@st.composite
def dialects(draw) -> tuple[str, bool]:
    """The text of VALUES in some dialect, and whether it has names."""
    delimiter = draw(st.sampled_from([",", ";", "\t", " ", "  ", ", ", " ; "]))
    header = draw(st.booleans())
    quoted = draw(st.booleans())
    names = [f'"{n}"' if quoted else n for n in ("t", "q1", "u1")]
    decimal_comma = delimiter.strip() != "," and draw(st.booleans())
    body = rows("|")
    body = body.replace(".", ",") if decimal_comma else body
    end = draw(st.sampled_from(["\n", "\r\n"]))
    comment = draw(st.sampled_from(["", "# made by a logger\n", "% units: s rad A\n"]))
    content = comment + ("|".join(names) + "\n" if header else "") + body
    content = content.replace("|", delimiter).replace("\n", end)
    return content if draw(st.booleans()) else content.rstrip(), header


@given(dialects())
def test_every_dialect_gives_the_same_numbers(tmp_path_factory, dialect):
    content, header = dialect
    table = read_text(tmp_path_factory.mktemp("text"), content)
    names = ["q1", "u1"] if header else ["column_2", "column_3"]
    assert list(table.channels) == names
    for name, column in zip(names, VALUES.T[1:], strict=True):
        np.testing.assert_allclose(table.channels[name].values, column)
        np.testing.assert_allclose(table.channels[name].t, VALUES[:, 0], atol=1e-12)


def test_pandas_index_without_a_name_is_left_out(tmp_path):
    body = "".join(f"{k},{line}" for k, line in enumerate(rows(",").splitlines(keepends=True)))
    table = read_text(tmp_path, ",t,q1,u1\n" + body)
    assert list(table.channels) == ["q1", "u1"]


def test_gzip_is_read_whatever_the_name(tmp_path):
    table = read_text(tmp_path, gzip.compress(("t,q1,u1\n" + rows(",")).encode()), "log.dat")
    assert list(table.channels) == ["q1", "u1"]


def test_a_comment_line_may_hold_the_names(tmp_path):
    np.savetxt(tmp_path / "log.txt", VALUES, header="t q1 u1")
    assert list(read(tmp_path / "log.txt").channels) == ["q1", "u1"]


def test_empty_fields_are_nan(tmp_path):
    table = read_text(tmp_path, "t,q1,u1\n0,1,\n0.01,,2\n0.02,NaN,3\n0.03,4,null\n")
    assert np.isnan(table.channels["q1"].values).tolist() == [False, True, True, False]
    assert np.isnan(table.channels["u1"].values).tolist() == [True, False, False, True]


def test_integers_at_the_beginning_do_not_hide_decimals(tmp_path):
    t = np.arange(200000) * 1e-3
    q = np.where(t < 199, 0, 0.5)
    content = "t,q1\n" + "".join(f"{a:g},{b:g}\n" for a, b in zip(t, q, strict=True))
    assert read_text(tmp_path, content).channels["q1"].values[-1] == 0.5


def test_a_row_cut_by_a_crash_is_skipped_and_told(tmp_path):
    table = read_text(tmp_path, "t,q1,u1\n" + rows(",") + "0.04,1.")
    assert len(table.channels["q1"].t) == 4
    (finding,) = table.findings
    assert finding.code == "malformed_rows" and finding.data["rows"] == [5]


def test_repeated_names_are_numbered(tmp_path):
    assert list(read_text(tmp_path, "t,q,q\n" + rows(",")).channels) == ["q", "q.1"]


@pytest.mark.parametrize("content", [b"", b"\n\n", b"t,q1\n", b"\x1f\x8b\x08broken"])
def test_a_file_without_rows_is_refused(tmp_path, content):
    with pytest.raises(UnreadableLog):
        read_text(tmp_path, content)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(UnreadableLog, match="no such file"):
        read_tables([tmp_path / "none.csv"])


def test_a_table_without_time_says_how_to_state_a_rate(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("q1,u1\n1,2\n0,3\n2,1\n1,1\n", encoding="utf-8")
    with pytest.raises(UnreadableLog, match="rate"):
        read(path)
    np.testing.assert_allclose(read(path, rate=100.0).channels["q1"].t, [0, 0.01, 0.02, 0.03])


def test_names_may_be_numbers_and_rows_may_hold_texts(tmp_path):
    assert list(read_text(tmp_path, "t,1,2\n" + rows(",")).channels) == ["1", "2"]
    named = "".join(f"{line},arm\n" for line in rows(",").splitlines())
    assert list(read_text(tmp_path, named).channels) == ["column_2", "column_3"]


def test_a_time_column_that_does_not_exist_is_told(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q1,u1\n" + rows(","), encoding="utf-8")
    assert read(path, time="t").findings == ()
    assert [f.code for f in read(path, time="stamp").findings] == ["time_column"]


def test_dialect_prefers_the_delimiter_of_all_lines():
    assert text.dialect_of(["a;b", "1,5;2", "2,5;3"], []).delimiter == ";"
