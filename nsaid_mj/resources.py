"""Where scenarios and assets lie: beside the package in a checkout, inside it in a wheel."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).resolve().parent


def folder(name: str) -> Path:
    """The folder `assets` or `scenarios`."""
    packed = _PACKAGE / f"_{name}"
    return packed if packed.is_dir() else _PACKAGE.parent / name


def asset(vehicle: str, file: str) -> Path:
    """The path of a vehicle's asset."""
    return folder("assets") / vehicle / file


def scenarios() -> dict[str, Path]:
    """All scenario scripts by name."""
    return {path.stem: path for path in sorted(folder("scenarios").glob("[!_]*.py"))}


def numbers(vehicle: str) -> dict[str, Any]:
    """A vehicle's published numbers, from its vehicle.toml; sources are in its SOURCE.md."""
    with asset(vehicle, "vehicle.toml").open("rb") as stream:
        return tomllib.load(stream)
