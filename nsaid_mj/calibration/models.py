"""Models in and out: a user's robot from its model file, and its file with identified values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..errors import BadRobot, UnknownName
from ..resources import asset, folder, scenarios
from .data import RobotModel

_REMEDY = "Give a file by its path: .urdf, .xml or .mjb (MJCF), or a vehicle's .toml."


def load_robot_model(
    model: str, lock: Sequence[str] = (), joints: Sequence[str] | None = None
) -> RobotModel:
    """Reads a robot's model from a URDF, MJCF or TOML file, or finds it by name.

    Args:
        model: path of a URDF file, of an MJCF file (.xml or .mjb), or of a vehicle's TOML file or
            its folder; or the name of a packed robot or vehicle, or one of example-robot-data.
        lock: joints to fix, at 0 or at the limit nearest to it.
        joints: joints to keep, all others being locked; None keeps all that are not in `lock`.

    Returns:
        The model, reduced to the joints that move, with physically consistent inertias. What was
        changed or left out is in its findings.

    Raises:
        BadRobot: the file cannot be read, or describes a robot that is not a tree of revolute and
            prismatic joints.
        InvalidInput: a value in a vehicle's file is missing or wrong, a joint is both to be locked
            and to be kept, or joints of a vehicle are to be locked.
        UnknownName: there is no such robot or joint; the message lists similar names.
    """
    path = Path(model).expanduser()
    if model in _packed_robots():
        from ..robot.packages import packed_robot

        return packed_robot(model, lock, joints)
    folder_of_vehicle = path.is_dir() and (path / "vehicle.toml").is_file()
    if model in _packed_vehicles() or path.suffix.lower() == ".toml" or folder_of_vehicle:
        from .sheets import load_vehicle

        return load_vehicle(model, lock, joints)
    if path.is_file():
        return _load_file(path, lock, joints)
    if path.is_dir():
        raise BadRobot(model or ".", "", "it is a folder without a vehicle.toml", _REMEDY)
    if path.suffix or path.name != model:
        raise BadRobot(model, "", "no such file", _REMEDY)
    from ..robot.packages import example_robot, example_robots

    known = example_robots()
    if model in known:
        return example_robot(model, lock, joints)
    from ..resources import MORE_ROBOTS, has_example_robots

    remedy = _REMEDY if has_example_robots() else f"{_REMEDY} {MORE_ROBOTS}"
    raise UnknownName("robot", model, [*known, *_packed_vehicles(), *_packed_robots()], remedy)


def _load_file(path: Path, lock: Sequence[str], joints: Sequence[str] | None) -> RobotModel:
    """Reads a robot's file, by its content: a URDF may also be called .xml."""
    from ..robot.text import root_tag

    if path.suffix.lower() == ".xacro":
        remedy = f"Convert it first: `xacro {path.name} > {path.stem}.urdf`."
        raise BadRobot(str(path), "", "it is a xacro template, not a URDF", remedy)
    tag = "mujoco" if path.suffix.lower() == ".mjb" else root_tag(path)
    if tag == "robot":
        from ..robot.urdf import load_urdf

        return load_urdf(path, lock, joints)
    if tag == "mujoco":
        from ..robot.mjcf import load_mjcf

        return load_mjcf(path, lock, joints)
    raise BadRobot(
        str(path), "", f"its root element is <{tag}>, neither <robot> nor <mujoco>", _REMEDY
    )


def _packed_vehicles() -> list[str]:
    """The vehicles that have a folder in assets and a scenario of their own."""
    return sorted({path.name for path in folder("assets").iterdir()} & set(scenarios()))


def _packed_robots() -> list[str]:
    """The robots in assets that are described by a URDF of the folder's name."""
    names = sorted(path.name for path in folder("assets").iterdir())
    return [name for name in names if asset(name, f"{name}.urdf").is_file()]
