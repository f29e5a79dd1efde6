"""A sweep's folder while it is written: locked, resumed, and appended to row by row."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from ..bounds import without_nonfinite
from ..errors import BadRun, NotWritten
from ..resources import atomic_write, check_own, locked, told, write_json
from .sweep_results import MANIFEST, ROWS, Row, read_manifest, read_rows, write_table


class Rows:
    """The rows of a sweep on disk.

    Attributes:
        known: rows that an earlier call has written, by run number.
    """

    def __init__(self, path: Path, known: dict[int, Row], stream: BinaryIO):
        self.known, self._path, self._stream = known, path, stream

    def append(self, row: Row) -> None:
        """Appends a row and waits until it is on the disk.

        Raises:
            NotWritten: the disk is full; the rows before are kept.
        """
        line = (
            json.dumps(without_nonfinite(row), ensure_ascii=False, allow_nan=False) + "\n"
        ).encode()
        remedy = "Make room on the disk; the same command then resumes"
        with told(self._path, remedy):
            if self._stream.write(line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._stream.fileno())


@contextmanager
def opened(
    folder: Path, manifest: dict[str, Any], say: Callable[[str], object] = print
) -> Iterator[Rows]:
    """Creates a sweep's folder, or reads what an earlier run of the same plan wrote.

    The folder is locked within the context; at its end the table of all rows is written.

    Args:
        folder: of the sweep.
        manifest: see `Plan.manifest`.
        say: called with a line about damaged rows, which are made again.

    Raises:
        FolderInUse: another process is writing into the folder.
        NotWritten: the folder cannot be written.
        BadRun: it holds another sweep, or rows of which nothing is known.
    """
    check_own(folder, (MANIFEST, ROWS))
    with locked(folder):
        rows = folder / ROWS
        known = _resumed(folder, manifest, say)
        with told(rows):
            flags = os.O_WRONLY | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
            descriptor = os.open(rows, flags)
        try:
            with os.fdopen(descriptor, "ab", buffering=0) as stream:
                yield Rows(rows, known, stream)
        except BaseException:
            with suppress(NotWritten, BadRun):  # the error that is on its way says more
                write_table(folder)
            raise
        write_table(folder)


def _resumed(
    folder: Path, manifest: dict[str, Any], say: Callable[[str], object]
) -> dict[int, Row]:
    """The rows of a sweep that exists; of a new one, creates the files."""
    rows = folder / ROWS
    wanted = json.loads(json.dumps(manifest))
    if not (folder / MANIFEST).is_file() and not (rows.is_file() and rows.stat().st_size):
        write_json(folder / MANIFEST, manifest)
        with atomic_write(rows):
            return {}
    there = read_manifest(folder)
    differ = [key for key in wanted if key != "arguments" and wanted[key] != there.get(key)]
    if differ:
        raise BadRun(
            folder,
            f"it holds another sweep; {', '.join(differ)} differ",
            "Give another folder with --out, or delete this one",
        )
    if not (folder / MANIFEST).is_file():
        write_json(folder / MANIFEST, there)
    found = read_rows(folder, there)
    if found.damaged:
        say(f"{found.words}; they are made again")
    if not rows.is_file() or found.intact != rows.read_bytes():
        with atomic_write(rows) as partial:  # without damaged and incomplete lines
            partial.write_bytes(found.intact)
    return found.rows
