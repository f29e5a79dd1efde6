"""An experiment as data: plant, excitation and identifiers, as fields with dotted names."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import field, fields, is_dataclass, replace
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_type_hints

import tyro
from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import PydanticCustomError, PydanticSerializationError
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from ..base import Config, InvalidInput, NonNegative, Positive, UnknownName, config
from ..core import IdentifierConfig, NullspaceAID
from .control.driver import DriverConfig
from .control.tracking import FourierTracking
from .fields import Share
from .plants.jointed import ArmPlant
from .plants.world.config import PlantConfig
from .plants.world.faults.kinds import Fault
from .plants.world.faults.text import fault_text, parse_faults
from .plants.world.noise import SensorNoise

MOST_HELD_OUT = 1e6
"""Largest number of time steps of the held-out trajectory, which is kept in memory."""
SHORTEST_STEP = 1e-6
"""Smallest time step [s]; half a second of a run is buffered in memory before it is written."""

_OTHER = "Is it from another version of nsaid-mj, or from a script that is not loaded?"


def _identifier(name: str) -> str:
    if not name.isidentifier():
        raise PydanticCustomError("name", "a name such as `conventional`")
    return name


_Rival = Annotated[str, AfterValidator(_identifier)]


@config
class Scenario(Config):
    """A complete experiment. Equal scenarios give records that are identical to the bit.

    Attributes:
        plant: the plant that MuJoCo simulates.
        excitation: the driver that makes its commands.
        identifier: estimates θ from the measurements.
        rivals: other identifiers on the same measurements, by name, for comparison.
        prior: `drawn` for a θ̂(0) drawn about the true θ, which differs from the published values by
            the plant's spread; `nominal` for the published values as θ̂(0), with the true θ drawn
            about them in all parameters and the plant's spread unused.
        initial_error: largest relative error of every parameter in θ̂(0).
        gain_error: relative error of the actuator gains in θ̂(0), alternating in sign; None treats
            gains like all other parameters.
        duration: simulated time [s].
        dt: time step of measurements, controller and identifier [s].
        substeps: steps of MuJoCo in a time step, so that the plant is integrated more accurately
            than the identifier.
        sensors: `ideal`, or `noisy` with the levels of `noise`.
        noise: sensor levels, used if `sensors` is `noisy`.
        pe_window: window δ₀ of the persistence levels [s].
        held_out: length of the held-out trajectory on which the estimate is judged [s].
        record_every: number of time steps per recorded row.
        seed: master seed of all random numbers.
    """

    MOST_STEPS: ClassVar[float] = 1e9
    """Largest number of time steps of a run; a longer record would fill a disk."""

    plant: PlantConfig = field(default_factory=ArmPlant)
    excitation: DriverConfig = field(default_factory=FourierTracking)
    identifier: IdentifierConfig = field(default_factory=NullspaceAID)
    rivals: Mapping[_Rival, IdentifierConfig] = field(default_factory=dict)
    prior: Literal["drawn", "nominal"] = "drawn"
    initial_error: NonNegative = 0.3
    gain_error: Share | None = None
    duration: Positive = 60.0
    dt: Annotated[float, Field(strict=True, ge=SHORTEST_STEP, le=10)] = 1e-3
    substeps: Annotated[int, Field(strict=True, ge=1, le=1000)] = 1
    sensors: Literal["ideal", "noisy"] = "ideal"
    noise: SensorNoise = field(default_factory=SensorNoise)
    pe_window: Positive = 2.0
    held_out: Positive = 5.0
    record_every: Annotated[int, Field(strict=True, ge=1, le=10**9)] = 1
    seed: Annotated[int, Field(strict=True, ge=0, le=2**64)] = 0

    def with_fields(self, new: Mapping[str, Any]) -> Self:
        """A copy with fields replaced, by dotted name."""
        return with_fields(self, new)

    def varied(self, texts: Sequence[str]) -> dict[str, tuple[Any, ...]]:
        """Parses varied fields and their values from `field=value,value`.

        Raises:
            UnknownName: there is no such field, or several.
            InvalidInput: a text is not of this form, a value is not of its field's type, or a field
                is given twice.
        """
        found: dict[str, tuple[Any, ...]] = {}
        for text in texts:
            name, equals, values = text.partition("=")
            if not equals:
                remedy = "Such as identifier.gain=0.1,1."
                raise InvalidInput("--vary", "field=value,value", text, remedy)
            path = field_path(name, self)
            if path in found:
                remedy = "Give all its values together."
                raise InvalidInput("--vary", "every field once", path, remedy)
            found[path] = tuple(field_value(path, value, self) for value in values.split(","))
        return found

    @model_validator(mode="after")
    def _check_steps(self) -> Self:
        if self.duration < 2 * self.dt:
            expected = f"at least two steps of {self.dt:g} s"
            raise InvalidInput("duration", expected, self.duration, "Make it longer.")
        for name, most in (("duration", self.MOST_STEPS), ("held_out", MOST_HELD_OUT)):
            value = getattr(self, name)
            if value > most * self.dt:
                expected = f"at most {most:.0e} steps of {self.dt:g} s"
                raise InvalidInput(name, expected, value, "Make it shorter, or dt longer.")
        return self

    @property
    def steps(self) -> int:
        """Number of time steps of the run."""
        return round(self.duration / self.dt)

    def to_json(self) -> str:
        """The scenario as JSON, including the type of each part.

        Raises:
            InvalidInput: a part of a user's own class holds what JSON cannot.
        """
        try:
            found = _ADAPTER.dump_python(self, mode="json")
        except PydanticSerializationError as error:
            remedy = "Give the fields of your classes numbers, text, lists or tuples of them."
            raise InvalidInput("scenario", "what JSON can hold", str(error), remedy) from error
        return json.dumps(found, indent=2, ensure_ascii=False)

    @staticmethod
    def from_json(text: str | bytes) -> Scenario:
        """Reads a scenario that `to_json` wrote.

        Raises:
            InvalidInput: the text is not a scenario, or one of another version of this package.
        """
        try:
            return _ADAPTER.validate_json(text)
        except ValidationError as error:
            raise Scenario.refusal(error, remedy=_OTHER) from None

    @staticmethod
    def json_schema() -> dict[str, Any]:
        """The JSON schema of scenarios, for the classes that are currently imported."""
        return TypeAdapter(Scenario).json_schema()

    @property
    def hash(self) -> str:
        """Twelve hexadecimal digits of the SHA-256 of the scenario's JSON."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:12]


