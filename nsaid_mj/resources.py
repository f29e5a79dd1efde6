"""Paths of scenarios and assets (beside the package in a checkout, inside it in a wheel)."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from .errors import InvalidInput, UnknownName

_PACKAGE = Path(__file__).resolve().parent


def folder(name: str) -> Path:
    """The path of the folder `assets` or `scenarios`."""
    packed = _PACKAGE / f"_{name}"
    return packed if packed.is_dir() else _PACKAGE.parent / name


def asset(vehicle: str, file: str) -> Path:
    """The path of a file in a vehicle's asset folder, whether or not it exists."""
    return folder("assets") / vehicle / file


class VehicleFiles(NamedTuple):
    """The files that describe a vehicle.

    Attributes:
        sheet: vehicle.toml, its physical parameters; the file exists.
        model: model.xml, its appearance in MuJoCo; the file may be missing.
    """

    sheet: Path
    model: Path


def vehicle_files(vehicle: str) -> VehicleFiles:
    """Finds a vehicle's files.

    Args:
        vehicle: the name of a folder in assets, or the path of a TOML file or of its folder.
            model.xml is looked for beside the TOML file.

    Raises:
        UnknownName: there is no such vehicle; the message lists similar names.
        InvalidInput: the folder has no vehicle.toml.
    """
    names = {path.parent.name for path in folder("assets").glob("*/vehicle.toml")}
    path = asset(vehicle, "") if vehicle in names else Path(vehicle).expanduser()
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
    return VehicleFiles(path, path.with_name("model.xml"))


def scenarios() -> dict[str, Path]:
    """All scenario scripts by name."""
    return {path.stem: path for path in sorted(folder("scenarios").glob("[!_]*.py"))}


def numbers(vehicle: str) -> dict[str, Any]:
    """A vehicle's published numbers, from its vehicle.toml; sources are in its SOURCE.md."""
    with asset(vehicle, "vehicle.toml").open("rb") as stream:
        return tomllib.load(stream)


def write_json(path: Path, value: Any) -> None:
    """Writes a value as JSON, atomically.

    Raises:
        ValueError: a number is NaN or infinite.
    """
    write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Writes text as UTF-8, atomically."""
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8")


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yields a temporary path to write to; on exit the file is synced and renamed to `path`.

    A reader sees either the old file or the complete new one. If writing fails, the temporary file
    is deleted.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        yield partial
        with partial.open("rb") as stream:
            os.fsync(stream.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
