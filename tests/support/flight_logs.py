"""Minimal ULog and DataFlash files, written byte by byte from their public specifications."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

Topics = dict[str, tuple[dict[str, np.ndarray], np.ndarray]]
"""By topic or kind of message: fields, (N,) or (N, k) for an array of k, and times (N,) [s]."""


def write_ulog(path: Path, topics: Topics) -> Path:
    """A ULog of topics of doubles."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    parts = [b"ULog\x01\x12\x35\x01" + bytes(8), message(b"B", bytes(40))]
    for topic, (columns, _) in topics.items():
        fields = "uint64_t timestamp;" + "".join(
            f"double{'' if x.ndim == 1 else f'[{x.shape[1]}]'} {name};"
            for name, x in columns.items()
        )
        parts.append(message(b"F", f"{topic}:{fields}".encode()))
    for number, topic in enumerate(topics):
        parts.append(message(b"A", struct.pack("<BH", 0, number) + topic.encode()))
    for number, (columns, t) in enumerate(topics.values()):
        table = np.column_stack(list(columns.values()))
        for stamp, row in zip(np.round(t * 1e6).astype(np.uint64).tolist(), table, strict=True):
            parts.append(message(b"D", struct.pack(f"<HQ{len(row)}d", number, stamp, *row)))
    path.write_bytes(b"".join(parts))
    return path


def write_dataflash(path: Path, kinds: Topics) -> Path:
    """A DataFlash log of kinds of messages with floats, one number a field."""

    def declared(number: int, length: int, name: str, types: str, labels: str) -> bytes:
        texts = (name.encode(), types.encode(), labels.encode())
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, *texts)

    parts = [declared(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    for number, (kind, (columns, _)) in enumerate(kinds.items(), start=0x90):
        types, length = "Q" + "f" * len(columns), 3 + 8 + 4 * len(columns)
        parts.append(declared(number, length, kind, types, ",".join(["TimeUS", *columns])))
    for number, (columns, t) in enumerate(kinds.values(), start=0x90):
        for k, stamp in enumerate(np.round(t * 1e6).astype(np.uint64).tolist()):
            row = struct.pack(f"<Q{len(columns)}f", stamp, *(c[k] for c in columns.values()))
            parts.append(b"\xa3\x95" + bytes([number]) + row)
    path.write_bytes(b"".join(parts))
    return path
