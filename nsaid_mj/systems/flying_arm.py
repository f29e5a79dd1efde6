"""Rotorcraft that carry an arm (5): rotors of unknown thrust and torque, in still air."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..parameters import Array, Block
from . import actuators
from .inertial import of_a_body
from .loads import carried_force_law
from .multibody import JointScales
from .optional import pin
from .tree import Carried
from .vehicle_manipulator import VehicleManipulator, link_blocks


class FlyingArm(VehicleManipulator):
    """A base with rotors, with or without an arm.

    θ = [base (10), links (10 k), joints, rotor thrust gains, rotor torque gains]. The command
    u ∈ [0, 1] of a rotor is its speed relative to its maximum: its thrust along its axis is
    gain·u², and its torque on the base about that axis spin·gain·u².

    Args:
        model: Pinocchio's, its root a free flyer; its inertias are discarded.
        joints: guesses of base, links and joints.
        thrust: (r,) guess of the rotors' thrust at full speed [N].
        torque: (r,) guess of the rotors' torque at full speed [N·m].
        speed: (6,) the base's velocities of operation [m/s, rad/s].
        friction_speed: joint speed at which Coulomb friction saturates [rad/s or m/s].
        positions: (r, 3) of the rotors on the base [m].
        directions: (r, 3) unit vectors along which they push.
        spins: (r,) ±1, the sense of the torque on the base about the direction.
    """

    def __init__(
        self,
        model: pin.Model,
        joints: JointScales,
        thrust: Array,
        torque: Array,
        speed: Array,
        friction_speed: float,
        positions: Array,
        directions: Array,
        spins: Array,
    ):
        bodies, rotors = model.njoints - 1, len(positions)
        self.allocation = np.zeros((2, model.nv, rotors))
        self.allocation[0, :6] = actuators.wrenches(positions, directions)
        self.allocation[1, 3:6] = (spins[:, None] * directions).T
        super().__init__(
            model,
            [Carried(i, of_a_body(0, 10), True) for i in range(bodies)],
            link_blocks(model, joints),
            joints,
            friction_speed,
            [
                _gains("rotor thrust gain", "thrust", "N", thrust),
                _gains("rotor torque gain", "torque", "N·m", torque),
            ],
            (np.full(rotors, 0.1), np.ones(rotors)),
            np.vstack([positions, np.full((rotors, 3), np.nan)]),  # a torque acts at no point
            speed,
            RotorForces(self.allocation),
        )


def _gains(name: str, letter: str, unit: str, scale: Array) -> Block:
    numbers = range(1, len(scale) + 1)
    names = tuple(f"{letter}_{i}" for i in numbers)
    labels = tuple(f"{letter} of rotor {i}" for i in numbers)
    return Block(name, names, (unit,) * len(scale), scale, "positive", actuator=True, labels=labels)


class RotorForces(NamedTuple):
    """The rotors, for compiled loops.

    Attributes:
        allocation: (2, n, r) unit wrenches of their thrusts, then of their torques.
    """

    allocation: Array


@carried_force_law(RotorForces)
@njit(cache=True)
def _rotors(forces, linkage, states, u):
    """(N, n, 2 r) wrench per gain of the rotors' thrusts, then torques, at speeds u (N, r)."""
    allocation = forces.allocation
    kinds, n, rotors = allocation.shape
    F = np.empty((u.shape[0], n, kinds * rotors))
    for s in range(u.shape[0]):
        for kind in range(kinds):
            for i in range(n):
                for k in range(rotors):
                    F[s, i, kind * rotors + k] = allocation[kind, i, k] * u[s, k] * u[s, k]
    return F