_ADAPTER = TypeAdapter(Scenario)


REGISTRY = ConstructorRegistry()
"""tyro's rules for a scenario's fields, beyond the types that it knows."""


@REGISTRY.primitive_rule
def _faults(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[tuple[Fault, ...]] | None:
    """Faults are given as text: "loss 0.4 of 2 at 5 s; payload 1 at 10 s"."""
    if info.type != tuple[Fault, ...]:
        return None
    return PrimitiveConstructorSpec(
        nargs="*",
        metavar='"KIND NUMBER of WHICH at TIME s; …"',
        instance_from_str=lambda words: parse_faults(" ; ".join(words)),
        is_instance=lambda value: (
            isinstance(value, tuple) and all(isinstance(fault, Fault) for fault in value)
        ),
        str_from_instance=lambda value: [fault_text(fault) for fault in value],
    )


@REGISTRY.primitive_rule
def _number_or_none(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[float | None] | None:
    """A number or None, shown as a number: the help of a field says what None means."""
    parts = [part for part in get_args(info.type) if part is not type(None)]
    if len(parts) != 1 or type(None) not in get_args(info.type):
        return None
    kind = PrimitiveTypeInfo.make(parts[0], info.markers).type
    if kind not in (float, int):
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=kind.__name__.upper(),
        instance_from_str=lambda words: None if words[0] == "None" else kind(words[0]),
        is_instance=lambda value: value is None or isinstance(value, int | float),
        str_from_instance=lambda value: [str(value)],
    )


def field_paths(value: Any, prefix: str = "") -> list[str]:
    """Dotted names of all leaf fields of nested dataclasses and mappings."""
    parts = (
        value
        if isinstance(value, Mapping)
        else {f.name: getattr(value, f.name) for f in fields(value)}
    )
    paths = []
    for name, item in parts.items():
        nested = is_dataclass(item) or isinstance(item, Mapping)
        paths += field_paths(item, f"{prefix}{name}.") if nested else [f"{prefix}{name}"]
    return paths


def field_path(name: str, scenario: Scenario) -> str:
    """The full dotted path of a field, given by any unambiguous end of it.

    Raises:
        UnknownName: there is no such field, or several; lists near matches.
    """
    paths = field_paths(scenario)
    wanted = name.replace("-", "_")
    if wanted in paths:
        return wanted
    same = same_end(wanted, paths)
    if len(same) == 1:
        return same[0]
    if same:
        raise UnknownName("field", name, same, f"It is one of {', '.join(same)}.")
    alike = paths if "." in wanted else {path.rpartition(".")[2] for path in paths}
    raise UnknownName("field", name, alike, "`nsaid run NAME --help` lists all.")


def same_end(name: str, paths: Sequence[str]) -> list[str]:
    """The dotted names that end with a name."""
    return [path for path in paths if path.endswith("." + name)]


def field_value(path: str, text: str, scenario: Scenario) -> Any:
    """Parses a field's value from command-line words, by the field's type.

    Raises:
        InvalidInput: the words are not a value of that type.
    """
    parent, _, name = f".{path}".rpartition(".")
    hint = get_type_hints(type(field_at(scenario, parent[1:])))[name]

    def parsed(value: Any) -> Any:
        return value

    parsed.__annotations__["value"] = tyro.conf.FlagConversionOff[hint]
    try:
        words = shlex.split(text)
        args = [f"--value={words[0]}"] if len(words) == 1 else ["--value", *words]
        with contextlib.redirect_stderr(io.StringIO()):
            return tyro.cli(parsed, args=args, console_outputs=False, registry=REGISTRY)
    except (SystemExit, ValueError) as error:
        kind = hint.__name__ if isinstance(hint, type) else str(hint).replace("typing.", "")
        remedy = "`nsaid run NAME --help` lists the types of all fields."
        raise InvalidInput(path, f"a value of type {kind}", repr(text), remedy) from error


def field_at(value: Any, path: str) -> Any:
    """The value at a dotted path in nested dataclasses and mappings; "" is the whole."""
    for name in filter(None, path.split(".")):
        value = value[name] if isinstance(value, Mapping) else getattr(value, name)
    return value


def with_fields(value: Any, new: Mapping[str, Any]) -> Any:
    """A copy of nested dataclasses and mappings with fields replaced, by dotted name."""
    parts: dict[str, dict[str, Any]] = {}
    for path, item in new.items():
        name, _, rest = path.partition(".")
        parts.setdefault(name, {})[rest] = item
    changed = {
        name: inner[""] if "" in inner else with_fields(field_at(value, name), inner)
        for name, inner in parts.items()
    }
    return {**value, **changed} if isinstance(value, Mapping) else replace(value, **changed)
