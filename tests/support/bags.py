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


def write_sensors(path: Path, times: np.ndarray) -> Path:
    """A bag with an Imu, a pose, a twist, an array, an image and a type that it defines itself."""
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    own = "robot_msgs/msg/Thrust"
    store.register(get_types_from_msg("float64[3] force\nfloat32 voltage\n", own))
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"]
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8)
    with Writer2(path, version=8, storage_plugin=StoragePlugin.MCAP) as bag:
        names = {
            "imu": "sensor_msgs/msg/Imu",
            "pose": "geometry_msgs/msg/PoseStamped",
            "twist": "geometry_msgs/msg/TwistStamped",
            "pwm": "std_msgs/msg/UInt16MultiArray",
            "image": "std_msgs/msg/UInt8MultiArray",
            "thrust": own,
        }
        topics = {
            t: bag.add_connection(f"/{t}", kind, typestore=store) for t, kind in names.items()
        }
        layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
        for t in times.tolist():
            nanoseconds = round(t * 1e9) + 10**9
            stamp = types["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 10**9))
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="base")
            nine = np.zeros(9)
            point = types["geometry_msgs/msg/Point"](t, 1.0, 2.0)
            pose = types["geometry_msgs/msg/Pose"](point, turn)
            twist = types["geometry_msgs/msg/Twist"](vector(t, 0.0, 0.0), vector(0.0, 0.0, 0.5))
            messages = {
                "imu": types[names["imu"]](
                    header, turn, nine, vector(0.1, 0.2, t), nine, vector(0.0, 0.0, 9.8), nine
                ),
                "pose": types[names["pose"]](header, pose),
                "twist": types[names["twist"]](header, twist),
                "pwm": types[names["pwm"]](layout, np.array([1500, 1600], np.uint16)),
                "image": types[names["image"]](layout, np.zeros(4096, np.uint8)),
                "thrust": types[own](np.array([1.0, 2.0, t]), 14.8),
            }
            for topic, message in messages.items():
                raw = store.serialize_cdr(message, names[topic])
                bag.write(topics[topic], nanoseconds, raw)
    return path
