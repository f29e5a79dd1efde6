"""Robots that are not simulated: their structure and prior, and the scenario of a run."""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np

from ..bounds import Name, Positive, config
from ..errors import InvalidInput
from ..experiment.loop import Robot
from ..experiment.scenario import MOST_STEPS, Scenario
from ..experiment.setup import with_prior_error
from ..laws import Identifier, NullspaceAID
from ..laws.cone.prior import drawn_inside
from ..plants import PlantConfig, SensorNoise
from ..plants.arm import ArmPlant, nominal_scales
from ..robot.model import RobotModel
from ..structure.multibody import CompiledMultibody
from .links import file_links
from .models import load_robot_model

_FRICTION_SPEED = 0.05  # s of tanh(v/s) of Coulomb friction [rad/s or m/s]
_FRICTION = 0.05  # friction of either kind over an actuator's largest force
_PER_SAMPLE = 2.0  # largest K times the time between two samples, for RK4 to be stable
_ACCELERATION = 300.0  # of a motor's rotor alone under this force [rad/s² or m/s²]


@config
class MeasuredRobot(PlantConfig, ABC):
    """A robot whose measurements come from outside; its true parameters are unknown."""

    def build(self, dt: float, seed: int) -> Any:
        """Raises `InvalidInput`: there is nothing to simulate."""
        remedy = "`nsaid run arm --robot` and the vehicles of `nsaid list` are simulated."
        raise InvalidInput("plant", "a simulated plant", "a robot that is measured", remedy)

    @abstractmethod
    def known(self) -> Robot:
        """Structure, prior and looks.

        Raises:
            BadRobot: its file cannot be read, or describes a robot that is not a tree of joints.
            UnknownName: there is no such robot or joint.
        """


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


def measured_scenario(
    robot: MeasuredRobot,
    law: str,
    rate: float,
    noise: tuple[float, float],
    error: float,
    steps: float = MOST_STEPS,
) -> Scenario:
    """The scenario of a run on measurements from outside, without the samples.

    They come at `rate` [Hz], at most `steps` after the first, with noise of given standard
    deviations of positions [rad or m] and velocities [rad/s or m/s]; `error` is the prior's largest
    relative one.

    Raises:
        InvalidInput: a value is out of range.
    """
    if not 0.1 <= rate <= 1e5:
        raise InvalidInput("rate", "0.1 to 1e5 samples per second", rate, "Give it in Hz.")
    return Scenario(
        plant=robot,
        identifier=NullspaceAID(
            law=law,  # pyright: ignore[reportArgumentType]  # checked there
            K=min(NullspaceAID().K, _PER_SAMPLE * rate),
        ),
        prior="nominal",
        initial_error=error,
        duration=steps / rate,
        held_out=1 / rate,
        dt=1 / rate,
        sensors="noisy",
        noise=SensorNoise(*noise),
    )


def identifiers_of(scenario: Scenario, robot: Robot) -> dict[str, Identifier]:
    """The scenario's own identifier, for a robot that is not simulated."""
    config, levels = with_prior_error(scenario.identifier, scenario), scenario.noise.levels
    return {"": config.build(robot.system, robot.prior, scenario.dt, levels)}
