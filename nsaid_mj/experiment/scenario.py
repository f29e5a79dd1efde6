"""A whole experiment as data: what is simulated, how it is driven, who identifies it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from ..bounds import Config, Name, NonNegative, Positive, Seed, Share, config, refusal
from ..control import DriverConfig, FourierTracking
from ..errors import InvalidInput
from ..identifiers import IdentifierConfig, NullspaceAID
from ..plants import ArmPlant, PlantConfig, SensorNoise

MOST_STEPS = 1e9
"""In a run: its record would fill a disk."""
MOST_HELD_OUT = 1e6
"""In the trajectory that judges an estimate: it is kept in memory."""
SHORTEST_STEP = 1e-6
"""Of simulation and identifier [s]: 0.9 s of a run are kept in memory before they are written."""

_OTHER = "Is it from another version of nsaid-mj, or from a script that is not loaded?"


def _identifier(name: str) -> str:
    if not name.isidentifier():
        raise PydanticCustomError("name", "a name such as `conventional`")
    return name


_Rival = Annotated[Name, AfterValidator(_identifier)]


@config
class Scenario(Config):
    """An experiment, complete: the same scenario gives the same record, to the bit.

    Attributes:
        plant: what MuJoCo simulates.
        excitation: what drives it.
        identifier: who identifies it.
        rivals: other identifiers on the same measurements, by name, for comparison.
        initial_error: θ̂(0) is off the truth by up to this share on every parameter.
        gain_error: assumed actuator gains are off by this share, up and down in turn; None treats
            them like every other parameter.
        duration: simulated time [s].
        dt: step of plant, controller and identifier [s].
        sensors: `ideal`, or `noisy` with the levels of `noise`.
        noise: sensor levels, used where `sensors` is `noisy`.
        pe_window: window δ₀ of the persistence levels [s].
        held_out: length of the held-out trajectory that judges the estimate [s].
        record_every: every how many steps a row is recorded.
        seed: of everything random.
    """

    plant: PlantConfig = field(default_factory=ArmPlant)
    excitation: DriverConfig = field(default_factory=FourierTracking)
    identifier: IdentifierConfig = field(default_factory=NullspaceAID)
    rivals: Mapping[_Rival, IdentifierConfig] = field(default_factory=dict)
    initial_error: NonNegative = 0.3
    gain_error: Share | None = None
    duration: Positive = 60.0
    dt: Annotated[float, Field(strict=True, ge=SHORTEST_STEP, le=10)] = 1e-3
    sensors: Literal["ideal", "noisy"] = "ideal"
    noise: SensorNoise = field(default_factory=SensorNoise)
    pe_window: Positive = 2.0
    held_out: Positive = 5.0
    record_every: Annotated[int, Field(strict=True, ge=1, le=10**9)] = 1
    seed: Seed = 0

    @model_validator(mode="after")
    def _check_steps(self) -> Self:
        if self.duration < 2 * self.dt:
            expected = f"at least two steps of {self.dt:g} s"
            raise InvalidInput("duration", expected, self.duration, "Make it longer.")
        for name, most in (("duration", MOST_STEPS), ("held_out", MOST_HELD_OUT)):
            value = getattr(self, name)
            if value > most * self.dt:
                expected = f"at most {most:.0e} steps of {self.dt:g} s"
                raise InvalidInput(name, expected, value, "Make it shorter, or dt longer.")
        return self

    @property
    def steps(self) -> int:
        """Number of steps of the run."""
        return round(self.duration / self.dt)

    def to_json(self) -> str:
        """The scenario as JSON, with the type of every part."""
        return json.dumps(_ADAPTER.dump_python(self, mode="json"), indent=2, ensure_ascii=False)

    @staticmethod
    def from_json(text: str) -> Scenario:
        """The scenario that `to_json` wrote.

        Raises:
            InvalidInput: it is not a scenario's JSON, or of another version of this package.
        """
        try:
            return _ADAPTER.validate_json(text)
        except ValidationError as error:
            raise refusal(error, Scenario, remedy=_OTHER) from None

    @staticmethod
    def json_schema() -> dict[str, Any]:
        """The JSON schema of what `from_json` reads, with the classes that are loaded now."""
        return TypeAdapter(Scenario).json_schema()

    @property
    def hash(self) -> str:
        """Twelve hexadecimal digits that two scenarios share only if they are equal."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:12]


_ADAPTER = TypeAdapter(Scenario)
