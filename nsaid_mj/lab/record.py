"""The record of a run: an Arrow IPC stream, appended while it runs.

The file holds measurements and estimates: time, q, v, u, v̂, θ̂, and no true value. Every half
second of the run is written as one batch, so a killed run loses little more, and two equal runs
write equal bytes.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..base import BadRun, NotWritten, OutputFile, OutputFolder, json_of
from ..core import Array, Indices, Log

BATCH_SECONDS = 0.5
"""Duration of a batch, and of what identifiers follow at once: by default an interval of the
memory, whose steps then end with it and are taken beside the filter's."""

RECORD_FILE = OutputFolder.RECORD
TARGET_DELAYS = "target_delays"
"""Key of a record's metadata: (n_u,) delays [s] of a servo arm's targets, after which u acts."""
PROFILED = "target_profile"
"""Another key: whether u is the targets after a profile's limits and smoothing."""


class RecordWriter:
    """Appends rows to an Arrow IPC stream, in batches; another file at its path is replaced.

    `widths` are the entries per row of each column, 0 for a scalar; `metadata` becomes JSON.

    Raises:
        NotWritten: the file cannot be written, by the other methods too. Earlier rows stay
            readable.
    """

    def __init__(self, path: Path, widths: dict[str, int], metadata: dict[str, Any], batch: int):
        types = {
            name: pa.list_(pa.float64(), width) if width else pa.float64()
            for name, width in widths.items()
        }
        self._widths, self._batch = widths, max(1, batch)
        self._schema = pa.schema(
            list(types.items()), metadata={"nsaid": json.dumps(metadata, ensure_ascii=False)}
        )
        self._path = path
        self._failed = False
        with NotWritten.on_failure(path):
            OutputFile(path).create()
            self._inode = path.stat().st_ino
            self._file = pa.OSFile(os.fsencode(path), "wb")  # unbuffered
        self._stream = pa.ipc.new_stream(self._file, self._schema)
        # Arrow writes the schema only with the first batch, so an empty one is written now
        self._write(pa.RecordBatch.from_pylist([], schema=self._schema))
        self._buffers = {
            name: np.zeros((self._batch, max(width, 1))) for name, width in widths.items()
        }
        self._rows = 0

    def extend(self, *columns: Array) -> None:
        """Appends k rows: one array (k,) or (k, width) for each column, in order."""
        start = 0
        count = len(columns[0])
        while start < count:
            end = min(count, start + self._batch - self._rows)
            here = slice(self._rows, self._rows + end - start)
            for buffer, column in zip(self._buffers.values(), columns, strict=True):
                buffer[here] = column[start:end].reshape(end - start, -1)
            start = end
            self._rows = here.stop
            if self._rows == self._batch:
                self.flush()

    def flush(self) -> None:
        """Writes all buffered rows as one batch."""
        if not self._rows:
            return
        columns = []
        for name, buffer in self._buffers.items():
            flat = pa.array(buffer[: self._rows].ravel())
            width = self._widths[name]
            columns.append(pa.FixedSizeListArray.from_arrays(flat, width) if width else flat)
        self._rows = 0
        self._write(pa.record_batch(columns, schema=self._schema))

    def _write(self, batch: pa.RecordBatch | None) -> None:
        """Writes a batch, or the end mark; after a failure, nothing more is written."""
        if self._failed:
            return
        remedy = (
            "Make room on the disk; `nsaid view --rebuild` with the run's folder then finishes it "
            "from what was recorded"
        )
        try:
            with NotWritten.on_failure(self._path, remedy):
                self._stream.close() if batch is None else self._stream.write_batch(batch)
        except NotWritten:
            self._failed = True
            raise

    def close(self) -> None:
        """Writes the buffered rows and ends the stream."""
        try:
            self.flush()
            self._write(None)
        finally:
            self._file.close()

    def check(self) -> None:
        """Raises `BadRun` if the file was removed or replaced."""
        if not self._path.exists() or self._path.stat().st_ino != self._inode:
            raise BadRun(
                self._path,
                "it was removed or replaced while the run was writing it",
                "Run the scenario again",
            )


