"""The folder of a sweep: its manifest, a row for each finished run, and a table of them all."""

import errno
import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from rich.progress import Progress as Bar

from ...base import BadRun, InputFile, NotWritten, OutputFile, json_of, without_nonfinite
from .runs import Runs
from .study import Row, in_folder
from .sweep_files import MANIFEST, ROWS, TABLE, no_sweep

_ROW = 64 << 10  # most bytes of a row, which has some 2000
_AGAIN = 1000  # lines of rows that were made again, at most
_KINDS = {"vary": dict, "script": str, "arguments": list, "runs": int}  # of a manifest
NEEDED = ("theta_perp_ratio", "time_to_converge")
"""Figures without which the row of a run with a result is damaged."""

_TYPES = {"failure": pa.string(), "time_to_converge": pa.float64()}  # columns that may be all null


def read(folder: Path) -> Runs:
    """Reads a sweep's folder, of several rows of one run the last one.

    Raises:
        BadRun: there is no sweep in it, or it is unreadable.
    """
    manifest = _manifest(folder)
    try:
        data = OutputFile(folder / ROWS).read(_ROW * (manifest["runs"] + _AGAIN))
    except FileNotFoundError:
        data = b""
    except OSError as error:
        raise BadRun(
            folder / ROWS, f"{error.strerror}", "Delete it to make all runs again"
        ) from error
    rows = dict[int, Row]()
    damaged = list[str]()
    intact = list[bytes]()
    for number, line in enumerate(data[: data.rfind(b"\n") + 1].split(b"\n")[:-1], 1):
        row = _row(line, manifest)
        if row is None:
            damaged.append(str(number))
        else:
            rows[row["run"]] = row
            intact.append(line + b"\n")
    words = ""
    if damaged:
        lines, are = ("lines", "are") if len(damaged) > 1 else ("line", "is")
        more = " …" if len(damaged) > 10 else ""
        words = f"{ROWS}: {lines} {', '.join(damaged[:10])}{more} {are} damaged"
    found = [rows[number] for number in sorted(rows)]
    return Runs(folder, manifest, found, words, b"".join(intact))


def _manifest(folder: Path) -> dict[str, Any]:
    """Reads a sweep's manifest, or its copy in the table if that is missing or damaged."""
    for text in (
        lambda: OutputFile(folder / MANIFEST).read(),
        lambda: _in_table(folder / TABLE),
    ):
        try:
            found = json_of(text())
            if all(isinstance(found[key], kind) for key, kind in _KINDS.items()):
                return found
        except (OSError, ValueError, AttributeError, KeyError, TypeError):
            continue
    if (folder / MANIFEST).is_file():
        raise BadRun(folder / MANIFEST, "not a sweep's manifest", "Give another folder")
    if (folder / ROWS).is_file():
        raise BadRun(
            folder,
            f"{MANIFEST} is missing, so the sweep of its rows is unknown",
            f"Restore the file; or delete {ROWS}, to make all runs again",
        )
    raise no_sweep(folder)


def _in_table(path: Path) -> bytes:
    """The manifest in the metadata of a table."""
    with InputFile(path).opened() as stream:
        return (pq.read_schema(stream).metadata or {})[b"nsaid"]


def _row(line: bytes, manifest: dict[str, Any]) -> Row | None:
    """The row in a line; None if it is damaged."""
    try:
        row = json_of(line)
        return row if _sound(row, manifest) else None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        return None


def _sound(row: Row, manifest: dict[str, Any]) -> bool:
    """Whether a row has what a sweep needs, each of its kind, and is of this sweep.

    Raises:
        KeyError: something is missing.
        TypeError, AttributeError, OverflowError: something is of another kind.
    """
    numbered = type(row["run"]) is int and 0 <= row["run"] < manifest["runs"]
    drawn = all(type(row[key]) is int and row[key] >= 0 for key in ("draw", "seed"))
    varied = all(row[path] in values for path, values in manifest["vary"].items())
    if row["failure"] is not None:
        return numbered and drawn and varied and isinstance(row["failure"], str)
    figures = [row[key] for key in NEEDED if row[key] is not None]
    lengths = all(type(x) in (int, float) and 0 <= float(x) < math.inf for x in figures)
    return numbered and drawn and varied and lengths and isinstance(row["status"], str)


