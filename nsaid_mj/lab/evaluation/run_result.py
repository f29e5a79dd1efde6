"""The result of a run: its statistics by topic, and what every result has, made of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base import Finding, without_nonfinite
from ...core import ParameterSpace, phrase
from ...report import Explains, Parameter, Result, Statistic, Status, percent
from .confidence import INTERVAL
from .figures import common_factor
from .statistics import (
    COMPARED,
    OPTIONAL,
    Accuracy,
    Conditions,
    Definiteness,
    Dimensions,
    Estimated,
    Excitation,
    LawUsed,
    Origin,
    RivalStatistics,
    RunCost,
    RunEnding,
    StatedConfidence,
    Theory,
    Unobservable,
)
from .truth import CONVERGED

if TYPE_CHECKING:
    from ...core import FaultEvent
    from ...watch import Misfit

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

_SAMPLES = {
    "gaps": ("gap", "gaps"),
    "missing": ("sample missing in {}", "samples missing in {}"),
    "not_finite": ("not finite",) * 2,
    "duplicates": ("repeated",) * 2,
    "late": ("out of order",) * 2,
    "unreadable": ("unreadable",) * 2,
}  # what may be wrong with the samples of a live robot: one, several


@dataclass(frozen=True, kw_only=True)
class RunResult(Result):
    """The result of a run; `summary` is the content of its summary.json.

    Attributes:
        truth_known: whether the plant's true parameters are known, as in a simulation.
        recorded: whether the record has a row; without one, everything that is computed from the
            record is None or empty.
        ending: how the run ended.
        dimensions: the size of the problem.
        accuracy: how good the last estimate is.
        theory: quantities of the paper's proofs.
        excitation: excitation by the motion.
        definiteness: how far the mass matrices were from losing definiteness.
        rivals: how good the last estimates of the other identifiers are, by name.
        misfit: how well the structure fits the motion; None where that was not tested.
        confidence: the confidence that the law states; None if it states none.
        estimates: all parameters, in order of θ, in the scale of the estimate.
        law: the law.
        conditions: what was simulated beside the structure.
        faults: faults that the law found.
        samples: faults of a live robot's samples, by kind; empty for a simulation.
        unobservable: the directions of P_s(θ).
        cost: computing times.
        origin: what is needed to run it again.
    """

    truth_known: bool
    recorded: bool = True
    ending: RunEnding
    dimensions: Dimensions
    accuracy: Accuracy = field(default_factory=Accuracy)
    theory: Theory = field(default_factory=Theory)
    excitation: Excitation = field(default_factory=Excitation)
    definiteness: Definiteness = field(default_factory=Definiteness)
    rivals: Mapping[str, RivalStatistics] = field(default_factory=dict)
    misfit: Misfit | None = None
    confidence: StatedConfidence | None = None
    estimates: tuple[Estimated, ...] = ()
    law: LawUsed
    conditions: Conditions
    faults: tuple[FaultEvent, ...] = ()
    samples: Mapping[str, int] = field(default_factory=dict)
    unobservable: tuple[Unobservable, ...] = ()
    cost: RunCost
    origin: Origin

    def summary(self) -> dict[str, Any]:
        """The content of summary.json; `summary.result_from` reads it.

        Keys of statistics that compare with an unknown truth are absent. Numbers that are not
        finite are None, as JSON cannot represent them.
        """
        known = self.truth_known
        document = {
            **_keys_of(self.ending, known),
            **_keys_of(self.dimensions, known),
            **(_evaluated(self) if self.recorded else _without_rows(known)),
            **_keys_of(self.law, known),
            **_keys_of(self.conditions, known),
            "faults": [fault.keys() for fault in self.faults],
            **({"stream": dict(self.samples)} if self.samples else {}),
            "unobservable": [_keys_of(one, known) for one in self.unobservable],
            **_keys_of(self.cost, known),
            **_keys_of(self.origin, known),
            "verdict": self.verdict,
        }
        return without_nonfinite(document)

    @property
    def labels(self) -> dict[str, str]:
        """The parameters' labels, by name."""
        return {row.name: row.label for row in self.estimates}

    @property
    def confidence_in_words(self) -> list[str]:
        """The confidence that the law states; empty if it states none."""
        stated = self.confidence
        labels = self.labels
        if stated is None:
            return []
        worst = phrase(labels[name] for name in stated.worst_known[0].parameters)
        low = stated.below_noise
        lines = [
            f"{stated.directions} observable directions: standard deviation "
            f"{percent(stated.deviation_median, 2)} of ‖θ̂‖ (median), "
            f"{percent(stated.deviation_largest, 2)} (worst: {worst})"
            + (f"; {low} below the noise" if low else "")
        ]
        if (covered := stated.covered) is not None:
            inside = f"{100 * covered:.0f} %"
            lines.append(f"the true value is inside the 95 % interval in {inside} of them")
        if (covered := stated.forces_covered) is not None:
            lines.append(
                f"on a held-out motion, {100 * covered:.0f} % of the forces are within the 95 % "
                "intervals of their predictions"
            )
        return lines

    @property
    def observable_in_words(self) -> str:
        """How many directions of θ the motion can reveal, as a sentence without its end."""
        r = self.dimensions.r
        p = self.dimensions.p
        seen = p - r
        return (
            f"{seen} of {p} directions of θ {'is' if seen == 1 else 'are'} observable; "
            f"{r} {'is' if r == 1 else 'are'} not"
        )

    @property
    def unobservable_in_words(self) -> list[tuple[str, str]]:
        """(direction, remedy) of the unobservable directions; single parameters share one line."""
        directions = self.unobservable
        alone = [one.labels[0] for one in directions if len(one.labels) == 1]
        found = [(one.direction, one.fix) for one in directions if len(one.labels) > 1]
        if alone:
            words = f"{phrase(alone)}: does not affect the motion"
            found.insert(1, (words, "cannot be identified; the model file's value is kept"))
        return found


