"""Rotorcraft that carry an arm (5): rotors of unknown thrust and torque, in still air."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...base import pin
from ...core import JointScales, JointTree, Operation
from .rotors import rotor_terms


def flying_arm(
    model: pin.Model, joints: JointScales, friction_speed: float, d: Mapping[str, Any]
) -> JointTree:
    """A base with rotors, with or without an arm.

    θ = [base (10), links (10 k), joints, rotor thrust gains, rotor torque gains]. The command
    u ∈ [0, 1] of a rotor is its speed relative to its maximum: its thrust along z is gain·u², and
    its torque on the base about z spin·gain·u².

    Args:
        model: Pinocchio's, its root a free flyer; its inertias are discarded.
        joints: guesses of base, links and joints.
        friction_speed: joint speed at which Coulomb friction saturates [rad/s or m/s].
        d: the robot's table of assets/flying_arm/vehicle.toml.
    """
    places = np.array(d["positions"])
    rotors = rotor_terms(places, d["spins"], d["thrust"], d["torque"])
    operation = Operation.within(d["speed"], np.ones(len(places)), 0.1)
    return JointTree(model, joints, np.full(len(joints.gain), friction_speed), rotors, operation)
