"""A run's summary in words, shared by the terminal, the report and the recording."""

from __future__ import annotations

import math
from typing import Any

from ..parameters import phrase
from ..system import SecondOrderSystem
from .confidence import INTERVAL

_FORCE_UNITS = {"m/s": "N", "rad/s": "N·m"}  # of a generalised force, by unit of its velocity

OWN = "NS-AID"
"""Label of the scenario's own identifier in tables and plots that also show its rivals."""

FIGURES = (
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the start", "theta_perp_ratio_initial", "%"),
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the end", "theta_perp_ratio", "%"),
    ("direction error of the plant's own parameters", "plant_direction_error", "%"),
    ("largest error of an actuator's gain relative to the others", "actuator_ratio_error", "%"),
    ("force residual on a held-out trajectory", "force_residual_ratio", "%"),
    ("rms Δv over the last tenth of the run [SI]", "velocity_error_rms", ""),
)
"""The figures shown for every identifier: label, key of the summary, unit."""


def force_units(system: SecondOrderSystem) -> list[str]:
    """The unit of the generalised force of each velocity."""
    return [_FORCE_UNITS.get(unit, "SI") for unit in system.velocity_units]


def figure(value: float | None, unit: str) -> str:
    """Formats a figure with three digits, as a percentage if its unit is %; None becomes –."""
    if value is None:
        return "–"
    return f"{100 * value:.3g} %" if unit == "%" else f"{value:.3g}"


def observable_line(summary: dict[str, Any]) -> str:
    """How many directions of θ the motion can and cannot reveal, as a sentence without its end."""
    r, p = summary["r"], summary["p"]
    seen = p - r
    return (
        f"{seen} of {p} directions of θ {'is' if seen == 1 else 'are'} observable; "
        f"{r} {'is' if r == 1 else 'are'} not"
    )


def scientific(value: float) -> str:
    """A level with up to four digits; in scientific notation below 0.01: 1e-4, 5e-3, 0.02."""
    if value == 0 or abs(value) >= 0.01:
        return f"{value:.4g}"
    mantissa, _, exponent = f"{value:.3e}".partition("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def confidence_lines(summary: dict[str, Any]) -> list[str]:
    """The confidence that the law states, in words; empty if the law states none."""
    stated = summary["confidence"]
    if stated is None:
        return []
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    worst = phrase(label[name] for name in stated["worst_known"][0]["parameters"])
    low = stated["below_noise"]
    lines = [
        f"of {stated['directions']} observable directions, half are known to within "
        f"±{100 * stated['deviation_median']:.2g} % of ‖θ̂‖, the least known ({worst}) to within "
        f"±{100 * stated['deviation_largest']:.2g} %" + (f"; {low} below the noise" if low else "")
    ]
    if (covered := stated.get("covered")) is not None:
        lines.append(f"the 95 % intervals contain the truth in {100 * covered:.0f} % of them")
    if (covered := stated.get("forces_covered")) is not None:
        lines.append(
            f"on a held-out motion, {100 * covered:.0f} % of the forces are within the 95 % "
            "intervals of their predictions"
        )
    return lines


def gain_rows(summary: dict[str, Any]) -> list[tuple[str, float | None, float, float | None]]:
    """(label, estimate, ±, truth) of every actuator; empty if the law states no intervals.

    Gains are relative to their geometric mean, because their common scale is unobservable. ± is
    half the width of the 95 % interval, relative to the gain. Estimate and truth are None if the
    gains have different units; the truth is also None if it is unknown.
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
    """Gains over their geometric mean; None if one is missing or ≤ 0, or if units differ."""
    values = [row[key] for row in rows if row.get(key) is not None and row[key] > 0]
    if len(values) < len(rows) or len({row["unit"] for row in rows}) > 1:
        return [None] * len(rows)
    mean = math.exp(sum(map(math.log, values)) / len(values))
    return [value / mean for value in values]


def unobservable_lines(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """(direction, remedy) of the unobservable directions; single parameters share one line."""
    lines = summary["unobservable"]
    alone = [line["labels"][0] for line in lines if len(line["labels"]) == 1]
    found = [(line["direction"], line["fix"]) for line in lines if len(line["labels"]) > 1]
    if alone:
        found.insert(1, (f"{phrase(alone)}: no effect on the motion", "has to be known beforehand"))
    return found
