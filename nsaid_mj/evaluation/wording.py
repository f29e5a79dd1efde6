"""How numbers and statistics are phrased, on the terminal, on pages and in recordings."""

import math
from collections.abc import Mapping, Sequence

from ..parameters import ABSENT, number, phrase, rounded
from ..structure.system import SecondOrderSystem
from .statistics import Dimensions, StatedConfidence, Unobservable

_FORCE_UNITS = {"m/s": "N", "rad/s": "N·m"}  # of a generalised force, by unit of its velocity


OWN = "NS-AID"
"""Label of the scenario's own identifier in tables and plots that also show its rivals."""

STATISTICS = (
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the start", "theta_perp_ratio_initial", "%"),
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the end", "theta_perp_ratio", "%"),
    ("direction error of the plant's own parameters", "plant_direction_error", "%"),
    ("error of gain ratios", "actuator_ratio_error", "%"),
    ("force residual on a held-out trajectory", "force_residual_ratio", "%"),
    ("rms Δv over the last tenth of the run", "velocity_error_rms", ""),
)
"""The statistics shown for every identifier: label, name in `Accuracy`, and % for ratios."""


def force_units(system: SecondOrderSystem) -> list[str]:
    """The unit of the generalised force of each velocity."""
    return [_FORCE_UNITS.get(unit, "SI") for unit in system.velocity_units]


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


def statistic(value: float | None, unit: str) -> str:
    """Formats a statistic with three digits, as a percentage if its unit is %; None becomes –."""
    if value is None:
        return "–"
    return f"{rounded(100 * value)} %" if unit == "%" else rounded(value)


def observable_line(dimensions: Dimensions) -> str:
    """How many directions of θ the motion can and cannot reveal, as a sentence without its end."""
    r, p = dimensions.r, dimensions.p
    seen = p - r
    return (
        f"{seen} of {p} directions of θ {'is' if seen == 1 else 'are'} observable; "
        f"{r} {'is' if r == 1 else 'are'} not"
    )


def confidence_lines(stated: StatedConfidence | None, labels: Mapping[str, str]) -> list[str]:
    """The confidence that a law states, in words; empty if it states none.

    `labels` are those of the parameters, by name.
    """
    if stated is None:
        return []
    worst = phrase(labels[name] for name in stated.worst_known[0].parameters)
    low = stated.below_noise
    lines = [
        f"{stated.directions} observable directions, known with a standard deviation of "
        f"{share_in_words(stated.deviation_median)} of ‖θ̂‖ in the median, of "
        f"{share_in_words(stated.deviation_largest)} at worst ({worst})"
        + (f"; {low} below the noise" if low else "")
    ]
    if (covered := stated.covered) is not None:
        lines.append(f"the 95 % intervals contain the truth in {100 * covered:.0f} % of them")
    if (covered := stated.forces_covered) is not None:
        lines.append(
            f"on a held-out motion, {100 * covered:.0f} % of the forces are within the 95 % "
            "intervals of their predictions"
        )
    return lines


def unobservable_lines(directions: Sequence[Unobservable]) -> list[tuple[str, str]]:
    """(direction, remedy) of the unobservable directions; single parameters share one line."""
    alone = [one.labels[0] for one in directions if len(one.labels) == 1]
    found = [(one.direction, one.fix) for one in directions if len(one.labels) > 1]
    if alone:
        found.insert(1, (f"{phrase(alone)}: no effect on the motion", "has to be known beforehand"))
    return found


def share_in_words(value: float) -> str:
    """A share in percent, with two digits."""
    return f"{rounded(100 * value, 2)} %"
