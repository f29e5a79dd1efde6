"""Delimited text: comma, semicolon, tab or spaces, with or without header, plain or gzipped."""

import csv
import gzip
import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv

from ..unusable import UnreadableLog
from . import STRAY, Columns, check_size
from .arrow import numpy_column

_NULLS = ["", "NaN", "nan", "-nan", "NA", "N/A", "null", "NULL", "None", "none", "-", "--"]
_NULLS += ["#N/A", "#NA", "#NV", "#VALUE!", "#DIV/0!", "#REF!", "#NUM!", "1.#QNAN", "-1.#IND"]
_COMMENT = re.compile(rb"^[ \t]*(?:#|%|//)")
_COMMENT_LINES = re.compile(rb"^[ \t]*(?:#|%|//).*\r?\n?", re.MULTILINE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?:inity)?", re.IGNORECASE)
_DATE = re.compile(r"\d{4}-\d\d-\d\d.*|\d\d:\d\d(?::\d\d.*)?")
_MARKED = re.compile(  # a number with points or commas that fills a field
    rb"(?:^|(?<=[;\t\" ]))[+-]?(\d+[.,][\d.,]*|[.,]\d[\d.,]*)(?:[eE][+-]?\d+)?(?=[;\t\" \r]|$)",
    re.MULTILINE,
)
_LIST = re.compile(r"\s*[\[(][^\[\]()]+[\])]\s*")
_MOST_ENTRIES = 256  # of a list in a field
_SAMPLE = 50  # lines to recognise the dialect, and fewer of more characters than this
_SAMPLE_SIZE = 200_000
_BLOCK = 1 << 20  # bytes to unpack at a time
_PARSED = 1 << 26  # bytes to parse at a time
_LONGEST = 1 << 20  # bytes of a line: some 50 000 columns
_WIDE = (b"\xff\xfe", b"\xfe\xff")  # marks of UTF-16 at the beginning of a file
_MOST_MALFORMED = 0.5  # share of rows beyond which a file is not a table


class Dialect(NamedTuple):
    """The format of a text table."""

    delimiter: str  # one character; runs of blanks count as one space
    decimal: str  # "." or ","
    names: list[str]  # names of the columns
    header: bool  # whether the first line holds the names


