"""Which files are ours: those whose content is still what this package wrote.

A folder of results has a hidden file with the SHA-256 of every file that was written there. A file
of the same name with any other content is the user's: made by hand, by another program, or ours
and edited. A name alone marks nothing.
"""

import hashlib
import json
import os
import stat
from contextlib import suppress
from io import BufferedReader
from pathlib import Path

from .errors import NotWritten
from .inputs import opened_file, read_bytes, was_read

SIGNATURES = ".nsaid-mj.json"
"""Name of the hidden file: SHA-256 of the last contents by name."""
_KEPT = 2  # contents by name: the new one is signed before it replaces the old one
_MARKS = {  # first bytes of formats whose head says who made a file, and what ours says
    b"\xff\xff\xff\xff": b"nsaid",  # a record: an Arrow stream with metadata of this name
}
_HEAD = 1 << 20  # bytes in which the mark is; the metadata of a record have a whole scenario


def check_replaceable(path: Path) -> None:
    """Checks that whatever is at a path may be replaced or deleted by this command.

    That is nothing, an empty file, a link (what it points to is kept), and a file of ours.

    Raises:
        NotWritten: it was read by this command, or is not ours.
    """
    try:
        status = path.lstat()
    except OSError:  # missing; or the attempt to write says why not
        return
    if was_read(path):
        raise NotWritten(path, "it is a file that was read", "Give another folder with --out")
    if not (stat.S_ISLNK(status.st_mode) or is_ours(path)):
        raise NotWritten(
            path,
            "it was not written by nsaid-mj, or has been changed since",
            "Move it elsewhere, or give another folder with --out",
        )


def is_ours(path: Path) -> bool:
    """Whether a file is empty, names us as its maker, or has a content that was signed."""
    try:
        with opened_file(path) as stream:
            head = stream.read(_HEAD)
            if not head or _is_marked(head):
                return True
            stream.seek(0)
            return _digest(stream) in _signed(path.parent).get(path.name, [])
    except OSError:
        return False


def sign(path: Path, written: Path | None = None) -> None:
    """Records that the content of a file is ours; `written` is where it is, if not at its path.

    A file that names its maker needs no signature. A folder's hidden file of another kind is left
    alone, and nothing is signed there.
    """
    with opened_file(written or path) as stream:
        if _is_marked(stream.read(_HEAD)):
            return
        stream.seek(0)
        digest = _digest(stream)
    file = path.parent / SIGNATURES
    signed = _signed(path.parent)
    if not signed and file.exists() and not file.is_symlink():
        return
    known = [other for other in signed.get(path.name, []) if other != digest]
    signed[path.name] = [*known, digest][-_KEPT:]
    partial = unused(file)
    partial.write_text(json.dumps(signed, indent=1), encoding="utf-8")
    partial.replace(file)


def unused(path: Path) -> Path:
    """A new empty file beside a path, for what shall replace it.

    Raises:
        OSError: the operating system refuses.
    """
    flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0)
    number = 1
    while True:
        name = f".{path.name}.part" if number == 1 else f".{path.name}-{number}.part"
        partial = path.with_name(name)
        try:
            os.close(os.open(partial, flags, 0o666))
            return partial
        except FileExistsError:  # of a killed process, or somebody else's
            number += 1


def _is_marked(head: bytes) -> bool:
    """Whether the first bytes of a file name us as its maker."""
    return any(head.startswith(magic) and mark in head for magic, mark in _MARKS.items())


def _digest(stream: BufferedReader) -> str:
    return hashlib.file_digest(stream, "sha256").hexdigest()


def _signed(folder: Path) -> dict[str, list[str]]:
    """The signed contents of a folder by name; empty if there are none."""
    with suppress(OSError, ValueError, RecursionError):
        found = json.loads(read_bytes(folder / SIGNATURES))
        if isinstance(found, dict) and all(isinstance(x, list) for x in found.values()):
            return found
    return {}
