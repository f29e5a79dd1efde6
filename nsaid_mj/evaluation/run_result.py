"""The `Result` of a run, from its summary.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..parameters import Indices, ParameterSpace
from ..robot.findings import Finding
from .confidence import INTERVAL
from .result import Explains, Figure, Mark, Parameter, Result, Status, judged
from .words import FIGURES, OWN

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
    verdict = summary.get("verdict") or summary.get("status", "completed")
    return Result(
        explains=explains_of(verdict),
        verdict=verdict,
        parameters=_parameters(summary, space),
        findings=_findings(summary),
    )


def figures_of(summary: dict[str, Any]) -> list[Figure]:
    """The figures of all identifiers of a run; those that none of them has are left out."""
    identifiers = {OWN: summary, **summary["rivals"]}
    return [
        Figure(label, unit, {name: found.get(key) for name, found in identifiers.items()})
        for label, key, unit in FIGURES
        if any(key in found for found in identifiers.values())
    ]


def _parameters(summary: dict[str, Any], space: ParameterSpace | None) -> tuple[Parameter, ...]:
    """The parameters; where the truth is known, times the factor that makes the gains' mean exact.

    Intervals hold the mean of the gains, and so does the ratio of a gain to the others.
    """
    rows, stated = summary.get("parameters", []), summary["confidence"] or {}
    known, gains = stated.get("parameters", {}), stated.get("actuators", {})
    blocks = [] if space is None else [b.name for b in space.blocks for _ in b.names]
    factor = 1.0
    if rows and all("true" in row for row in rows):
        at = [k for k, row in enumerate(rows) if row["name"] in gains]
        factor = _common_factor(rows, np.array(at) if space is None else space.actuators)
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


def _common_factor(rows: list[dict[str, Any]], actuators: Indices) -> float:
    """The factor that makes the mean of the actuators' gains exact.

    Without an actuator, or with one of the wrong sign, that which brings the estimate closest to
    the truth in θ/scale.
    """
    true, estimate = (
        np.array([row[key] / row["scale"] for row in rows]) for key in ("true", "estimate")
    )
    working = [k for k in actuators if true[k] != 0]
    if working and (estimate[working] / true[working] > 0).all():
        return float(1 / np.mean(estimate[working] / true[working]))
    return float(true @ estimate / (estimate @ estimate))


def _findings(summary: dict[str, Any]) -> tuple[Finding, ...]:
    """How a run ended early, and what distinguishes it from one in the paper."""
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


def mark_of(summary: dict[str, Any]) -> Mark | None:
    """The verdict of a run with its mark; None if the summary, of an earlier version, has none."""
    verdict = summary.get("verdict")
    return judged(explains_of(verdict), verdict) if verdict else None


def explains_of(verdict: str) -> Explains:
    """Whether the structure explains a run, from the judgement before the verdict's colon."""
    return _OUTCOMES.get(verdict.partition(":")[0], "no")
