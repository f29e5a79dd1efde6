"""The `Result` that every command reports at its end; that of a run is read from its summary."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ..parameters import ParameterSpace
from ..robot.findings import Finding, Level
from .confidence import INTERVAL
from .figures import common_factor
from .panels import AnyPanel
from .words import FIGURES, OWN

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


def counts(parameters: Iterable[Parameter]) -> list[Mark]:
    """A mark for each status that occurs, with the number of parameters that have it."""
    found = Counter(p.status for p in parameters)
    return [
        mark._replace(text=f"{found[status]} {status}")
        for status, mark in STATUSES.items()
        if status and found[status]
    ]


class Figure(NamedTuple):
    """A figure of everything that is compared: identifiers, methods, laws, joints, experiments.

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


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of every command; a truth may be missing.

    Attributes:
        explains: whether the structure explains the motion, or a study has its answer; None if
            that was not judged.
        verdict: the same in one sentence, with the figures that carry it.
        figures: of the estimates, and of what they are compared with.
        parameters: all parameters, in order of θ.
        curves: what is drawn, the first ones carry the verdict.
        findings: everything noticed, the gravest first.
        complete: whether no run of a study is without a result.
    """

    explains: Explains | None = None
    verdict: str = ""
    figures: tuple[Figure, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    curves: tuple[AnyPanel, ...] = ()
    findings: tuple[Finding, ...] = ()
    complete: bool = True

    @property
    def mark(self) -> Mark | None:
        """The verdict with its mark; None if there is none."""
        return EXPLAINS[self.explains]._replace(text=self.verdict) if self.explains else None

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


_OUTCOMES: dict[str, Explains] = {"converged": "yes", "still converging": "partly"}
_STREAM = {
    "gaps": ("gap", "gaps"),
    "missing": ("sample missing in {}", "samples missing in {}"),
    "not_finite": ("not finite",) * 2,
    "duplicates": ("repeated",) * 2,
    "late": ("out of order",) * 2,
    "unreadable": ("unreadable",) * 2,
}  # what may be wrong with the samples of a live robot: one, several


def result_of(summary: dict[str, Any], space: ParameterSpace | None = None) -> Result:
    """The result of a run from its summary.json; without a space, parameters have no blocks."""
    verdict = summary.get("verdict")  # summaries of earlier versions have none
    return Result(
        explains=_OUTCOMES.get(verdict.partition(":")[0], "no") if verdict else None,
        verdict=verdict or "",
        figures=_figures(summary),
        parameters=_parameters(summary, space),
        findings=_findings(summary),
    )


def _figures(summary: dict[str, Any]) -> tuple[Figure, ...]:
    """The figures of all identifiers of a run; those that none of them has are left out."""
    identifiers = {OWN: summary, **summary["rivals"]}
    return tuple(
        Figure(
            label if unit else f"{label} [{', '.join(summary['velocity_units'])}]",
            unit,
            {name: found.get(key) for name, found in identifiers.items()},
        )
        for label, key, unit in FIGURES
        if any(key in found for found in identifiers.values())
    )


def _parameters(summary: dict[str, Any], space: ParameterSpace | None) -> tuple[Parameter, ...]:
    """The parameters; where the truth is known, times the factor that makes the gains' mean exact.

    Intervals are at a fixed mean of the gains, and so is the ratio of a gain to the others.
    """
    rows, stated = summary.get("parameters", []), summary["confidence"] or {}
    known, gains = stated.get("parameters", {}), stated.get("actuators", {})
    blocks = [] if space is None else [b.name for b in space.blocks for _ in b.names]
    factor = 1.0
    if rows and all("true" in row for row in rows):
        at = [k for k, row in enumerate(rows) if row["name"] in gains]
        estimate, true, scale = np.array(
            [[row[key] for key in ("estimate", "true", "scale")] for row in rows]
        ).T
        actuators = np.array(at, dtype=np.intp) if space is None else space.actuators
        factor = float(common_factor(estimate, true, scale, actuators))
    found = []
    for k, row in enumerate(rows):
        value, own = factor * row["estimate"], known.get(row["name"])
        half = INTERVAL * abs(factor) * own["deviation"] if own else 0.0
        status: Status = ""
        if known:
            status = "only in combination" if own is None else "identified"
            status = "below the noise" if own and own["below_noise"] else status
        relative = INTERVAL * gains[row["name"]] if row["name"] in gains else None
        found.append(
            Parameter(
                row["name"], row["label"], blocks[k] if blocks else "", row["unit"],
                value, value - half, value + half, factor * row["prior"], status,
                relative=relative if len(gains) > 1 else None, true=row.get("true"),
            )
        )  # fmt: skip
    return tuple(found)


def _findings(summary: dict[str, Any]) -> tuple[Finding, ...]:
    """How a run ended early, and its deviations from the paper's assumptions."""
    found = []
    if summary.get("status", "completed") != "completed":
        signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
        text = f"{summary['status']} at t = {summary['status_time']:.4g} s{signal}"
        ended = Finding("refusal", "ended", "ended early", text, summary["status_remedy"])
        found.append(ended)
    if summary.get("fault"):
        found.append(Finding("warning", "fault", "fault in the plant", summary["fault"]))
    for fault in summary.get("faults", []):
        text = f"{fault['words']}, {100 * fault['confidence']:.4g} % sure"
        where = f"fault found at {fault['found']:.4g} s"
        found.append(Finding("warning", "fault_found", where, text))
    for mismatch in summary.get("mismatch", []):
        found.append(Finding("warning", "mismatch", "not in the structure", mismatch))
    counts = summary.get("stream", {})
    wrong = [f"{counts[k]} {w[counts[k] != 1]}" for k, w in _STREAM.items() if counts.get(k)]
    if wrong:
        text = ", ".join(wrong).format("it" if counts.get("gaps") == 1 else "them")
        found.append(Finding("note", "samples", "samples", text))
    if summary["sensor_noise"]:
        found.append(Finding("note", "noise", "sensors", summary["sensor_noise"]))
    return tuple(found)
