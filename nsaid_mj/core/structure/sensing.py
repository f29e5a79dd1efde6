"""Names of a system's sensors, and the effect of a bias on their measurements."""

import numpy as np

from ..parameters import Array
from .blocks import AXES
from .joints import JointTree
from .single_body import SingleBody
from .system import SecondOrderSystem

# components of a body's twist and pose, by its dimension
_TWIST = {6: AXES, 3: ("surge", "sway", "yaw")}
_POSE = {6: ("x", "y", "z", *AXES[3:]), 3: ("x", "y", "yaw")}


def velocity_labels(system: SecondOrderSystem) -> list[str]:
    """A name for each velocity: surge, sway …, then the robot's own names of its joints."""
    twist = list(_TWIST.get(system.group, ()))
    rest = system.n - len(twist)
    if isinstance(system, SingleBody) and system.n == 1:
        return ["heave"]
    names = system.joint_names if isinstance(system, JointTree) else []
    if len(names) != rest:
        names = [f"velocity {i}" for i in range(1, rest + 1)]
    return twist + names


def position_labels(system: SecondOrderSystem) -> list[str]:
    """A name for each position: x, y, z and the quaternion's parts of a pose in space, then joints.

    In the plane x, y and yaw.
    """
    pose = list(_POSE.get(system.group, ()))
    pose = [*pose[:3], "qx", "qy", "qz", "qw"] if len(pose) == 6 else pose
    return pose + velocity_labels(system)[system.group :]


def rate_labels(system: SecondOrderSystem) -> list[str]:
    """A name for each velocity, a body's angular ones as rates: surge, … yaw rate, joints."""
    turning = [k < system.group and u == "rad/s" for k, u in enumerate(system.velocity_units)]
    named = zip(velocity_labels(system), turning, strict=True)
    return [f"{label} rate" if turns else label for label, turns in named]


def sensor_labels(system: SecondOrderSystem) -> list[str]:
    """A name for each sensor of position, then for each of velocity."""
    rates = velocity_labels(system)
    pose = list(_POSE.get(system.group, ()))
    places = pose + rates[len(pose) :]
    return [f"position of {a}" for a in places] + [f"velocity of {a}" for a in rates]


def sensor_units(system: SecondOrderSystem) -> list[str]:
    """The unit of each sensor of position, then of each of velocity."""
    rates = list(system.velocity_units)
    return [unit.removesuffix("/s") for unit in rates] + rates


def displaced(system: SecondOrderSystem, q: Array, by: Array) -> Array:
    """(m,) the position q (m,) as measured by a sensor with a bias.

    The error `by` (n,) is in world axes for a place [m], in the body's own axes for an attitude
    [rad], as of a sensor mounted at an angle, and in a joint's position.
    """
    if not by.any():
        return q
    places = {6: 3, 3: 2}.get(system.group, 0)
    turn = by.copy()
    if places:
        shift = np.zeros(system.n)
        shift[:places] = system.J(q)[:places, :places].T @ by[:places]
        q = system.integrate(q, shift)
        turn[:places] = 0.0
    return system.integrate(q, turn)
