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

from ..dynamics.tree import AT, AXIS
from ..log import Log
from ..numerics.triples import add, cross, dot, forth, three
from ..parameters import Array, Block, ParameterSpace
from ..system import Instant, LoadedTree
from . import loads
from .joints import JointTree, body_names
from .multibody import JointScales, joint_blocks, link_block
from .tree import Carried, linkage_of, loaded


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

    loaded: LoadedTree

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
        self.space = ParameterSpace((*blocks, *joint_blocks(self, joints), *vehicle))
        low, high = thrust_limits
        self.command_limits = np.r_[-joints.command, low], np.r_[joints.command, high]
        self.n_u = len(self.command_limits[0])
        self.mounts = np.vstack([np.full((len(self.joints), 3), np.nan), mounts])
        start, k = sum(len(block) for block in blocks), len(self.joints)
        viscous = start + k * (k > 0 and joints.rotor is not None)
        self._vehicle = viscous + 3 * k
        columns = np.array([start, viscous, viscous + k, viscous + 2 * k])
        linkage = linkage_of(self.model, np.full(k, friction_speed), columns)
        self.loaded = loaded(linkage, inertias)
        self._speed = np.concatenate([speed, joints.speed])

    @abstractmethod
    def applied(self, states: Array, u: Array) -> Array:
        """As in the base class: the columns of `vehicle`."""

    def _state(self, q: Array, v: Array) -> Array:
        """(b, ·) of `recursion`."""
        return loads.placed(self.loaded.linkage, q[None], v[None])[0]

    def _W_M(self, q: Array, a: Array) -> Array:
        still = np.zeros(self.n)
        return loads.inertial(self.loaded, self._state(q, still), still, still, a, self.p)

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        return loads.inertial(self.loaded, self._state(q, v), v, w, np.zeros(self.n), self.p)

    def _transport(self, q: Array, v: Array) -> Array:
        return loads.transport(self.loaded, self._state(q, v), self.n, self.p)

    def _mass_tensor(self, q: Array) -> Array:
        state = self._state(q, np.zeros(self.n))
        return loads.mass_tensor(self.loaded, state, self.n, self.p)

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        return self._forces(self._state(q, v)[None], v[None], u[None])[0]

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """As in the base class, compiled."""
        return self._forces(loads.placed(self.loaded.linkage, q, v), v, u)

    def _forces(self, states: Array, v: Array, u: Array) -> Array:
        F = loads.forces(self.loaded, states, v, u, self.p)
        F[:, :, self._vehicle :] = self.applied(states, u)
        return F

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """As in the base class, compiled."""
        linkage, held = self.loaded.linkage, log.u[:-1]
        states, middles = loads.placed(linkage, log.q, log.v), loads.placed(linkage, q, v)
        terms = loads.balance(self.loaded, leak, states, middles, log.v, v, held, self.p)
        for F, those in zip(terms[1:], (states[:-1], middles, states[1:]), strict=True):
            F[:, :, self._vehicle :] = self.applied(those, held)
        return terms

    def at(self, t: float, q: Array, v: Array, u: Array) -> Instant:
        """The vehicle at one measured state and command."""
        return _VehicleInstant(self, t, q, v, u)

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a pose and a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self._speed * rng.uniform(-1, 1, self.n)
        return q, v, rng.uniform(*self.command_limits)


class _VehicleInstant(Instant):
    """A vehicle at one state, by `loaded`: no tensor of its mass matrix."""

    system: VehicleManipulator

    @cached_property
    def _state(self) -> Array:
        return self.system._state(self.q, self.v)

    @cached_property
    def F(self) -> Array:
        """(n, p) force regressor of (4)."""
        return self.system._forces(self._state[None], self.v[None], self.u[None])[0]

    def evaluate(self, w: Array, theta: Array) -> tuple[Array, Array, float]:
        """As in the base class."""
        theta = np.ascontiguousarray(theta)
        return loads.evaluate(self.system.loaded, self._state, self.v, self.u, self.F, w, theta)

    def commanded(self, t: float, u: Array) -> Instant:
        """The same state under another command."""
        other = _VehicleInstant(self.system, t, self.q, self.v, u)
        other.__dict__["_state"] = self._state
        return other


@njit(cache=True)
def pull(linkage, state, b, force, moment, F, column):
    """Adds to F[:, column] (n,) what a wrench on body b does, in its axes."""
    joints, numbers, _, _ = linkage
    while b > 0:
        F[5 + b, column] += dot(three(joints, b, AXIS), force)
        F[5 + b, column] += dot(three(joints, b, AXIS + 3), moment)
        force = forth(state, b, force)
        moment = add(forth(state, b, moment), cross(three(state, b, AT), force))
        b = numbers[b, 0]
    for i in range(3):
        F[i, column] += force[i]
        F[3 + i, column] += moment[i]


def link_blocks(model: pin.Model, joints: JointScales) -> list[Block]:
    """The inertial parameters of the base, then of every link."""
    guesses = zip(body_names(model), joints.mass, joints.length, strict=True)
    return [link_block(i, name, mass, length) for i, (name, mass, length) in enumerate(guesses)]
