"""Logs of walking robots in the layouts in which people have them, from one of `walking`.

A layout renames and reorders columns, as its logger does, and adds columns that a file of its kind
also has. Names are those of the messages and sensors: Unitree's LowState and LowCmd, ROS's
JointState and Imu, MuJoCo's sensors and state, arrays of training frameworks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray
Table = dict[str, Array]

LEGS = ("FR", "FL", "RR", "RL")
"""Order of the legs in Unitree's messages; a model's is often FL, FR, RL, RR."""


class Walked(dict[str, Array]):
    """Columns of a log of `walking` by name, and its joints in the model's order."""

    @property
    def joints(self) -> list[str]:
        """Names of the joints."""
        return [name[2:] for name in self if name.startswith("q_")]

    def of(self, kind: str, joints: Sequence[str]) -> Array:
        """(N, k) columns `kind_joint`."""
        return np.column_stack([self[f"{kind}_{joint}"] for joint in joints])

    @property
    def quaternion(self) -> Array:
        """(N, 4) w, x, y, z."""
        return np.column_stack([self[f"imu_q{x}"] for x in "wxyz"])

    @property
    def gyro(self) -> Array:
        """(N, 3) [rad/s]."""
        return np.column_stack([self[f"gyro_{x}"] for x in "xyz"])

    @property
    def force(self) -> Array:
        """(N, 3) specific force [m/s²]."""
        return np.column_stack([self[f"acc_{x}"] for x in "xyz"])


def read_walk(log: Path) -> Walked:
    """A log that `walking` wrote."""
    with log.open(encoding="utf-8") as stream:
        names = stream.readline().strip().split(",")
        rows = np.loadtxt(stream, delimiter=",")
    return Walked(zip(names, rows.T, strict=True))


def by_limbs(joints: Sequence[str]) -> list[list[str]]:
    """The joints of each leg, whose names begin alike, in the model's order."""
    limbs = dict.fromkeys(joint.split("_")[0] for joint in joints)
    return [[joint for joint in joints if joint.split("_")[0] == limb] for limb in limbs]


def by_legs(joints: Sequence[str]) -> list[str]:
    """The joints leg by leg, in Unitree's order of the legs if the robot has these."""
    limbs = by_limbs(joints)
    names = [limb[0].split("_")[0] for limb in limbs]
    order = [names.index(leg) for leg in LEGS] if set(names) == set(LEGS) else range(len(limbs))
    return [joint for k in order for joint in limbs[k]]


def by_depth(joints: Sequence[str]) -> list[str]:
    """The joints by their place in the leg, hips first, as a search through the tree by breadth."""
    return [joint for level in zip(*by_limbs(joints), strict=True) for joint in level]


def _numbered(stem: str, columns: Array) -> Table:
    return {stem.format(k): column for k, column in enumerate(columns.T)}


def lowstate(walk: Walked, pattern: str, imu: str, feet: Array | None = None) -> Table:
    """Unitree's LowState: `pattern` is a motor's column with {k} and {field}, `imu` the IMU's."""
    order = by_legs(walk.joints)
    found = {}
    names = "q", "dq", "tau_est"
    for k, joint in enumerate(order):
        for name, kind in zip(names, ("q", "dq", "u"), strict=True):
            found[pattern.format(k=k, field=name)] = walk[f"{kind}_{joint}"]
        found[pattern.format(k=k, field="temperature")] = np.full(len(walk["time"]), 31.0 + k)
    rpy = Rotation.from_quat(walk.quaternion, scalar_first=True).as_euler("ZYX")[:, ::-1]
    parts = (("quaternion", walk.quaternion), ("gyroscope", walk.gyro))
    for name, columns in (*parts, ("accelerometer", walk.force), ("rpy", rpy)):
        found |= {imu.format(field=name, k=k): x for k, x in enumerate(columns.T)}
    if feet is not None:
        stem = imu.partition("imu")[0] + "foot_force" + imu.partition("{field}")[2]
        found |= {stem.format(k=k): x for k, x in enumerate(feet.T)}
    return found


def _csv(walk: Walked, feet: Array | None) -> Table:
    table = lowstate(walk, "motor_state[{k}].{field}", "imu_state.{field}[{k}]", feet)
    return {"timestamp": walk["time"]} | table


def _plotjuggler(walk: Walked, feet: Array | None) -> Table:
    state = "/lowstate/motor_state[{k}]/{field}"
    table = lowstate(walk, state, "/lowstate/imu_state/{field}[{k}]", feet)
    return {"__time": 1.7e9 + walk["time"]} | table


def _echo(walk: Walked, feet: Array | None) -> Table:
    """Of `rostopic echo -p`, whose time is in nanoseconds."""
    table = lowstate(walk, "field.motorState{k}.{field}", "field.imu.{field}{k}")
    table = {name.replace("tau_est", "tauEst"): column for name, column in table.items()}
    stamps = (1_700_000_000 + walk["time"]) * 1e9
    return {"%time": stamps} | table


