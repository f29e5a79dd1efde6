"""The `Result` that a run, or the identification of a log or of servos, reports at its end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

from ..robot.findings import Finding, Level

Explains = Literal["yes", "partly", "no"]
Status = Literal["identified", "known", "only in combination", "below the noise", "not excited", ""]


class Mark(NamedTuple):
    """The display of a status or a verdict.

    Attributes:
        glyph: in front of the words, so that colour is not needed.
        kind: good, fair, poor or weak: a class of the page's style sheet, a colour elsewhere.
        text: the words.
    """

    glyph: str
    kind: str
    text: str = ""


STATUSES: dict[str, Mark] = {
    status: Mark(glyph, kind, status)
    for status, glyph, kind in (
        ("identified", "●", "good"),
        ("known", "■", "good"),
        ("only in combination", "◐", "fair"),
        ("below the noise", "≈", "weak"),
        ("not excited", "○", "weak"),
        ("", "", "weak"),
    )
}
"""Marks of parameters' statuses, best first."""

EXPLAINS: dict[Explains, Mark] = {
    "yes": Mark("✔", "good"),
    "partly": Mark("◐", "fair"),
    "no": Mark("✘", "poor"),
}
"""Marks of verdicts."""

LEVELS: dict[Level, Mark] = {
    "refusal": Mark("✘", "poor"),
    "warning": Mark("▲", "fair"),
    "note": Mark("·", "weak"),
}
"""Marks of findings, the gravest first."""


def judged(explains: Explains, sentence: str) -> Mark:
    """A verdict with its mark."""
    return EXPLAINS[explains]._replace(text=sentence)


def gravest_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings ordered by level."""
    return tuple(sorted(findings, key=lambda finding: list(LEVELS).index(finding.level)))


@dataclass(frozen=True)
class Parameter:
    """One parameter of θ.

    Attributes:
        name: short name, as in `--known`.
        label: in words, by the robot's own names.
        block: kind of parameter.
        unit: SI unit.
        value: estimate.
        low: lower end of the 95 % interval; both ends are the estimate where none is stated.
        high: upper end of the 95 % interval.
        prior: value before the motion; NaN where the fit needs none.
        status: what the motion reveals of it: `identified`; `only in combination` with others;
            `not excited`: the motion does not depend on it; `below the noise`: its effect is not
            distinguishable from 0; `known`: given by the user; empty if the law does not say.
        combination: the combination that the motion determines; "" unless the status says so.
        relative: of a gain, the half-width of the 95 % interval of its ratio to the other gains,
            which does not depend on the common scale; None for other parameters.
        true: the plant's value; None if it is unknown.
    """

    name: str
    label: str
    block: str
    unit: str
    value: float
    low: float
    high: float
    prior: float
    status: Status
    combination: str = ""
    relative: float | None = None
    true: float | None = None

    @property
    def is_gain(self) -> bool:
        """Whether it is the gain of an actuator."""
        return "gain" in self.block or self.relative is not None

    @property
    def part(self) -> str:
        """The part that it belongs to: "elbow" of "gain of elbow"."""
        return self.label.partition(" of ")[2] or self.label

    @property
    def firm(self) -> bool:
        """Whether its own value is known."""
        return self.status in {"identified", "known"}

    def document(self) -> dict[str, Any]:
        """Its fields for JSON, without a truth that is unknown."""
        return {k: v for k, v in asdict(self).items() if k != "true" or v is not None}


def counts(parameters: Iterable[Parameter]) -> list[Mark]:
    """A mark for each status that occurs, with the number of parameters that have it."""
    found = Counter(p.status for p in parameters)
    return [
        mark._replace(text=f"{found[status]} {status}")
        for status, mark in STATUSES.items()
        if status and found[status]
    ]


class Figure(NamedTuple):
    """A figure of one or several estimates, in an SI unit or percent; None where unknown."""

    name: str
    unit: str
    values: Mapping[str, float | None]


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of every command; a truth may be missing.

    Attributes:
        explains: whether the structure explains the motion.
        verdict: the same in one sentence, with the figures that carry it.
        parameters: all parameters, in order of θ.
        findings: everything noticed, the gravest first.
    """

    explains: Explains
    verdict: str
    parameters: tuple[Parameter, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def mark(self) -> Mark:
        """The verdict with its mark, which decides the exit code."""
        return judged(self.explains, self.verdict)

    def of(self, block: str) -> list[Parameter]:
        """The parameters of a kind, such as "motor gain"."""
        return [p for p in self.parameters if p.block == block]

    @property
    def gains(self) -> list[Parameter]:
        """The gains of the actuators."""
        return [p for p in self.parameters if p.is_gain]

    @property
    def blocks(self) -> dict[str, list[Parameter]]:
        """The parameters by kind."""
        return {name: self.of(name) for name in dict.fromkeys(p.block for p in self.parameters)}

    @property
    def bodies(self) -> set[str]:
        """Names of the blocks that hold inertial parameters of a body."""
        return {p.block for p in self.parameters if p.unit == "kg" and p.label.startswith("mass")}