def write_table(folder: Path) -> Path:
    """Writes all rows as one Parquet table, with the manifest as metadata."""
    runs = read(folder)
    names = dict.fromkeys(key for row in runs.rows for key in row)
    table = pa.table({name: _column(name, [row.get(name) for row in runs.rows]) for name in names})
    table = table.replace_schema_metadata({"nsaid": json.dumps(runs.manifest)})
    path = folder / TABLE
    with OutputFile(path).atomically() as partial:
        pq.write_table(table, partial)
    return path


def _column(name: str, values: list[Any]) -> pa.Array:
    try:
        return pa.array(values, _TYPES.get(name))
    except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):  # several types, a large integer
        return pa.array([None if value is None else str(value) for value in values])


@contextmanager
def opened(
    folder: Path, manifest: dict[str, Any], quiet: bool, done: str
) -> Iterator[tuple[dict[int, Row], Callable[[Row], None], Bar]]:
    """Creates a sweep's folder, or reads what an earlier run of the same plan wrote.

    Yields the rows of earlier runs by number, a function that appends a row and syncs the disk,
    and a bar; `done` is the format of its count. The folder is locked within the context; at its
    end the table of all rows is written. Damaged rows are made again.

    Raises:
        FolderInUse: another process is writing into the folder.
        NotWritten: the folder cannot be written; rows on a full disk are kept.
        BadRun: it holds another sweep, or rows of an unknown one.
    """
    rows = folder / ROWS
    remedy = "Make room on the disk; the same command then resumes"
    _sign_rows(folder)
    with in_folder(folder, (ROWS, TABLE, "report.html"), quiet, done) as bar:
        known = _resumed(folder, manifest, partial(bar.console.print, highlight=False))
        with NotWritten.on_failure(rows):
            flags = os.O_WRONLY | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
            descriptor = os.open(rows, flags)
        try:
            with os.fdopen(descriptor, "ab", buffering=0) as stream:

                def append(row: Row) -> None:
                    plain = without_nonfinite(row)
                    line = json.dumps(plain, ensure_ascii=False, allow_nan=False) + "\n"
                    with NotWritten.on_failure(rows, remedy):
                        if stream.write(line.encode()) < len(line.encode()):
                            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                        os.fsync(descriptor)

                yield known, append, bar
        except BaseException:
            with suppress(NotWritten, BadRun):  # the original error says more
                write_table(folder)
            raise
        write_table(folder)


def _sign_rows(folder: Path) -> None:
    """Signs the rows of a sweep, which grew since they were made, if the sweep itself is ours.

    Raises:
        BadRun: it holds another sweep's files, or rows of an unknown one.
    """
    rows = folder / ROWS
    if (folder / MANIFEST).is_file() or (rows.is_file() and rows.stat().st_size):
        read(folder)
        if rows.is_file() and (
            OutputFile(folder / MANIFEST).is_ours or OutputFile(folder / TABLE).is_ours
        ):
            OutputFile(rows).sign()


def _resumed(
    folder: Path, manifest: dict[str, Any], say: Callable[[str], object]
) -> dict[int, Row]:
    """The rows of an existing sweep; for a new one, creates the files."""
    rows = folder / ROWS
    wanted = json.loads(json.dumps(manifest))
    if not (folder / MANIFEST).is_file() and not (rows.is_file() and rows.stat().st_size):
        OutputFile(folder / MANIFEST).write_json(manifest)
        with OutputFile(rows).atomically():
            return {}
    there = read(folder)
    before = there.manifest
    differ = [key for key in wanted if key != "arguments" and wanted[key] != before.get(key)]
    if differ:
        raise BadRun(
            folder,
            f"it holds another sweep; {', '.join(differ)} differ",
            "Give another folder with --out, or delete this one",
        )
    if not (folder / MANIFEST).is_file():
        OutputFile(folder / MANIFEST).write_json(before)
    if there.damaged:
        say(f"{there.damaged}; they are made again")
    if not rows.is_file() or len(there.intact) != rows.stat().st_size:
        with OutputFile(rows).atomically() as partial:  # without damaged and incomplete lines
            partial.write_bytes(there.intact)
    return {row["run"]: row for row in there.rows}
