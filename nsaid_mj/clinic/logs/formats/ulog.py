"""PX4's ULog, through `pyulog`."""

from pathlib import Path

import numpy as np

from ..unusable import UnreadableLog
from . import Columns, check_size


def read(path: Path) -> list[Columns]:
    """One group of columns for each topic, called `TOPIC/FIELD`; `TOPIC_1/FIELD` of instance 1.

    Times are the fields `timestamp`, or `timestamp_sample` where a topic has it.

    Raises:
        UnreadableLog: the file is beyond the limit or has no data.
    """
    from pyulog import ULog

    check_size(path, path.stat().st_size)
    log = ULog(str(path))
    found = []
    for topic in log.data_list:
        name = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
        data = dict(topic.data)
        stamp = data.pop("timestamp")
        sampled = data.pop("timestamp_sample", stamp)
        times = sampled if np.all(sampled > 0) else stamp
        values = {
            f"{name}/{field}": np.asarray(column, np.float64) for field, column in data.items()
        }
        if values and len(times):
            found.append(Columns(values, times.astype(np.int64) * 1000))
    if not found:
        raise UnreadableLog(path, "the log has no data", "Record the log again.")
    dropped = []
    if log.file_corruption:
        dropped.append(("pyulog", "a part of the file is damaged and was skipped"))
    dropped += [("logger", f"{d.duration} ms were not recorded") for d in log.dropouts]
    return [found[0]._replace(dropped=tuple(dropped)), *found[1:]]
