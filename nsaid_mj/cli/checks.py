"""Checks of arguments before anything heavy is imported: names, paths, words, numbers, maps.

They raise the errors that the work itself would raise, a second or more later.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..base import (
    CRITERIA,
    FRAMES,
    IDENTIFICATION_LAWS,
    JOINT_COLUMNS,
    LAWS,
    LIMITS_FORM,
    VEHICLE_COLUMNS,
    BadRun,
    InvalidInput,
    check_choice,
    path_of,
    toml_of,
)
from ..robots import asset, check_model, robot_file, vehicle_files

if TYPE_CHECKING:
    from ..lab import PlantConfig
    from .grammar import Excite, Identify, Inspect, Live


def names_in(text: str) -> tuple[str, ...]:
    """The parts of a comma-separated text."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def numbers_in(flag: str, text: str, remedy: str) -> tuple[float, ...]:
    """The comma-separated numbers of a flag's text; raises `InvalidInput` if it has others."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidInput(flag, "comma-separated numbers", text, remedy) from error


def known_number(text: str) -> tuple[str, float]:
    """Name and value of a known parameter, of `NAME=VALUE`; raises `InvalidInput` otherwise."""
    name, equals, value = text.rpartition("=")
    try:
        if not equals:
            raise ValueError
        return name.strip(), float(value)
    except ValueError as error:
        raise InvalidInput("--known", "NAME=VALUE", text, "Such as gain_1=0.11.") from error


def two_noises(text: str) -> tuple[float, float]:
    """The standard deviations of `--noise`; raises `InvalidInput` unless they are two numbers."""
    try:
        position, velocity = (float(part) for part in text.split(","))
    except ValueError as error:
        expected = "two numbers, of position and velocity"
        raise InvalidInput("--noise", expected, text, "Such as 1e-4,5e-3.") from error
    return position, velocity


def check_logs(paths: Sequence[Path]) -> None:
    """Raises `UnreadableLog` if a file is missing, empty, or of no known format."""
    if paths:
        from ..clinic import files, form_of

        for path in paths:
            for file in files(path_of(path)):
                form_of(file)


def check_map(path: Path | None) -> None:
    """Raises `InvalidInput` unless the file is a map of columns; None is none."""
    if path is not None:
        from ..clinic import read_map

        read_map(path)


def check_plant(plant: PlantConfig) -> None:
    """Raises an error if there is no such robot or vehicle as a plant of this package names."""
    from ..lab import ArmPlant

    if isinstance(plant, ArmPlant):
        robot_file(plant.robot)
        return
    from ..lab import VehiclePlant

    if isinstance(plant, VehiclePlant):
        vehicle_files(plant.vehicle)


def check_identify(chosen: Identify, model: str) -> None:
    """Checks what `nsaid identify` was given."""
    check_choice("law", chosen.law, IDENTIFICATION_LAWS)
    if chosen.delay != "auto":
        numbers_in("--delay", chosen.delay, "Such as 0.01.")
    for text in chosen.known:
        known_number(text)
    if chosen.columns != "auto":
        for name in names_in(chosen.columns):
            if name not in VEHICLE_COLUMNS:
                check_choice("column", name, JOINT_COLUMNS)
    check_model(model)
    if chosen.load:
        from ..clinic import load_of

        for text in chosen.load:
            load_of(text)
    check_map(chosen.map)
    check_map(chosen.validate_map)
    check_logs(chosen.log)
    check_logs(chosen.validate)


def check_inspect(chosen: Inspect) -> None:
    """Checks what `nsaid inspect` was given."""
    check_map(chosen.map)
    first = chosen.logs[0]
    packed = len(chosen.logs) == 1 and asset(str(first), "log.csv.gz").is_file()
    if first.exists() or not packed:
        check_logs(chosen.logs)
    if chosen.model is not None:
        check_model(chosen.model)


def check_live(chosen: Live) -> None:
    """Checks what `nsaid live` was given."""
    if chosen.law not in LAWS:
        from ..core import NullspaceAID

        NullspaceAID(law=chosen.law)  # type: ignore[arg-type]  # raises
    check_choice("frame", chosen.frame, FRAMES)
    check_model(chosen.model)


def check_excite(chosen: Excite) -> None:
    """Checks what `nsaid excite` was given, but the scenario's name."""
    check_choice("criterion", chosen.criterion, CRITERIA)
    if chosen.noise is not None:
        two_noises(chosen.noise)
    if chosen.limits is not None:
        toml_of(chosen.limits, "--limits", LIMITS_FORM)
    if chosen.model is not None:
        check_model(chosen.model)


def without_excitation(arguments: Sequence[str]) -> tuple[str, Sequence[str]]:
    """The value of `--excitation` on a command line, "" without it, and the other arguments.

    Raises:
        InvalidInput: the value is missing.
    """
    rest = list(arguments)
    given = ""
    for k, argument in enumerate(rest):
        flag, equals, value = argument.partition("=")
        if flag != "--excitation":
            continue
        if not equals and k + 1 == len(rest):
            raise InvalidInput("--excitation", "`designed` or `designed:FOLDER`", "nothing", "")
        given = value if equals else rest[k + 1]
        del rest[k : k + (1 if equals else 2)]
        break
    return given, rest


def check_excitation(given: str) -> None:
    """Checks the value of `--excitation`: `designed` or `designed:FOLDER`; "" is none.

    Raises:
        InvalidInput: the value is neither.
        BadRun: the folder holds no design.
    """
    word, colon, folder = given.partition(":")
    if given and word != "designed":
        expected = "`designed`, or `designed:FOLDER` of an earlier `nsaid excite`"
        raise InvalidInput("--excitation", expected, given, "All else is in the scenario's script.")
    if colon and not (Path(folder) / "scenario.json").is_file():
        raise BadRun(folder, "there is no design", "Give the folder that `nsaid excite` wrote")
