"""The files in assets: model files and sheets of robots and vehicles, by name.

They are beside the package in a checkout, inside it in a wheel.
"""

from __future__ import annotations

import ast
import tomllib
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from ..base import InvalidInput, UnknownName, path_of

_PACKAGE = Path(__file__).resolve().parent.parent


def folder(name: str) -> Path:
    """The path of the folder `assets` or `scenarios`."""
    packed = _PACKAGE / f"_{name}"
    return packed if packed.is_dir() else _PACKAGE.parent / name


def asset(vehicle: str, file: str) -> Path:
    """The path of a file in a vehicle's asset folder, whether or not it exists."""
    return folder("assets") / vehicle / file


class VehicleFiles(NamedTuple):
    """The files that describe a vehicle."""

    sheet: Path  # vehicle.toml, its physical parameters; the file exists
    model: Path  # model.xml, its appearance in MuJoCo; the file may be missing

    @classmethod
    def of(cls, vehicle: str) -> VehicleFiles:
        """A vehicle's files, by its folder's name in assets, or the path of a TOML file or folder.

        model.xml is sought beside the TOML file.

        Raises:
            UnknownName: there is no such vehicle; the message lists similar names.
            InvalidInput: the folder has no vehicle.toml.
        """
        names = {path.parent.name for path in folder("assets").glob("*/vehicle.toml")}
        path = asset(vehicle, "") if vehicle in names else path_of(vehicle)
        if path.is_dir():
            path = path / "vehicle.toml"
            if not path.is_file():
                raise InvalidInput(
                    str(path),
                    "a file with the vehicle's numbers",
                    "no such file",
                    "docs/your_vehicle.md shows how to write one.",
                )
        if path.suffix != ".toml" or not path.is_file():
            remedy = "Give a vehicle of your own by the path of its TOML file or of its folder."
            raise UnknownName("vehicle", vehicle, names, remedy)
        return cls(path, path.with_name("model.xml"))


def published_numbers(vehicle: str) -> dict[str, Any]:
    """A vehicle's published numbers, from its vehicle.toml; sources are in its SOURCE.md."""
    with asset(vehicle, "vehicle.toml").open("rb") as stream:
        return tomllib.load(stream)


MORE_ROBOTS = "More robots by name: pip install 'nsaid-mj[robots]'."
"""Remedy where a name is unknown and example-robot-data is not installed."""


def packed_robots() -> dict[str, Path]:
    """The URDF files of the robots in assets/robots, by name."""
    files = sorted((folder("assets") / "robots").glob("*/*.urdf"))
    return {file.stem: file for file in files}


def has_example_robots() -> bool:
    """Whether example-robot-data and its loaders are installed."""
    return find_spec("example_robot_data") is not None


def example_robots() -> dict[str, Any]:
    """The loaders of example-robot-data by name; empty if it is not installed."""
    if not has_example_robots():
        return {}
    from example_robot_data.robots_loader import ROBOTS

    return ROBOTS


def known_robots() -> list[str]:
    """The names of all robots that are packed or, if it is installed, in example-robot-data.

    They are parsed from its source: importing it also imports Pinocchio, a quarter of a second.
    """
    spec = find_spec("example_robot_data")
    if spec is None or spec.origin is None:
        return sorted(packed_robots())
    text = Path(spec.origin).with_name("robots_loader.py").read_text(encoding="utf-8")
    for statement in ast.parse(text).body:
        match statement:
            case ast.Assign(targets=[ast.Name(id="ROBOTS")], value=ast.Dict(keys=keys)):
                return sorted({*packed_robots(), *map(ast.literal_eval, filter(None, keys))})
    return sorted({*packed_robots(), *example_robots()})


def scenarios() -> dict[str, Path]:
    """All scenario scripts by name."""
    return {path.stem: path for path in sorted(folder("scenarios").glob("[!_]*.py"))}


def listed_robots() -> list[str]:
    """Lines with the names of all robots, and how to get more."""
    names = known_robots()
    rows = (names[start : start + 4] for start in range(0, len(names), 4))
    lines = ["".join(f"{name:28}" for name in row).rstrip() for row in rows]
    return lines if has_example_robots() else [*lines, MORE_ROBOTS]
