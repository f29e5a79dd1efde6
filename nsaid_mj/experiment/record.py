"""The record of a run: an Arrow IPC stream, appended while it runs.

The file holds measurements and estimates: time, q, v, u, v̂, θ̂, and no true value. Every 0.9 s of
the run are written as one batch, so a killed run loses less than a second, and two equal runs write
equal bytes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..errors import BadRun
from ..log import Log
from ..parameters import Array

BATCH_SECONDS = 0.9
FILE = "record.arrow"


class RecordWriter:
    """Appends rows to an Arrow IPC stream.

    Args:
        path: of the file, which is overwritten.
        widths: entries per row of each column; 0 for a scalar column.
        metadata: stored as JSON in the schema.
        batch: rows in a batch.
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
        self._file = pa.OSFile(str(path), "wb")  # unbuffered
        self._stream = pa.ipc.new_stream(self._file, self._schema)
        # Arrow writes the schema only with the first batch, so an empty one is written now
        self._stream.write_batch(pa.RecordBatch.from_pylist([], schema=self._schema))
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
        self._stream.write_batch(pa.record_batch(columns, schema=self._schema))
        self._rows = 0

    def close(self) -> None:
        """Writes the buffered rows and ends the stream."""
        self.flush()
        self._stream.close()
        self._file.close()


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

    @staticmethod
    def read(path: Path) -> Record:
        """Reads the record of a run's folder, or a record file, complete or truncated.

        Raises:
            BadRun: there is no record, or it is unreadable.
        """
        file = path / FILE if path.is_dir() else path
        if not file.is_file():
            raise BadRun(path, "there is no record.arrow", "Give the folder that a run has written")
        batches, complete = [], False
        try:
            with pa.memory_map(str(file)) as source:
                reader = pa.ipc.open_stream(source)
                schema = reader.schema
                try:
                    for batch in reader:
                        batches.append(batch)
                    complete = _ended(file)
                except (pa.ArrowInvalid, OSError):
                    complete = False  # truncated within a batch; the batches before are intact
                table = pa.Table.from_batches(batches, schema)
                columns = {
                    field.name: _column(table.column(field.name), field.type) for field in schema
                }
            metadata = json.loads((schema.metadata or {})[b"nsaid"])
        except (pa.ArrowException, OSError) as error:
            raise BadRun(
                file, f"not an Arrow stream ({error})", "Run the scenario again"
            ) from error
        except (KeyError, ValueError) as error:
            raise BadRun(file, "an Arrow stream, but not a run's", "Give a run's folder") from error
        return Record(columns, metadata, complete)


def _ended(file: Path) -> bool:
    """Whether the stream has Arrow's end mark: a continuation marker and a length of 0."""
    with file.open("rb") as stream:
        stream.seek(-8, 2)
        return stream.read() == b"\xff\xff\xff\xff\x00\x00\x00\x00"


def _column(column: pa.ChunkedArray, kind: pa.DataType) -> Array:
    if pa.types.is_fixed_size_list(kind):
        # `values`, not `flatten`, which imports pyarrow.compute; equal for batches without offset
        flat = [chunk.values.to_numpy(zero_copy_only=False) for chunk in column.chunks]
        joined = np.concatenate(flat) if flat else np.zeros(0)
        return joined.reshape(-1, kind.list_size)
    return column.to_numpy().copy()
