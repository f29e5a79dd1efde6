"""Text files of every dialect give the same numbers."""

import gzip
import time
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.logs.formats import text
from nsaid_mj.clinic.logs.mapping import Map, Time
from nsaid_mj.clinic.logs.tables import Channel, LogTable, join, read, read_tables
from nsaid_mj.clinic.logs.unusable import UnreadableLog

VALUES = np.array([[0.0, 1.5, -2.0], [0.01, 1.25, -2.5e-3], [0.02, 1.0, 3.0], [0.03, 0.75, 1e3]])


def read_text(folder: Path, content: str | bytes, name: str = "log.csv") -> LogTable:
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


@settings(deadline=None)
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
    np.testing.assert_allclose(read(path, Time(rate=100.0)).channels["q1"].t, [0, 0.01, 0.02, 0.03])


def test_names_may_be_numbers_and_rows_may_hold_texts(tmp_path):
    assert list(read_text(tmp_path, "t,1,2\n" + rows(",")).channels) == ["1", "2"]
    named = "".join(f"{line},arm\n" for line in rows(",").splitlines())
    assert list(read_text(tmp_path, named).channels) == ["column_2", "column_3"]


def test_a_time_column_that_does_not_exist_is_told(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q1,u1\n" + rows(","), encoding="utf-8")
    assert read(path, Time(column="t")).findings == ()
    assert [f.code for f in read(path, Time(column="stamp")).findings] == ["time_column"]


def test_dialect_prefers_the_delimiter_of_all_lines():
    assert text.dialect_of(["a;b", "1,5;2", "2,5;3"], []).delimiter == ";"


# -- nothing is lost in silence --------------------------------------------------------------------


def codes(table: LogTable) -> dict[str, Finding]:
    return {finding.code: finding for finding in table.findings}


@settings(deadline=None)
@given(st.sets(st.tuples(st.integers(0, 29), st.integers(0, 8)), min_size=1, max_size=4))
def test_a_stray_quote_costs_no_other_row(tmp_path_factory, quotes):
    lines = [f"{0.01 * k:.2f},{k},2.5" for k in range(30)]
    for row, at in sorted(quotes):
        lines[row] = lines[row][:at] + '"' + lines[row][at:]
    table = read_text(tmp_path_factory.mktemp("text"), "t,q1,u1\n" + "\n".join(lines))
    skipped = 30 - len(table.channels["u1"].values)
    paired = {row for row, _ in quotes if lines[row].count('"') % 2 == 0}
    assert skipped <= len(paired)  # a pair of quotes may hide a comma, of its own row
    told = codes(table).get("stray_quotes")
    rows = set(cast(list[int], told.data["rows"])) if told else set()
    assert {row + 1 for row, _ in quotes} - {row + 1 for row in paired} <= rows
    assert rows <= {row + 1 for row, _ in quotes}
    if skipped:
        assert codes(table)["malformed_rows"].data["count"] == skipped


def test_a_quoted_field_may_hold_the_delimiter(tmp_path):
    rows = "".join(f'{k},"a, ""b""",{k}\n' for k in range(5))
    table = read_text(tmp_path, '"t","name","q1"\n' + rows)
    assert table.channels["q1"].values.tolist() == [0, 1, 2, 3, 4]
    assert "stray_quotes" not in codes(table)


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        (["1,234", "0.5"], [1234.0, 0.5]),  # a point elsewhere: commas group thousands
        (["1.234", "0,5"], [1234.0, 0.5]),
        (["1,234.5", "2"], [1234.5, 2.0]),
        (["1.234,5", "2"], [1234.5, 2.0]),
        (["1,234,567", "2"], [1234567.0, 2.0]),
        (["1,234", "2"], [1.234, 2.0]),  # with semicolons a comma alone is a decimal one
        (["1.234", "2"], [1.234, 2.0]),
        (["-0,123", "1,234"], [-0.123, 1.234]),
    ],
)
@pytest.mark.parametrize("first", [3, 100])
def test_marks_of_thousands_and_decimals_are_told_apart_by_the_whole_file(
    tmp_path, fields, wanted, first
):
    rows = [f"{k};1;2;{k}" for k in range(first)] + [f"{first};{';'.join(fields)};{first}"]
    table = read_text(tmp_path, "\n".join(["t_ms;q1;u1;k", *rows]))
    assert [table.channels[name].values[-1] for name in ("q1", "u1")] == wanted


def test_marks_that_do_not_tell_are_refused(tmp_path):
    with pytest.raises(UnreadableLog, match=r"2,345 and 1\.234 leave open"):
        read_text(tmp_path, "t;q1;u1\n0;1,234;1.234\n1;2,345;2\n2;1;1\n")


def test_thousands_in_quotes_of_a_comma_file(tmp_path):
    table = read_text(tmp_path, 't,q1,u1\n0,"1,234.5",1\n0.1,"2,000",2\n0.2,"3",3\n')
    assert table.channels["q1"].values.tolist() == [1234.5, 2000.0, 3.0]


