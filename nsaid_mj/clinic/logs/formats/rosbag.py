"""ROS 1 bags, ROS 2 bags (SQLite or MCAP) and single MCAP files, through `rosbags`.

It reads `sensor_msgs/JointState`, `nav_msgs/Odometry` and `std_msgs/Float64MultiArray`. Times are
the stamps of the headers; for a message without one, the time of recording.
"""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..unusable import UnreadableLog
from . import Columns, check_size

_VECTOR = ("x", "y", "z")
_QUATERNION = ("x", "y", "z", "w")


def read(path: Path) -> list[Columns]:
    """One group of columns for each joint, body or array of a topic.

    Columns are called `TOPIC/position/JOINT`, `TOPIC/velocity/JOINT`, `TOPIC/effort/JOINT`;
    `TOPIC/position/x` …, `TOPIC/orientation/x` …, `TOPIC/linear/x` …, `TOPIC/angular/x` …; and
    `TOPIC/data_0` …

    Raises:
        UnreadableLog: the bag is beyond the limit or has no message of these types.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    times: dict[str, list[int]] = defaultdict(list)
    rows: dict[str, list[dict[str, float]]] = defaultdict(list)
    store = get_typestore(Stores.ROS2_HUMBLE)
    numbers = 0
    with AnyReader([path], default_typestore=store) as reader:
        known = [c for c in reader.connections if c.msgtype in _PARTS]
        others = {c.topic: c.msgtype for c in reader.connections if c.msgtype not in _PARTS}
        for connection, received, raw in reader.messages(known):
            message: Any = reader.deserialize(raw, connection.msgtype)
            topic = connection.topic.strip("/")
            header = getattr(message, "header", None)
            own = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec if header else 0
            time = own or received
            for part, values in _PARTS[connection.msgtype](message):
                times[f"{topic}/{part}"].append(time)
                rows[f"{topic}/{part}"].append({f"{topic}/{k}": x for k, x in values.items()})
                numbers += 1 + len(values)
            check_size(path, 8 * numbers)
    if not rows:
        types = ", ".join(sorted(set(others.values())))
        remedy = f"Record sensor_msgs/JointState or nav_msgs/Odometry; it has {types}."
        raise UnreadableLog(path, "the bag has no message of joints or odometry", remedy)
    found = []
    for part, own in rows.items():
        names = dict.fromkeys(name for row in own for name in row)
        values = {name: np.array([row.get(name, np.nan) for row in own], float) for name in names}
        found.append(Columns(values, np.array(times[part], dtype=np.int64)))
    dropped = tuple((topic, f"a topic of {kind}") for topic, kind in others.items())
    return [found[0]._replace(dropped=dropped), *found[1:]]


def _joints(message: Any) -> Iterator[tuple[str, dict[str, float]]]:
    """Each joint's numbers; a part that the publisher leaves empty is absent."""
    parts = {part: getattr(message, part) for part in ("position", "velocity", "effort")}
    for k, joint in enumerate(message.name):
        yield joint, {f"{part}/{joint}": float(x[k]) for part, x in parts.items() if len(x) > k}


def _odometry(message: Any) -> Iterator[tuple[str, dict[str, float]]]:
    pose = message.pose.pose
    twist = message.twist.twist
    parts = (
        ("position", pose.position, _VECTOR),
        ("orientation", pose.orientation, _QUATERNION),
        ("linear", twist.linear, _VECTOR),
        ("angular", twist.angular, _VECTOR),
    )
    found = {f"{name}/{axis}": getattr(part, axis) for name, part, axes in parts for axis in axes}
    yield "odometry", found


def _array(message: Any) -> Iterator[tuple[str, dict[str, float]]]:
    yield "data", {f"data_{k}": float(value) for k, value in enumerate(message.data)}


_PARTS = {
    "sensor_msgs/msg/JointState": _joints,
    "nav_msgs/msg/Odometry": _odometry,
    "std_msgs/msg/Float64MultiArray": _array,
}
