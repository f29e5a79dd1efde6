"""Vehicles that carry an arm: a base with thrusters in water, or with rotors in air (4–6).

θ = the inertia of the base, then of every link; friction and motor gain of every joint; what the
fluid does; the gain of every thruster. Bodies have x forward, y left, z up; link inertias are about
the joint-frame origin in joint axes, in Pinocchio's order. Commands are the joints' first, then the
thrusters'.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numba import njit

from ..parameters import Array, Block, ParameterSpace
from ..spatial import cross
from ..system import Instant
from . import actuators, fluid
from .joints import JointTree
from .multibody import JointScales, inertial_block, joint_block, joint_blocks
from .rigid_body import of_a_body, symmetric
from .tree import (
    Carried,
    add_inertial,
    add_weight,
    along,
    entries_of,
    evaluate,
    kinematics,
    mass_matrix,
    mass_tensor,
    tree_of,
)
from .underwater import UnderwaterScales, body_blocks, mass_block

_UP = np.array([0.0, 0.0, 1.0])
_STRIPS = 4  # points of Gauss-Legendre quadrature along a link: exact to the seventh power


class VehicleManipulator(JointTree):
    """M(q, θ) v̇ + C(x, θ) v = weight, friction, motors, and what a subclass adds.

    Args:
        model: Pinocchio's, its root a free flyer; its inertias are not read and not kept.
        inertias: of the bodies, in the order of θ.
        blocks: of these inertias.
        joints: guesses of the joints' friction, rotors and motors.
        friction_speed: joint speed at which Coulomb friction is developed [rad/s or m/s].
        vehicle: further blocks: what the fluid does, and actuators last.
        thrusters: number of their commands.
        mounts: (k, 3) where every actuator's force acts on the base [m], for those in `vehicle`.
        speed: (6,) the base's velocities of operation [m/s, rad/s].

    Attributes:
        mounts: (k, 3) for every actuator parameter, NaN where it makes no force on the base.
    """

    def __init__(
        self,
        model: pin.Model,
        inertias: list[Carried],
        blocks: list[Block],
        joints: JointScales,
        friction_speed: float,
        vehicle: list[Block],
        thrusters: int,
        mounts: Array,
        speed: Array,
    ):
        super().__init__(model)
        self.scales, self.friction_speed = joints, friction_speed
        self.space = ParameterSpace((*blocks, *joint_blocks(self.slides, joints), *vehicle))
        self.n_u = len(self.joints) + thrusters
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

    def mass_matrix_at(self, q: Array, theta: Array) -> Array:
        """(n, n) M(q, θ) at one position, without its regressor."""
        J, _, _ = kinematics(self._tree, q, np.zeros(self.n))
        return mass_matrix(self._entries, self._rotor, J, theta)

    def at(self, t: float, q: Array, v: Array, u: Array) -> Instant:
        """The vehicle at one measured state and command."""
        return _VehicleInstant(self, t, q, v, u, kinematics(self._tree, q, v))

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a pose and a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self._speed * rng.uniform(-1, 1, self.n)
        motors = self.scales.command * rng.uniform(-1, 1, len(self.joints))
        return q, v, np.concatenate([motors, self._random_thrust(rng)])

    def _random_thrust(self, rng: np.random.Generator) -> Array:
        return rng.uniform(-1, 1, self.n_u - len(self.joints))


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

    def evaluate(self, w: Array, theta: Array) -> tuple[Array, Array, float]:
        """As in the base class."""
        system, (J, J_dot, up) = self.system, self._kinematics
        if "F" not in self.__dict__:
            self.__dict__["F"] = system._forces(J, up, self.q, self.v, self.u)
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


# -- in water --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Cylinders:
    """What is known of the k links' shapes in water: slender cylinders, in the links' own axes.

    Attributes:
        centres: (k, 3) [m].
        axes: (k, 3) unit vectors.
        lengths: (k,) [m].
    """

    centres: Array
    axes: Array
    lengths: Array


@dataclass(frozen=True)
class LinkFluidScales:
    """What an engineer would guess of the links in water; it becomes the scale of θ.

    Attributes:
        added: (k,) added mass across the cylinder [kg].
        drag: (k,) quadratic drag across the cylinder, per length [N·s²/m³].
        buoyancy: (k,) [N].
    """

    added: Array
    drag: Array
    buoyancy: Array


class UnderwaterManipulator(VehicleManipulator):
    """An underwater vehicle (see `UnderwaterVehicle`) whose arm moves water, too.

    θ = [base's M with added mass (21), links (10 k), links' added mass (k), joints, linear drag
    (6), quadratic drag (6), net weight, righting moments (3), links' drag (k), links' buoyancy (k),
    thrust]. A link is a cylinder of axis e: its added mass is m_A (1 − e eᵀ) at every point of the
    axis, its drag on a strip ds is −c |v_⊥| v_⊥ ds, its buoyancy acts at its centre.

    Args:
        model: Pinocchio's, its root a free flyer.
        joints: guesses of links and joints; of the base's mass and length no use is made.
        base: guesses of the base in water.
        links: guesses of the links in water.
        cylinders: the links' shapes.
        friction_speed: joint speed at which Coulomb friction is developed [rad/s or m/s].
        positions: (k, 3) of the thrusters on the base [m].
        directions: (k, 3) in which they push, unit vectors.
        curve: coefficients of u, u³, u⁵ … of the command curve; their sum is 1.
    """

    def __init__(
        self,
        model: pin.Model,
        joints: JointScales,
        base: UnderwaterScales,
        links: LinkFluidScales,
        cylinders: Cylinders,
        friction_speed: float,
        positions: Array,
        directions: Array,
        curve: Array,
    ):
        k, g = model.njoints - 2, float(np.linalg.norm(model.gravity.linear))
        added = added_inertias(cylinders)
        _, drag, restoring, thrust = (  # mass, drags, weight and moment, thrusters
            body_blocks(base)[:1],
            body_blocks(base)[1:3],
            body_blocks(base)[3:5],
            body_blocks(base)[5:],
        )
        super().__init__(
            model,
            [Carried(0, symmetric(6, 0, 21), 0.0)]
            + [Carried(1 + i, of_a_body(0, 10), g) for i in range(k)]
            + [Carried(1 + i, added[i][:, :, None], 0.0) for i in range(k)],
            [mass_block(base.mass), *_link_blocks(joints), _per_link("added mass", "added", "kg", links.added)],
            joints,
            friction_speed,
            [
                *drag,
                *restoring,
                _per_link("drag", "link_drag", "N·s²/m³", links.drag),
                _per_link("buoyancy", "buoyancy", "N", links.buoyancy),
                *thrust,
            ],
            len(positions),
            positions,
            base.speed,
        )
