"""Nullspace adaptive identification (NS-AID) of robots on MuJoCo.

Estimates the parameters of plant and actuators together, from position, velocity and command alone,
up to the directions that no motion reveals.

Public names are imported on first use, so `import nsaid_mj` is fast. Vehicles, systems, drivers and
identifiers are discovered by file: a new file in one of these folders makes its classes public.
"""

import re
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

_NAMED = {
    "calibration.data": ("RobotModel",),
    "calibration.findings": ("UnusableLog",),
    "calibration.identify": ("identify",),
    "calibration.live_robot": ("LiveRobot",),
    "calibration.models": ("load_robot_model",),
    "calibration.result": ("Identification",),
    "cli": ("main",),
    "control": ("DriverConfig", "Phase"),
    "errors": ("NsaidError",),
    "experiment.loop": ("run",),
    "experiment.record": ("Record",),
    "experiment.scenario": ("Scenario",),
    "identifiers": ("ConventionalAID", "EfficientConfig", "MemoryConfig", "NullspaceAID", "Status"),
    "identifiers.cone.law": ("cone_identifier",),
    "identifiers.efficient.law": ("efficient_identifier",),
    "identifiers.memory.law": ("memory_identifier",),
    "identifiers.nullspace_aid": ("NullspaceIdentifier", "paper_identifier"),
    "log": ("Log", "Measurement", "SensorLevels"),
    "parameters": ("Block", "ParameterSpace"),
    "reporting.finish": ("finish",),
    "streaming.client": ("live",),
    "plants": (
        "Bias",
        "Broken",
        "Fault",
        "Friction",
        "Loss",
        "Mismatch",
        "ParametricPlantConfig",
        "Payload",
        "Plant",
        "PlantConfig",
        "Reversed",
        "SensorNoise",
        "Sensors",
        "Stuck",
        "parse_faults",
    ),
    "system": ("SecondOrderSystem",),
}

_FOUND = {
    "control/*.py": r"^class (\w+)\(DriverConfig\)",
    "control/adaptive/config.py": r"^class (\w+)\(DriverConfig\)",
    "plants/*.py": r"^class (\w+Plant)\(",
    "systems/*.py": r"^class ([A-Z]\w*)\b(?!\(NamedTuple\))",
}
"""Files that define public classes, and the pattern of the defining lines."""


@cache
def _homes() -> dict[str, str]:
    """The module of every public name, read from the source text without importing it."""
    homes = {name: module for module, names in _NAMED.items() for name in names}
    package = Path(__file__).parent
    for files, pattern in _FOUND.items():
        for path in sorted(package.glob(files)):
            module = ".".join(path.relative_to(package).with_suffix("").parts)
            for name in re.findall(pattern, path.read_text(encoding="utf-8"), re.MULTILINE):
                homes.setdefault(name, module.removesuffix(".__init__"))
    return homes


def __dir__() -> list[str]:
    return sorted({*_homes(), *(name for name in globals() if name.startswith("__"))})


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted(_homes())
    if name.startswith("__") or name not in _homes():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_homes()[name]}", __name__), name)
