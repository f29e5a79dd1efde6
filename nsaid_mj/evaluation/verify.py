"""The paper's statements, judged on one run: which hold, which do not yet, which fail.

A run is finite and a limit is not: of a limit a run can only say how far it has come. What is said
to vanish holds where its last tenth is at most `SETTLED` of its first, fails where it has not
fallen at all, and does not hold yet in between. Statements about every step hold or fail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from ..errors import BadRun
from ..experiment.loop import Run, reopen
from ..experiment.record import Record
from ..identifiers import ConventionalAID
from ..identifiers import Status as Ended
from ..resources import write_json
from .summary import summarize
from .truth import Truth, truth_of

FILE = "verify.json"
SETTLED = 0.1  # of its first size: what is smaller has vanished as far as a run can tell
DRIFT = 1e-4  # of the conserved quantity: a tenth of what ends a run
UNEXCITED = 1e-9  # of a window's excitation, or of ‖θ̂‖: no more than rounding and its propagation
BLIND = 1e-2  # of V(0): a bound on rises beyond which none that matters would be seen
_ROUNDING = 1e-9  # of its first size: what is smaller by less has not fallen
_ROWS = 20  # two to a tenth

Word = Literal["holds", "not yet", "fails", "not applicable"]
_COLOURS = {"holds": "green", "not yet": "yellow", "fails": "red", "not applicable": "dim"}


@dataclass(frozen=True)
class Verdict:
    """What a run says about one statement.

    Attributes:
        statement: its name and equation.
        claim: what it says.
        verdict: `holds`, `not yet`, `fails` or `not applicable`.
        number: the figure that was judged; None where there is none.
        bound: what it was judged against; likewise.
        words: both in words, or why the statement does not apply.
    """

    statement: str
    claim: str
    verdict: Word
    number: float | None
    bound: float | None
    words: str


def verify(run: Run, truth: Truth | None, summary: dict[str, Any] | None = None) -> list[Verdict]:
    """Judges the paper's statements on a run.

    Args:
        run: a run that has ended, however it did.
        truth: of its plant; None leaves the statements about a true θ unjudged.
        summary: of this very run, where there is one; None makes it.

    Raises:
        BadRun: its record is too short to be judged.
    """
    _check_length(run.folder, run.record)
    summary = summary or summarize(run, truth)
    premises = _premises(run, truth, summary)
    excitation = _excitation(run, summary, premises)
    return [
        _lyapunov(run, summary, premises),
        _limit(
            "Theorem 1 (70)",
            "Δv vanishes",
            "rms Δv of a tenth of the run:",
            "velocity_error_rms",
            run,
            summary,
            premises,
        ),
        _conserved(summary),
        _limit(
            "Lemma 1 (74)",
            "W(t, x, v, θ) P̄_⊥ θ̄_P⊥ vanishes",
            "rms W θ̂ of a tenth of the run:",
            "excited_error_rms",
            run,
            summary,
            premises,
        ),
        excitation,
        _convergence(run, summary, premises, excitation),
    ]


def _check_length(folder: Path, record: Record) -> None:
    """Refuses a record that is too short to be judged."""
    if len(record) < _ROWS:
        raise BadRun(
            folder,
            f"its record has {len(record)} rows, {_ROWS} are needed",
            "Run the scenario for longer, or record more rows.",
        )


def _lyapunov(run: Run, summary: dict[str, Any], premises: str) -> Verdict:
    """(69): V falls in every step, but for the error of the integrator."""
    name, claim = "Theorem 1 (69)", "V falls in every step"
    broken = premises or _anchored(run)
    if broken:
        return Verdict(name, claim, "not applicable", None, None, broken)
    count, rise = summary["lyapunov_violations"], summary["lyapunov_largest_rise"]
    bound = summary["lyapunov_bound"]
    if bound > BLIND:
        words = (
            f"the integrator and the memory may be blamed for {bound:.2g} of V(0) in a "
            f"step: too much to judge by; the largest rise is {rise:.2g}"
        )
        return Verdict(name, claim, "not applicable", rise, bound, words)
    words = (
        f"{count} of {len(run.record) - 1} steps rose by more than integrator and memory "
        f"explain; the largest rise is {rise:.2g} of V(0), bound {bound:.2g}"
    )
    return Verdict(name, claim, "fails" if count else "holds", rise, bound, words)


def _conserved(summary: dict[str, Any]) -> Verdict:
    """(30) in (45): the law conserves its quantity whatever the plant and the sensors do."""
    name, claim = "(30) in (45)", "the law's conserved quantity stands"
    drift = summary["conserved_drift"]
    if drift is None:
        return Verdict(name, claim, "not applicable", None, None, "this law conserves nothing")
    words = f"it drifted by {drift:.2g} of itself, bound {DRIFT:g}"
    return Verdict(name, claim, "holds" if drift <= DRIFT else "fails", drift, DRIFT, words)


def _limit(
    name: str,
    claim: str,
    what: str,
    key: str,
    run: Run,
    summary: dict[str, Any],
    premises: str,
) -> Verdict:
    """Something that vanishes: how large it is at last, as a share of what it was at first."""
    broken = premises or _no_way(run, summary)
    if broken:
        return Verdict(name, claim, "not applicable", None, None, broken)
    first, last = summary[f"{key}_initial"], summary[key]
    share = last / first if first else 0.0
    words = f"{what} {first:.2g} at first, {last:.2g} at last: {share:.2g} of it, bound {SETTLED:g}"
    if share <= SETTLED:
        return Verdict(name, claim, "holds", share, SETTLED, words)
    if share < 1 - _ROUNDING:
        return Verdict(name, claim, "not yet", share, SETTLED, words)
    return Verdict(name, claim, "fails", share, SETTLED, words + "; it has not fallen")


def _excitation(run: Run, summary: dict[str, Any], premises: str) -> Verdict:
    """(75): no direction of P_⊥ stays unexcited throughout a window."""
    name, claim, window = "(75)", "every window excites all of P_⊥", run.scenario.pe_window
    if premises:
        return Verdict(name, claim, "not applicable", None, None, premises)
    level, share = summary["pe_level_perp"], summary["pe_share_perp"]
    if share is None:
        words = f"no window of {window:g} s has rows enough: see pe_window"
        return Verdict(name, claim, "not applicable", None, None, words)
    words = (
        f"ε₀ = {level:.2g} N·m·s in the least excited window of {window:g} s, {share:.2g} of "
        f"all that excites it, bound {UNEXCITED:g}"
    )
    return Verdict(name, claim, "holds" if share > UNEXCITED else "fails", share, UNEXCITED, words)


def _convergence(run: Run, summary: dict[str, Any], premises: str, excitation: Verdict) -> Verdict:
    """Theorem 2: with (75), θ̂ → P(θ)."""
    name, claim = "Theorem 2", "θ̂ converges to P(θ)"
    if excitation.verdict != "holds" and not premises:
        unmet = "is not met" if excitation.verdict == "fails" else "no window could judge"
        return Verdict(name, claim, "not applicable", None, None, f"it takes (75), which {unmet}")
    return _limit(name, claim, "‖θ̄_P⊥‖/‖θ̂‖:", "theta_perp_ratio", run, summary, premises)


def _premises(run: Run, truth: Truth | None, summary: dict[str, Any]) -> str:
    """Why Theorems 1 and 2 cannot be held against a true θ; "" where they can."""
    if truth is None:
        return "the true θ is not known"
    if summary["mismatch"]:
        return f"not in the structure: {'; '.join(summary['mismatch'])}"
    if summary["fault"]:
        return f"the true θ has changed: {summary['fault']}"
    if isinstance(run.scenario.identifier, ConventionalAID):
        return "the law holds parameters at their prior, and these are not the true ones"
    return ""


def _anchored(run: Run) -> str:
    """Why V need not fall; "" where it must."""
    if getattr(run.identifiers[""], "anchor", 0.0) > 0:
        return "the anchor pulls towards the prior: docs/theory.md"
    return ""


def _no_way(run: Run, summary: dict[str, Any]) -> str:
    """Why a run can show no way to a limit; "" where it can."""
    if run.ending.status is not Ended.completed:
        return f"the run ended early: {run.ending.status.words}"
    return "θ̂ began in P(θ)" if summary["theta_perp_ratio_initial"] < UNEXCITED else ""


def verify_folder(folder: Path) -> tuple[Run, list[Verdict]]:
    """Judges the statements on a run's folder, from its record alone, and writes verify.json.

    Raises:
        BadRun: the folder has no readable record, or too short a one.
    """
    record = Record.read(folder)
    _check_length(folder, record)
    run = reopen(folder, record)
    verdicts = verify(run, truth_of(run))
    write(run, verdicts)
    return run, verdicts


def document(run: Run, verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """What verify.json holds."""
    return {
        "status": run.ending.status.words,
        "scenario_hash": run.scenario.hash,
        "settled": SETTLED,
        "statements": [asdict(verdict) for verdict in verdicts],
    }


def write(run: Run, verdicts: Sequence[Verdict]) -> None:
    """Writes verify.json into the run's folder, whole or not at all."""
    write_json(run.folder / FILE, document(run, verdicts))


def print_verdicts(name: str, run: Run, verdicts: Sequence[Verdict]) -> None:
    """Prints one verdict for each statement, and why."""
    console, end = Console(highlight=False), float(run.record["t"][-1])
    console.print(f"[bold]{name}[/bold]: {run.ending.status.words}, {end:.4g} s simulated")
    for v in verdicts:
        colour = _COLOURS[v.verdict]
        console.print(
            f"  [{colour}]{v.verdict:14}[/{colour}]  {v.statement}: {v.claim}\n"
            f"                  {v.words}",
            soft_wrap=True,
        )
    console.print(f"  verdicts        {run.folder / FILE}")


def failed(verdicts: Sequence[Verdict]) -> bool:
    """Whether any statement fails."""
    return any(verdict.verdict == "fails" for verdict in verdicts)
