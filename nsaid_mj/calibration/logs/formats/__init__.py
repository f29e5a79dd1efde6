"""File formats of logs: one module for each, chosen by the content of a file.

A module has `recognises(path, head)`, whether a file (or folder) with the given first bytes has its
format, and `read(path)`, its columns. The text format accepts what no other one recognises.
"""

from __future__ import annotations

import importlib
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from contextvars import ContextVar
from pathlib import Path
from typing import NamedTuple, Protocol, cast

import numpy as np

from ....errors import InvalidInput, NsaidError, printable
from ..errors import UnreadableLog

HEAD = 64
"""Number of bytes by which a format is recognised."""

LIMIT = 4.0
"""Largest size of an unpacked file, unless `limited_to` says otherwise [GB]."""

_limit = ContextVar("limit", default=LIMIT * 1e9)

STRAY = "a stray quote"
"""The problem of a row whose quotes were ignored."""

_MOST_SAID = 1 << 20  # characters of a library's output that are examined
_ORDER = ("run", "lerobot", "arrow", "npz", "rosbag", "ulog", "dataflash", "rrd", "text")
_SUFFIXES = (
    *(".csv", ".tsv", ".gz", ".parquet", ".arrow", ".feather", ".npz"),
    *(".bag", ".mcap", ".ulg", ".bin", ".rrd"),
)


class Columns(NamedTuple):
    """Columns of a file that share their rows.

    Attributes:
        values: (N,) arrays by name: real numbers, `datetime64` or strings.
        time: (N,) times [ns], int64; None if the time is one of the columns or unknown.
        problems: rows that could not be read as they are and why; rows are counted from 1 without
            the header.
        dropped: columns, or other parts of the file, that were left out, and why.
        skipped: how many of the rows with problems are not in `values`.
    """

    values: dict[str, np.ndarray]
    time: np.ndarray | None = None
    problems: tuple[tuple[int, str], ...] = ()
    dropped: tuple[tuple[str, str], ...] = ()
    skipped: int = 0


class Format(Protocol):
    """The interface of a module of this folder; `LIBRARY` names the reader in messages."""

    LIBRARY: str

    def recognises(self, path: Path, head: bytes, /) -> bool:
        """Whether a file with these first bytes has the format."""
        ...

    def read(self, path: Path) -> list[Columns]:
        """The file's columns, in groups that share their rows.

        It may raise whatever the library raises; it calls `check_size` before it unpacks.
        """
        ...


def files(path: Path) -> list[Path]:
    """The log files of a folder, ordered by name; a log that is a folder is one."""
    if not path.is_dir() or any(_module(name).recognises(path, b"") for name in _ORDER[:-1]):
        return [path]
    found = sorted(p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file())
    if not found:
        remedy = f"Give a folder with files that end in {', '.join(_SUFFIXES)}."
        raise UnreadableLog(path, "the folder holds no logs", remedy)
    return found


def read(path: Path) -> list[Columns]:
    """Reads a log file of any known format, or a folder: our run, a ROS 2 bag, a LeRobot dataset.

    Whatever a format's library raises becomes `UnreadableLog`, and its output never reaches the
    terminal. Control characters in names are replaced, so that no name can steer a terminal.

    Raises:
        UnreadableLog: there is no such file, or its content is damaged, empty or beyond the limit.
        MissingExtra: the library for its format is not installed.
    """
    if not path.exists():
        raise UnreadableLog(path, "there is no such file", "Check the path.")
    head = b""
    if path.is_file():
        with path.open("rb") as stream:
            head = stream.read(HEAD)
        if not head:
            raise UnreadableLog(path, "the file is empty", "Record the log again.")
    for name in _ORDER:
        candidate = _module(name)
        if candidate.recognises(path, head):
            return _read(candidate, path)
    remedy = "Known are CSV, Parquet, Arrow, npz, ROS bags, MCAP, ULog, DataFlash, LeRobot, Rerun."
    raise UnreadableLog(path, "no known format", remedy)


def _module(name: str) -> Format:
    """A format's module, imported alone: some need an optional library, which most files do not."""
    return cast(Format, importlib.import_module(f"{__name__}.{name}"))


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


def _read(candidate: Format, path: Path) -> list[Columns]:
    """Reads a file with one format; the only boundary to the formats' libraries."""
    try:
        with _output_caught() as output:
            found = candidate.read(path)
    except NsaidError:
        raise
    except Exception as error:  # whatever a library raises on a damaged file
        said = " ".join(printable(str(error)).split())[:200]
        reason = f"{candidate.LIBRARY} cannot read it ({type(error).__name__}: {said})"
        raise UnreadableLog(path, reason, "Record or export the log again.") from error
    # lines with control characters are from our own progress bar, drawn meanwhile
    if said := [line for line in output if line.strip() and line == printable(line)]:
        about = (candidate.LIBRARY, f"its first of {len(said)} messages is: {said[0][:200]}")
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
