"""What a run's report tells of the parameters: tables, intervals, and how sure the law is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import evaluation
from ..evaluation import words
from ..evaluation.confidence import INTERVAL
from ..evaluation.words import STATUSES
from ..parameters import Indices, ParameterSpace
from . import pages
from .pages import Figures, Fold, Items, Table, Text

_OPEN = 12  # parameters in total, up to which no table is collapsed


def confidence(summary: dict[str, Any], gains: Sequence[pages.Figure]) -> list[pages.Panel]:
    """The stated confidence in words, and the least known directions; empty if none is stated."""
    stated = summary["confidence"]
    if stated is None:
        return []
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    worst = [
        [
            ", ".join(f"{weight:+.2f} {label[name]}" for name, weight in row["parameters"].items()),
            f"±{100 * row['deviation']:.2g} %",
            "below the noise" if row["below_noise"] else "",
        ]
        for row in stated["worst_known"]
    ]
    return [
        *([Figures(gains)] if gains else []),
        Items(evaluation.confidence_lines(summary)),
        Text("Least known directions of θ/scale", head=True),
        Table(["largest components", "standard deviation / ‖θ̂/scale‖", ""], worst),
    ]


def parameters_note(summary: dict[str, Any]) -> str:
    """What the table of parameters is relative to."""
    told = "Estimates are determined up to the unobservable directions above."
    if _true(summary["parameters"]):
        told += (
            " For comparison, prior and estimate are multiplied by the one factor that makes the "
            "mean of the estimated gains equal to the true one."
        )
    if summary["confidence"] is not None:
        told += (
            " Intervals hold the mean of the actuators' gains, since the common scale is "
            "unobservable. What the motion reveals only in sums has none."
        )
    return told


def parameters(space: ParameterSpace, summary: dict[str, Any]) -> list[Fold]:
    """A table for each block of θ; those of actuators are expanded."""
    rows, stated = summary["parameters"], summary["confidence"]
    known = (stated or {}).get("parameters", {})
    factor = _common_factor(rows, space.actuators) if _true(rows) else 1.0
    tables = []
    for block, place in space:
        heads = ["parameter", "estimate", "unit"]
        heads += ["95 % interval", "status"] * bool(known)
        heads += ["prior", *["true"] * _true(rows)]
        lines, statuses = [], []
        for row in rows[place]:
            value, half = factor * row["estimate"], 0.0
            if known:
                found = known.get(row["name"])
                statuses.append(_status(found))
                half = INTERVAL * abs(factor) * (found["deviation"] if found else 0.0)
            told, interval = words.estimate(value, value - half, value + half)
            line = [row["label"], told, row["unit"]]
            line += [interval, STATUSES[statuses[-1]]] if known else []
            line.append(words.number(factor * row["prior"]))
            line += [words.number(row["true"])] if "true" in row else []
            lines.append(line)
        counts = [
            mark._replace(text=f"{statuses.count(status)} {status}")
            for status, mark in STATUSES.items()
            if status in statuses
        ]
        shown = block.actuator or len(rows) <= _OPEN
        table = Table(heads, lines, (0, 2, 4) if known else (0, 2))
        tables.append(Fold(block.name, [table], counts, str(len(lines)), open=shown))
    return tables


def _status(found: dict[str, Any] | None) -> str:
    """Whether a parameter is identified, from its entry of the summary's confidence."""
    if found is None:
        return "only in combination"
    return "below the noise" if found["below_noise"] else "identified"


def _true(rows: Sequence[dict[str, Any]]) -> bool:
    """Whether the parameters of a summary include their true values."""
    return all("true" in row for row in rows)


def _common_factor(rows: Sequence[dict[str, Any]], actuators: Indices) -> float:
    """The factor that makes the mean of the actuators' gains exact.

    Without an actuator, or with one of the wrong sign, that which brings the estimate closest to
    the truth in θ/scale.
    """
    true, estimate = (
        np.array([row[key] / row["scale"] for row in rows]) for key in ("true", "estimate")
    )
    ratio = estimate[actuators] / true[actuators]
    if len(ratio) and (ratio > 0).all():
        return float(1 / ratio.mean())
    return float(true @ estimate / (estimate @ estimate))
