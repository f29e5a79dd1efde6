"""File formats of logs: one module for each, chosen by the content of a file.

A module has `read(path)`: the file's columns, in groups that share their rows. It may raise any
exception of its library, an `ImportError` if that is not installed; it calls `check_size` before
unpacking.
"""

import importlib
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from contextvars import ContextVar
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ....base import InputFile, InvalidInput, NsaidError, OutputFolder, printable
from ..unusable import MissingExtra, UnreadableLog

LIMIT = 4.0
"""Largest size of an unpacked file, unless `limited_to` says otherwise [GB]."""

_limit = ContextVar("limit", default=LIMIT * 1e9)

STRAY = "a stray quote"
"""The problem of a row whose quotes were ignored."""

_MOST_SAID = 1 << 20  # characters of a library's output that are examined
_SUFFIXES = (
    *(".csv", ".tsv", ".gz", ".parquet", ".arrow", ".feather", ".npz", ".mat", ".json", ".jsonl"),
    *(".bag", ".mcap", ".ulg", ".bin", ".rrd"),
)


class Columns(NamedTuple):
    """Columns of a file that share their rows."""

    values: dict[str, np.ndarray]  # (N,) arrays by name: real numbers, `datetime64` or strings
    time: np.ndarray | None = None  # (N,) [ns], int64; None if it is one of the columns or unknown
    # rows that could not be read literally, and why; rows are counted from 1 without the header
    problems: tuple[tuple[int, str], ...] = ()
    dropped: tuple[tuple[str, str], ...] = ()  # columns or parts that were skipped, and why
    skipped: int = 0  # how many of the rows with problems are not in `values`


class Format(NamedTuple):
    """A file format."""

    name: str  # name of its module, which is imported for files of this format alone
    library: str  # that reads it, for messages
    heads: tuple[bytes, ...] = ()  # first bytes of a file
    inside: str = ""  # name of the file by which a folder is one log; "" if none is
    extra: str = ""  # the optional dependency with the library; "" if it is always there

    def recognises(self, path: Path, head: bytes = b"") -> bool:
        """Whether a file with these first bytes, or a folder, has this format."""
        named = self.inside and (path.name == self.inside or (path / self.inside).is_file())
        return bool(named) or head.startswith(self.heads)


_BAGS = (b"#ROSBAG V", b"\x89MCAP0\r\n", b"SQLite format 3\x00")
FORMATS = (
    Format("run", "Arrow", inside=OutputFolder.RECORD),
    Format("lerobot", "Arrow", inside="meta/info.json"),
    Format("arrow", "Arrow", (b"PAR1", b"ARROW1", b"\xff\xff\xff\xff")),
    Format("npz", "NumPy", (b"PK\x03\x04",)),
    Format("mat", "SciPy", (b"MATLAB",)),
    Format("json", "the reader of JSON", (b"{", b"[{", b"[ ", b"[\n", b"[\r", b"\xef\xbb\xbf{")),
    Format("rosbag", "rosbags", _BAGS, inside="metadata.yaml", extra="ros"),
    Format("ulog", "pyulog", (b"ULog\x01\x12\x35",), extra="ulog"),
    Format("dataflash", "pymavlink", (b"\xa3\x95\x80",), extra="dataflash"),
    Format("rrd", "Rerun", (b"RRF",), extra="view"),
)
TEXT = Format("text", "the reader of text tables", (b"\x1f\x8b", b"\xff\xfe", b"\xfe\xff"))
"""Of a gzip file, of UTF-16, and of any other without a byte 0 that no other format recognises."""


def files(path: Path) -> list[Path]:
    """The log files of a folder, ordered by name; a log that is a folder is one."""
    if not path.is_dir() or any(form.recognises(path) for form in FORMATS):
        return [path]
    found = sorted(p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file())
    if not found:
        remedy = f"Give a folder with files that end in {', '.join(_SUFFIXES)}."
        raise UnreadableLog(path, "the folder holds no logs", remedy)
    return found


def read(path: Path) -> list[Columns]:
    """Reads a log file of any known format, or a folder: our run, a ROS 2 bag, a LeRobot dataset.

    Any exception of a format's library becomes `UnreadableLog`, and its output is kept from the
    terminal. Control characters in names are replaced, so that no name can control a terminal.

    Raises:
        UnreadableLog: there is no such file, or its content is damaged, empty or beyond the limit.
        MissingExtra: the library for its format is not installed.
    """
    return _read(form_of(path), path)


