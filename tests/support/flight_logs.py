"""Minimal ULog and DataFlash files, written byte by byte from their public specifications."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np


def write_ulog(path: Path, topic: str, columns: dict[str, np.ndarray], t: np.ndarray) -> Path:
    """A ULog of one topic of doubles, at times t [s]."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    stamps = np.round(t * 1e6).astype(np.uint64)
    fields = "uint64_t timestamp;" + "".join(f"double {name};" for name in columns)
    parts = [
        b"ULog\x01\x12\x35\x01" + struct.pack("<Q", int(stamps[0])),
        message(b"B", bytes(40)),
        message(b"F", f"{topic}:{fields}".encode()),
        message(b"A", struct.pack("<BH", 0, 7) + topic.encode()),
    ]
    for k, stamp in enumerate(stamps.tolist()):
        row = struct.pack(f"<HQ{len(columns)}d", 7, stamp, *(c[k] for c in columns.values()))
        parts.append(message(b"D", row))
    path.write_bytes(b"".join(parts))
    return path


def write_dataflash(path: Path, kind: str, columns: dict[str, np.ndarray], t: np.ndarray) -> Path:
    """A DataFlash log of one kind of message with floats, at times t [s]."""

    def declared(number: int, length: int, name: str, types: str, labels: str) -> bytes:
        texts = (name.encode(), types.encode(), labels.encode())
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, *texts)

    types = "Q" + "f" * len(columns)
    length = 3 + 8 + 4 * len(columns)
    parts = [
        declared(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        declared(0x90, length, kind, types, ",".join(["TimeUS", *columns])),
    ]
    for k, stamp in enumerate(np.round(t * 1e6).astype(np.uint64).tolist()):
        row = struct.pack(f"<Q{len(columns)}f", stamp, *(c[k] for c in columns.values()))
        parts.append(b"\xa3\x95\x90" + row)
    path.write_bytes(b"".join(parts))
    return path
