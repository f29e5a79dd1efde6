"""Rotorcraft that carry an arm (5): rotors of unknown thrust and torque, in still air."""

from __future__ import annotations

import numpy as np

from ..parameters import Array, Block
from ..structure.parts import Column, Inertia, columns_at
from .multibody import JointScales, link_blocks
from .optional import pin
from .vehicle_manipulator import VehicleManipulator


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
        rotors = len(positions)
        turning = spins[:, None] * directions
        self.allocation = np.zeros((2, model.nv, rotors))
        self.allocation[0, :6] = np.hstack([directions, np.cross(positions, directions)]).T
        self.allocation[1, 3:6] = turning.T
        super().__init__(
            model,
            [Inertia(b, 10 * b) for b in range(model.njoints - 1)],
            link_blocks(model, joints),
            joints,
            friction_speed,
            [
                _gains("rotor thrust gain", "thrust", "N", thrust),
                _gains("rotor torque gain", "torque", "N·m", torque),
            ],
            [
                *columns_at("rotor", positions, directions),
                *(
                    Column("rotor_torque", rotors + i, body=0, input=i, direction=e)
                    for i, e in enumerate(turning)
                ),
            ],
            (np.full(rotors, 0.1), np.ones(rotors)),
            np.vstack([positions, np.full((rotors, 3), np.nan)]),  # a torque acts at no point
            speed,
        )


def _gains(name: str, letter: str, unit: str, scale: Array) -> Block:
    numbers = range(1, len(scale) + 1)
    names = tuple(f"{letter}_{i}" for i in numbers)
    labels = tuple(f"{letter} of rotor {i}" for i in numbers)
    return Block(name, names, (unit,) * len(scale), scale, "positive", actuator=True, labels=labels)
