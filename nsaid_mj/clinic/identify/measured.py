"""Robots that are not simulated: their structure and prior, and the scenario of a run.

A robot is known from its model file alone, or with the columns chosen from its log.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields, replace
from typing import Any

import numpy as np
from pydantic import StrictBool

from ...base import InvalidInput, Number, Positive, config
from ...core import (
    Block,
    Column,
    Geometry,
    JointTree,
    NullspaceAID,
    ParameterSpace,
    Prior,
    Rotor,
)
from ...lab import (
    ArmPlant,
    PlantConfig,
    RobotDescription,
    Scenario,
    SensorNoise,
)
from ...robots import RobotModel
from .links import file_links
from .models import load_robot_model
from .result import Identification

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
    def known(self) -> RobotDescription:
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

    robot: str
    lock: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    gain: Positive | None = None

    def known(self) -> RobotDescription:
        """Structure, prior and looks from the model file.

        Raises:
            BadRobot: the file cannot be read, or describes a robot that is not a tree of joints.
            UnknownName: there is no such robot or joint.
        """
        model = load_robot_model(self.robot, self.lock, self.joints or None)
        if model.followers:  # laws that follow a motion know no coupled joints
            moving = [joint for joint in self.joints if joint not in model.followers]
            still = (*self.lock, *model.followers)
            model = load_robot_model(self.robot, still, moving or None)
        if not model.jointed:
            assert model.prior is not None
            return RobotDescription(model.system, model.prior, model.visuals)
        return _arm(model, self.gain)


def _arm(model: RobotModel, gain: float | None) -> RobotDescription:
    """A tree of joints with rotor inertia and viscous and Coulomb friction, and motors.

    What the file does not state is guessed by order of magnitude: a geared motor needs about a
    twentieth of its largest force to overcome friction of either kind, and its rotor alone
    accelerates at some 300 rad/s². If the file states no largest force, that of a fast motion
    replaces it; see `ArmPlant.nominal_scales`.
    """
    tree = model.model
    nominal = ArmPlant().nominal_scales(model.model)
    k = len(model.joints)
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
    friction = {"viscous": viscous, "coulomb": coulomb}
    command = nominal.command[driven] / gains
    scales = replace(
        nominal, rotor=rotor, gain=gains, command=command, driven=tuple(driven), **friction
    )
    system = JointTree.checked(tree, scales, np.full(k, _FRICTION_SPEED))
    prior = np.concatenate([file_links(tree), rotor, viscous, coulomb, gains])
    prior = Prior(system.space, prior, 0.0).draw(np.random.default_rng(0))
    return RobotDescription(system, prior, model.visuals)


def measured_scenario(
    robot: MeasuredRobot,
    law: str,
    rate: float,
    noise: tuple[float, float],
    error: float,
    steps: float = Scenario.MOST_STEPS,
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


_OPERATION = 2.0  # largest speeds and commands, relative to their rms


@config
class Parameters:
    """A block of θ, see `parameters.Block`."""

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: tuple[Positive, ...]
    geometry: Geometry
    actuator: StrictBool
    labels: tuple[str, ...]
    entries: tuple[tuple[int, int, int, float], ...] = ()

    @staticmethod
    def of(block: Block) -> Parameters:
        """Those of a block."""
        values = {field.name: getattr(block, field.name) for field in fields(block)}
        return Parameters(**values | {"scale": block.scale.tolist()})

    def block(self) -> Block:
        """The block."""
        scale = np.array(self.scale)
        return Block(
            self.name,
            self.names,
            self.units,
            scale,
            self.geometry,
            self.actuator,
            self.entries,
            self.labels,
        )


@config
class FittedColumn:
    """A column of F, see `structure.parts.Column`."""

    kind: str
    parameter: int
    body: int
    dof: int
    input: int
    constants: tuple[tuple[str, tuple[Number, ...]], ...]

    @staticmethod
    def of(column: Column) -> FittedColumn:
        """That of a column."""
        constants = tuple(
            (name, tuple(np.ravel(np.asarray(value, dtype=np.float64)).tolist()))
            for name, value in column.constants.items()
        )
        return FittedColumn(
            column.kind, column.parameter, column.body, column.dof, column.input, constants
        )

    @property
    def column(self) -> Column:
        """The column."""
        constants = {name: np.squeeze(np.array(values)) for name, values in self.constants}
        return Column(
            self.kind, self.parameter, body=self.body, dof=self.dof, input=self.input, **constants
        )


@config
class LogRobot(MeasuredRobot):
    """A robot as `nsaid identify` fits it to a log: θ is that of the batch fit."""

    # path of a URDF, MJCF or vehicle's TOML file, or the name of a robot or vehicle, for its
    # kinematics
    robot: str
    joints: tuple[str, ...]  # the joints that move; none of a vehicle
    blocks: tuple[Parameters, ...]  # blocks of θ
    prior: tuple[Number, ...]  # (p,) θ̂(0)
    columns: tuple[FittedColumn, ...]  # that the fit adds to the robot's own
    rotors: tuple[tuple[int, int, int], ...]  # `dof`, `parameter` and `other` of its rotors
    speed: tuple[Number, ...] = ()  # (n,) largest velocities, for probes of the structure
    command: tuple[Number, ...] = ()  # (n_u,) largest commands

    def known(self) -> RobotDescription:
        """Structure, prior and looks; kinematics and looks are the model file's."""
        return self.robot_of(load_robot_model(self.robot, (), self.joints or None))

    def robot_of(self, model: RobotModel) -> RobotDescription:
        """Structure, prior and looks of a robot with a loaded model."""
        own = model.system
        if model.jointed:
            own = JointTree.links(model.model, np.array(self.speed), np.array(self.command))
        structure = own.structure
        space = ParameterSpace(tuple(block.block() for block in self.blocks))
        columns = [*structure.columns, *(each.column for each in self.columns)]
        rotors = [*structure.rotors, *(Rotor(*each) for each in self.rotors)]
        structure = replace(structure, columns=columns, rotors=rotors, p=len(space))
        prior = Prior(space, np.array(self.prior), 0.0).draw(np.random.default_rng(0))
        return RobotDescription(own.rebuilt(structure, space), prior, model.visuals)


def log_robot(found: Identification) -> LogRobot:
    """The robot of a batch fit."""
    robot = found.robot
    made, problem, *_ = found.fitted
    v, u = (np.concatenate([getattr(s.log, x) for s in found.recordings.segments]) for x in "vu")
    speed, command = (_OPERATION * np.sqrt(np.mean(x**2, axis=0)) for x in (v, u))
    return LogRobot(
        robot=str(robot.source or robot.name),
        joints=robot.joints if robot.jointed else (),
        blocks=tuple(Parameters.of(block) for block in problem.space.blocks),
        prior=tuple(problem.prior.tolist()),
        columns=tuple(FittedColumn.of(column) for column in made.columns),
        rotors=tuple((rotor.dof, rotor.parameter, rotor.other) for rotor in made.rotors),
        speed=tuple(speed.tolist()),
        command=tuple(command.tolist()),
    )
