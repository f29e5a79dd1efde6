"""The record of a run: an Arrow IPC stream, appended while it runs.

The file holds measurements and estimates: time, q, v, u, v̂, θ̂, and no true value. Every 0.9 s of
the run are written as one batch, so a killed run loses less than a second, and two equal runs write
equal bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..errors import BadRun, NotWritten
from ..log import Log
from ..parameters import Array
from ..resources import create, json_of, path_of, writing

BATCH_SECONDS = 0.9
FILE = "record.arrow"


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
        self._path, self._failed = path, False
        with writing(path):
            create(path)
            self._inode = path.stat().st_ino
            self._file = pa.OSFile(str(path), "wb")  # unbuffered
        self._stream = pa.ipc.new_stream(self._file, self._schema)
        # Arrow writes the schema only with the first batch, so an empty one is written now
        self._write(pa.RecordBatch.from_pylist([], schema=self._schema))
        self._buffers = {
            name: np.zeros((self._batch, max(width, 1))) for name, width in widths.items()
        }
        self._rows = 0

    def extend(self, *columns: Array) -> None:
        """Appends k rows: one array (k,) or (k, width) for each column, in order."""
        start, count = 0, len(columns[0])
        while start < count:
            end = min(count, start + self._batch - self._rows)
            here = slice(self._rows, self._rows + end - start)
            for buffer, column in zip(self._buffers.values(), columns, strict=True):
                buffer[here] = column[start:end].reshape(end - start, -1)
            start, self._rows = end, here.stop
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
            with writing(self._path, remedy):
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
        metadata: `scenario` (JSON text), `names`, `units`, `scale`, `r`.
        complete: whether the stream was closed; that of a killed run was not.
    """

    columns: dict[str, Array]
    metadata: dict[str, Any]
    complete: bool

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

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
            shape = self.columns[name].shape[1:] if name in self.columns else None
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
        file = _file_of(path)
        with _typed(file):
            schema, batches, rows, complete = _survey(file)
            metadata = _metadata(schema)
            if "t" not in schema.names:
                raise KeyError("t")
            columns = {
                field.name: np.empty((rows, width) if (width := _width(field.type)) else rows)
                for field in schema
            }
            with pa.OSFile(str(file)) as source, pa.ipc.open_stream(source) as stream:
                row = 0
                for _ in range(batches):
                    batch = stream.read_next_batch()
                    here = slice(row, row + batch.num_rows)
                    for name, column in columns.items():
                        column[here] = _values(batch.column(name)).reshape(column[here].shape)
                    if "theta_hat" in columns and not _sound(columns, here):  # damaged here
                        complete = False
                        columns = {name: column[:row] for name, column in columns.items()}
                        break
                    row = here.stop
        return Record(columns, metadata, complete)

    @staticmethod
    def metadata_of(path: Path) -> dict[str, Any]:
        """Reads only the metadata of a run's folder or record file; `BadRun` if unreadable."""
        file = _file_of(path)
        with _typed(file), pa.OSFile(str(file)) as source, pa.ipc.open_stream(source) as stream:
            return _metadata(stream.schema)


def _file_of(path: Path) -> Path:
    file = path / FILE if path_of(path).is_dir() else path
    if not file.is_file():
        raise BadRun(path, "there is no record.arrow", "Give the folder that a run has written")
    return file


@contextmanager
def _typed(file: Path) -> Iterator[None]:
    """Context in which any error of an unreadable file becomes `BadRun`."""
    try:
        yield
    except (pa.ArrowInvalid, OSError) as error:
        raise BadRun(file, f"not an Arrow stream ({error})", "Run the scenario again") from error
    except (KeyError, TypeError, ValueError) as error:
        raise BadRun(file, "an Arrow stream, but not a run's", "Give a run's folder") from error


def _survey(file: Path) -> tuple[pa.Schema, int, int, bool]:
    """The schema of a stream, its intact batches, their rows, and whether its end is there."""
    batches, rows, complete = 0, 0, False
    with pa.memory_map(str(file)) as source:  # the bodies of the batches are not read
        reader = pa.ipc.open_stream(source)
        with suppress(pa.ArrowInvalid, OSError):  # truncated; the batches before are intact
            for batch in reader:
                batches, rows = batches + 1, rows + batch.num_rows
            complete = _ended(file)
        return reader.schema, batches, rows, complete


def _sound(columns: dict[str, Array], rows: slice) -> bool:
    """Whether rows are finite, time increases up to their end, and no estimate is zero.

    A disk that loses power leaves zeros in place of data.
    """
    t = columns["t"] if "t" in columns else np.arange(rows.stop)
    steady = (np.diff(t[max(0, rows.start - 1) : rows.stop]) > 0).all()
    estimates = [column[rows] for name, column in columns.items() if name.startswith("theta_hat")]
    return (
        bool(steady)
        and all(np.isfinite(column[rows]).all() for column in columns.values())
        and all(estimate.any(axis=-1).all() for estimate in estimates if estimate.ndim == 2)
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


def _values(column: pa.Array) -> Array:
    # `values`, not `flatten`, which imports pyarrow.compute; equal for batches without offset
    flat = column.values if pa.types.is_fixed_size_list(column.type) else column
    return flat.to_numpy(zero_copy_only=False)