def test_lists_in_fields_are_columns(tmp_path):
    """As pandas writes a column of arrays; lists of different lengths stay text."""
    rows = '0,"[0.5, -1.0]",[1 2e-1],"[1, 2]"\n0.1,,[3 4],"[1]"\n0.2,"[1, 2]",[5 6.],"[]"\n'
    table = read_text(tmp_path, "t,q,tau,n\n" + rows)
    assert list(table.channels) == ["q_0", "q_1", "tau_0", "tau_1"]
    np.testing.assert_array_equal(table.channels["q_1"].values, [-1, np.nan, 2])
    assert table.channels["tau_1"].values.tolist() == [0.2, 4.0, 6.0]
    assert "n (text such as" in codes(table)["left_out"].text


def test_a_file_of_targets_beside_one_of_states_is_left_out_with_the_names_for_a_map(tmp_path):
    t = np.arange(0, 10, 0.01)
    states = {name: Channel(t, np.sin(t)) for name in ("q1", "dq1", "u1")}
    tables = [LogTable("state.csv", states, 0), LogTable("wish.csv", {"q1": states["q1"]}, 0)]
    logs, findings = join(tables, Map(), ["q1", "dq1", "u1"])
    assert [log.source for log in logs] == ["state.csv"]
    (finding,) = findings
    assert (finding.where, finding.code) == ("wish.csv", "unused_file")
    assert '"wish/q1"' in finding.remedy


def test_columns_without_numbers_are_told_with_what_they_hold(tmp_path):
    table = read_text(tmp_path, "t,q1,mode\n0,1,AUTO\n1,2,AUTO\n2,3,HOLD\n")
    finding = codes(table)["left_out"]
    assert "1 of 2 channels" in finding.text
    assert "mode (text such as 'AUTO')" in finding.text


@pytest.mark.parametrize("null", ["#N/A", "#DIV/0!", "-nan", "N/A", "", "1.#QNAN"])
def test_what_spreadsheets_write_for_no_value_is_none(tmp_path, null):
    table = read_text(tmp_path, f"t,q1\n0,1\n1,{null}\n2,3\n")
    np.testing.assert_array_equal(table.channels["q1"].values, [1, np.nan, 3])


@pytest.mark.parametrize(
    ("absent", "told"), [(-9999, True), (65535, True), (99.9, False), (3, False)]
)
def test_a_number_that_stands_for_none_is_told(tmp_path, absent, told):
    values = [absent if k in (5, 6, 17) else 0.1 * k for k in range(30)]
    table = read_text(tmp_path, "t,q1\n" + "".join(f"{k},{x}\n" for k, x in enumerate(values)))
    column = table.channels["q1"].values
    assert np.flatnonzero(np.isnan(column)).tolist() == ([5, 6, 17] if told else [])
    assert ("sentinel" in codes(table)) == told
    if told:
        assert codes(table)["sentinel"].data["rows"] == [6, 7, 18]


def test_a_number_within_reach_of_the_others_is_a_number(tmp_path):
    ticks = [0, 65535, 65000, 1000, 30000, 20000] * 3
    table = read_text(tmp_path, "t,q1\n" + "".join(f"{k},{x}\n" for k, x in enumerate(ticks)))
    assert table.channels["q1"].values.tolist() == ticks and "sentinel" not in codes(table)


def test_a_file_of_which_most_rows_do_not_fit_is_refused(tmp_path):
    rows = "".join(f"{k},1,2{',3' * (1 + k % 4)}\n" for k in range(40))
    with pytest.raises(UnreadableLog, match="rows do not have"):
        read_text(tmp_path, "t,q1,u1\n" + rows)


def test_escapes_in_names_do_not_reach_a_terminal(tmp_path):
    table = read_text(tmp_path, "t,q\x1b[31m1,\x9b2J\n0,1,2\n1,2,3\n2,3,4\n")
    assert list(table.channels) == ["q\ufffd[31m1", "\ufffd2J"]


def test_time_to_read_a_table_is_linear_in_columns(tmp_path):
    def taken(width: int) -> float:
        path = tmp_path / f"{width}.csv"
        path.write_text("\n".join([";".join(["0,5"] * width)] * 5), encoding="utf-8")
        begin = time.process_time()
        text.read(path)
        return time.process_time() - begin

    taken(100)
    assert taken(20_000) < 40 * max(taken(2_000), 0.01)


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {1500: "1,2", 1700: "1,2,3,4"},
        {1500: "15.0,1,2.5"},
        {1500: "15.0,1,abc"},
        {k: f"{k / 100},1," for k in range(1000)},
    ],
    ids=["sound", "malformed rows", "whole numbers, then not", "a word", "empty, then numbers"],
)
def test_a_large_text_is_read_block_by_block_as_in_one(tmp_path, monkeypatch, changed):
    rows = [changed.get(k, f"{k / 100},{np.sin(k):.4f},{k}") for k in range(2000)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t,q,n", *rows]))
    (whole,) = text.read(path)
    monkeypatch.setattr(text, "_PARSED", 3000)
    (parts,) = text.read(path)
    assert (parts.problems, parts.skipped) == (whole.problems, whole.skipped)
    assert len(whole.problems) == sum(row.count(",") != 2 for row in rows)
    for name, values in whole.values.items():
        assert values.dtype == parts.values[name].dtype
        np.testing.assert_array_equal(parts.values[name], values)
