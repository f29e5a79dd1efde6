"""Bags of ROS 1 and ROS 2, by the writers of `rosbags`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.support.robot_logs import JOINTS, motion


def write_bag(path: Path, kind: str, times: np.ndarray, effort: bool = True) -> Path:
    """A bag with JointState at every time [s] and Odometry at every fourth, since 1970."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    types = store.types
    q, v, u = motion(times)
    frame = {"seq": 0} if ros1 else {}
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    made = Writer1(path) if ros1 else Writer2(path, version=8, storage_plugin=plugin)
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    joint_state, odometry = "sensor_msgs/msg/JointState", "nav_msgs/msg/Odometry"
    with made as bag:
        joints = bag.add_connection("/joint_states", joint_state, typestore=store)
        odom = bag.add_connection("/odom", odometry, typestore=store)
        for k, t in enumerate(times):
            nanoseconds = 1_700_000_000_000_000_000 + round(t * 1e9)
            stamp = types["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 10**9))
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="base", **frame)
            message = types[joint_state](
                header=header,
                name=list(JOINTS),
                position=q[k],
                velocity=v[k],
                effort=u[k] if effort else np.zeros(0),
            )
            late = nanoseconds + 3_000_000  # the recorder is 3 ms behind the stamp
            bag.write(joints, late, serialize(message, joint_state))
            if k % 4 == 0:
                vector = types["geometry_msgs/msg/Vector3"]
                pose = types["geometry_msgs/msg/Pose"](
                    types["geometry_msgs/msg/Point"](t, 0.0, 0.0),
                    types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                )
                twist = types["geometry_msgs/msg/Twist"](vector(1.0, 0.0, 0.0), vector(0.0, 0, 0))
                message = types[odometry](
                    header,
                    "body",
                    types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
                    types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
                )
                bag.write(odom, late, serialize(message, odometry))
    return path
