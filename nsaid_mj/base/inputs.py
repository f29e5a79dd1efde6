"""Files that are read: regular ones of bounded size, which the same command never replaces.

Everything that is opened is opened here, or checked here before a library opens it.
"""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from .errors import InvalidInput

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

LARGEST_TEXT = 64 << 20
"""Largest file of text that is read as a whole [bytes]: maps, limits, sheets, models, summaries."""
LARGEST_FILE = 1 << 40
"""Largest file that a library may open; a log's own limit is that of its unpacked size."""

_Options = TypeVar("_Options", bound="DataclassInstance")
_Key = tuple[int, int]  # device and inode: one file, by whatever path, link or mount

_read: list[set[_Key]] = []  # files read, for each `InputFile.reading` around it
_written: list[set[_Key]] = []  # files that it wrote itself: read again, they are no inputs


def path_of(text: str | os.PathLike[str]) -> Path:
    """A path with the home directory in place of a leading `~`, if there is such a user.

    Raises:
        InvalidInput: the operating system does not accept such a path, or it is a link to itself.
    """
    path = Path(text)
    with suppress(RuntimeError):  # of a file that is called ~.csv
        path = path.expanduser()
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:  # a name of 300 letters, a folder that may not be read
        name = str(path) if len(str(path)) <= 60 else f"{str(path)[:60]}…"
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidInput(
            "path", "the name of a file", f"{name}: {reason}", "Correct it."
        ) from error
    return path


def with_homes(options: _Options) -> _Options:
    """A command's options with `path_of` of every path among them, and of words with a leading `~`.

    Raises:
        InvalidInput: the operating system does not accept one of the paths.
    """

    def whole(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(whole, value))
        if isinstance(value, str) and value.startswith("~"):  # a model may be a name or a path
            return str(path_of(value))
        return path_of(value) if isinstance(value, Path) else value

    given = {field.name: getattr(options, field.name) for field in fields(options)}
    return replace(options, **{name: whole(value) for name, value in given.items()})


def wrote(path: Path) -> None:
    """Says that the current command wrote the file at a path, which it may read and write again."""
    for files in _written:
        files.add(_key(path.stat()))


def was_read(path: Path) -> bool:
    """Whether the current command has read the file at a path, or the one that it links to."""
    keys = set[_Key]()
    for status in (os.stat, os.lstat):
        with suppress(OSError):
            keys.add(_key(status(path)))
    return any(keys & files for files in _read)


class InputFile:
    """A file of the user's, which no command that reads it replaces.

    Attributes:
        path: where it is.
    """

    def __init__(self, path: Path):
        self.path = path

    def check(self, text: bool = False) -> None:
        """Checks it before a library opens it; it then counts as read.

        Raises:
            OSError: it is missing, no regular file, or larger than a log (or a `text`) can be. A
                pipe or a device would be waited for or read without end.
        """
        _count(self.path, LARGEST_TEXT if text else LARGEST_FILE)

    def opened(self) -> BufferedReader:
        """Opened for reading, without waiting for a pipe's writer; it does not yet count as read.

        Raises:
            OSError: it cannot be read, is no regular file, or is larger than a log can be.
        """
        return opened_file(self.path)

    def read(self, most: int = LARGEST_TEXT) -> bytes:
        """Its content; it then counts as read.

        Raises:
            OSError: it cannot be read, is no regular file, or has more than `most` bytes.
        """
        _count(self.path, most)
        return read_bytes(self.path, most)

    @staticmethod
    @contextmanager
    def reading(*paths: str | Path | None) -> Iterator[None]:
        """Context in which no file that is read is replaced, however its path is written.

        Args:
            paths: files that count as read from the beginning; others are ignored.
        """
        files = set[_Key]()
        for path in filter(None, paths):
            with suppress(OSError, ValueError):
                files.add(_key(os.stat(path)))
        _read.append(files)
        _written.append(set())
        try:
            yield
        finally:
            _read.pop()
            _written.pop()


def _count(path: Path, most: int) -> None:
    """Counts a file as read; raises `OSError` unless it is regular and has at most `most` bytes."""
    status = os.stat(path)
    _check(path, status, most)
    key = _key(status)
    if not any(key in files for files in _written):
        for files in _read:
            files.add(key)


def read_bytes(path: Path, most: int = LARGEST_TEXT) -> bytes:
    """The content of a file, such as one of our own that may be replaced later.

    Raises:
        OSError: it cannot be read, is no regular file, or has more than `most` bytes.
    """
    with opened_file(path, most) as stream:
        return stream.read(most)


def opened_file(path: Path, most: int = LARGEST_FILE) -> BufferedReader:
    """A file opened for reading, without waiting for a pipe's writer.

    Raises:
        OSError: it cannot be read, is no regular file, or has more than `most` bytes.
    """
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
    stream = open(os.open(path, flags), "rb")  # noqa: SIM115 (the caller closes it)
    try:
        _check(path, os.fstat(stream.fileno()), most)
    except OSError:
        stream.close()
        raise
    return stream


def _check(path: Path, status: os.stat_result, most: int) -> None:
    """Raises `OSError` unless this is a regular file of at most `most` bytes."""
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a regular file", str(path))
    if status.st_size > most:
        size = f"it has {status.st_size / 1e6:.4g} MB, more than {most / 1e6:.4g} MB"
        raise OSError(errno.EFBIG, size, str(path))


def _key(status: os.stat_result) -> _Key:
    return status.st_dev, status.st_ino
