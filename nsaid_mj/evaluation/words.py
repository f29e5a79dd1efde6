"""How a summary is told, by terminal, report and recording alike."""

from __future__ import annotations

from typing import Any

OWN = "NS-AID"
"""What a scenario's own identifier is called beside its rivals."""

FIGURES = (
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at first", "theta_perp_ratio_initial", ""),
    ("… at the end", "theta_perp_ratio", ""),
    ("direction of the plant alone, error", "plant_direction_error", "%"),
    ("largest error of an actuator's share", "actuator_ratio_error", "%"),
    ("force residual on another trajectory", "force_residual_ratio", "%"),
    ("rms Δv over the last tenth [SI]", "velocity_error_rms", ""),
)
"""What terminal, report and recording tell of every identifier: label, key, unit."""


def figure(value: float | None, unit: str) -> str:
    """A figure with three digits, as a percentage where its unit is %; – where there is none."""
    if value is None:
        return "–"
    return f"{100 * value:.3g} %" if unit == "%" else f"{value:.3g}"


def confidence_lines(summary: dict[str, Any]) -> list[str]:
    """What the confidence says, in words; none where the law does not say."""
    stated = summary["confidence"]
    if stated is None:
        return []
    worst, actuators = stated["worst_known"][0], stated["actuators"]
    covered = []
    if "covered" in stated:
        covered = [
            f"95 % intervals hold the truth in {100 * stated['covered']:.0f} % of the directions"
        ]
    lines = [
        f"known to ±{stated['deviation_median']:.2g} of ‖θ̂‖ along half of {stated['directions']} "
        f"directions, to ±{stated['deviation_largest']:.2g} along the worst "
        f"({', '.join(worst['parameters'])}); {stated['below_noise']} are below the noise",
        *covered,
    ]
    if len(actuators) > 1:
        name = max(actuators, key=lambda key: actuators[key])
        lines.append(f"actuators' shares to ±{100 * actuators[name]:.2g} % or better ({name})")
    return lines


def unobservable_lines(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """(what, remedy) of the unobservable directions; those of one parameter each in one line."""
    lines = summary["unobservable"]
    alone = [line["parameters"][0] for line in lines if len(line["parameters"]) == 1]
    told = [(line["direction"], line["fix"]) for line in lines if len(line["parameters"]) > 1]
    if alone:
        what = f"{', '.join(alone)}: without effect on the motion, each alone"
        told.insert(1, (what, "nothing but knowing them"))
    return told