def judged(result: RunResult, space: ParameterSpace | None = None) -> RunResult:
    """The result with verdict, comparison, parameters and findings that follow from its statistics.

    Without a space, parameters have no blocks.
    """
    explains, sentence = verdict_of(result)
    return replace(
        result,
        explains=explains,
        verdict=sentence,
        statistics=_compared(result),
        parameters=_parameters(result, space),
        findings=_findings(result),
    )


# -- the verdict -----------------------------------------------------------------------------------

PREDICTS = 1e-3  # largest force residual on a held-out trajectory, used if the truth is unknown
CONTRADICTED = 1e-2  # smallest share of the actuator forces left unexplained by every θ
_MARGIN = 3.0  # factor on the smallest possible residual, within which an estimate has converged
_FASTER = "--law efficient does in seconds what this law does in hours"


def verdict_of(result: RunResult) -> tuple[Explains, str]:
    """The outcome of a run, also in one line: a judgement, a colon, and the figures it is based on.

    The first of these that applies:

    - *ended early*: the run did not complete;
    - *contradicts*: no θ of the structure explains the motion, judged from the measurements alone
      (`misfit`), or, for a simulated plant, because every θ leaves more than `CONTRADICTED` of the
      forces on a held-out trajectory unexplained;
    - *converged*: the estimate is within `CONVERGED` of the true set;
    - *still converging*: it is closer to the true set than the prior.

    If the truth is unknown, the stated confidence replaces the distance. The force residual is
    added unless the filter's innovations show that the structure explains the motion, because with
    noisy sensors the residual stays large. A misfit of `some` is reported with the widening of the
    intervals, or as gains that drift.
    """
    ending = result.ending
    misfit = result.misfit
    accuracy = result.accuracy
    if ending.status != "completed":
        signal = f" ({ending.status_signal})" if ending.status_signal else ""
        return "no", f"ended early: {ending.status} at t = {ending.status_time:.4g} s{signal}"
    if misfit is not None and misfit.level == "contradicts":
        times = misfit.contradictions
        return "no", (
            f"the motion contradicts this structure: {len(times)} times in the last "
            f"{misfit.seconds:.3g} s the innovations exceeded chance, first at t = "
            f"{times[0]:.4g} s; look for a delay, a lag, a reversed sign or a force left out"
        )
    floor = result.theory.force_residual_floor
    if floor is not None and floor > CONTRADICTED:
        return "no", (
            f"the motion contradicts this structure: no parameters explain more than "
            f"{100 * (1 - floor):.3g} % of the actuator forces on a held-out trajectory"
        )
    residual = accuracy.force_residual
    distance = accuracy.theta_perp_ratio
    first = accuracy.theta_perp_ratio_initial
    if distance is None:
        arrived, where = _without_truth(result, residual, floor or 0.0)
        nearer = True
    else:
        arrived = distance <= CONVERGED
        nearer = first is None or distance < first
        predicts = "" if residual is None else f", force residual {percent(residual, 2)}"
        where = f"{percent(distance, 2)} from the true set{predicts}"
    if misfit is not None and misfit.drift:
        where += f"; gains drift by up to {percent(misfit.drift, 2)} a minute"
    elif misfit is not None and misfit.level == "some":
        where += (
            "; the structure does not explain everything, so the intervals are "
            f"{misfit.widening:.2g} times wider"
        )
    if arrived:
        return "yes", f"converged: {where}"
    if result.law.law in {"memory", "efficient"}:
        advice = "try a longer run or a motion with more excitation"
    elif result.law.gains_held:
        advice = "this law holds the actuator gains at their assumed values"
    else:
        advice = _FASTER
    if nearer:
        return "partly", f"still converging: {where}; {advice}"
    return "no", f"not converging: {where}; {advice}"


