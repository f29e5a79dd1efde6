"""Identified values of a tree of joints, for the exporters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..base import pin
from ..core import Array
from .model import RobotModel
from .tree import set_inertias


class SharedFriction(NamedTuple):
    """Shared parameters of two joints if the motor of one turns by v_i ± v_j."""

    joints: tuple[int, int]  # their indices
    sign: int  # sign of the second joint's rate in the motor's
    inertia: float  # entry (i, j) of the mass matrix that the rotor adds [kg·m²]
    damping: float  # that of the viscous friction [N·m·s/rad]
    friction: float  # Coulomb friction against v_i ± v_j [N·m]


class Spring(NamedTuple):
    """A spring, counterweight or cable that pulls at a joint."""

    joint: int  # its index
    stiffness: float  # [N·m/rad or N/m]; negative where it pushes away from its rest
    rest: float  # position at which it exerts nothing [rad or m]


@dataclass(frozen=True)
class Identified:
    """Identified values of a tree of n joints, in SI units.

    Joint i moves by M v̇ + C v + g = gain·u − damping·v − friction·tanh(v/friction_speed)
    − stiffness·(q − rest), where M includes the rotor inertias.
    """

    model: Any  # Pinocchio's model with the identified inertias and, in `armature`, rotor inertias
    damping: Array  # (n,) viscous friction [N·m·s/rad or N·s/m]
    friction: Array  # (n,) Coulomb friction [N·m or N]
    friction_speed: Array  # (n,) speed at which Coulomb friction saturates [rad/s or m/s]
    gain: Array  # (n,) force per unit of command [N·m or N]; 0 for joints without a motor
    anchor: str  # what fixed the common scale of masses, frictions and gains, in words
    notes: tuple[str, ...] = ()  # further remarks for readers of the exported files
    # couplings of joints that share a motor; a URDF cannot hold them. None keeps the tendons in the
    # model's own file
    couplings: tuple[SharedFriction, ...] | None = ()
    # springs of joints; a URDF cannot hold them. Other joints keep those of an MJCF
    springs: tuple[Spring, ...] = ()

    @property
    def rotor(self) -> Array:
        """(n,) reflected rotor inertia [kg·m² or kg]."""
        return np.array(self.model.armature)[-len(self.gain) :]

    @staticmethod
    def nominal(robot: RobotModel) -> Identified:
        """The values of a robot's own file; its Coulomb friction saturates at 0.05 rad/s or m/s."""
        model = with_inertias(robot.model, inertial_parameters(robot.model), robot.rotor)
        speeds = np.full(len(robot.joints), 0.05)
        anchor = "values of the model file; nothing was identified"
        return Identified(
            model, robot.damping, robot.friction, speeds, robot.gain, anchor, couplings=None
        )


def inertial_parameters(model: pin.Model) -> Array:
    """(b, 10) inertial parameters of a model's links, about the joints' frames.

    Their order is Pinocchio's: m, m·c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    """
    return np.array([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])


def with_inertias(model: pin.Model, inertial: Array, rotor: Array) -> pin.Model:
    """A copy of a model with other inertias: inertial (b, 10), ordered as `inertial_parameters`.

    rotor (n,) is reflected [kg·m² or kg]; a floating base, before the joints, has none.
    """
    changed = pin.Model(model)
    set_inertias(changed, np.asarray(inertial))
    changed.armature = np.append(np.zeros(model.nv - len(rotor)), rotor)
    return changed


def remarks(robot: RobotModel, values: Identified, also: tuple[str, ...] = ()) -> str:
    """The text of an exported file's comment: gains, the scale's anchor, and remarks."""
    lines = ["Calibrated by nsaid-mj.", f"Scale: {values.anchor}."]
    lines.append("Force per unit of command [N·m or N], and speed s of Coulomb friction tanh(v/s):")
    for k, joint in enumerate(robot.joints):
        speed = values.friction_speed[k]
        gain = values.gain[k]
        lines.append(f"  {joint}: gain {gain:.6g}, s {speed:.3g}, rotor {values.rotor[k]:.6g}")
    return "\n".join([*lines, *values.notes, *also])
