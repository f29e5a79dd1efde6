"""ArduPilot's DataFlash logs (.bin), through `pymavlink`."""

import contextlib
import re
from collections import defaultdict
from pathlib import Path

import numpy as np

from ..unusable import UnreadableLog
from . import Columns, check_size

_CLOCKS = {"TimeUS": 1.0, "TimeMS": 1e3}  # fields of the time, and their unit [µs]
_LATEST = 1e15  # thirty years [µs]; a time beyond is damaged
_WANTED = re.compile(r"MOT_\d+_DIRECTION|FRAME_CONFIG|FRAME_TYPE")
"""Parameters that say what commands mean, and of which motors."""
_INSTANCES = ("I", "Instance", "C")


def read(path: Path) -> list[Columns]:
    """One group of columns for each kind of message, called `KIND/FIELD`.

    Messages of several sensors or motors (field `I`, `C` or `Instance`) are separated:
    `KIND_1/FIELD` of instance 1. Times are `TimeUS` [µs], in old logs `TimeMS` [ms].
    A parameter that reverses a motor is `PARM/MOT_1_DIRECTION`, one of frames `PARM/FRAME_TYPE`.

    Raises:
        UnreadableLog: the file is beyond the limit or has no message with a time.
    """
    from pymavlink.DFReader import DFReader_binary

    check_size(path, path.stat().st_size)
    rows: dict[tuple[str, tuple[str, ...]], list[list[float]]] = defaultdict(list)
    unread: dict[str, str] = {}
    numbers_read = 0
    with contextlib.closing(DFReader_binary(str(path), zero_time_base=True)) as reader:
        while (message := reader.recv_msg()) is not None:
            values = message.to_dict()
            kind = values.pop("mavpackettype")
            if _CLOCKS.keys().isdisjoint(values):
                if kind != "FMT":  # the declarations of the others
                    unread[kind] = "messages without a time"
                continue
            if _WANTED.fullmatch(str(values.get("Name", ""))):  # else a table of names and values
                values[values.pop("Name")] = values.pop("Value", np.nan)
            instance = next((values[key] for key in _INSTANCES if key in values), 0)
            name = f"{kind}_{instance}" if isinstance(instance, int) and instance else kind
            numbers = {k: x for k, x in values.items() if isinstance(x, int | float)}
            unread |= {f"{name}/{k}": "text" for k in values.keys() - numbers.keys()}
            rows[name, tuple(numbers)].append(list(numbers.values()))
            numbers_read += len(numbers)
            check_size(path, 8 * numbers_read)
    found = []
    for (name, fields), table in rows.items():
        numbers = np.array(table, np.float64)
        clock = next(name for name in _CLOCKS if name in fields)
        timed = np.abs(numbers[:, fields.index(clock)] * _CLOCKS[clock]) < _LATEST
        if lost := np.count_nonzero(~timed):
            unread[name] = f"{lost} of {len(table)} messages, whose time is damaged"
        dense = dict(zip(fields, numbers[timed].T, strict=True))
        time = np.round(dense.pop(clock) * _CLOCKS[clock] * 1000).astype(np.int64)
        if dense and len(time):
            found.append(Columns({f"{name}/{k}": x for k, x in dense.items()}, time))
    if not found:
        raise UnreadableLog(path, "no message has a time", "Record the log again.")
    return [found[0]._replace(dropped=tuple(unread.items())), *found[1:]]
