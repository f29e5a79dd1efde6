"""A whole experiment as data: what is simulated, how it is driven, who identifies it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal

import numpy as np

from ..control import DriverConfig, FourierTracking
from ..errors import InvalidInput
from ..identifiers import IdentifierConfig, MemoryConfig, NullspaceAID
from ..plants import ArmPlant, Fault, Mismatch, PlantConfig, SensorNoise

_TYPE = "$type"  # in JSON; no field or rival can be called so
_OTHER = "Is it from another version of nsaid-mj?"


@dataclass(frozen=True)
class Scenario:
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
    rivals: Mapping[str, IdentifierConfig] = field(default_factory=dict)
    initial_error: float = 0.3
    gain_error: float | None = None
    duration: float = 60.0
    dt: float = 1e-3
    sensors: Literal["ideal", "noisy"] = "ideal"
    noise: SensorNoise = field(default_factory=SensorNoise)
    pe_window: float = 2.0
    held_out: float = 5.0
    record_every: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        for name, low, remedy in (
            ("dt", 0, "1e-3 s suits arms."),
            ("duration", 0, "60 is a minute."),
            ("pe_window", 0, "2 s will do."),
            ("held_out", 0, "5 s will do."),
        ):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > low):
                raise InvalidInput(name, "a finite time > 0 s", value, remedy)
        if self.duration < 2 * self.dt:
            raise InvalidInput("duration", f"at least two steps of {self.dt:g} s", self.duration,
                               "Make it longer.")  # fmt: skip
        if not (np.isfinite(self.initial_error) and self.initial_error >= 0):
            raise InvalidInput("initial_error", "a share ≥ 0", self.initial_error, "0.3 is 30 %.")
        if self.gain_error is not None and not 0 <= self.gain_error < 1:
            raise InvalidInput("gain_error", "a share in [0, 1), or None", self.gain_error,
                               "0.2 is 20 %.")  # fmt: skip
        if not (isinstance(self.record_every, int) and self.record_every >= 1):
            raise InvalidInput("record_every", "a whole number ≥ 1", self.record_every, "1 is all.")
        if not (isinstance(self.seed, int) and self.seed >= 0):
            raise InvalidInput("seed", "a whole number ≥ 0", self.seed, "0 will do.")
        if self.sensors not in ("ideal", "noisy"):
            raise InvalidInput("sensors", "ideal or noisy", self.sensors, "ideal is exact.")
        if any(not name.isidentifier() for name in self.rivals):
            raise InvalidInput("rivals", "names like `conventional`", list(self.rivals), "Rename.")

    @property
    def steps(self) -> int:
        """Number of steps of the run."""
        return round(self.duration / self.dt)

    def to_json(self) -> str:
        """The scenario as JSON, with the type of every part."""
        return json.dumps(_encode(self), indent=2, ensure_ascii=False)

    @staticmethod
    def from_json(text: str) -> Scenario:
        """The scenario that `to_json` wrote.

        Raises:
            InvalidInput: it is not a scenario's JSON, or of another version of this package.
        """
        try:
            found = _decode(json.loads(text))
        except (ValueError, TypeError) as error:
            if isinstance(error, InvalidInput):
                raise
            raise InvalidInput("scenario", "what `to_json` writes", f"{error}", _OTHER) from error
        if not isinstance(found, Scenario):
            raise InvalidInput("scenario", "a Scenario", type(found).__name__, _OTHER)
        return found

    @property
    def hash(self) -> str:
        """Twelve hexadecimal digits that two scenarios share only if they are equal."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:12]


def _encode(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {_TYPE: type(value).__name__} | {
            f.name: float(item)
            if str(f.type).startswith("float") and type(item) is int
            else _encode(item)
            for f in fields(value)
            for item in (getattr(value, f.name),)
        }
    if isinstance(value, Mapping):
        return {key: _encode(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [_encode(item) for item in value]
    return value


def _decode(value: Any) -> Any:
    if isinstance(value, dict):
        parts = {key: _decode(item) for key, item in value.items() if key != _TYPE}
        if _TYPE not in value:
            return parts
        cls = _parts().get(str(value[_TYPE]))
        if cls is None:
            raise InvalidInput("scenario", "types of nsaid_mj", value[_TYPE], _OTHER)
        return cls(**parts)
    if isinstance(value, list):
        return tuple(_decode(item) for item in value)
    return value


def _parts() -> dict[str, type]:
    """All types a scenario may be made of, those of a loaded script among them."""
    found: list[type] = [Scenario, SensorNoise, Mismatch, Fault, MemoryConfig]
    waiting: list[type] = [PlantConfig, DriverConfig, IdentifierConfig]
    while waiting:
        subclasses = waiting.pop().__subclasses__()
        found += subclasses
        waiting += subclasses
    return {cls.__name__: cls for cls in found}
