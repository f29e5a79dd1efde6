"""Good logs of every format, and damages done to them."""

from __future__ import annotations

import gzip
import random
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
from hypothesis import strategies as st

from nsaid_mj.clinic.logs.tables import LogTable, read
from nsaid_mj.clinic.logs.unusable import UnusableLog
from tests.support.bags import write_bag
from tests.support.flight_logs import write_dataflash, write_ulog
from tests.support.robot_logs import columns, motion

FORMATS = (
    "csv",
    "csv.gz",
    "parquet",
    "feather",
    "arrow",
    "npz",
    "bag",
    "mcap",
    "db3",
    "ulg",
    "bin",
    "record.arrow",
)
"""Ends of the names of the files in `good`."""

Edit = tuple[str, float, bytes]
"""What is done, where (as a share of the length), and the bytes it is done with."""

_WAYS = ("cut", "overwrite", "insert", "zero", "repeat", "remove")


@cache
def good(kind: str) -> bytes:
    """The bytes of a good log."""
    values = columns(0.1 if kind in ("bag", "mcap", "db3") else 0.5)
    rest = {name: column for name, column in values.items() if name != "t"}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        if kind in ("csv", "csv.gz"):
            rows = zip(*values.values(), strict=True)
            lines = [",".join(values), *(",".join(f"{x:.6g}" for x in row) for row in rows)]
            text = "\n".join(lines).encode()
            return gzip.compress(text) if kind == "csv.gz" else text
        if kind == "parquet":
            pa.parquet.write_table(pa.table(values), path)
        elif kind == "feather":
            pa.feather.write_feather(pa.table(values), str(path), compression="lz4")
        elif kind == "arrow":
            table = pa.table(values)
            with pa.ipc.new_stream(str(path), table.schema) as stream:
                stream.write_table(table)
        elif kind == "npz":
            q, v, u = motion(values["t"])
            np.savez_compressed(path.with_suffix(".npz"), t=values["t"], q=q, dq=v, tau=u)
            path = path.with_suffix(".npz")
        elif kind in ("bag", "mcap", "db3"):
            write_bag(path, {"bag": "ros1", "db3": "ros2"}.get(kind, kind), values["t"])
            path = path if kind == "bag" else next(path.glob(f"*.{kind}"))
        elif kind == "ulg":
            write_ulog(path, {"arm_state": (rest, values["t"] + 5)})
        elif kind == "bin":
            write_dataflash(path, {"ARM": (rest, values["t"] + 5)})
        else:
            write_record(path, values["t"])
        return path.read_bytes()


def write_record(path: Path, t: np.ndarray) -> None:
    """A run's record."""
    from nsaid_mj.lab.record import RecordWriter

    q, v, u = motion(t)
    writer = RecordWriter(path, {"t": 0, "q": 2, "v": 2, "u": 2}, {"names": []}, 20)
    writer.extend(t, q, v, u)
    writer.close()


def write_bomb(kind: str, path: Path, count: int) -> None:
    """A small file of `count` equal numbers."""
    zeros = np.zeros(count)
    if kind == "gz":
        path.write_bytes(gzip.compress(b"t,q\n" + b"0,0\n" * count))
    elif kind == "npz":
        np.savez_compressed(path, t=zeros, q=zeros)
    elif kind == "parquet":
        pa.parquet.write_table(pa.table({"t": zeros, "q": zeros}), path)
    else:
        table = pa.table({"t": zeros, "q": zeros})
        options = pa.ipc.IpcWriteOptions(compression="zstd")
        with pa.ipc.new_file(str(path), table.schema, options=options) as stream:
            stream.write_table(table, max_chunksize=10_000)


def damage(data: bytes, edits: list[Edit]) -> bytes:
    """Data after some damages, one after the other."""
    for way, share, junk in edits:
        at = int(share * len(data))
        end = at + len(junk)
        data = {
            "cut": data[:at],
            "overwrite": data[:at] + junk + data[end:],
            "insert": data[:at] + junk + data[at:],
            "zero": data[:at] + bytes(len(data[at:end])) + data[end:],
            "repeat": data[:end] + data[at:],
            "remove": data[:at] + data[end:],
        }[way]
    return data


def end_of_reading(path: Path) -> LogTable | UnusableLog:
    """A table with channels, or the error that names the file."""
    try:
        table = read(path)
    except UnusableLog as error:
        assert str(path) in str(error) and error.findings[0].level == "refusal"
        return error
    assert table.channels
    return table


def edits() -> st.SearchStrategy[list[Edit]]:
    """One to four damages."""
    junk = st.one_of(
        st.binary(min_size=1, max_size=64),
        st.sampled_from(
            [b"\xff" * 4, b"\xff" * 8, b"\x7f" + b"\xff" * 7, b"\x80" * 8, b'"', b"\n"]
        ),
    )
    one = st.tuples(st.sampled_from(_WAYS), st.floats(0.0, 1.0), junk)
    return st.lists(one, min_size=1, max_size=4)


def drawn(rng: random.Random) -> list[Edit]:
    """One to four damages, from a generator."""
    return [
        (rng.choice(_WAYS), rng.random(), rng.choice((rng.randbytes(8), b"\xff" * 8, b"\x80\x7f")))
        for _ in range(rng.choice((1, 1, 2, 4)))
    ]
