"""A run's summary in words, shared by the terminal, the report and the recording."""

from __future__ import annotations

import math
from typing import Any

from ..parameters import phrase
from ..system import SecondOrderSystem

_FORCE_UNITS = {"m/s": "N", "rad/s": "N·m"}  # of a generalised force, by unit of its velocity

ABSENT = "–"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LEAST, _MOST = 1e-3, 1e5  # numbers outside are written as powers of ten,
_FINEST = 1e-4  # unless they are rounded to this or more


OWN = "NS-AID"
"""Label of the scenario's own identifier in tables and plots that also show its rivals."""

FIGURES = (
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the start", "theta_perp_ratio_initial", "%"),
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the end", "theta_perp_ratio", "%"),
    ("direction error of the plant's own parameters", "plant_direction_error", "%"),
    ("error of gain ratios", "actuator_ratio_error", "%"),
    ("force residual on a held-out trajectory", "force_residual_ratio", "%"),
    ("rms Δv over the last tenth of the run [rad/s, m/s]", "velocity_error_rms", ""),
)
"""The figures shown for every identifier: label, key of the summary, unit."""


def force_units(system: SecondOrderSystem) -> list[str]:
    """The unit of the generalised force of each velocity."""
    return [_FORCE_UNITS.get(unit, "SI") for unit in system.velocity_units]


def number(value: float, quantum: float | None = None) -> str:
    """A number with four digits, or rounded to a quantum: 0.031, −12.5, 3.2·10⁻⁵."""
    if not math.isfinite(value):
        return ABSENT if math.isnan(value) else ("∞" if value > 0 else "−∞")
    size = abs(value)
    if quantum is None or not 0 < quantum < math.inf:
        quantum = 10.0 ** (math.floor(math.log10(size)) - 3) if size > 0 else 1.0
        trim = True
    else:
        quantum, trim = 10.0 ** math.floor(math.log10(quantum) + 1e-9), False
    if size < quantum / 2:
        text = "0"
    elif (_LEAST <= size < _MOST or quantum >= _FINEST) and quantum < 1e3:
        digits = max(0, -round(math.log10(quantum)))
        text = f"{round(size / quantum) * quantum:.{digits}f}"
        text = text.rstrip("0").rstrip(".") if trim and "." in text else text
    else:
        digits = max(0, math.floor(math.log10(size)) - round(math.log10(quantum)))
        factor, _, power = f"{size:.{min(digits, 3)}e}".partition("e")
        factor = factor.rstrip("0").rstrip(".") if trim and "." in factor else factor
        text = f"{factor}·10{str(int(power)).translate(_SUPERSCRIPTS)}"
    return f"−{text}" if value < 0 and text != "0" else text


def estimate(value: float, low: float, high: float) -> tuple[str, str]:
    """An estimate and its 95 % interval, rounded to two digits of the interval's half-width."""
    half = (high - low) / 2
    if not math.isfinite(half) or half <= 0:
        return number(value), ABSENT if half == 0 else f"{number(low)} … {number(high)}"
    quantum = 10.0 ** (math.floor(math.log10(half)) - 1)
    least = 10.0 ** (math.floor(math.log10(abs(value))) - 1) if value else quantum
    if low > 0:  # an interval of a factor: two digits of the estimate too
        quantum = min(quantum, least)
    return number(value, quantum), f"{number(low, quantum)} … {number(high, quantum)}"


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


def unobservable_lines(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """(direction, remedy) of the unobservable directions; single parameters share one line."""
    lines = summary["unobservable"]
    alone = [line["labels"][0] for line in lines if len(line["labels"]) == 1]
    found = [(line["direction"], line["fix"]) for line in lines if len(line["labels"]) > 1]
    if alone:
        found.insert(1, (f"{phrase(alone)}: no effect on the motion", "has to be known beforehand"))
    return found
