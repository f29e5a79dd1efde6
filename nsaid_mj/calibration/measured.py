"""Runs of robots that are not simulated: prior knowledge, and the scenario."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from ..bounds import config
from ..errors import InvalidInput
from ..experiment.loop import Robot
from ..experiment.scenario import MOST_STEPS, Scenario
from ..experiment.setup import with_prior_error
from ..identifiers import Identifier, NullspaceAID
from ..plants import PlantConfig, SensorNoise


@config
class MeasuredRobot(PlantConfig, ABC):
    """A robot whose measurements come from outside. Nobody knows its true parameters."""

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


def measured_scenario(
    robot: MeasuredRobot,
    law: str,
    rate: float,
    noise: tuple[float, float],
    error: float,
    steps: float = MOST_STEPS,
) -> Scenario:
    """The scenario of a run on measurements from outside: everything about it but the samples.

    Args:
        robot: the robot.
        law: name of the law.
        rate: samples per second [Hz].
        noise: standard deviations of positions [rad or m] and velocities [rad/s or m/s].
        error: largest relative error of the prior.
        steps: largest number of samples after the first.

    Raises:
        InvalidInput: a value is out of range.
    """
    if not 0.1 <= rate <= 1e5:
        raise InvalidInput("rate", "0.1 to 1e5 samples per second", rate, "Give it in Hz.")
    return Scenario(
        plant=robot,
        identifier=NullspaceAID(law=law),  # pyright: ignore[reportArgumentType]  # checked there
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
