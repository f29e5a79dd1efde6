"""Vehicles with an arm (4–6): the common part of those in water and in air.

θ = the inertia of the base, then of every link; friction and motor gain of every joint; fluid
forces; the gains of the thrusters. The base has x forward, y left, z up; link inertias are
about the joint-frame origin in joint axes, in Pinocchio's order. Commands are the joints' first,
then the thrusters'.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from ..dynamics.interpolation import tree_midpoints
from ..dynamics.motions import LoadedMotion, tree_motion
from ..dynamics.structures import LoadedTree
from ..dynamics.tree import AT, AXIS
from ..log import Log, Middle
from ..numerics.triples import add, cross, dot, forth, three
from ..parameters import Array, Block, ParameterSpace
from ..system import Stage
from . import loads
from .joints import JointTree, body_names
from .multibody import JointScales, joint_blocks, link_block
from .optional import pin
from .tree import Carried, linkage_of, loaded


class VehicleManipulator(JointTree):
    """M(q, θ) v̇ + C(x, θ) v = weight + friction + motors + the forces that a subclass adds.

    Args:
        model: Pinocchio's, its root a free flyer; its inertias are discarded.
        inertias: of the bodies, in the order of θ.
        blocks: of these inertias.
        joints: guesses of the joints' friction, rotors and motors.
        friction_speed: joint speed at which Coulomb friction saturates [rad/s or m/s].
        vehicle: further blocks: fluid forces, and the thrusters' gains.
        thrust_limits: (t,), (t,) range of the thrusters' commands.
        mounts: (·, 3) point on the base where the force of every actuator parameter in `vehicle`
            acts [m], NaN if it exerts no force.
        speed: (6,) the base's velocities of operation [m/s, rad/s].
        law: of the forces in `vehicle`; see `loads.carried_force_law`.

    Attributes:
        mounts: (k, 3) point of application of every actuator parameter's force in the base's
            frame [m], NaN if it exerts none on the base.
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
        law: Any,
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
        self.forward = loads.Carrier(self.loaded, law)
        self._speed = np.concatenate([speed, joints.speed])

    def applied(self, states: Array, u: Array) -> Array:
        """(N, n, k) the columns of F of the blocks in `vehicle`.

        Args:
            states: (N, b, ·) of `dynamics.tree`.
            u: (N, n_u) commands.
        """
        return loads.applied_along(self.forward, states, u)

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return self._W_M(q, a) + self._W_C(q, v, w) - self._F(t, q, v, u)

    def _state(self, q: Array, v: Array) -> Array:
        """(b, ·) of `dynamics.tree`."""
        return loads.states_of(self.loaded.linkage, q[None], v[None])[0]

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
        """(N, n, p) F for N samples, compiled."""
        return self._forces(loads.states_of(self.loaded.linkage, q, v), v, u)

    def _forces(self, states: Array, v: Array, u: Array) -> Array:
        F = loads.forces_along_states(self.loaded, states, v, u, self.p)
        F[:, :, self._vehicle :] = self.applied(states, u)
        return F

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance, compiled."""
        linkage, held = self.loaded.linkage, log.u[:-1]
        states, middles = loads.states_of(linkage, log.q, log.v), loads.states_of(linkage, q, v)
        terms = loads.balance(self.loaded, leak, states, middles, log.v, v, held, self.p)
        for F, those in zip(terms[1:], (states[:-1], middles, states[1:]), strict=True):
            F[:, :, self._vehicle :] = self.applied(those, held)
        return terms

    def evaluate_at(self, t: float, q: Array, v: Array, u: Array, w: Array, theta: Array) -> Stage:
        """â of (29), W of (10, 31) and M̂'s smallest pivot at one sample, without a tensor of M."""
        state, theta = self._state(q, v), np.ascontiguousarray(theta)
        F = self._forces(state[None], v[None], u[None])[0]
        return Stage(*loads.evaluate(self.loaded, state, v, u, F, w, theta))

    def midpoints(self, log: Log, hermite: bool) -> Middle:
        """The states half-way between a log's samples."""
        return Middle(*tree_midpoints(self.loaded.linkage, log.t, log.q, log.v, hermite))

    def motion(self, log: Log, hermite: bool) -> LoadedMotion:
        """The vehicle's motion along a log."""
        tree = tree_motion(self.loaded.linkage, hermite, *log)
        states = tree.states[:-1], tree.middles, tree.states[1:]
        F = np.stack([self.applied(those, log.u[:-1]) for those in states])
        return LoadedMotion(self.loaded, *tree[1:], F)

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a pose and a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self._speed * rng.uniform(-1, 1, self.n)
        return q, v, rng.uniform(*self.command_limits)


@njit(cache=True)
def pull(linkage, state, b, force, moment, F, column):
    """Adds the generalised force of a wrench on body b, in its axes, to F[:, column] (n,)."""
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
