"""A run's summary in words, shared by the terminal, the report and the recording."""

import math
from typing import Any

from ..parameters import ABSENT, number, phrase, rounded
from ..structure.system import SecondOrderSystem
from .figures import CONVERGED

_FORCE_UNITS = {"m/s": "N", "rad/s": "N·m"}  # of a generalised force, by unit of its velocity


OWN = "NS-AID"
"""Label of the scenario's own identifier in tables and plots that also show its rivals."""

FIGURES = (
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the start", "theta_perp_ratio_initial", "%"),
    ("distance to the true set ‖θ̄_P⊥‖/‖θ̂‖, at the end", "theta_perp_ratio", "%"),
    ("direction error of the plant's own parameters", "plant_direction_error", "%"),
    ("error of gain ratios", "actuator_ratio_error", "%"),
    ("force residual on a held-out trajectory", "force_residual_ratio", "%"),
    ("rms Δv over the last tenth of the run", "velocity_error_rms", ""),
)
"""The figures shown for every identifier: label, key of the summary, and % for ratios."""


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


def figure(value: float | None, unit: str) -> str:
    """Formats a figure with three digits, as a percentage if its unit is %; None becomes –."""
    if value is None:
        return "–"
    return f"{rounded(100 * value)} %" if unit == "%" else rounded(value)


def observable_line(summary: dict[str, Any]) -> str:
    """How many directions of θ the motion can and cannot reveal, as a sentence without its end."""
    r, p = summary["r"], summary["p"]
    seen = p - r
    return (
        f"{seen} of {p} directions of θ {'is' if seen == 1 else 'are'} observable; "
        f"{r} {'is' if r == 1 else 'are'} not"
    )


def confidence_lines(summary: dict[str, Any]) -> list[str]:
    """The confidence that the law states, in words; empty if the law states none."""
    stated = summary["confidence"]
    if stated is None:
        return []
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    worst = phrase(label[name] for name in stated["worst_known"][0]["parameters"])
    low = stated["below_noise"]
    lines = [
        f"{stated['directions']} observable directions, known with a standard deviation of "
        f"{_share(stated['deviation_median'])} of ‖θ̂‖ in the median, of "
        f"{_share(stated['deviation_largest'])} at worst ({worst})"
        + (f"; {low} below the noise" if low else "")
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


PREDICTS = 1e-3  # largest force residual on a held-out trajectory, used if the truth is unknown
CONTRADICTED = 1e-2  # smallest share of the actuator forces left unexplained by every θ
_MARGIN = 3.0  # factor on the smallest possible residual, within which an estimate has converged
_FASTER = "--law efficient does in seconds what this law does in hours"


def verdict(summary: dict[str, Any]) -> str:
    """The outcome of a run in one line: a judgement, a colon, and the figures it is based on.

    The first of these that applies: a run that did not complete *ended early*; a motion that no θ
    of the structure explains *contradicts* it, judged from the measurements alone (`misfit`), or,
    for a simulated plant, because every θ leaves more than `CONTRADICTED` of the forces on a
    held-out trajectory unexplained; an estimate within `CONVERGED` of the true set has *converged*;
    one that is closer to it than the prior is *still converging*. If the truth is unknown, the
    stated confidence and, unless the filter's innovations show that the structure explains the
    motion, the force residual replace the distance: with noisy sensors the residual stays large. A
    misfit of `some` is reported with the widening of the intervals, or as gains that drift.
    """
    if summary["status"] != "completed":
        signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
        return f"ended early: {summary['status']} at t = {summary['status_time']:.4g} s{signal}"
    if summary.get("misfit") == "contradicts":
        times = summary["misfit_contradictions"]
        return (
            f"the motion contradicts this structure: {len(times)} times in the last "
            f"{summary['misfit_seconds']:.3g} s the innovations exceeded chance, first at t = "
            f"{times[0]:.4g} s; look for a delay, a lag, a reversed sign or a force left out"
        )
    residual, floor = summary.get("force_residual_ratio"), summary.get("force_residual_floor")
    if floor is not None and floor > CONTRADICTED:
        return (
            f"the motion contradicts this structure: no parameters explain more than "
            f"{100 * (1 - floor):.3g} % of the actuator forces on a held-out trajectory"
        )
    distance, first = (summary.get(f"theta_perp_ratio{end}") for end in ("", "_initial"))
    if residual is None:  # no held-out trajectory: use the run's own last part
        residual = summary.get("force_residual_ratio_measured")
    if distance is None:
        arrived, where = _without_truth(summary, residual, floor or 0.0)
        nearer = True
    else:
        arrived, nearer = distance <= CONVERGED, first is None or distance < first
        predicts = "" if residual is None else f", force residual {_share(residual)}"
        where = f"{_share(distance)} from the true set{predicts}"
    if drift := summary.get("misfit_drift"):
        where += f"; gains drift by up to {_share(drift)} a minute"
    elif summary.get("misfit") == "some":
        where += (
            "; the structure does not explain everything, so the intervals are "
            f"{summary['misfit_widening']:.2g} times wider"
        )
    if arrived:
        return f"converged: {where}"
    if summary["law"] in {"memory", "efficient"}:
        advice = "try a longer run or a motion with more excitation"
    elif summary.get("gains_held"):
        advice = "this law holds the actuator gains at their assumed values"
    else:
        advice = _FASTER
    return f"{'still converging' if nearer else 'not converging'}: {where}; {advice}"


def _without_truth(
    summary: dict[str, Any], residual: float | None, floor: float
) -> tuple[bool, str]:
    """Whether a run has converged, by confidence and force residual, and these in words."""
    stated = summary.get("confidence")
    worst = None if stated is None else stated["deviation_largest"]
    explained = summary.get("misfit") == "none" and worst is not None
    small = residual is not None and residual <= max(PREDICTS, _MARGIN * floor)
    known = "" if worst is None else f"least known direction: deviation {_share(worst)}"
    predicts = "" if residual is None else f"force residual {_share(residual)}"
    if explained and residual is not None and not small:
        predicts += " by noise of the measured accelerations"
    where = ", ".join(filter(None, (known, predicts))) or "no measure of convergence available"
    return (explained or small) and (worst is None or worst <= CONVERGED), where


def _share(value: float) -> str:
    return f"{rounded(100 * value, 2)} %"