def _without_truth(result: RunResult, residual: float | None, floor: float) -> tuple[bool, str]:
    """Whether a run has converged, by confidence and force residual, and these in words."""
    worst = None if result.confidence is None else result.confidence.deviation_largest
    fits = result.misfit is not None and result.misfit.level == "none"
    explained = fits and worst is not None
    small = residual is not None and residual <= max(PREDICTS, _MARGIN * floor)
    known = "" if worst is None else f"least known direction: deviation {percent(worst, 2)}"
    predicts = "" if residual is None else f"force residual {percent(residual, 2)}"
    if explained and residual is not None and not small:
        predicts += " by noise of the measured accelerations"
    where = ", ".join(filter(None, (known, predicts))) or "no measure of convergence available"
    return (explained or small) and (worst is None or worst <= CONVERGED), where


# -- what every result has -------------------------------------------------------------------------


def _compared(result: RunResult) -> tuple[Statistic, ...]:
    """The statistics of all identifiers; without those that none of them has."""
    identifiers: dict[str, Accuracy] = {OWN: result.accuracy, **result.rivals}
    units = ", ".join(result.dimensions.velocity_units)
    return tuple(
        Statistic(
            label if unit else f"{label} [{units}]",
            unit,
            {name: getattr(accuracy, key) for name, accuracy in identifiers.items()},
        )
        for label, key, unit in STATISTICS
        if result.truth_known or key == "velocity_error_rms"
    )


def _parameters(result: RunResult, space: ParameterSpace | None) -> tuple[Parameter, ...]:
    """The parameters; where the truth is known, times the factor that makes the gains' mean exact.

    Intervals are at a fixed mean of the gains, and so is the ratio of a gain to the others.
    """
    rows = result.estimates
    stated = result.confidence
    known = stated.parameters if stated is not None else {}
    gains = stated.actuators if stated is not None else {}
    blocks = [] if space is None else [b.name for b in space.blocks for _ in b.names]
    factor = _factor_of(rows, gains, space)
    found = []
    for k, row in enumerate(rows):
        value = factor * row.estimate
        own = known.get(row.name)
        deviation = own.deviation if own is not None else None
        half = INTERVAL * abs(factor) * deviation if deviation is not None else 0.0
        status: Status = ""
        if known:
            status = "only in combination" if own is None else "identified"
            status = "below the noise" if own is not None and own.below_noise else status
        gain = gains.get(row.name)
        relative = INTERVAL * gain if gain is not None else None
        found.append(
            Parameter(
                row.name,
                row.label,
                blocks[k] if blocks else "",
                row.unit,
                value,
                value - half,
                value + half,
                factor * row.prior,
                status,
                relative=relative if len(gains) > 1 else None,
                true=row.true,
            )
        )
    return tuple(found)


