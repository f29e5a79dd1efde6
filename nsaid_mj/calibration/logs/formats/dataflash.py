"""ArduPilot's DataFlash logs (.bin), through `pymavlink`."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MissingExtra, UnreadableLog
from . import Columns

_HEAD = b"\xa3\x95\x80"  # the first message declares the format of formats


def recognises(_path: Path, head: bytes) -> bool:
    """Whether it begins as DataFlash does."""
    return head.startswith(_HEAD)


def read(path: Path) -> list[Columns]:
    """One group of columns for each kind of message, called `KIND/FIELD`.

    Messages of several sensors (field `I` or `C`) are separated: `KIND_1/FIELD` of instance 1.

    Raises:
        MissingExtra: `pymavlink` is not installed.
        UnreadableLog: the file is damaged or has no message with a time.
    """
    try:
        from pymavlink.DFReader import DFReader_binary
    except ImportError as error:
        raise MissingExtra(path, "dataflash") from error
    try:
        rows = _rows(DFReader_binary(str(path), zero_time_base=True))
    except Exception as error:  # pymavlink raises bare exceptions on damaged files
        raise UnreadableLog(path, f"unreadable log ({error})", "Copy the log again.") from error
    found = []
    for (name, fields), table in rows.items():
        dense = dict(zip(fields, np.array(table, np.float64).T, strict=True))
        time = np.round(dense.pop("TimeUS") * 1000).astype(np.int64)
        if dense:
            found.append(Columns({f"{name}/{k}": x for k, x in dense.items()}, time))
    if not found:
        raise UnreadableLog(path, "no message has a time", "Record the log again.")
    return found


def _rows(reader: Any) -> dict[tuple[str, tuple[str, ...]], list[list[float]]]:
    """The numbers of all messages by kind and fields."""
    rows = defaultdict(list)
    while (message := reader.recv_msg()) is not None:
        values = message.to_dict()
        kind = values.pop("mavpackettype")
        if "TimeUS" not in values:
            continue
        instance = values.get("I", values.get("C", 0))
        name = f"{kind}_{instance}" if isinstance(instance, int) and instance else kind
        numbers = {k: x for k, x in values.items() if isinstance(x, int | float)}
        rows[name, tuple(numbers)].append(list(numbers.values()))
    return rows
