"""Files: paths of scenarios and assets, atomic writes, and locks of folders.

Scenarios and assets are beside the package in a checkout, inside it in a wheel.
"""

import errno
import json
import os
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import BadRun, FolderInUse, NotWritten
from .inputs import path_of, wrote
from .signatures import check_replaceable, sign, unused

RECORDING = "run.rrd"
"""File of a run's recording."""
RECORD = "record.arrow"
"""File of a run's record."""


def record_file(path: Path) -> Path:
    """The record in a run's folder, or the record file itself; raises `BadRun` if there is none."""
    file = path / RECORD if path_of(path).is_dir() else path
    if not file.is_file():
        raise BadRun(path, f"there is no {RECORD}", "Give the folder that a run has written")
    return file


def json_of(text: str | bytes) -> Any:
    """The value of a JSON text; raises `ValueError` if it is not JSON, or nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("thousands of values inside each other") from error


def print_json(value: Any) -> None:
    """Prints a value as strict JSON; numbers that are not finite become null."""
    from .bounds import without_nonfinite  # pydantic takes a fifth of a second

    plain = without_nonfinite(value)
    print(json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False), flush=True)


def write_json(path: Path, value: Any) -> None:
    """Writes a value as JSON, atomically.

    Raises:
        ValueError: a number is NaN or infinite.
        NotWritten: the file cannot be written.
    """
    write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Writes text as UTF-8, atomically; halves of surrogate pairs, as in odd names, become `?`.

    Raises:
        NotWritten: the file cannot be written.
    """
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8", errors="replace")


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yields a temporary path to write to; on exit the file is synced and renamed to `path`.

    A reader sees either the old file or the complete new one. If writing fails, the temporary file
    is deleted.

    Raises:
        NotWritten: the operating system refuses to write.
    """
    with writing(path):
        check_replaceable(path)
        partial = unused(path)
        try:
            yield partial
            with partial.open("rb") as stream:
                os.fsync(stream.fileno())
            sign(path, partial)
            partial.replace(path)
            wrote(path)
        finally:
            with suppress(OSError):  # of a folder that is gone
                partial.unlink(missing_ok=True)


def check_own(folder: Path, results: Sequence[str], remedy: str | None = "") -> None:
    """Checks, before any work, that a command may write its files into a folder.

    The folder may be missing, or hold hidden files. Of the names of `results`, what is there must
    be ours by its content; other files may be there only beside such results. `remedy` is an
    alternative to another folder, and None if the user wants to write among other files.

    Raises:
        BadRun: a file would be lost, or the folder holds other files only.
    """
    try:  # new/../old is `old` once new is made
        real = folder.resolve()
        there = {path.name for path in real.iterdir()}
    except (OSError, RuntimeError):  # of a folder that is missing, a file, or a link to itself
        return
    for name in sorted(there & set(results)):
        try:
            check_replaceable(real / name)
        except NotWritten as error:
            holds = f"it holds other files, such as {name}: {error.reason}"
            raise NotWritten(folder, holds, error.remedy) from error
    others = [name for name in there if not name.startswith(".")]
    if remedy is not None and others and not there & set(results):
        raise BadRun(
            folder,
            f"it holds other files, such as {min(others)}",
            f"Give another folder with --out{remedy}",
        )


def create(path: Path) -> None:
    """Creates an empty file in place of one of ours, without following a symbolic link.

    Raises:
        NotWritten: the file that is there was read by this command, or is not ours.
    """
    discard(path)
    flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0)
    os.close(os.open(path, flags, 0o666))


def discard(path: Path) -> None:
    """Deletes a file of ours, if there is one.

    Raises:
        NotWritten: the file that is there was read by this command, or is not ours.
    """
    check_replaceable(path)
    path.unlink(missing_ok=True)


@contextmanager
def writing(path: Path, remedy: str = "") -> Iterator[None]:
    """Context in which an error of the operating system, while writing to a path, is `NotWritten`.

    The default remedy depends on the error.
    """
    try:
        yield
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        remedy = remedy or (
            "Make room on the disk, or give another folder with --out"
            if full
            else "Give another folder, with --out"
        )
        reason = error.strerror or str(error)
        raise NotWritten(path, f"it cannot be written: {reason}", remedy) from error


# -- folders that only one run writes into -----------------------------------------------------

_held: dict[tuple[int, int], int] = {}  # thread that holds a folder, by device and inode


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Creates a folder if missing, and keeps other processes and threads from writing into it.

    The lock is advisory: it excludes only callers of this function. The operating system releases
    it when the process ends for any reason. The same thread may lock a folder again. Folders that
    were created and are still empty at the end are removed.

    Raises:
        FolderInUse: another process or thread holds the folder.
        NotWritten: the folder cannot be created, or is not a folder.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        status = folder.stat()
    key = (status.st_dev, status.st_ino)
    thread = threading.get_ident()
    if _held.get(key) == thread:
        yield
        return
    if _held.setdefault(key, thread) != thread:
        raise FolderInUse(folder)
    try:
        descriptor = _flock(folder)
        try:
            yield
        finally:
            if descriptor is not None:
                os.close(descriptor)
    finally:
        del _held[key]
        with suppress(OSError):  # not empty
            for path in missing:
                path.rmdir()


def _flock(folder: Path) -> int | None:
    """A descriptor that holds the lock of a folder; None where folders cannot be locked."""
    from filelock import lock_descriptor  # imported late: most commands answer without a lock

    if os.name == "nt":  # it has no descriptors of folders
        return None
    with writing(folder):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        free = lock_descriptor(descriptor, blocking=False)
    except OSError:  # a file system without locks
        os.close(descriptor)
        return None
    if not free:
        os.close(descriptor)
        raise FolderInUse(folder)
    return descriptor


# -- robots by name ----------------------------------------------------------------------------
