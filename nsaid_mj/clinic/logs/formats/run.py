"""Runs of this package: the measurements and commands of `record.arrow`, no estimate."""

from pathlib import Path

import numpy as np

from ....base import BadRun, OutputFolder
from ....lab import Record
from ..unusable import UnreadableLog
from . import Columns, check_size

FOLLOWED = "followed"
"""First word of columns of targets to which a profile has been applied."""


def read(path: Path) -> list[Columns]:
    """The columns `t`, `q_0` …, `v_0` …, `u_0` … of a run.

    Of position servos it holds `target_0` … at the times at which the targets were issued.

    Raises:
        UnreadableLog: the record is damaged, empty, or beyond the limit.
    """
    file = path / OutputFolder.RECORD if path.is_dir() else path
    check_size(file, file.stat().st_size)
    try:
        record = Record.read(path)
    except BadRun as error:
        raise UnreadableLog(path, error.reason, f"{error.remedy}.") from error
    if not len(record):
        raise UnreadableLog(path, "the record has no rows", "Run the scenario again.")
    values: dict[str, np.ndarray] = {"t": record["t"]}
    if missing := [name for name in "qvu" if name not in record.columns]:
        raise UnreadableLog(path, f"its record has no column {missing[0]}", "Run it again.")
    delays = record.target_delays
    for name in "qvu" if delays is None else "qv":
        values |= {f"{name}_{k}": column for k, column in enumerate(record[name].T)}
    name = f"{FOLLOWED}_target" if record.profiled else "target"
    targets = [
        Columns({"t": record["t"] - delay, f"{name}_{k}": record["u"][:, k]})
        for k, delay in enumerate(delays or ())
    ]
    return [Columns(values), *targets]
