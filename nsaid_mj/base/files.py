"""Files that are written: JSON, the files of a run, atomic writes, and locks of folders."""

import json
import os
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import BadRun, FolderInUse, NotWritten
from .inputs import LARGEST_TEXT, path_of, read_bytes, wrote
from .signatures import check_replaceable, is_ours, sign, unused


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


class OutputFile:
    """A file that this package writes: only in place of one of ours, which it signs.

    Attributes:
        path: where it is.
    """

    def __init__(self, path: Path):
        self.path = path

    def write_json(self, value: Any) -> None:
        """Writes a value as JSON, atomically.

        Raises:
            ValueError: a number is NaN or infinite.
            NotWritten: the file cannot be written.
        """
        text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
        self.write_text(text + "\n")

    def write_text(self, text: str) -> None:
        """Writes text as UTF-8, atomically; halves of surrogate pairs, as in odd names, become `?`.

        Raises:
            NotWritten: the file cannot be written.
        """
        with self.atomically() as partial:
            partial.write_text(text, encoding="utf-8", errors="replace")

    @contextmanager
    def atomically(self) -> Iterator[Path]:
        """Yields a temporary path to write to; on exit the file is synced, and renamed to ours.

        A reader sees either the old file or the complete new one. If writing fails, the temporary
        file is deleted.

        Raises:
            NotWritten: the operating system refuses to write.
        """
        with NotWritten.on_failure(self.path):
            check_replaceable(self.path)
            partial = unused(self.path)
            try:
                yield partial
                with partial.open("rb") as stream:
                    os.fsync(stream.fileno())
                sign(self.path, partial)
                partial.replace(self.path)
                wrote(self.path)
            finally:
                with suppress(OSError):  # of a folder that is gone
                    partial.unlink(missing_ok=True)

    def create(self) -> None:
        """Creates it empty, in place of one of ours, without following a symbolic link.

        Raises:
            NotWritten: the file that is there was read by this command, or is not ours.
        """
        self.discard()
        flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0)
        os.close(os.open(self.path, flags, 0o666))

    def discard(self) -> None:
        """Deletes it, if it is there.

        Raises:
            NotWritten: the file that is there was read by this command, or is not ours.
        """
        check_replaceable(self.path)
        self.path.unlink(missing_ok=True)

    @property
    def is_ours(self) -> bool:
        """Whether it is empty, names us as its maker, or has a content that was signed."""
        return is_ours(self.path)

    def sign(self) -> None:
        """Records that its content is ours, such as rows that were appended to it."""
        sign(self.path)

    def read(self, most: int = LARGEST_TEXT) -> bytes:
        """Its content; it does not count as read, so that it may be replaced later.

        Raises:
            OSError: it cannot be read, is no regular file, or has more than `most` bytes.
        """
        return read_bytes(self.path, most)


class OutputFolder:
    """A folder that a command writes its results into.

    Attributes:
        path: where it is.
        RECORD: name of a run's record in its folder.
        RECORDING: name of the recording of a run or an identification.
    """

    RECORD = "record.arrow"
    RECORDING = "run.rrd"

    def __init__(self, path: Path):
        self.path = path

    def record_file(self) -> Path:
        """The record in a run's folder; if the path is not a folder's, it is the record's own.

        Raises:
            BadRun: there is none.
        """
        file = self.path / self.RECORD if path_of(self.path).is_dir() else self.path
        if not file.is_file():
            raise BadRun(
                self.path, f"there is no {self.RECORD}", "Give the folder that a run has written"
            )
        return file

    def check(self, results: Sequence[str], remedy: str | None = "") -> None:
        """Checks, before any work, that a command may write its files into it.

        It may be missing, or hold hidden files. Of the names of `results`, what is there must be
        ours by its content; other files may be there only beside such results. `remedy` is an
        alternative to another folder, and None if the user wants to write among other files.

        Raises:
            BadRun: a file would be lost, or the folder holds other files only.
        """
        try:  # new/../old is `old` once new is made
            real = self.path.resolve()
            there = {path.name for path in real.iterdir()}
        except (OSError, RuntimeError):  # of a folder that is missing, a file, or a link to itself
            return
        for name in sorted(there & set(results)):
            try:
                check_replaceable(real / name)
            except NotWritten as error:
                holds = f"it holds other files, such as {name}: {error.reason}"
                raise NotWritten(self.path, holds, error.remedy) from error
        others = [name for name in there if not name.startswith(".")]
        if remedy is not None and others and not there & set(results):
            raise BadRun(
                self.path,
                f"it holds other files, such as {min(others)}",
                f"Give another folder with --out{remedy}",
            )

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Creates it if missing, and keeps other processes and threads from writing into it.

        The lock is advisory: it excludes only callers of this method. The operating system releases
        it when the process ends for any reason. The same thread may lock a folder again. Folders
        that were created and are still empty at the end are removed.

        Raises:
            FolderInUse: another process or thread holds the folder.
            NotWritten: the folder cannot be created, or is not a folder.
        """
        missing = [path for path in (self.path, *self.path.parents) if not path.exists()]
        with NotWritten.on_failure(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
            status = self.path.stat()
        key = (status.st_dev, status.st_ino)
        thread = threading.get_ident()
        if _held.get(key) == thread:
            yield
            return
        if _held.setdefault(key, thread) != thread:
            raise FolderInUse(self.path)
        try:
            descriptor = _flock(self.path)
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


_held: dict[tuple[int, int], int] = {}  # thread that holds a folder, by device and inode


def _flock(folder: Path) -> int | None:
    """A descriptor that holds the lock of a folder; None where folders cannot be locked."""
    from filelock import lock_descriptor  # imported late: most commands answer without a lock

    if os.name == "nt":  # it has no descriptors of folders
        return None
    with NotWritten.on_failure(folder):
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
