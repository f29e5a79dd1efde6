"""The file that describes a robot, by its path or name; no file is read."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..base import UnknownName, path_of
from .assets import (
    MORE_ROBOTS,
    VehicleFiles,
    asset,
    example_robots,
    folder,
    has_example_robots,
    known_robots,
    packed_robots,
    scenarios,
)
from .errors import BadRobot

REMEDY = "Give the path of a file ending in .urdf, .xml or .mjb (MJCF), or a vehicle's .toml."
_WALKING = {"g1_legs", "go2"}  # packed robots whose base floats
_CUT_IN_CODE = "talos_legs"  # the only one whose loader removes joints in its file


class RobotFile(NamedTuple):
    """The file that describes a robot."""

    path: Path  # path of its URDF or MJCF
    named: bool = False  # whether it was given by a name
    floats: bool = False  # whether its base floats although its file does not state it


def robot_file(name: str, others: Sequence[str] = ()) -> RobotFile:
    """The file that describes a robot, by its path or name; `others` are further names to suggest.

    Raises:
        BadRobot: there is no such file, or no file describes the robot of this name.
        UnknownName: there is no robot of this name.
    """
    path = path_of(name)
    packed = {**packed_robots(), **packed_folders()}
    if name in packed:
        return RobotFile(packed[name], named=True, floats=name in _WALKING)
    if path.is_dir() and name not in known_robots():  # a folder hides no robot of its name
        reason = "no such file, but a folder without a vehicle.toml"
        raise BadRobot(name or ".", "", reason, REMEDY)
    if path.is_file():
        return RobotFile(path)
    if path.suffix or path.name != name:
        raise BadRobot(name, "", "no such file", REMEDY)
    if name not in known_robots():
        remedy = f"`nsaid list` shows all. {REMEDY}"
        remedy += "" if has_example_robots() else f" {MORE_ROBOTS}"
        raise UnknownName("robot", name, [*known_robots(), *packed_folders(), *others], remedy)
    from example_robot_data.robots_loader import getModelPath

    loader = example_robots()[name]
    file = Path(loader.path, loader.urdf_subpath, loader.urdf_filename)
    if file.suffix != ".urdf" or name == _CUT_IN_CODE:
        reason = "example-robot-data has no URDF file of it"
        raise BadRobot(name, "", reason, "Choose another robot.")
    return RobotFile(Path(getModelPath(str(file))) / file, True, bool(loader.free_flyer))


def packed_folders() -> dict[str, Path]:
    """The robots in assets, each described by a URDF or MJCF of its folder's name."""
    names = sorted(path.name for path in folder("assets").iterdir())
    files = [(name, asset(name, name + end)) for name in names for end in (".urdf", ".xml")]
    return {name: file for name, file in files if file.is_file()}


def mjcf_of(model: str) -> Path | None:
    """The MJCF file of a model, by its path or of a packed robot by its name; None without one."""
    packed = asset(model, f"{model}.xml") if model == Path(model).name else Path(model)
    path = packed if packed.is_file() else Path(model)
    return path if path.suffix.lower() == ".xml" and path.is_file() else None


def packed_vehicles() -> list[str]:
    """The vehicles that have a folder in assets and a scenario of their own."""
    return sorted({path.name for path in folder("assets").iterdir()} & set(scenarios()))


def is_vehicle(model: str) -> bool:
    """Whether a model to identify is a vehicle: the path of a sheet or its folder, or a name."""
    path = path_of(model)
    sheet = path.suffix.lower() == ".toml" or (path.is_dir() and (path / "vehicle.toml").is_file())
    return model not in packed_folders() and (sheet or model in packed_vehicles())


def check_model(model: str) -> None:
    """Raises what `load_robot_model` would if there is no such file or name."""
    if not is_vehicle(model):
        robot_file(model, packed_vehicles())
    elif model not in scenarios():
        VehicleFiles.of(model)
