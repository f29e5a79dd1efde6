"""Rebuilds the run of a robot that was not simulated from its record."""

from __future__ import annotations

from pathlib import Path

from ..experiment.loop import Cost, Ending, Run, columns
from ..experiment.record import Record
from ..experiment.scenario import Scenario
from ..identifiers import Status
from .live_robot import LiveRobot
from .log_robot import LogRobot
from .measured import identifiers_of


def reopen_measured(folder: Path, record: Record) -> Run | None:
    """Rebuilds the run of a measured robot from its record; None if its robot was simulated."""
    scenario = Scenario.from_json(record.scenario(folder))
    if not isinstance(scenario.plant, LiveRobot | LogRobot):
        return None
    robot = scenario.plant.known()
    record.check(folder, columns(robot.system, scenario))
    return Run(
        scenario=scenario,
        folder=folder,
        record=record,
        system=robot.system,
        prior=robot.prior,
        identifiers=identifiers_of(scenario, robot),
        statuses={"": Status.completed},
        ending=Ending(Status.completed, float(record["t"][-1])),
        cost=Cost(steps=len(record)),
        looks=robot.looks,
    )
