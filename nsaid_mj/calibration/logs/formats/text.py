"""Delimited text: comma, semicolon, tab or spaces, with or without header, plain or gzipped."""

from __future__ import annotations

import gzip
import io
import re
import zlib
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv

from ..errors import UnreadableLog
from . import Columns
from .arrow import numpy_column

_NULLS = ["", "NaN", "nan", "NA", "N/A", "null", "NULL", "None", "none", "-", "--"]
_COMMENT = re.compile(rb"^[ \t]*(?:#|%|//)")
_COMMENT_LINES = re.compile(rb"^[ \t]*(?:#|%|//).*\r?\n?", re.MULTILINE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?:inity)?", re.IGNORECASE)
_DATE = re.compile(r"\d{4}-\d\d-\d\d.*|\d\d:\d\d(?::\d\d.*)?")
_SAMPLE = 50  # lines by which the dialect is recognised


class Dialect(NamedTuple):
    """How a text is to be read.

    Attributes:
        delimiter: one character; runs of blanks count as one space.
        decimal: "." or ",".
        names: of the columns.
        header: whether the first line holds the names.
    """

    delimiter: str
    decimal: str
    names: list[str]
    header: bool


def recognises(path: Path, head: bytes) -> bool:
    """Whether it is text or a gzip file; UTF-16 and other binary data are not."""
    return path.is_file() and (head.startswith(b"\x1f\x8b") or b"\x00" not in head)


def read(path: Path) -> list[Columns]:
    """The columns of a text file.

    Raises:
        UnreadableLog: it is damaged, or is no table of at least one row.
    """
    try:
        data = path.read_bytes()
        text = gzip.decompress(data) if data.startswith(b"\x1f\x8b") else data
    except (OSError, EOFError, zlib.error) as error:
        raise UnreadableLog(path, f"unreadable ({error})", "Copy the file again.") from error
    text = text.removeprefix(b"\xef\xbb\xbf")
    comments = [line for line in text[:65536].splitlines() if _COMMENT.match(line)]
    if comments:
        text = _COMMENT_LINES.sub(b"", text)
    encoding = _encoding(text)
    lines = [line for line in text[: 1 << 20].decode(encoding, "replace").splitlines() if line]
    if not lines or not lines[0].strip():
        raise UnreadableLog(path, "the file has no rows", "Record the log again.")
    dialect = dialect_of(lines[:_SAMPLE], [c.decode(encoding, "replace") for c in comments])
    if dialect.delimiter == " ":
        text = re.sub(rb"^[ \t]+|[ \t]+(?=\r?$)", b"", text, flags=re.MULTILINE)
        text = re.sub(rb"[ \t]+", b" ", text)
    return [_parsed(path, text, dialect, encoding)]


def dialect_of(lines: list[str], comments: list[str]) -> Dialect:
    """Recognises delimiter, decimal mark and header.

    Args:
        lines: the first lines, without comments.
        comments: comment lines; the last one is the header if it has as many words as columns.
    """
    delimiter = _delimiter(lines)
    rows = [split(line, delimiter) for line in lines]
    width = Counter(len(row) for row in rows[1:] or rows).most_common(1)[0][0]
    fields = [field for row in rows[1:] or rows for field in row]
    comma = delimiter != "," and any(re.fullmatch(r"[+-]?\d+,\d+", f) for f in fields)
    values = [[_value(f.replace(",", ".") if comma else f) for f in row] for row in rows]
    below = [row for row in values[1:] if len(row) == len(values[0])] or [[True] * len(values[0])]
    header = any(  # a text above values; rows may hold texts too, such as names of joints
        not first and sum(column) > 0.5 * len(column)
        for first, column in zip(values[0], zip(*below, strict=True), strict=True)
    )
    names = rows[0] if header else []
    if not header and comments:
        words = split(comments[-1].lstrip(" \t#%/"), delimiter)
        names = words if len(words) == width and not all(map(_value, words)) else []
    if header and len(names) == width - 1:
        names = ["", *names]  # as R and np.savetxt write an index without a name
    names = [name or f"Unnamed: {k}" for k, name in enumerate(names)]
    names = names or [f"column_{k + 1}" for k in range(width)]
    return Dialect(delimiter, "," if comma else ".", _unique(names), header)


