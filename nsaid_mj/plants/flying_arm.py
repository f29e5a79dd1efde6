"""Rotorcraft that carry an arm (5): rotors of unknown thrust and torque, in still air."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..bounds import Name, Share, config
from ..errors import UnknownName
from ..parameters import Array
from ..resources import numbers
from ..robot.loading import load_robot
from ..robot.tree import tree_spec
from ..structure.joints import Carrier, JointScales, link_blocks
from ..structure.multibody import CompiledMultibody
from ..structure.optional import pin
from ..structure.parts import Inertia
from ..structure.single_body import Operation
from .arm import ArmPlant, give_rotors, nominal_scales, published_theta, true_model
from .rotors import rotor_terms
from .world.body import command_inputs
from .world.simulated import Known, KnownPlant, SimulatedRobot

_UNSURE = (
    ("rotor inertia", 1.0), ("rotor thrust gain", 1.0), ("rotor torque gain", 0.25),
    ("viscous friction", 1.0), ("Coulomb friction", 1.0), ("motor gain", 1.0),
)  # fmt: skip


@config
class FlyingArmPlant(KnownPlant):
    """A flying robot of example-robot-data; rotor parameters and sources in assets/flying_arm.

    Attributes:
        robot: `borinot`, a hexarotor with an arm, or `iris`, a quadrotor without one.
        spread: largest relative deviation of the true joint friction, rotor inertia, motor gains
            and thrusts from the nominal values; a quarter of it for the rotors' torques, because
            yaw authority is small.
    """

    _refuses: ClassVar[tuple[str, ...]] = ("a flying arm in still air", "flow", "fluid")

    robot: Name = "borinot"
    spread: Share = 0.2

    def _published(self) -> Known:
        """The robot's description, its structure, and its published or nominal θ.

        Raises:
            UnknownName: assets/flying_arm/vehicle.toml does not list this robot's rotors.
        """
        known = numbers("flying_arm")
        if self.robot not in known:
            remedy = "Rotors are listed in assets/flying_arm/vehicle.toml."
            raise UnknownName("flying robot", self.robot, known, remedy)
        robot, d = load_robot(self.robot, "free"), known[self.robot]
        sheet = ArmPlant()
        scales = nominal_scales(robot.model, sheet)
        system = flying_arm(robot.model, scales, sheet.friction_speed, d)
        theta, count = published_theta(robot.model, system), len(d["spins"])
        theta[-2 * count :] = np.repeat([d["thrust"], d["torque"]], count)
        return Known(robot, system, theta, _UNSURE)

    def _made(self, known: Known, dt: float, theta: Array) -> SimulatedRobot:
        robot, system = known.source, known.system
        model, acting = true_model(robot.model, theta), theta.copy()
        spec, names = tree_spec(model, dt), list(model.names)[1:]
        give_rotors(spec, system, theta)
        acting[~np.isin(np.arange(system.p), [c.parameter for c in system.structure.columns])] = 0.0
        command_inputs(spec, system.n_u, names[0])
        return SimulatedRobot(system, theta, acting, spec, names, self.mismatch, robot.visuals)


def flying_arm(
    model: pin.Model, joints: JointScales, friction_speed: float, d: Mapping[str, Any]
) -> CompiledMultibody:
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
    carrier = Carrier(
        [Inertia(b, 10 * b) for b in range(model.njoints - 1)],
        link_blocks(model, joints),
        rotor_terms(places, d["spins"], d["thrust"], d["torque"]),
        Operation.within(d["speed"], np.ones(len(places)), 0.1),
    )
    return CompiledMultibody(model, joints, np.full(len(joints.gain), friction_speed), carrier)