@dataclass(frozen=True)
class Record:
    """The record of a run, read from its file.

    Attributes:
        columns: arrays by name: `t` (N,) [s], `q` (N, m), `v` (N, n), `u` (N, n_u) the command held
            from t on, `v_hat` (N, n), `theta_hat` (N, p), `pivot` (N,) M̂'s smallest pivot, `spent`
            (N,) decrease of the conserved quantity by implicit steps, `pe` and `pe_perp` (N,) the
            online levels of (2) and (75); for every rival R also `v_hat_R` and `theta_hat_R`.
        metadata: `scenario` (JSON text), `names`, `units`, `scale`, `r`; see `TARGET_DELAYS`.
        complete: whether the stream was closed; that of a killed run was not.
    """

    columns: Mapping[str, Array]
    metadata: dict[str, Any]
    complete: bool

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    @property
    def target_delays(self) -> list[float] | None:
        """(n_u,) delays of position servos' targets [s]; None if commands are no targets."""
        return self.metadata.get(TARGET_DELAYS)

    @property
    def profiled(self) -> bool:
        """Whether a profile was applied to the targets."""
        return bool(self.metadata.get(PROFILED))

    def rows(self, name: str, rows: int | slice | Indices) -> Array:
        """Some rows of a column, which an `opened` record reads without all the others."""
        if isinstance(self.columns, _Stored):
            return self.columns.rows(name, rows)
        return self.columns[name][rows]

    def __len__(self) -> int:
        return len(self.columns["t"])

    @property
    def log(self) -> Log:
        """The measurements and commands; the record must have at least one row."""
        return Log(*(self.columns[name] for name in ("t", "q", "v", "u")))

    @property
    def rivals(self) -> list[str]:
        """Names of the rivals in the record."""
        prefix = "theta_hat_"
        return [name.removeprefix(prefix) for name in self.columns if name.startswith(prefix)]

    def scenario(self, folder: Path) -> str:
        """The JSON text of the run's scenario; `BadRun` naming the folder if there is none."""
        text = self.metadata.get("scenario")
        if not isinstance(text, str):
            raise BadRun(folder, "its record has no scenario", "Run the scenario again")
        return text

    def check(self, folder: Path, widths: Mapping[str, int]) -> None:
        """Checks that the record has its scenario's columns: entries per row, 0 for a scalar.

        Raises:
            BadRun: one is missing, or has another number of entries.
        """
        for name, width in widths.items():
            shape = self.rows(name, slice(1)).shape[1:] if name in self.columns else None
            if shape != ((width,) if width else ()):
                reason = f"the column {name} of its record is not that of its scenario"
                raise BadRun(folder, reason, "Run the scenario again")

    @staticmethod
    def read(path: Path) -> Record:
        """Reads the record of a run's folder, or a record file, complete or truncated.

        It needs no more memory than the record itself.

        Raises:
            BadRun: there is no record, or it is unreadable.
            InvalidInput: the operating system does not accept such a path.
        """
        record = Record.opened(path)
        return replace(record, columns=dict(record.columns))

    @staticmethod
    def opened(path: Path) -> Record:
        """Opens a record whose columns are read when used; the file must not change until then.

        `rows` never has more in memory than the rows asked for.
        """
        file = OutputFolder(path).record_file()
        with _typed(file):
            return Record(*_scan(file))

    @staticmethod
    def metadata_of(path: Path) -> dict[str, Any]:
        """Reads only the metadata of a run's folder or record file; `BadRun` if unreadable."""
        file = OutputFolder(path).record_file()
        with _typed(file), pa.OSFile(os.fsencode(file)) as source:
            return _metadata(pa.ipc.open_stream(source).schema)


@contextmanager
def _typed(file: Path) -> Iterator[None]:
    """Context in which any error of an unreadable file becomes `BadRun`."""
    try:
        yield
    except (pa.ArrowInvalid, OSError) as error:
        raise BadRun(file, f"not an Arrow stream ({error})", "Run the scenario again") from error
    except (KeyError, TypeError, ValueError) as error:
        raise BadRun(file, "an Arrow stream, but not a run's", "Give a run's folder") from error


