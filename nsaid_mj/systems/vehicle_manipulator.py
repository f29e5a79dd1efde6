"""Vehicles that carry an arm (4–6): what they share in water and in air.

θ = the inertia of the base, then of every link; friction and motor gain of every joint; what the
fluid does; the gains of the thrusters. The base has x forward, y left, z up; link inertias are
about the joint-frame origin in joint axes, in Pinocchio's order. Commands are the joints' first,
then the thrusters'.
"""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property

import numpy as np
import pinocchio as pin
from numba import njit

from ..parameters import Array, Block, ParameterSpace
from ..system import Instant
from .joints import JointTree
from .multibody import JointScales, joint_blocks, link_block
from .tree import (
    Carried,
    add_inertial,
    add_weight,
    along,
    entries_of,
    evaluate,
    kinematics,
    mass_tensor,
    tree_of,
)


class VehicleManipulator(JointTree):
    """M(q, θ) v̇ + C(x, θ) v = weight, friction, motors, and what a subclass adds.

    Args:
        model: Pinocchio's, its root a free flyer; its inertias are not read and not kept.
        inertias: of the bodies, in the order of θ.
        blocks: of these inertias.
        joints: guesses of the joints' friction, rotors and motors.
        friction_speed: joint speed at which Coulomb friction is developed [rad/s or m/s].
        vehicle: further blocks: what the fluid does, and the thrusters' gains.
        thrust_limits: (t,), (t,) range of the thrusters' commands.
        mounts: (·, 3) where the force of every actuator parameter in `vehicle` acts on the base
            [m], NaN where it makes no force.
        speed: (6,) the base's velocities of operation [m/s, rad/s].

    Attributes:
        mounts: (k, 3) where the force of every actuator parameter acts in the base's frame [m],
            NaN where it makes none on it.
        command_limits: (n_u,), (n_u,) range of the commands of operation.
    """

    def __init__(
        self,
        model: pin.Model,
        inertias: list[Carried],
        blocks: list[Block],
        joints: JointScales,
        friction_speed: float,
        vehicle: list[Block],
        thrust_limits: tuple[Array, Array],
        mounts: Array,
        speed: Array,
    ):
        super().__init__(model)
        self.scales, self.friction_speed = joints, friction_speed
        self.space = ParameterSpace((*blocks, *joint_blocks(self.slides, joints), *vehicle))
        low, high = thrust_limits
        self.command_limits = np.r_[-joints.command, low], np.r_[joints.command, high]
        self.n_u = len(self.command_limits[0])
        self.mounts = np.vstack([np.full((len(self.joints), 3), np.nan), mounts])
        self._tree, self._entries = tree_of(self.model), entries_of(inertias)
        start, k = sum(len(block) for block in blocks), len(self.joints)
        has_rotors = k > 0 and joints.rotor is not None
        self._rotor = start if has_rotors else -1
        self._viscous = start + k * has_rotors
        self._vehicle = self._viscous + 3 * k
        self._speed = np.concatenate([speed, joints.speed])

    @abstractmethod
    def _add_vehicle(self, F: Array, J: Array, up: Array, q: Array, v: Array, u: Array) -> None:
        """Writes the columns from `_vehicle` on into F (n, p).

        Args:
            F: to write into.
            J: (b, 6, n) Jacobians of the bodies' twists, in their own axes.
            up: (b, 3) upwards in the bodies' axes.
            q: (m,) position.
            v: (n,) velocity.
            u: (k,) commands of the thrusters.
        """

    def _W_M(self, q: Array, a: Array) -> Array:
        J, _, _ = kinematics(self._tree, q, np.zeros(self.n))
        W, still = np.zeros((self.n, self.p)), np.zeros((self.bodies, 6))
        add_inertial(W, self._entries, J, along(J, a), still, still)
        if self._rotor >= 0:
            joints = np.arange(self.n - 6)
            W[6 + joints, self._rotor + joints] = a[6:]
        return W

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        J, J_dot, _ = kinematics(self._tree, q, v)
        W = np.zeros((self.n, self.p))
        add_inertial(W, self._entries, J, along(J_dot, w), along(J, v), along(J, w))
        return W

    def _transport(self, q: Array, v: Array) -> Array:
        J, J_dot, _ = kinematics(self._tree, q, v)
        W, V = np.zeros((self.n, self.p)), along(J, v)
        still = 0.0 * V
        # Ṁ v − C v = Σ J̇ᵀ I V + Jᵀ ad_Vᵀ I V
        add_inertial(W, self._entries, J_dot, V, still, still)
        add_inertial(W, self._entries, J, still, -V, V)
        return W

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        J, _, up = kinematics(self._tree, q, v)
        return self._forces(J, up, q, v, u)

    def _forces(self, J: Array, up: Array, q: Array, v: Array, u: Array) -> Array:
        """(n, p) F of (4), from the kinematics."""
        F, joints = np.zeros((self.n, self.p)), len(self.joints)
        add_weight(F, self._entries, J, up)
        _add_joints(F, self._viscous, v, self.friction_speed, u)
        self._add_vehicle(F, J, up, q, v, u[joints:])
        return F

    def _mass_tensor(self, q: Array) -> Array:
        J, _, _ = kinematics(self._tree, q, np.zeros(self.n))
        return mass_tensor(self._entries, self._rotor, J, self.p)

    def at(self, t: float, q: Array, v: Array, u: Array) -> Instant:
        """The vehicle at one measured state and command."""
        return _VehicleInstant(self, t, q, v, u, kinematics(self._tree, q, v))

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a pose and a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self._speed * rng.uniform(-1, 1, self.n)
        return q, v, rng.uniform(*self.command_limits)


class _VehicleInstant(Instant):
    """A vehicle at one state: its kinematics once, and no tensor of its mass matrix."""

    system: VehicleManipulator

    def __init__(
        self,
        system: VehicleManipulator,
        t: float,
        q: Array,
        v: Array,
        u: Array,
        kinematics: tuple[Array, Array, Array],
    ):
        super().__init__(system, t, q, v, u)
        self._kinematics = kinematics

    @cached_property
    def F(self) -> Array:
        """(n, p) force regressor of (4)."""
        J, _, up = self._kinematics
        return self.system._forces(J, up, self.q, self.v, self.u)

    def evaluate(self, w: Array, theta: Array) -> tuple[Array, Array, float]:
        """As in the base class."""
        system, (J, J_dot, _) = self.system, self._kinematics
        return evaluate(
            system._entries, system._rotor, J, J_dot, self.F, self.v, w, np.ascontiguousarray(theta)
        )

    def commanded(self, t: float, u: Array) -> Instant:
        """The same state under another command."""
        return _VehicleInstant(self.system, t, self.q, self.v, u, self._kinematics)


@njit(cache=True)
def _add_joints(F, start, v, friction_speed, u):
    """Viscous and Coulomb friction and motors of the joints, from column `start` on."""
    count = v.shape[0] - 6
    for k in range(count):
        F[6 + k, start + k] = -v[6 + k]
        F[6 + k, start + count + k] = -np.tanh(v[6 + k] / friction_speed)
        F[6 + k, start + 2 * count + k] = u[k]


def link_blocks(joints: JointScales) -> list[Block]:
    """The inertial parameters of every link but the base."""
    numbers = range(1, len(joints.mass))
    return [link_block(i, joints.mass[i], joints.length[i]) for i in numbers]
