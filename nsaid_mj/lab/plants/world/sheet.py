"""Data sheets: a vehicle's parameters, read from its vehicle.toml and validated."""

import json
import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from ....base import InputFile, InvalidInput, UnknownName
from ....core import Array
from ....robots import VehicleFiles, asset, packed_vehicles

LARGEST = 1e9
SMALLEST = 1e-12
"""Bounds on the magnitude of every number in a data sheet; products of a few remain finite."""

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(ge=SMALLEST, le=LARGEST)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Negative = Annotated[float, Field(ge=-LARGEST, le=-SMALLEST)]
"""Types of single numbers in a data sheet."""

_REMEDY = "docs/your_vehicle.md explains every key; assets/ has complete examples."


class SheetTable(BaseModel):
    """A table of a data sheet. Unknown keys, values of a wrong type, NaN and inf are errors.

    Every field's description says what is expected, with its unit; error messages quote it.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def one(expected: str) -> Any:
    """A required value; `expected` describes it, with its unit, in error messages."""
    return Field(description=expected)


def several(count: int, expected: str) -> Any:
    """A required list of `count` values; `expected` describes it, with its unit, in messages."""
    return Field(description=expected, min_length=count, max_length=count)


Place = Annotated[list[Number], Field(min_length=3, max_length=3)]
"""A point, or a direction."""


class Guess(SheetTable):
    """An engineer's guesses before any measurement, of a vehicle in space."""

    speed: list[Positive] = several(6, "six velocities of operation > 0 [m/s, rad/s]")


class Sheet(SheetTable):
    """A complete data sheet.

    Attributes:
        kind: the family, optional where all keys belong to one family.
        size: length, width and height of the box drawn without a model.xml [m]; by default those of
            a solid box of this inertia.
    """

    family: ClassVar[str]
    """Name of the family, the only value of `kind`."""
    frames: ClassVar[tuple[str, ...]] = ()
    """Frames of which a sheet can be guessed from a mass and the length of an arm; see `begun`."""
    of_frame: ClassVar[tuple[str, ...]] = ()
    """Keys that frame and arm determine."""

    kind: str | None = Field(default=None, description="the name of the vehicle's family")
    size: Annotated[list[Positive], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="length, width and height, three numbers > 0 [m]"
    )

    @field_validator("kind")
    @classmethod
    def _is_own(cls, kind: str | None) -> str | None:
        if kind not in (None, cls.family):
            remedy = "This plant reads no other; `nsaid inspect` finds the family by itself."
            raise InvalidInput("kind", f'"{cls.family}"', kind, remedy)
        return kind

    @classmethod
    def of(cls, vehicle: str) -> Self:
        """The data sheet of an included vehicle, or of the TOML file or folder at a path.

        Raises:
            InvalidInput: a value is missing or invalid; the message names file and key.
            UnknownName: the vehicle, or a key in the file, does not exist.
        """
        path = VehicleFiles.of(vehicle).sheet
        content = _read(path)
        if "frame" in content:
            content = _over(cls._guesses(path), _stated(content))
        try:
            return cls.model_validate(content)
        except ValidationError as error:
            raise _explained(cls, path, error) from error

    @classmethod
    def begun(cls, frame: str, mass: float, arm: float) -> dict[str, Any]:
        """A sheet's content guessed from a frame, a mass [kg] and the length of an arm [m].

        Sizes are those of a usual vehicle of the kind, to within a factor of two or three.
        """
        raise NotImplementedError

    @classmethod
    def guessed(cls, vehicle: str) -> list[str]:
        """What is guessed of a vehicle whose sheet states a frame, as `key = value`; else nothing.

        Raises:
            InvalidInput: its mass or the length of its arm is missing or invalid.
            UnknownName: there is no such frame.
        """
        path = VehicleFiles.of(vehicle).sheet
        content = _read(path)
        if "frame" not in content:
            return []
        known = {*_leaves(_stated(content)), *cls.of_frame}
        left = {k: v for k, v in _leaves(cls._guesses(path)).items() if k not in known}
        return [f"{key} = {_toml(value)}" for key, value in left.items() if "guess." not in key]

    @classmethod
    def _guesses(cls, path: Path) -> dict[str, Any]:
        """The content guessed for a sheet that states a frame."""
        content = _read(path)
        frame = content["frame"]
        if frame not in cls.frames:
            raise UnknownName(f"frame in {path}", str(frame), cls.frames)
        sizes = {"mass": "kg", "arm": "m, of a rotor or level thruster from the centre"}
        for key, unit in sizes.items():
            value = content.get(key)
            if not isinstance(value, int | float) or not SMALLEST <= value <= LARGEST:
                got = "nothing" if value is None else _short(value)
                raise InvalidInput(f"{path}: {key}", f"a number > 0 [{unit}]", got, _REMEDY)
        return cls.begun(frame, float(content["mass"]), float(content["arm"]))


