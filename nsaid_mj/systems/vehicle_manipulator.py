"""Vehicles with an arm (4–6): the common part of those in water and in air.

θ = the inertia of the base, then of every link; friction and motor gain of every joint; fluid
forces; the gains of the thrusters. The base has x forward, y left, z up; link inertias are
about the joint-frame origin in joint axes, in Pinocchio's order. Commands are the joints' first,
then the thrusters'.
"""

from __future__ import annotations

import numpy as np

from ..parameters import Array, Block, ParameterSpace
from ..structure.parts import Column, Inertia
from ..structure.structure import Structure
from .joints import JointTree, bodies_of, joint_parts, moving_joints, without_inertia
from .multibody import JointScales, joint_blocks
from .optional import pin
from .structured import StructuredSystem


class VehicleManipulator(JointTree, StructuredSystem):
    """M(q, θ) v̇ + C(x, θ) v = weight + friction + motors + the forces that a subclass adds.

    Args:
        model: Pinocchio's, its root a free flyer; its inertias are discarded.
        inertias: of the bodies.
        blocks: of these inertias.
        joints: guesses of the joints' friction, rotors and motors.
        friction_speed: joint speed at which Coulomb friction saturates [rad/s or m/s].
        vehicle: further blocks: fluid forces, and the thrusters' gains.
        forces: the columns of these blocks; their parameters count from the first block's, and
            their commands from the first thruster's.
        thrust_limits: (t,), (t,) range of the thrusters' commands.
        mounts: (·, 3) point on the base where the force of every actuator parameter in `vehicle`
            acts [m], NaN if it exerts no force.
        speed: (6,) the base's velocities of operation [m/s, rad/s].

    Attributes:
        mounts: (k, 3) point of application of every actuator parameter's force in the base's
            frame [m], NaN if it exerts none on the base.
        command_limits: (n_u,), (n_u,) range of the commands of operation.
    """

    def __init__(
        self,
        model: pin.Model,
        inertias: list[Inertia],
        blocks: list[Block],
        joints: JointScales,
        friction_speed: float,
        vehicle: list[Block],
        forces: list[Column],
        thrust_limits: tuple[Array, Array],
        mounts: Array,
        speed: Array,
    ):
        model, k = without_inertia(model), len(moving_joints(model))
        motors = joint_blocks(model, joints)
        start, first = (sum(map(len, part)) for part in (blocks, [*blocks, *motors]))
        low, high = thrust_limits
        self.command_limits = np.r_[-joints.command, low], np.r_[joints.command, high]
        rotors, columns = joint_parts(
            model, start, joints.rotor is not None, np.full(k, friction_speed)
        )
        columns += [column.shifted(first, k) for column in forces]
        space = ParameterSpace((*blocks, *motors, *vehicle))
        super().__init__(
            model,
            Structure(
                bodies_of(model),
                inertias,
                columns,
                len(space),
                len(self.command_limits[0]),
                rotors,
                model.gravity.linear.copy(),
            ),
            space,
            np.vstack([np.full((k, 3), np.nan), mounts]),
        )
        self.scales, self.friction_speed = joints, friction_speed
        self._speed = np.concatenate([speed, joints.speed])

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a pose and a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self._speed * rng.uniform(-1, 1, self.n)
        return q, v, rng.uniform(*self.command_limits)
