"""A robot that is not simulated: what is known about it before it moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..bounds import Name, Positive, config
from ..experiment.loop import Robot
from ..identifiers.cone.prior import drawn_inside
from ..plants.arm import ArmPlant, nominal_scales
from ..structure.multibody import CompiledMultibody
from .data import RobotModel
from .links import file_links
from .measured import MeasuredRobot
from .models import load_robot_model

_FRICTION_SPEED = 0.05  # s of tanh(v/s) of Coulomb friction [rad/s or m/s]
_FRICTION = 0.05  # friction of either kind over an actuator's largest force
_ACCELERATION = 300.0  # of a motor's rotor alone under this force [rad/s² or m/s²]


@config
class LiveRobot(MeasuredRobot):
    """A robot whose measurements arrive while it moves.

    Attributes:
        robot: path of a URDF, MJCF or vehicle's TOML file, or the name of a robot or vehicle.
        lock: joints that do not move.
        joints: the joints that move; all others are locked. If empty, all that are not in `lock`.
        gain: expected force per unit of command of every actuator of an arm, for commands other
            than forces [N·m or N per unit]; None for the model file's, or 1.
    """

    robot: Name
    lock: tuple[Name, ...] = ()
    joints: tuple[Name, ...] = ()
    gain: Positive | None = None

    def known(self) -> Robot:
        """Structure, prior and looks from the model file.

        Raises:
            BadRobot: the file cannot be read, or describes a robot that is not a tree of joints.
            UnknownName: there is no such robot or joint.
        """
        model = load_robot_model(self.robot, self.lock, self.joints or None)
        if model.system is not None:
            assert model.prior is not None
            return Robot(model.system, model.prior, model.visuals)
        return _arm(model, self.gain)


def _arm(model: RobotModel, gain: float | None) -> Robot:
    """A tree of joints with rotor inertia and viscous and Coulomb friction, and motors.

    What the file does not state is guessed by order of magnitude: a geared motor needs about a
    twentieth of its largest force to overcome friction of either kind, and its rotor alone
    accelerates at some 300 rad/s². If the file states no largest force, that of a fast motion
    replaces it; see `nominal_scales`.
    """
    tree, nominal, k = model.model, nominal_scales(model.model, ArmPlant()), len(model.joints)
    driven = [j for j, name in enumerate(model.joints) if name not in model.passive]
    gains = np.abs(model.gain[driven]) if gain is None else np.full(len(driven), gain)
    limit = tree.effortLimit[tree.nv - k :]
    force = np.where(np.isfinite(limit) & (limit > 0), limit, nominal.command)
    friction = _FRICTION * force
    given = (model.rotor, model.damping, model.friction)
    guess = (force / _ACCELERATION, friction / nominal.speed, friction)
    rotor, viscous, coulomb = (
        np.where(own > 0, own, other) for own, other in zip(given, guess, strict=True)
    )
    friction, command = {"viscous": viscous, "coulomb": coulomb}, nominal.command[driven] / gains
    scales = replace(
        nominal, rotor=rotor, gain=gains, command=command, driven=tuple(driven), **friction
    )
    system = CompiledMultibody(tree, scales, np.full(k, _FRICTION_SPEED))
    prior = np.concatenate([file_links(tree), rotor, viscous, coulomb, gains])
    prior = drawn_inside(system.space, prior, 0.0, np.random.default_rng(0))
    return Robot(system, prior, model.visuals)
