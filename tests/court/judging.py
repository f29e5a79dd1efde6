"""Whether a run is right or wrong, and confident, unsure or flagged; see `scripts/court.py`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from nsaid_mj.core.laws.faults import FaultEvent
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab.plants.world.faults.kinds import Fault

from .effects import FAULTS
from .online import Stated

COVERED = 0.6  # least share of the directions' intervals that hold
DEVIATIONS = 10.0  # largest error of a gain [stated standard deviations]
VAGUE = 0.5  # share of directions as uncertain as before the data, from which a run is unsure
RIGHT, WRONG = "right", "wrong"
CONFIDENT, UNSURE, FLAGGED, CRASH, NOT_RUN = "confident", "unsure", "flagged", "crash", "not run"


@dataclass
class Judgement:
    """What is said of a run.

    Attributes:
        wrong: reasons why it is wrong; empty if it is right.
        flagged: how the result itself says that something does not fit.
        unsure: how the result itself says that it knows little.
        coverage: share of intervals that hold; None if there are none.
        gain_errors: error of every gain relative to the common scale, a natural logarithm.
        gain_deviations: its stated standard deviation.
        events: faults found, in words.
        named: of a true fault, whether the first event has its kind and part; None without one.
        figures: anything else worth a look.
    """

    wrong: list[str] = field(default_factory=list)
    flagged: list[str] = field(default_factory=list)
    unsure: list[str] = field(default_factory=list)
    coverage: float | None = None
    gain_errors: list[float] = field(default_factory=list)
    gain_deviations: list[float] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    named: bool | None = None
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def truth(self) -> str:
        """`right` or `wrong`."""
        return WRONG if self.wrong else RIGHT

    @property
    def manner(self) -> str:
        """`flagged`, `unsure` or `confident`, the first that applies."""
        return FLAGGED if self.flagged else UNSURE if self.unsure else CONFIDENT

    def keys(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"truth": self.truth, "manner": self.manner}


def judge_online(
    stated: Stated, system: SecondOrderSystem, effect: str, faults: Sequence[Fault]
) -> Judgement:
    """Judges what a law says at the end of a run.

    Args:
        stated: what it says.
        system: the structure.
        effect: name of the effect.
        faults: of the plant: true ones, or those that stand for sag and drift.
    """
    found = Judgement(events=[event.in_words for event in stated.events])
    if stated.status != "completed":
        found.flagged.append(f"ended early: {stated.status}")
        return found
    found.figures["innovations"] = stated.innovations
    _judge_events(found, stated.events, system, effect, faults)
    found.figures["misfit"] = stated.misfit
    if stated.misfit not in (None, "none"):
        found.flagged.append(f"misfit {stated.misfit}")
    if stated.confidence is None:
        found.unsure.append("no intervals")
        return found
    _judge_intervals(found, stated, system)
    return found


def _judge_intervals(found: Judgement, stated: Stated, system: SecondOrderSystem) -> None:
    confidence, k = stated.confidence, system.space.actuators
    assert confidence is not None
    vague = confidence.below_noise / max(confidence.directions, 1)
    if vague >= VAGUE:
        found.unsure.append(f"{vague:.0%} of the directions as uncertain as the prior")
    found.coverage = confidence.covered
    widths = [confidence.deviation_median, confidence.deviation_largest]
    found.figures |= {"deviation_median": widths[0], "below_noise": vague}
    deviation = np.array([confidence.actuators[system.space.names[i]] for i in k], float)
    if not np.isfinite([*widths, *deviation, found.coverage or 0.0]).all():
        found.wrong.append("an interval is not a number")
        return
    if found.coverage is not None and found.coverage < COVERED:
        found.wrong.append(f"coverage {found.coverage:.2f}")
    if len(k) > 1:
        judge_gains(found, stated.theta[k] / stated.truth[k], deviation)


def judge_gains(found: Judgement, ratio: np.ndarray, deviation: np.ndarray) -> None:
    """Judges gains by their ratios to the true ones (k,) and stated relative deviations (k,).

    A gain that is broken in truth is left out.
    """
    use = np.isfinite(ratio)
    if not (ratio[use] > 0).all():
        found.wrong.append("a gain has the wrong sign")
        return
    error = np.log(ratio[use])
    error = error - error.mean()
    found.gain_errors, found.gain_deviations = error.tolist(), deviation[use].tolist()
    off = np.abs(error) / np.maximum(deviation[use], 1e-12)
    if off.max() > DEVIATIONS:
        found.wrong.append(
            f"a gain off by {100 * abs(error[off.argmax()]):.2g} %, {off.max():.0f} deviations"
        )


def _judge_events(
    found: Judgement,
    events: Sequence[FaultEvent],
    system: SecondOrderSystem,
    effect: str,
    faults: Sequence[Fault],
) -> None:
    """Judges what was named: true faults and fading gains may be, anything else may not."""
    if any(event.kind == "unknown" for event in events):
        found.flagged.append("a change that no single fault explains")
    named = [event for event in events if event.kind not in ("none", "unknown")]
    true = {name for fault in faults for name in _names(fault, system)}
    kind = "payload" if effect == "payload" else "loss"
    false = [e for e in named if e.kind != kind or not set(e.names) & true]
    if effect == "sag":
        false = [event for event in false if event.kind != "several"]
    if effect in FAULTS:
        found.named = bool(named) and named[0] not in false
        if found.named:
            found.figures["size"] = [named[0].size, named[0].low, named[0].high]
    if false:
        found.wrong.append(f"{len(false)} named faults that are not there")
    found.figures |= {"false_faults": len(false), "named_faults": len(named)}


def _names(fault: Fault, system: SecondOrderSystem) -> list[str]:
    return [system.space.names[i] for i in fault.affected(system)]
