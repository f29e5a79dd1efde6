"""The `Result` that every command reports at its end; `run_result` has that of a run."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from ..base import Finding
from ..core import ABSENT, rounded
from .panels import AnyPanel, Forest, Points
from .wording import percent

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

    @staticmethod
    def of(word: Status | Explains) -> Mark:
        """The mark of a status, or of whether the structure explains the motion."""
        return _STATUSES.get(word) or _EXPLAINS[word]


_STATUSES: dict[str, Mark] = {
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

_EXPLAINS: dict[str, Mark] = {
    "yes": Mark("✔", "good"),
    "partly": Mark("◐", "fair"),
    "no": Mark("✘", "poor"),
}
"""Marks of verdicts."""

LEVELS: dict[Literal["refusal", "warning", "note"], Mark] = {
    "refusal": Mark("✘", "poor"),
    "warning": Mark("▲", "fair"),
    "note": Mark("·", "weak"),
}
"""Marks of findings, the gravest first."""


_NUMBER = re.compile(r"(?<![\w.])[−-]?\d+(?:\.\d+)?(?:·10[⁻⁰¹²³-⁹]+)?(?!\w)(?!\.\d)")
_ROWS = re.compile(r" \(rows [\d, …]+\)")
_NAMED = 6  # places that are named; of more the first and the last


def gathered(findings: Iterable[Finding]) -> list[Finding]:
    """Findings as they are read: what is said alike of several places is one finding.

    Alike are level, code, remedy and words but for their numbers, of which the least and the
    largest are told. Rows stand in the single findings alone.
    """
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for finding in findings:
        words = _NUMBER.sub("#", _ROWS.sub("", finding.text))
        groups.setdefault((finding.level, finding.code, finding.remedy, words), []).append(finding)
    return [some[0] if len(some) == 1 else _together(some) for some in groups.values()]


def _together(alike: Sequence[Finding]) -> Finding:
    """One finding of several that differ in their places and numbers."""
    first = alike[0]
    texts = [_ROWS.sub("", finding.text) for finding in alike]
    columns = zip(*(_NUMBER.findall(text) for text in texts), strict=True)
    ranges = iter([_range(column) for column in columns])
    text = _NUMBER.sub(lambda _: next(ranges), texts[0])
    return replace(first, where=_places([f.where for f in alike]), text=text)


def _range(numbers: Sequence[str]) -> str:
    """The least and the largest of some numbers, in words; one if they are equal."""
    powers = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
    ordered = sorted(numbers, key=lambda n: float(n.translate(powers).replace("·10", "e")))
    return " to ".join(dict.fromkeys((ordered[0], ordered[-1])))


def _places(wheres: Sequence[str]) -> str:
    """Places in words: what they share in front, such as a file, is said once."""
    names = list(dict.fromkeys(where for where in wheres if where))
    shared = {name.rpartition(", ")[0] for name in names}
    if len(shared) == 1 and (before := shared.pop()):
        return f"{before}, {_places([name.removeprefix(f'{before}, ') for name in names])}"
    if len(names) > _NAMED:
        return f"{names[0]}, {names[1]} … {names[-1]} ({len(names)})"
    return ", ".join(names)


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
        status: its identifiability: `identified`; `only in combination` with others; `not excited`:
            the motion does not depend on it; `below the noise`: its effect is not significant;
            `known`: given by the user; empty if the law states none.
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
    def kind(self) -> str:
        """What it is, for a title: its block, or "fin lift" of "fin lift of rudder" in "fin"."""
        what = self.label.partition(" of ")[0]
        return what if self.block in what else self.block

    @property
    def firm(self) -> bool:
        """Whether its own value is known."""
        return self.status in {"identified", "known"}

    def document(self) -> dict[str, Any]:
        """Its fields for JSON, without a truth that is unknown."""
        return {k: v for k, v in asdict(self).items() if k != "true" or v is not None}

    @staticmethod
    def counted(parameters: Iterable[Parameter]) -> list[Mark]:
        """A mark for each status that occurs, with the number of parameters that have it."""
        found = Counter(p.status for p in parameters)
        return [
            mark._replace(text=f"{found[status]} {status}")
            for status, mark in _STATUSES.items()
            if status and found[status]
        ]

    @staticmethod
    def forests(parameters: Sequence[Parameter]) -> list[Forest]:
        """Estimates with intervals, priors and true values, a panel for each kind and unit."""
        groups: dict[tuple[str, str], list[Parameter]] = {}
        for p in parameters:
            kind = p.label.partition(" of ")[0] if p.block.startswith("coupling") else p.kind
            groups.setdefault((kind, p.unit), []).append(p)
        found = []
        for (kind, unit), members in groups.items():
            rows = [(p.value, p.low, p.high, p.prior) for p in members]
            value, low, high, prior = np.array(rows).T
            others = [Points("prior", prior)]
            true = np.array([p.true for p in members], dtype=float)
            others += [Points("true", true, "x")] if np.isfinite(true).any() else []
            firm = np.array([p.firm for p in members])
            names = [p.part for p in members]
            title = kind[:1].upper() + kind[1:]
            found.append(Forest(title, f"{kind} [{unit}]", names, value, low, high, firm, others))
        return found


class Statistic(NamedTuple):
    """A number for each of what is compared: identifiers, methods, laws, joints, experiments.

    Attributes:
        name: what it is.
        unit: its SI unit, or % for a ratio.
        values: by what is compared, over several seeds the median; None where unknown, infinite
            where it failed.
        worst: those of the worst seed; empty for a single one.
    """

    name: str
    unit: str
    values: Mapping[str, float | None]
    worst: Mapping[str, float | None] = {}

    def words(self, value: float | None) -> str:
        """One of the values with three digits, as a percentage if the unit is %; – for None."""
        if self.unit == "%":
            return percent(value)
        return ABSENT if value is None else rounded(value)


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of every command; a truth may be missing.

    Attributes:
        explains: whether the structure explains the motion, or a study has its answer; None if
            that was not judged.
        verdict: the same in one sentence, with the figures that carry it.
        statistics: of the estimates, and of what they are compared with.
        parameters: all parameters, in order of θ.
        curves: what is drawn, the first ones carry the verdict.
        findings: everything noticed, the gravest first.
        complete: whether no run of a study is without a result.
    """

    explains: Explains | None = None
    verdict: str = ""
    statistics: tuple[Statistic, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    curves: tuple[AnyPanel, ...] = ()
    findings: tuple[Finding, ...] = ()
    complete: bool = True

    @property
    def mark(self) -> Mark | None:
        """The verdict with its mark; None if there is none."""
        return Mark.of(self.explains)._replace(text=self.verdict) if self.explains else None

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