def split(line: str, delimiter: str) -> list[str]:
    """The fields of a line, without quotes and blanks around them."""
    blank = r"[ \t]+" if delimiter == " " else rf"[ \t]*{re.escape(delimiter)}[ \t]*"
    if delimiter == "\t":
        blank = r" *\t *"
    outside = rf'{blank}(?=(?:[^"]*"[^"]*")*[^"]*$)'
    return [field.strip().strip('"').strip() for field in re.split(outside, line.strip(" \r\n"))]


def _delimiter(lines: list[str]) -> str:
    """The delimiter that divides the lines most consistently, into more than one field."""
    best, found = (0.0, 0), ","
    for delimiter in ("\t", ";", ",", " "):
        widths = Counter(len(split(line, delimiter)) for line in lines)
        width, count = widths.most_common(1)[0]
        if width > 1 and (count / len(lines), 0) > (best[0], 0):
            best, found = (count / len(lines), width), delimiter
    return found


def _value(field: str) -> bool:
    """Whether a field is a value rather than a name."""
    return field in _NULLS or bool(_NUMBER.fullmatch(field) or _DATE.fullmatch(field))


def _unique(names: list[str]) -> list[str]:
    """Names with `.1`, `.2` … appended to repeated ones."""
    seen: Counter[str] = Counter()
    found = []
    for name in names:
        found.append(f"{name}.{seen[name]}" if seen[name] else name)
        seen[name] += 1
    return found


def _encoding(text: bytes) -> str:
    try:
        text[: 1 << 16].decode("utf-8")
    except UnicodeDecodeError as error:
        return "utf-8" if error.start > (1 << 16) - 4 else "latin-1"
    return "utf-8"


def _parsed(path: Path, text: bytes, dialect: Dialect, encoding: str) -> Columns:
    bad: list[tuple[int, str]] = []

    def skip(row: pa.csv.InvalidRow) -> str:
        bad.append((row.number or 0, f"{row.actual_columns} fields"))
        return "skip"

    try:
        table = pa.csv.read_csv(
            io.BytesIO(text),
            # one block, so that a column's type follows from all its rows; row numbers need one
            # thread
            pa.csv.ReadOptions(
                use_threads=False,
                block_size=min(len(text) + 1, 2**31 - 1),
                column_names=dialect.names,
                skip_rows=int(dialect.header),
                encoding=encoding,
            ),
            pa.csv.ParseOptions(delimiter=dialect.delimiter, invalid_row_handler=skip),
            pa.csv.ConvertOptions(
                null_values=_NULLS,
                strings_can_be_null=True,
                decimal_point=dialect.decimal,
            ),
        )
    except pa.ArrowInvalid as error:
        raise UnreadableLog(path, f"not a table ({error})", "Export it as CSV again.") from error
    if not table.num_rows:
        raise UnreadableLog(path, "the table has no rows", "Record the log again.")
    values = {name: numpy_column(table.column(name)) for name in table.column_names}
    kept = {name: column for name, column in values.items() if not _index(name, column)}
    first = 1 + int(dialect.header)
    return Columns(kept, None, tuple((row - first + 1, why) for row, why in bad))


def _index(name: str, column: np.ndarray) -> bool:
    """Whether a column without a name is empty or counts the rows, as pandas' index does."""
    if not name.startswith("Unnamed: "):
        return False
    if column.dtype.kind not in "fiu":
        return bool(column.dtype.kind in "OU" and not np.any(column != None))  # noqa: E711 (an array)
    if column.dtype.kind == "f":
        return bool(np.isnan(column).all())
    return bool(np.all(np.diff(column.astype(np.int64)) == 1))
