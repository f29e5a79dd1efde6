"""File formats of logs: one module for each, chosen by the content of a file.

A module has `recognises(path, head)`, whether a file (or folder) with the given first bytes has its
format, and `read(path)`, its columns. The text format accepts what no other one recognises.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import NamedTuple, Protocol, cast

import numpy as np

from ..errors import UnreadableLog

HEAD = 64
"""Number of bytes by which a format is recognised."""

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
        problems: rows that could not be read and why; rows are counted from 1 without the header.
    """

    values: dict[str, np.ndarray]
    time: np.ndarray | None = None
    problems: tuple[tuple[int, str], ...] = ()


class Format(Protocol):
    """What a module of this folder offers."""

    def recognises(self, path: Path, head: bytes, /) -> bool:
        """Whether a file with these first bytes has the format."""
        ...

    def read(self, path: Path) -> list[Columns]:
        """The file's columns, in groups that share their rows."""
        ...


def files(path: Path) -> list[Path]:
    """The log files of a folder in the order of their names; a log that is a folder is one."""
    if not path.is_dir() or any(_module(name).recognises(path, b"") for name in _ORDER[:-1]):
        return [path]
    found = sorted(p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file())
    if not found:
        remedy = f"Give a folder with files that end in {', '.join(_SUFFIXES)}."
        raise UnreadableLog(path, "the folder holds no logs", remedy)
    return found


def read(path: Path) -> list[Columns]:
    """Reads a log file of any known format.

    Args:
        path: of a file, or of a folder (a run of ours, a ROS 2 bag, a LeRobot dataset).

    Raises:
        UnreadableLog: there is no such file, or its content is damaged or empty.
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
            return candidate.read(path)
    remedy = "Known are CSV, Parquet, Arrow, npz, ROS bags, MCAP, ULog, DataFlash, LeRobot, Rerun."
    raise UnreadableLog(path, "no known format", remedy)


def _module(name: str) -> Format:
    """A format, imported alone: some need an optional library, and most files need none of them."""
    return cast(Format, importlib.import_module(f"{__name__}.{name}"))
