"""Names of a system's velocities, positions and sensors, and the effect of a sensor's bias."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..parameters import Array, Block
from .configuration_space import StructuredKinematics

# components of a body's twist and pose, by its dimension
_TWIST = {6: Block.AXES, 3: ("surge", "sway", "yaw")}
_POSE = {6: ("x", "y", "z", *Block.AXES[3:]), 3: ("x", "y", "yaw")}
_FORCES = {"m/s": "N", "rad/s": "N·m"}  # units of generalised forces, by unit of the velocity


class SensedKinematics(StructuredKinematics):
    """Kinematics whose velocities, positions and sensors have names.

    Attributes:
        own_names: names of the velocities after a body's twist, such as those of joints; they are
            numbered where there is not one for each.
        vertical: whether it is a body that moves along the vertical alone.
    """

    own_names: Sequence[str] = ()
    vertical = False

    @property
    def body_axes(self) -> list[int]:
        """Indices of the body axes x, y, z of a vehicle's linear velocities; empty for an arm."""
        return [2] if self.vertical else {6: [0, 1, 2], 3: [0, 1], 0: []}[self.group]

    @property
    def velocity_labels(self) -> list[str]:
        """A name for each velocity: surge, sway …, then the robot's own names of its joints."""
        twist = list(_TWIST.get(self.group, ()))
        rest = self.n - len(twist)
        if len(self.own_names) == rest:
            return twist + list(self.own_names)
        return twist + [f"velocity {i}" for i in range(1, rest + 1)]

    @property
    def position_labels(self) -> list[str]:
        """A name for each position: x, y, z, the parts of a quaternion in space, then joints.

        In the plane x, y and yaw.
        """
        pose = list(_POSE.get(self.group, ()))
        pose = [*pose[:3], "qx", "qy", "qz", "qw"] if len(pose) == 6 else pose
        return pose + self.velocity_labels[self.group :]

    @property
    def rate_labels(self) -> list[str]:
        """A name for each velocity, a body's angular ones as rates: surge, … yaw rate, joints."""
        turning = [k < self.group and u == "rad/s" for k, u in enumerate(self.velocity_units)]
        named = zip(self.velocity_labels, turning, strict=True)
        return [f"{label} rate" if turns else label for label, turns in named]

    @property
    def velocity_names(self) -> list[str]:
        """The names of velocities with units: surge [m/s], … yaw rate [rad/s], joints."""
        named = zip(self.rate_labels, self.velocity_units, strict=True)
        return [f"{label} [{unit}]" for label, unit in named]

    @property
    def command_names(self) -> list[str]:
        """Names of the commands with units: those of the joints where there is one for each."""
        if self.n_u == self.n and not self.group:
            return [f"command of {label} [–]" for label in self.velocity_labels]
        return [f"command {i} [–]" for i in range(1, self.n_u + 1)]

    @property
    def force_units(self) -> list[str]:
        """The unit of the generalised force of each velocity."""
        return [_FORCES.get(unit, "SI") for unit in self.velocity_units]

    @property
    def sensors(self) -> list[tuple[str, str]]:
        """Name and unit of each sensor of position, then of each of velocity."""
        rates = self.velocity_labels
        pose = list(_POSE.get(self.group, ()))
        places = pose + rates[len(pose) :]
        units = [unit.removesuffix("/s") for unit in self.velocity_units]
        found = [(f"position of {a}", unit) for a, unit in zip(places, units, strict=True)]
        moving = zip(rates, self.velocity_units, strict=True)
        return found + [(f"velocity of {a}", unit) for a, unit in moving]

    def displaced(self, q: Array, by: Array) -> Array:
        """(m,) the position q (m,) as measured by a sensor with a bias.

        The error `by` (n,) is in world axes for a place [m], in the body's own axes for an attitude
        [rad], as of a sensor mounted at an angle, and in a joint's position.
        """
        if not by.any():
            return q
        places = {6: 3, 3: 2}.get(self.group, 0)
        turn = by.copy()
        if places:
            shift = np.zeros(self.n)
            shift[:places] = self.J(q)[:places, :places].T @ by[:places]
            q = self.integrate(q, shift)
            turn[:places] = 0.0
        return self.integrate(q, turn)