def _named(walk: Walked, feet: Array | None) -> Table:
    """A logger that names the motors: `FR_hip_q`, `FR_hip_tau_est`, `quat_w`."""
    found = {"timestamp": walk["time"]}
    for joint in by_legs(walk.joints):
        for name, kind in (("q", "q"), ("dq", "dq"), ("tau_est", "u")):
            found[f"{joint.removesuffix('_joint')}_{name}"] = walk[f"{kind}_{joint}"]
    found |= {f"quat_{x}": c for x, c in zip("wxyz", walk.quaternion.T, strict=True)}
    found |= {f"gyro_{x}": c for x, c in zip("xyz", walk.gyro.T, strict=True)}
    return found | {f"accel_{x}": c for x, c in zip("xyz", walk.force.T, strict=True)}


def _arrays(walk: Walked, feet: Array | None) -> Table:
    """Training frameworks' arrays, joints by breadth, gravity's direction, no accelerometer."""
    order = by_depth(walk.joints)
    found = {"time": walk["time"]}
    for name, kind in (("joint_pos", "q"), ("joint_vel", "dq"), ("applied_torque", "u")):
        found |= _numbered(name + "_{}", walk.of(kind, order))
    turns = Rotation.from_quat(walk.quaternion, scalar_first=True)
    found |= _numbered("root_quat_w_{}", walk.quaternion)
    found |= _numbered("root_ang_vel_b_{}", walk.gyro)
    return found | _numbered("projected_gravity_b_{}", turns.inv().apply([0.0, 0.0, -1.0]))


def _gravity(walk: Walked, feet: Array | None) -> Table:
    """A log without a quaternion: what a policy sees, gravity in the base's axes instead."""
    found = _arrays(walk, feet)
    return {name: column for name, column in found.items() if "quat" not in name}


def _rpy(walk: Walked, feet: Array | None) -> Table:
    """A logger of a controller: q, dq, tau, roll, pitch and yaw."""
    order = by_legs(walk.joints)
    found = {"time": walk["time"]}
    for name, kind in (("q", "q"), ("dq", "dq"), ("tau", "u")):
        found |= _numbered(name + "_{}", walk.of(kind, order))
    angles = Rotation.from_quat(walk.quaternion, scalar_first=True).as_euler("ZYX")[:, ::-1]
    found |= _numbered("imu_rpy_{}", angles)
    found |= _numbered("imu_acc_{}", walk.force)
    return found | _numbered("ang_vel_{}", walk.gyro)


def _sensors(walk: Walked, feet: Array | None) -> Table:
    """MuJoCo's sensors by name."""
    found = {"time": walk["time"]}
    for name, kind in (("pos", "q"), ("vel", "dq"), ("torque", "u")):
        for joint in by_legs(walk.joints):
            found[f"{joint.removesuffix('_joint')}_{name}"] = walk[f"{kind}_{joint}"]
    found |= _numbered("imu_quat_{}", walk.quaternion)
    found |= _numbered("imu_gyro_{}", walk.gyro)
    return found | _numbered("imu_acc_{}", walk.force)


def _state(walk: Walked, feet: Array | None) -> Table:
    """MuJoCo's state with a free joint, commands and sensors without names."""
    base = np.zeros((len(walk["time"]), 3))
    q = np.hstack([base, walk.quaternion, walk.of("q", walk.joints)])
    v = np.hstack([base, walk.gyro, walk.of("dq", walk.joints)])
    found = {"time": walk["time"]} | _numbered("qpos_{}", q) | _numbered("qvel_{}", v)
    found |= _numbered("ctrl_{}", walk.of("u", walk.joints))
    return found | _numbered("accelerometer_{}", walk.force)


def _ros(walk: Walked, feet: Array | None) -> Table:
    """JointState and Imu, as a bag's columns are named."""
    found = {"time": walk["time"]}
    for name, kind in (("position", "q"), ("velocity", "dq"), ("effort", "u")):
        found |= {f"/joint_states/{name}/{j}": walk[f"{kind}_{j}"] for j in by_legs(walk.joints)}
    quaternion = zip("xyzw", np.roll(walk.quaternion, -1, axis=1).T, strict=True)
    found |= {f"/imu/data/orientation/{x}": c for x, c in quaternion}
    for name, columns in (("angular_velocity", walk.gyro), ("linear_acceleration", walk.force)):
        found |= {f"/imu/data/{name}/{x}": c for x, c in zip("xyz", columns.T, strict=True)}
    return found


LAYOUTS: dict[str, Callable[[Walked, Array | None], Table]] = {
    "lowstate": _csv,
    "plotjuggler": _plotjuggler,
    "echo": _echo,
    "named": _named,
    "arrays": _arrays,
    "gravity": _gravity,
    "rpy": _rpy,
    "sensors": _sensors,
    "state": _state,
    "ros": _ros,
}
"""A log's columns by layout."""


def write_table(path: Path, table: Table) -> Path:
    """Writes columns as CSV."""
    rows = np.column_stack(list(table.values()))
    header = ",".join(f'"{name}"' if "," in name else name for name in table)
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return path
