"""A summary in words, for terminal, report and recording alike."""

from __future__ import annotations

import math
from typing import Any

from ..parameters import phrase
from .confidence import INTERVAL

OWN = "NS-AID"
"""What a scenario's own identifier is called beside its rivals."""

FIGURES = (
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the start", "theta_perp_ratio_initial", "%"),
    ("… at the end", "theta_perp_ratio", "%"),
    ("direction error of the plant without its actuators", "plant_direction_error", "%"),
    ("largest error of an actuator's gain relative to the others", "actuator_ratio_error", "%"),
    ("force residual on another trajectory", "force_residual_ratio", "%"),
    ("rms Δv over the last tenth of the run [SI]", "velocity_error_rms", ""),
)
"""The figures shown for every identifier: label, key of the summary, unit."""


def figure(value: float | None, unit: str) -> str:
    """A figure with three digits, as a percentage where its unit is %; – where it is None."""
    if value is None:
        return "–"
    return f"{100 * value:.3g} %" if unit == "%" else f"{value:.3g}"


def confidence_lines(summary: dict[str, Any]) -> list[str]:
    """The stated confidence in words; no lines where the law states none."""
    stated = summary["confidence"]
    if stated is None:
        return []
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    worst = phrase(label[name] for name in stated["worst_known"][0]["parameters"])
    low = stated["below_noise"]
    lines = [
        f"of {stated['directions']} observable directions half are known to "
        f"±{100 * stated['deviation_median']:.2g} % of ‖θ̂‖ or better, the worst ({worst}) to "
        f"±{100 * stated['deviation_largest']:.2g} %"
        + (f"; {low} are lost in the noise" if low else "")
    ]
    if (covered := stated.get("covered")) is not None:
        lines.append(f"the 95 % intervals hold the truth in {100 * covered:.0f} % of them")
    return lines


def gain_rows(summary: dict[str, Any]) -> list[tuple[str, float | None, float, float | None]]:
    """(label, estimate, ±, truth) of the actuators; no rows where the law states no intervals.

    Gains are relative to their geometric mean, since their common scale is unobservable. ± is half
    of the 95 % interval, as a share of the gain. Estimate and truth are None where units differ,
    the truth also where there is none.
    """
    stated = summary["confidence"]
    if stated is None or len(stated["actuators"]) < 2:
        return []
    rows = {row["name"]: row for row in summary["parameters"]}
    found = [rows[name] for name in stated["actuators"]]
    estimates, truths = (_relative(found, key) for key in ("estimate", "true"))
    return [
        (row["label"], estimate, INTERVAL * deviation, truth)
        for row, estimate, deviation, truth in zip(
            found, estimates, stated["actuators"].values(), truths, strict=True
        )
    ]


def _relative(rows: list[dict[str, Any]], key: str) -> list[float | None]:
    """Gains over their geometric mean; None where that has no meaning."""
    values = [row[key] for row in rows if row.get(key) is not None and row[key] > 0]
    if len(values) < len(rows) or len({row["unit"] for row in rows}) > 1:
        return [None] * len(rows)
    mean = math.exp(sum(map(math.log, values)) / len(values))
    return [value / mean for value in values]


def unobservable_lines(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """(what, remedy) of the unobservable directions; single parameters share one line."""
    lines = summary["unobservable"]
    alone = [line["labels"][0] for line in lines if len(line["labels"]) == 1]
    found = [(line["direction"], line["fix"]) for line in lines if len(line["labels"]) > 1]
    if alone:
        found.insert(1, (f"{phrase(alone)}: without any effect on the motion", "only knowing them"))
    return found