def _read(path: Path) -> dict[str, Any]:
    """The tables of a sheet; raises `InvalidInput` if it is no readable TOML."""
    try:
        return tomllib.loads(InputFile(path).read().decode())
    except (ValueError, RecursionError) as error:  # not TOML, not UTF-8, or 5000 digits
        raise InvalidInput(str(path), "a TOML file in UTF-8", error, _REMEDY) from error
    except OSError as error:
        expected = "a readable file"
        raise InvalidInput(str(path), expected, error.strerror or error, _REMEDY) from error


def _stated(content: dict[str, Any]) -> dict[str, Any]:
    """The keys of a sheet that no frame replaces."""
    return {key: value for key, value in content.items() if key not in ("frame", "arm")}


def _over(below: dict[str, Any], stated: dict[str, Any]) -> dict[str, Any]:
    """Nested tables with what is stated in place of what is below."""
    found = dict(below)
    for key, value in stated.items():
        own = below.get(key)
        if isinstance(own, dict) and isinstance(value, dict):
            found[key] = _over(own, value)
        else:
            found[key] = value
    return found


def _leaves(table: dict[str, Any], above: str = "") -> dict[str, Any]:
    """The values of nested tables by dotted key."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        found |= (
            _leaves(value, f"{above}{key}.") if isinstance(value, dict) else {above + key: value}
        )
    return found


def _explained(sheet: type[Sheet], path: Path, error: ValidationError) -> Exception:
    """The first of pydantic's errors as an `NsaidError`; unknown keys, likely typos, come first.

    Missing keys are told all at once, with values of an included vehicle to begin from.
    """
    missing = [e["loc"] for e in error.errors() if e["type"] == "missing"]
    if len(missing) > 1 and len(missing) == error.error_count():
        return _incomplete(sheet, path, missing)
    found = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")[0]
    inner = found.get("ctx", {}).get("error")
    if isinstance(inner, InvalidInput):  # from a check between several keys
        return InvalidInput(f"{path}: {inner.name}", inner.expected, inner.got, inner.remedy)
    *parents, last = found["loc"]
    key = "".join(f"[{p + 1}]" if isinstance(p, int) else f".{p}" for p in found["loc"])[1:]
    if found["type"] == "extra_forbidden":
        table, _ = _declared(sheet, parents)
        return UnknownName(f"key in {path}", str(last), table.model_fields, _REMEDY)
    table, expected = _declared(sheet, found["loc"])
    got = "nothing" if found["type"] == "missing" else _short(found["input"])
    return InvalidInput(f"{path}: {key}", expected, got, _REMEDY)


def _incomplete(
    sheet: type[Sheet], path: Path, missing: Sequence[tuple[int | str, ...]]
) -> InvalidInput:
    """The error about several missing keys."""
    own = tomllib.loads(InputFile(path).read().decode()).get("mass")
    sheets = [name for name in packed_vehicles() if asset(name, "vehicle.toml").is_file()]
    known = [name for name in sheets if _content(name).get("kind") == sheet.family]
    known.sort(key=lambda name: _apart(own, _content(name).get("mass")))
    example = next(iter(known), "")
    keys = []
    values = []
    for places in missing:
        key = ".".join(map(str, places))
        keys.append(f"{key} ({_declared(sheet, places)[1]})")
        value = _at(_content(example) if example else {}, places)
        values += [f"{key} = {_toml(value)}"] if value is not None else []
    begin = ""
    if sheet.frames:
        frames = " or ".join(f'"{frame}"' for frame in sheet.frames)
        begin = f"State frame ({frames}), mass [kg] and arm [m], and all else is guessed. "
    if values:
        begin += f"Values to begin from, of {example}: {'; '.join(values)}. "
    wanted = f"{len(keys)} more keys, {', '.join(keys)}"
    return InvalidInput(str(path), wanted, "none of them", begin + _REMEDY)


def _apart(own: Any, other: Any) -> float:
    """How far two masses [kg] are apart, as a logarithm; 0 where one is not stated."""
    stated = all(isinstance(mass, int | float) and mass > 0 for mass in (own, other))
    return abs(math.log(own / other)) if stated else 0.0


def _content(vehicle: str) -> dict[str, Any]:
    """The tables of an included vehicle's sheet."""
    return tomllib.loads(InputFile(VehicleFiles.of(vehicle).sheet).read().decode())


