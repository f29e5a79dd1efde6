"""ROS 1 bags, ROS 2 bags (SQLite or MCAP) and single MCAP files, through `rosbags`.

Messages are read by their structure: names with positions, velocities and efforts are joints; of
others all numbers are columns, also of types that the bag itself defines. Times are the stamps of
the headers; for a message without one, the time of recording.
"""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..unusable import UnreadableLog
from . import Columns, check_size

_WRAPPERS = frozenset({"pose", "twist", "transform", "wrench", "accel", "layout"})
"""Fields that only hold others, as `pose` of a PoseStamped: their names are left out."""
_SKIPPED = frozenset({"header", "stamp", "dim", "data_offset"})
_NUMBERS = "numbers"  # the part of a message that is not of joints
_MOST = 256  # entries of an array, beyond which it is no vector of channels but an image or a cloud
_DEEPEST = 8  # messages in messages


def read(path: Path) -> list[Columns]:
    """One group of columns for each joint of a topic, or for each topic.

    Columns are called `TOPIC/position/JOINT`, `TOPIC/velocity/JOINT`, `TOPIC/effort/JOINT` of
    joints; else `TOPIC/FIELD`, such as `TOPIC/position/x` and `TOPIC/orientation/w` of a pose,
    `TOPIC/linear/x` and `TOPIC/angular/x` of a twist, `TOPIC/angular_velocity/x` of an Imu, and
    `TOPIC/data_0` of an array. Covariances, images and clouds are left out.

    Raises:
        UnreadableLog: the bag is beyond the limit or has no numbers.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    times: dict[str, list[int]] = defaultdict(list)
    rows: dict[str, list[dict[str, float]]] = defaultdict(list)
    store = get_typestore(Stores.ROS2_HUMBLE)
    numbers = 0
    others: dict[str, str] = {}
    with AnyReader([path], default_typestore=store) as reader:
        types = sorted({connection.msgtype for connection in reader.connections})
        for connection, received, raw in reader.messages():
            topic = connection.topic.strip("/")
            if topic in others:
                continue
            if connection.msgtype not in reader.typestore.fielddefs:
                others[topic] = f"a topic of {connection.msgtype}, which the bag does not define"
                continue
            message: Any = reader.deserialize(raw, connection.msgtype)
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            own = stamp.sec * 1_000_000_000 + stamp.nanosec if stamp else 0
            parts = dict(_parts(message))
            if parts == {_NUMBERS: {}} and f"{topic}/{_NUMBERS}" not in rows:
                others[topic] = f"a topic of {connection.msgtype}"
            for part, values in parts.items():
                if values:
                    times[f"{topic}/{part}"].append(own or received)
                    rows[f"{topic}/{part}"].append({f"{topic}/{k}": x for k, x in values.items()})
                    numbers += 1 + len(values)
            check_size(path, 8 * numbers)
    if not rows:
        remedy = f"Record joint states, odometry or other numbers; it has {', '.join(types)}."
        raise UnreadableLog(path, "the bag has no message of numbers", remedy)
    found = []
    for part, own in rows.items():
        names = dict.fromkeys(name for row in own for name in row)
        values = {name: np.array([row.get(name, np.nan) for row in own], float) for name in names}
        found.append(Columns(values, np.array(times[part], dtype=np.int64)))
    return [found[0]._replace(dropped=tuple(others.items())), *found[1:]]


def _parts(message: Any) -> Iterator[tuple[str, dict[str, float]]]:
    """The numbers of a message by part: one for each joint, or one of all."""
    names = getattr(message, "name", None) or getattr(message, "joint_names", None)
    groups = ("position", "velocity", "effort")
    if isinstance(names, list) and any(hasattr(message, group) for group in groups):
        parts = {group: getattr(message, group, ()) for group in groups}
        for k, joint in enumerate(names):  # a part that the publisher leaves empty is absent
            yield joint, {f"{part}/{joint}": float(x[k]) for part, x in parts.items() if len(x) > k}
    else:
        yield _NUMBERS, dict(_numbers("", message))


def _numbers(name: str, value: Any, depth: int = 0) -> Iterator[tuple[str, float]]:
    """The numbers of a message or of a part of it, by name."""
    if isinstance(value, bool | int | float | np.integer | np.floating | np.bool_):
        yield name, float(value)
    elif isinstance(value, np.ndarray | list | tuple):
        if len(value) <= _MOST and depth < _DEEPEST:
            for k, entry in enumerate(value):
                yield from _numbers(f"{name}_{k}", entry, depth + 1)
    elif depth < _DEEPEST:
        fields = getattr(value, "__dataclass_fields__", {})
        for field in fields:
            if field in _SKIPPED or "covariance" in field or field.startswith("__"):
                continue
            inner = name if field in _WRAPPERS else f"{name}/{field}".strip("/")
            yield from _numbers(inner, getattr(value, field), depth + 1)