class _Stored(Mapping[str, Array]):
    """Columns of a record file, each read when it is used.

    `widths` are entries per row of each column, 0 for a scalar, places (batches, columns) the
    position of each column's first entry in a batch [bytes], first (batches + 1,) the number of
    each batch's first row, and of all rows.
    """

    def __init__(self, file: Path, widths: dict[str, int], places: Indices, first: Indices):
        self._file = file
        self._widths = widths
        self._first = first
        self._loaded = {}
        self._places = dict(zip(widths, places.T, strict=True))
        self._state = _state(os.stat(file))

    def __getitem__(self, name: str) -> Array:
        if name not in self._loaded:
            self._loaded[name] = self.rows(name, slice(None))
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self._widths  # `Mapping` would read the column

    def __iter__(self) -> Iterator[str]:
        return iter(self._widths)

    def __len__(self) -> int:
        return len(self._widths)

    def rows(self, name: str, rows: int | slice | Indices) -> Array:
        """Some rows of a column; raises `BadRun` if the file has changed."""
        if name in self._loaded:
            return self._loaded[name][rows]
        width = self._widths[name]
        shape = (width,) if width else ()
        size = 8 * max(1, width)
        chosen = np.arange(self._first[-1])[rows]
        at = np.ravel(chosen)
        batch = np.searchsorted(self._first, at, side="right") - 1
        places = self._places[name][batch] + size * (at - self._first[batch])
        found = np.empty((len(at), *shape))
        edges = [0, *(np.flatnonzero(np.diff(places) != size) + 1), len(at)]
        with _typed(self._file), self._file.open("rb") as stream:
            if _state(os.fstat(stream.fileno())) != self._state:
                raise BadRun(self._file, "it has changed since it was opened", "Open it again")
            for a, b in pairwise(edges) if len(at) else ():
                stream.seek(places[a])
                stream.readinto(found[a:b].data)
        return found.reshape((*chosen.shape, *shape))


def _state(stat: os.stat_result) -> tuple[int, int, int]:
    """A file's identity, which changes when it is replaced or written to."""
    return stat.st_ino, stat.st_size, stat.st_mtime_ns


def _scan(file: Path) -> tuple[_Stored, dict[str, Any], bool]:
    """The columns of a stream up to its first damaged batch, its metadata, whether it is whole."""
    places = []
    first = [0]
    last = -np.inf
    complete = False
    with pa.OSFile(os.fsencode(file)) as source:
        messages = pa.ipc.MessageReader.open_stream(source)
        begin = next(messages, None)
        if begin is None:
            raise pa.ArrowInvalid("it is empty")
        schema = pa.ipc.read_schema(begin)
        widths = {field.name: _width(field.type) for field in schema}
        metadata = _metadata(schema)
        if "t" not in widths:
            raise KeyError("t")
        with suppress(pa.ArrowInvalid, OSError):  # truncated; the batches before are intact
            for message in messages:
                batch = pa.ipc.read_record_batch(message, schema)
                if not batch.num_rows:
                    continue
                arrays = {name: _flat(batch.column(name)) for name in widths}
                if "theta_hat" in widths and not _sound(arrays, last, batch.num_rows):
                    break
                body = source.tell() - message.body.size - message.body.address
                places.append([body + array.buffers()[1].address for array in arrays.values()])
                first.append(first[-1] + batch.num_rows)
                last = arrays["t"][-1].as_py()
            else:
                complete = _ended(file)
    shaped = np.array(places, dtype=np.intp).reshape(-1, len(widths))
    return _Stored(file, widths, shaped, np.array(first, dtype=np.intp)), metadata, complete


def _sound(arrays: Mapping[str, pa.Array], last: float, rows: int) -> bool:
    """Whether rows are finite, time increases from `last` on, and no estimate is zero.

    A disk that loses power leaves zeros in place of data.
    """
    values = {name: array.to_numpy() for name, array in arrays.items()}
    estimates = [x.reshape(rows, -1) for name, x in values.items() if name.startswith("theta_hat")]
    return (
        bool((np.diff(values["t"], prepend=last) > 0).all())
        and all(np.isfinite(x).all() for x in values.values())
        and all(estimate.any(axis=1).all() for estimate in estimates)
    )


def _metadata(schema: pa.Schema) -> dict[str, Any]:
    return dict(json_of((schema.metadata or {})[b"nsaid"]))


def _ended(file: Path) -> bool:
    """Whether the stream has Arrow's end mark: a continuation marker and a length of 0."""
    with file.open("rb") as stream:
        stream.seek(-8, 2)
        return stream.read() == b"\xff\xff\xff\xff\x00\x00\x00\x00"


def _width(kind: pa.DataType) -> int:
    """Entries per row of a column; 0 for a scalar column."""
    return kind.list_size if pa.types.is_fixed_size_list(kind) else 0


def _flat(column: pa.Array) -> pa.Array:
    """The numbers of a column, row by row; raises `ValueError` unless each is a float64."""
    # `values`, not `flatten`, which imports pyarrow.compute; equal for batches without offset
    flat = column.values if pa.types.is_fixed_size_list(column.type) else column
    if flat.type != pa.float64() or flat.null_count or column.null_count:
        raise ValueError(f"a column of {column.type}")
    return flat
