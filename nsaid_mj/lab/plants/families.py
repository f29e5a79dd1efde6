"""The families of vehicles, each of which is read from its own form of data sheet."""

from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any

from .world.config import ParametricPlantConfig


def vehicle_families() -> list[type[Any]]:
    """The plants made from a vehicle's TOML file, without special cases of others.

    Every file in this folder is imported, as each may define one.
    """
    for file in sorted(Path(__file__).parent.glob("[!_]*.py")):
        import_module(f".{file.stem}", __package__)
    known = ParametricPlantConfig.kinds().values()
    found = [kind for kind in known if "vehicle" in {field.name for field in fields(kind)}]
    return [f for f in found if not any(f is not g and issubclass(f, g) for g in found)]