def _at(table: Any, places: Sequence[int | str]) -> Any:
    """The value at a place of nested tables; None if it is not there."""
    for place in places:
        table = table.get(place) if isinstance(table, dict) else None
    return table


def _toml(value: Any) -> str:
    """A value as it stands in a TOML file; a table on one line."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(inner)}' for key, inner in value.items())} }}"
    return json.dumps(value)


def _declared(sheet: type[SheetTable], places: Sequence[int | str]) -> tuple[type[SheetTable], str]:
    """The table type that contains a location in a data sheet, and the value expected there.

    Places are keys and list indices, from the top level down.
    """
    table = sheet
    expected = "a table"
    for place in places:
        if isinstance(place, int):
            continue
        field = table.model_fields[place]
        expected = field.description or "a table"
        inner = field.annotation
        while get_origin(inner) is not None:
            inner = get_args(inner)[0]
        if not (isinstance(inner, type) and issubclass(inner, SheetTable)):
            break
        table = inner
    return table, expected


def _short(value: Any) -> str:
    """A value's repr, shortened to 60 characters, with the length if it is a list."""
    text = repr(value)
    text = text if len(text) <= 60 else f"{text[:57]}..."
    return f"{len(value)} values, {text}" if isinstance(value, list) else text


# -- checks between several numbers --------------------------------------------------------------


def check_inertia(moments: Sequence[float]) -> None:
    """Checks three principal moments of inertia by the triangle inequality.

    Raises:
        InvalidInput: one of them is not less than the sum of the other two.
    """
    if 2 * max(moments) >= sum(moments):
        raise InvalidInput(
            "inertia",
            "moments each less than the sum of the other two",
            list(moments),
            "No body has these moments: check units and order.",
        )


def check_directions(table: str, item: str, positions: Array, directions: Array) -> None:
    """Checks that every position (k, 3) of an item of a table has its unit vector.

    Raises:
        InvalidInput: their numbers differ, or one is not a unit vector.
    """
    if len(positions) != len(directions):
        raise InvalidInput(
            f"{table}.directions",
            f"one for each of {len(positions)} positions",
            len(directions),
            f"Give every {item} its position and its direction.",
        )
    lengths = np.linalg.norm(directions, axis=1)
    for row, length in zip(directions, lengths, strict=True):
        if not abs(length - 1) < 1e-6:
            remedy = f"Divide it by its length, {length:.6g}."
            raise InvalidInput(f"{table}.directions", "unit vectors", row.tolist(), remedy)