def _factor_of(
    rows: tuple[Estimated, ...], gains: Mapping[str, float | None], space: ParameterSpace | None
) -> float:
    """The `common_factor` of the estimates; 1 if the truth is unknown."""
    true = [row.true for row in rows if row.true is not None]
    if not rows or len(true) < len(rows):
        return 1.0
    estimate = np.array([row.estimate for row in rows])
    scale = np.array([row.scale for row in rows])
    actuators = [k for k, row in enumerate(rows) if row.name in gains]
    if space is not None:
        actuators = space.actuators
    at = np.array(actuators, dtype=np.intp)
    return float(common_factor(estimate, np.array(true), scale, at))


def _findings(result: RunResult) -> tuple[Finding, ...]:
    """How a run ended early, and its deviations from the paper's assumptions."""
    ending = result.ending
    conditions = result.conditions
    found = []
    if ending.status != "completed":
        signal = f" ({ending.status_signal})" if ending.status_signal else ""
        text = f"{ending.status} at t = {ending.status_time:.4g} s{signal}"
        found.append(Finding("refusal", "ended", "ended early", text, ending.status_remedy))
    if conditions.fault:
        found.append(Finding("warning", "fault", "fault in the plant", conditions.fault))
    for fault in result.faults:
        text = f"{fault.in_words}, {100 * fault.confidence:.4g} % sure"
        where = f"fault found at {fault.found:.4g} s"
        found.append(Finding("warning", "fault_found", where, text))
    for mismatch in conditions.mismatch or ():
        found.append(Finding("warning", "mismatch", "not in the structure", mismatch))
    counts = result.samples
    wrong = [f"{counts[k]} {w[counts[k] != 1]}" for k, w in _SAMPLES.items() if counts.get(k)]
    if wrong:
        text = ", ".join(wrong).format("it" if counts.get("gaps") == 1 else "them")
        found.append(Finding("note", "samples", "samples", text))
    if conditions.sensor_noise:
        found.append(Finding("note", "noise", "sensors", conditions.sensor_noise))
    return tuple(found)


_WITHOUT_ROWS = (
    "velocity_error_rms",
    "velocity_error_rms_initial",
    "conserved_drift",
    "pe_level",
    "confidence",
)
"""Keys that are null if the run ended before its first row."""

_WITHOUT_ROWS_COMPARED = (
    "r_excited",
    "theta_perp_ratio_initial",
    "theta_perp_ratio",
    "plant_direction_error",
    "actuator_ratio_error",
    "force_residual_ratio",
    "force_residual_floor",
    "lyapunov_violations",
    "pe_level_perp",
    "pe_share_perp",
    "excited_error_rms",
    "excited_error_rms_initial",
)
"""Keys that are null in such a run, even though its truth is known."""


def _evaluated(result: RunResult) -> dict[str, Any]:
    """The keys that are computed from a record of at least one row."""
    known = result.truth_known
    stated = result.confidence
    return {
        **_keys_of(result.accuracy, known),
        **_keys_of(result.theory, known),
        **_keys_of(result.excitation, known),
        **_keys_of(result.definiteness, known),
        "rivals": {name: _keys_of(rival, known) for name, rival in result.rivals.items()},
        **({} if result.misfit is None else result.misfit.keys()),
        "confidence": None if stated is None else _keys_of(stated, known),
        "parameters": [_keys_of(row, known) for row in result.estimates],
    }


def _without_rows(known: bool) -> dict[str, Any]:
    """Keys and values of the statistics of a run without any row."""
    keys = _WITHOUT_ROWS + (_WITHOUT_ROWS_COMPARED if known else ())
    return dict.fromkeys(keys) | {"rivals": {}}


def _keys_of(topic: Any, known: bool) -> dict[str, Any]:
    """The keys of a topic, whose statistics are compared with the truth if that is `known`."""
    found = {}
    for one in fields(topic):
        value = getattr(topic, one.name)
        absent = (one.metadata.get(COMPARED) and not known) or (
            one.metadata.get(OPTIONAL) and value is None
        )
        if not absent:
            found[one.name] = _plain(value, known)
    return found


def _plain(value: Any, known: bool) -> Any:
    """A value for JSON."""
    if is_dataclass(value):
        return _keys_of(value, known)
    if isinstance(value, Mapping):
        return {key: _plain(item, known) for key, item in value.items()}
    if isinstance(value, tuple):
        return [_plain(item, known) for item in value]
    return value