def form_of(path: Path) -> Format:
    """The format of a log file, or of a folder that is a log, by its first bytes.

    Raises:
        UnreadableLog: there is no such file, or it is empty or of no known format.
    """
    if not path.exists():
        raise UnreadableLog(path, "there is no such file", "Check the path.")
    head = b""
    folder = path.is_dir()
    inside = (
        [file for file in path.rglob("*") if file.exists() and not file.is_dir()]
        if folder
        else [path]
    )
    try:
        for file in inside:
            InputFile(file).check()
        if not folder:
            with InputFile(path).opened() as stream:
                head = stream.read(64)
    except OSError as error:
        reason = f"{error.filename}: {error.strerror}" if folder else f"{error.strerror}"
        raise UnreadableLog(path, reason, "Give readable, regular files.") from error
    if not folder and not head:
        raise UnreadableLog(path, "the file is empty", "Record the log again.")
    found = next((form for form in (*FORMATS, TEXT) if form.recognises(path, head)), None)
    if found is not None or (path.is_file() and b"\x00" not in head):
        return found or TEXT
    remedy = "Known are CSV, JSON, Parquet, Arrow, npz, MATLAB, ROS bags, MCAP, ULog, DataFlash, "
    remedy += "LeRobot and Rerun."
    raise UnreadableLog(path, "no known format", remedy)


@contextmanager
def limited_to(size: float) -> Iterator[None]:
    """Context that limits every unpacked file to `size` bytes; `InvalidInput` unless size > 0."""
    if not size > 0:
        raise InvalidInput("limit", "a positive number of GB", size / 1e9, "Such as 8.")
    token = _limit.set(size)
    try:
        yield
    finally:
        _limit.reset(token)


def check_size(path: Path, size: int) -> None:
    """Raises `UnreadableLog` if a file's unpacked size so far [bytes] exceeds the limit."""
    limit = _limit.get()
    if size > limit:
        raise UnreadableLog(
            path,
            f"unpacked it holds {size / 1e9:.3g} GB or more, above the limit of {limit / 1e9:g} GB",
            f"Cut the log into parts, or give --limit {1.01 * size / 1e9:.3g} or more.",
        )


def _read(form: Format, path: Path) -> list[Columns]:
    """Reads a file with one format; the only boundary to the formats' libraries."""
    try:
        with _output_caught() as output:
            found = importlib.import_module(f"{__name__}.{form.name}").read(path)
    except NsaidError:
        raise
    except ImportError as error:
        raise MissingExtra(path, form.extra) from error
    except Exception as error:  # whatever a library raises on a damaged file
        said = " ".join(printable(str(error)).split())[:200]
        reason = f"{form.library} cannot read it ({type(error).__name__}: {said})"
        remedy = "If other programs can read it, convert it to CSV or Parquet; else it is damaged: "
        remedy += "record or export it again."
        raise UnreadableLog(path, reason, remedy) from error
    # lines with control characters are from our own progress bar, drawn meanwhile
    if said := [line for line in output if line.strip() and line == printable(line)]:
        about = (form.library, f"its first of {len(said)} messages is: {said[0][:200]}")
        found[0] = found[0]._replace(dropped=(*found[0].dropped, about))
    return [
        group._replace(values={printable(name): column for name, column in group.values.items()})
        for group in found
    ]


@contextmanager
def _output_caught() -> Iterator[list[str]]:
    """Context that keeps all output of libraries, C libraries included, from the terminal.

    Yields the printed lines once it has ended.
    """
    lines: list[str] = []
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    kept = [os.dup(number) for number in (1, 2)]
    try:
        with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as sink:
            for number in (1, 2):
                os.dup2(sink.fileno(), number)
            try:
                with redirect_stdout(sink), redirect_stderr(sink):
                    yield lines
            finally:
                for number, own in zip((1, 2), kept, strict=True):
                    os.dup2(own, number)
            sink.flush()
            sink.seek(0)
            lines += sink.read(_MOST_SAID).splitlines()
    finally:
        for own in kept:
            os.close(own)
