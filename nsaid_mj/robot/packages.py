"""Robots that are known by name: packed ones, and those of example-robot-data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import BadRobot
from ..resources import asset, known_robots, packed_robots
from .findings import Finding
from .model import RobotModel
from .urdf import load_urdf


def example_robots() -> list[str]:
    """The names of all robots in assets/robots and example-robot-data, sorted."""
    return known_robots()


def example_robot(
    name: str, lock: Sequence[str] = (), joints: Sequence[str] | None = None
) -> RobotModel:
    """Reads a robot of assets/robots or example-robot-data; one that floats is fixed to a stand.

    Args:
        name: of the robot.
        lock: joints to fix.
        joints: joints to keep; None keeps all that are not in `lock`.

    Raises:
        BadRobot: it is not described by a URDF file.
    """
    robot = load_urdf(example_file(name), lock, joints)
    findings = robot.findings
    if name not in packed_robots() and _loader(name).free_flyer:
        text = "its base can move; it was taken as fixed to a stand, level"
        findings += (
            Finding("warning", "base_held", name, text, "Use logs of the robot on a stand."),
        )
    return replace(robot, name=name, source=None, findings=findings)


def packed_robot(
    name: str, lock: Sequence[str] = (), joints: Sequence[str] | None = None
) -> RobotModel:
    """Reads a robot that is packed with this package, by the name of its folder in assets.

    Args:
        name: of the robot.
        lock: joints to fix.
        joints: joints to keep; None keeps all that are not in `lock`.
    """
    return replace(load_urdf(packed_file(name), lock, joints), name=name, source=None)


def packed_file(name: str) -> Path:
    """The URDF file of a packed robot, whether or not it exists."""
    return asset(name, f"{name}.urdf")


def model_file(robot: RobotModel) -> Path:
    """The file that a robot was read from."""
    packed = packed_file(robot.name)
    return robot.source or (packed if packed.is_file() else example_file(robot.name))


def _loader(name: str) -> Any:
    from example_robot_data.robots_loader import ROBOTS

    return ROBOTS[name]


def example_file(name: str) -> Path:
    """The URDF file of a robot in assets/robots or of example-robot-data.

    Raises:
        BadRobot: it is not described by a URDF file.
    """
    if name in packed_robots():
        return packed_robots()[name]
    from example_robot_data.robots_loader import getModelPath

    loader = _loader(name)
    file = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
    if file.suffix != ".urdf":
        raise BadRobot(name, "", "it is not described by a URDF file", "Choose another robot.")
    return Path(getModelPath(str(file))) / file
