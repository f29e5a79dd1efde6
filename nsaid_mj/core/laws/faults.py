"""A fault that an identifier has found, as recorded and shown."""

from __future__ import annotations

from typing import Any, NamedTuple


class FaultEvent(NamedTuple):
    """A fault that was detected and isolated."""

    time: float  # when the motion first contradicted the earlier estimate [s]
    found: float  # when the fault was isolated [s]
    # `loss`, `reversed`, `broken`, `stuck`, `friction`, `payload`, `bias`, `several` or `unknown`
    kind: str
    part: str  # the affected part, in words, such as `thrust of thruster 3`
    names: tuple[str, ...]  # the parameters of θ that it changed; of a sensor such as `position 2`
    size: float  # size of the change
    low: float  # lower end of its 95 % interval
    high: float  # upper end of it
    unit: str  # unit of these three; `1` for a share of an actuator's gain
    confidence: float  # posterior probability of this hypothesis among all others
    slow: bool = False  # whether the change is gradual; `time` is then when it was noticed

    @property
    def in_words(self) -> str:
        """Such as `thrust of thruster 3 lost 39.8 % (39.1 … 40.5 %)`."""
        verb = {
            "loss": "lost" if self.size > 0 else "rose by",
            "broken": "",
            "reversed": "reversed, with its gain changed by",
            "stuck": "is stuck at a command of",
            "friction": "changed by",
            "payload": "changed by",
            "bias": "is off by",
        }.get(self.kind)
        if verb is None:
            return {"several": "several actuators changed at once"}.get(
                self.kind, "a change that no single fault explains"
            )
        sign = -1 if self.kind == "loss" and self.size < 0 else 1
        low, high = sorted((sign * self.low, sign * self.high))
        slowly = "slowly " if self.slow else ""
        if self.kind == "broken":
            return f"{self.part} no longer exerts any force"
        if self.unit == "1" and self.kind != "stuck":
            return (
                f"{self.part} {slowly}{verb} {100 * sign * self.size:.3g} % "
                f"({100 * low:.3g} … {100 * high:.3g} %)"
            )
        unit = "" if self.unit == "1" else f" {self.unit}"
        size = f"{sign * self.size:.3g}{unit} ({low:.3g} … {high:.3g}{unit})"
        return f"{self.part} {slowly}{verb} {size}"

    def keys(self) -> dict[str, Any]:
        """The entry of summary.json."""
        return self._asdict() | {"names": list(self.names), "words": self.in_words}

    @staticmethod
    def of(keys: dict[str, Any]) -> FaultEvent:
        """The event of an entry of summary.json.

        Raises:
            KeyError, TypeError, ValueError: it is not one.
        """
        parts: dict[str, Any] = {name: str(keys[name]) for name in ("kind", "part", "unit")}
        for name in ("time", "found", "size", "low", "high", "confidence"):
            parts[name] = float(keys[name])
        return FaultEvent(**parts, names=tuple(map(str, keys["names"])), slow=bool(keys["slow"]))