def read(path: Path) -> list[Columns]:
    """The columns of a text file.

    Raises:
        UnreadableLog: it is beyond the limit, is not a table of at least one row, has a line of
            more than 1 MB, or leaves open whether points or commas are its decimal marks.
    """
    text = _unpacked(path).removeprefix(b"\xef\xbb\xbf")
    if text.startswith(_WIDE):
        text = text.decode("utf-16", "replace").encode()
    ends = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n"))
    longest = np.diff(ends, prepend=-1, append=len(text)).max()
    if longest > _LONGEST:
        reason = f"a line of it has {longest / 1e6:.3g} MB; a row of a log has less than 1 MB"
        raise UnreadableLog(path, reason, "Export the log as one row for each sample.")
    comments = [line for line in text[:65536].splitlines() if _COMMENT.match(line)]
    if comments:
        text = _COMMENT_LINES.sub(b"", text)
    encoding = "utf-8"
    if not text.isascii():  # spares a copy of a log that may be large
        try:
            text.decode("utf-8")
        except UnicodeDecodeError:
            encoding = "latin-1"
    lines = [line for line in text[: 1 << 20].decode(encoding, "replace").splitlines() if line]
    if not lines or not lines[0].strip():
        raise UnreadableLog(path, "the file has no rows", "Record the log again.")
    lines = lines[: max(5, min(_SAMPLE, _SAMPLE_SIZE // len(lines[0])))]
    dialect = dialect_of(lines, [c.decode(encoding, "replace") for c in comments])
    check_size(path, 8 * text.count(b"\n") * len(dialect.names))
    problems = []
    if b'"' in text:
        text, problems = _without_stray_quotes(text, dialect)
    if dialect.delimiter != ",":
        dialect = dialect._replace(decimal=_decimal(path, text))
    if dialect.delimiter == " ":
        text = re.sub(rb"^[ \t]+|[ \t]+(?=\r?$)", b"", text, flags=re.MULTILINE)
        text = re.sub(rb"[ \t]+", b" ", text)
    return [_parsed(path, text, dialect, encoding, problems)]


def _unpacked(path: Path) -> bytes:
    """The bytes of a file, or those that a gzip file holds.

    A gzip file is unpacked twice, first block by block, so that one beyond the limit takes no
    memory, and any other no more than its known size.
    """
    with path.open("rb") as stream:
        packed = stream.read(2) == b"\x1f\x8b"
    if not packed:
        check_size(path, path.stat().st_size)
        return path.read_bytes()
    with gzip.open(path) as stream:
        size = 0
        while block := stream.read(_BLOCK):
            size += len(block)
            check_size(path, size)
    with gzip.open(path) as stream:
        return stream.read(size)


def _without_stray_quotes(text: bytes, dialect: Dialect) -> tuple[bytes, list[tuple[int, str]]]:
    """A text in which no field reaches beyond its line, and the rows that have lost their quotes.

    A quote that opens a field and is not closed before the next delimiter would swallow what
    follows, even other lines; such a line loses its quotes.
    """
    lines = text.split(b"\n")
    found = []
    row = -int(dialect.header)
    delimiter = re.escape(dialect.delimiter.encode())
    blank = b"" if dialect.delimiter == " " else b" *"
    quoted = rb'%b"[^"]*(?:""[^"]*)*"%b' % (blank, blank)
    field = rb"(?:%b|[^\"%b]*)" % (quoted, delimiter)
    sound = re.compile(rb"%b(?:%b%b)*\r?" % (field, delimiter, field))
    for k, line in enumerate(lines):
        row += bool(line.strip())
        if b'"' in line and not sound.fullmatch(line):
            lines[k] = line.replace(b'"', b"")
            found.append((row, STRAY))
    return (b"\n".join(lines) if found else text), found


def _decimal(path: Path, text: bytes) -> str:
    """The decimal mark of a text whose delimiter is not a comma.

    Raises:
        UnreadableLog: it has only fields like `1,234` and `1.234`.
    """
    if b"," not in text:
        return "."
    seen: dict[bytes, str] = {}
    for found in _MARKED.finditer(text):
        number = found[1]
        last = max(number.rfind(b"."), number.rfind(b","))
        mark = number[last : last + 1]
        other = b"," if mark == b"." else b"."
        whole = number[:last]
        part = number[last + 1 :]
        if mark in whole:  # 1,234,567: a repeated mark groups thousands
            return other.decode()
        if other in whole or len(part) != 3 or not 1 <= len(whole) <= 3 or whole.startswith(b"0"):
            return mark.decode()
        seen[mark] = found[0].decode()
    if len(seen) > 1:
        reason = f"{' and '.join(seen.values())} leave open which mark is the decimal point"
        raise UnreadableLog(path, reason, "Export the log without thousands separators.")
    return "," if b"," in seen else "."


def dialect_of(lines: list[str], comments: list[str]) -> Dialect:
    """Recognises delimiter, decimal mark and header from the first lines, without comments.

    The last of the comment lines is the header if it has as many words as columns.
    """
    delimiter = _delimiter(lines)
    rows = [split(line, delimiter) for line in lines]
    width = Counter(len(row) for row in rows[1:] or rows).most_common(1)[0][0]
    fields = [field for row in rows[1:] or rows for field in row]
    comma = delimiter != "," and any(re.fullmatch(r"[+-]?\d+,\d+", f) for f in fields)
    values = [[_value(f.replace(",", ".") if comma else f) for f in row] for row in rows]
    below = [row for row in values[1:] if len(row) == len(values[0])] or [[True] * len(values[0])]
    header = any(  # a text above values; rows may hold texts too, such as joint names
        not first and sum(column) > 0.5 * len(column)
        for first, column in zip(values[0], zip(*below, strict=True), strict=True)
    )
    names = rows[0] if header else []
    if not header and comments:
        words = split(comments[-1].lstrip(" \t#%/"), delimiter)
        names = words if len(words) == width and not all(map(_value, words)) else []
    if header and len(names) == width - 1:
        names = ["", *names]  # as R and np.savetxt write an unnamed index
    names = [name or f"Unnamed: {k}" for k, name in enumerate(names)]
    names = names or [f"column_{k + 1}" for k in range(width)]
    return Dialect(delimiter, "," if comma else ".", _unique(names), header)


def split(line: str, delimiter: str) -> list[str]:
    """The fields of a line, without quotes and blanks around them."""
    line = line.strip(" \r\n")
    if delimiter == " ":
        line = re.sub("[ \t]+", " ", line).strip()
    if '"' in line:
        (fields,) = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    else:
        fields = line.split(delimiter)
    return [field.strip().strip('"').strip() for field in fields]


def _delimiter(lines: list[str]) -> str:
    """The delimiter that divides the lines most consistently, into more than one field."""
    best = (0.0, 0)
    found = ","
    for delimiter in ("\t", ";", ",", " "):
        widths = Counter(len(split(line, delimiter)) for line in lines)
        width, count = widths.most_common(1)[0]
        if width > 1 and (count / len(lines), 0) > (best[0], 0):
            best = (count / len(lines), width)
            found = delimiter
    return found


def _value(field: str) -> bool:
    """Whether a field is a value, not a name."""
    return field in _NULLS or bool(_NUMBER.fullmatch(field) or _DATE.fullmatch(field))


def _unique(names: list[str]) -> list[str]:
    """Names with `.1`, `.2` … appended to repeated ones."""
    seen: Counter[str] = Counter()
    found: dict[str, None] = {}
    for name in names:
        new = name
        while new in found:
            seen[name] += 1
            new = f"{name}.{seen[name]}"
        found[new] = None
    return list(found)


def _parsed(
    path: Path, text: bytes, dialect: Dialect, encoding: str, problems: list[tuple[int, str]]
) -> Columns:
    bad: list[tuple[int, str]] = []
    first = 1 + int(dialect.header)

    def skip(row: pa.csv.InvalidRow) -> str:
        bad.append(((row.number or 0) - first + 1, f"{row.actual_columns} fields"))
        return "skip"

    def options(block: int) -> tuple[Any, ...]:
        return (
            pa.BufferReader(text),
            pa.csv.ReadOptions(
                use_threads=False,  # row numbers need one thread
                block_size=min(block, 2**31 - 1),
                column_names=dialect.names,
                skip_rows=int(dialect.header),
                encoding=encoding,
            ),
            pa.csv.ParseOptions(delimiter=dialect.delimiter, invalid_row_handler=skip),
            pa.csv.ConvertOptions(
                null_values=_NULLS, strings_can_be_null=True, decimal_point=dialect.decimal
            ),
        )

    try:  # block by block, with the types of the first one
        table = pa.csv.open_csv(*options(_PARSED)).read_all() if len(text) > _PARSED else None
    except pa.ArrowInvalid:
        table = None
    if table is None:  # one block, so that a column's type follows from all its rows
        bad.clear()
        table = pa.csv.read_csv(*options(len(text) + 1))
    if not table.num_rows:
        raise UnreadableLog(path, "the table has no rows", "Record the log again.")
    if len(bad) > _MOST_MALFORMED * (len(bad) + table.num_rows):
        reason = f"{len(bad)} of {len(bad) + table.num_rows} rows do not have {len(dialect.names)} "
        reason += f"fields; the first is row {bad[0][0]} with {bad[0][1]}"
        raise UnreadableLog(path, reason, "Export the log as one table.")
    names = table.column_names
    count = table.num_rows
    columns = table.columns[::-1]
    del table
    values = {name: numpy_column(columns.pop(), dialect.decimal) for name in names}  # frees each
    pa.default_memory_pool().release_unused()
    index = tuple(
        (name, "it has no name, and is empty or counts the rows")
        for name, column in values.items()
        if _index(name, column)
    )
    for name, _ in index:
        del values[name]
    values = {
        own: part for name, column in values.items() for own, part in _entries(name, column).items()
    }
    check_size(path, 8 * count * len(values))
    return Columns(values, None, tuple(sorted([*problems, *bad])), index, len(bad))


def _entries(name: str, column: np.ndarray) -> dict[str, np.ndarray]:
    """A column by name, or `a_0`, `a_1` … of one whose fields are lists, such as `"[0.1, 0.2]"`.

    An empty field is a list of NaN. Lists of different lengths, or not of numbers, stay texts.
    """
    own = {name: column}
    if column.dtype.kind not in "OU" or not len(column):
        return own
    some = [field for field in column[:_SAMPLE] if field]
    if not some or not all(_LIST.fullmatch(field) for field in some):
        return own
    rows = [re.split(r"[,;\s]+", field.strip(" []()")) if field else None for field in column]
    width = len(re.split(r"[,;\s]+", some[0].strip(" []()")))
    if width > _MOST_ENTRIES or any(row is not None and len(row) != width for row in rows):
        return own
    try:
        numbers = np.array([row or [np.nan] * width for row in rows], dtype=np.float64)
    except ValueError:
        return own
    return {f"{name}_{k}": part for k, part in enumerate(numbers.T.copy())}


def _index(name: str, column: np.ndarray) -> bool:
    """Whether a column without a name is empty or counts the rows, as pandas' index does."""
    if not name.startswith("Unnamed: "):
        return False
    if column.dtype.kind not in "fiu":
        return bool(column.dtype.kind in "OU" and not np.any(column != None))  # noqa: E711 (an array)
    if column.dtype.kind == "f":
        return bool(np.isnan(column).all())
    return bool(np.all(np.diff(column.astype(np.int64)) == 1))
