"""Checks the paper's statements on one run: each holds, does not hold yet, or fails.

A finite run cannot prove a limit; it only shows how far the quantity has decayed. A quantity that
must vanish *holds* if its rms over the last tenth of the run is at most `SETTLED` of that over the
first tenth, *fails* if it has not decayed at all, and is *not yet* settled in between. Statements
about every time step either hold or fail.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ...base import BadRun, OutputFile, single_threaded
from ...core import ConventionalAID, NullspaceIdentifier, number, rounded
from ...core import Status as Ended
from ...report import Explains, Items, Mark, Page, PageItem, Result, Section, Table
from ..loop import Run, reopen
from ..record import Record
from .run_evaluation import evaluate
from .run_result import RunResult
from .statistics import Accuracy, Theory
from .truth import Truth

VERIFY_FILE = "verify.json"
SETTLED = 0.1  # last value over first, below which a quantity counts as vanished
DRIFT = 1e-4  # relative drift of the conserved quantity; a tenth of what ends a run
UNEXCITED = 1e-9  # of a window's excitation, or of ‖θ̂‖; rounding error and its propagation
BLIND = 1e-2  # bound on rises, over V(0), above which the test could not see a relevant rise
_ROUNDING = 1e-9  # relative decrease that does not count as decay
ROWS = 20
"""Minimum length of a record: two rows in a tenth."""


Word = Literal["holds", "not yet", "fails", "not applicable"]
_HOLD = ("hold", "holds")  # of several, and of one
_FAIL = ("fail", "fails")


@dataclass(frozen=True)
class StatementVerdict:
    """The outcome of checking one statement."""

    statement: str  # name and equation of the statement
    claim: str  # the statement in words
    verdict: Word  # `holds`, `not yet`, `fails` or `not applicable`
    number: float | None  # the figure that was compared with the bound; None if there is none
    bound: float | None  # the largest or smallest admissible figure; None if there is none
    words: str  # figure and bound in words, or why the statement does not apply


@dataclass(frozen=True, kw_only=True)
class Verification(Result):
    """The result of a check of the paper's statements on a run.

    Attributes:
        statements: the statements with their verdicts.
        status: how the run ended, in words.
        end: time of its last row [s].
        scenario_hash: digest of its scenario.
        file: path of verify.json.
    """

    statements: tuple[StatementVerdict, ...]
    status: str
    end: float
    scenario_hash: str
    file: Path

    def document(self) -> dict[str, Any]:
        """The content of verify.json."""
        return {
            "status": self.status,
            "scenario_hash": self.scenario_hash,
            "settled": SETTLED,
            "statements": [asdict(verdict) for verdict in self.statements],
        }

    def write(self) -> None:
        """Writes verify.json into the run's folder, atomically."""
        OutputFile(self.file).write_json(self.document())

    def items(self) -> list[PageItem]:
        """The statements with their verdicts, then those that do not apply, by reason."""
        kinds = {"holds": ("✔", "good"), "not yet": ("◐", "fair"), "fails": ("✘", "poor")}
        lines = []
        apart = dict[str, list[str]]()
        for v in self.statements:
            if v.verdict in kinds:
                lines.append([v.statement, v.claim, Mark(*kinds[v.verdict], v.verdict), v.words])
            else:
                apart.setdefault(v.words, []).append(f"{v.statement}: {v.claim}")
        heads = ["statement", "claim", "verdict", "figure"]
        reasons = [(f"Not applicable: {why}", f"{'; '.join(said)}.") for why, said in apart.items()]
        return [
            *([Table(heads, lines, (0, 1, 2, 3))] if lines else []),
            *([Items(reasons)] if reasons else []),
        ]

    def page(self, name: str) -> Page:
        """The page of the check, for the terminal."""
        lines = [
            f"{v.verdict:15} {v.statement}: {v.claim}\n{' ' * 20}{v.words}" for v in self.statements
        ]
        return Page(
            heading=name,
            result=self,
            lead=f"{self.status}, {self.end:.4g} s simulated",
            sections=[Section("", [Items(lines)], brief=True)],
        )

    @staticmethod
    @single_threaded
    def of_run(run: Run, truth: Truth | None, result: RunResult | None = None) -> Verification:
        """Checks the paper's statements on a finished run, completed or not.

        Without the truth of its plant, statements about the true θ are not applicable. `result` is
        what `evaluate` makes of the run, if that is known.

        Raises:
            BadRun: the record is too short.
        """
        return _verified(run, truth, result)

    @staticmethod
    @single_threaded
    def of_folder(folder: Path) -> Verification:
        """Checks the statements on a run's folder, from its record alone, and writes verify.json.

        Raises:
            BadRun: the folder has no readable record, or the record is too short.
        """
        record = Record.read(folder)
        _check_length(folder, record)
        run = reopen(folder, record)
        try:
            found = _verified(run, Truth.of(run), None)
        except np.linalg.LinAlgError as error:
            raise BadRun(folder, "its record is damaged", "Run the scenario again") from error
        found.write()
        return found


_Outcome = tuple[Word, float | None, float | None, str]
"""Verdict, figure, bound and words of a `StatementVerdict`."""


def _no(why: str) -> _Outcome:
    """The outcome of a statement that does not apply."""
    return "not applicable", None, None, why


def _verified(run: Run, truth: Truth | None, result: RunResult | None) -> Verification:
    """See `Verification.of`."""
    _check_length(run.folder, run.record)
    result = result or evaluate(run, truth)
    premises = _premises(run, result)
    excited = _excitation(run, result, premises)
    no_limit = premises or _no_limit(run, result)
    accuracy = result.accuracy
    motion = result.excitation
    velocity_errors = motion.velocity_error_rms_initial, accuracy.velocity_error_rms
    excited_errors = motion.excited_error_rms_initial, motion.excited_error_rms
    dv, force = (f"rms of {of} over a tenth of the run:" for of in ("Δv", "W θ̂"))
    outcomes: dict[tuple[str, str], _Outcome] = {
        ("Theorem 1 (69)", "V decreases in every time step"): _lyapunov(run, result, premises),
        ("Theorem 1 (70)", "Δv vanishes"): _limit(dv, *velocity_errors, no_limit),
        ("(30) in (45)", "the law's conserved quantity is constant"): _conserved(result.theory),
        ("Lemma 1 (74)", "W(t, x, v, θ) P̄_⊥ θ̄_P⊥ vanishes"): _limit(
            force, *excited_errors, no_limit
        ),
        ("(75)", "every window excites all of P_⊥"): excited,
        ("Theorem 2", "θ̂ converges to P(θ)"): _convergence(
            accuracy, premises, no_limit, excited[0]
        ),
    }
    statements = tuple(StatementVerdict(*what, *outcome) for what, outcome in outcomes.items())
    return verification_of(run, statements)


def verification_of(run: Run, statements: tuple[StatementVerdict, ...]) -> Verification:
    """The result of a check: whether the statements that apply hold; without a verdict if none."""
    counts = Counter(verdict.verdict for verdict in statements)
    apply = len(statements) - counts["not applicable"]
    said = [f"{counts['holds']} of the {apply} statements that apply {_HOLD[counts['holds'] == 1]}"]
    said += [f"{counts['not yet']} not yet"] * bool(counts["not yet"])
    said += [f"{counts['fails']} {_FAIL[counts['fails'] == 1]}"] * bool(counts["fails"])
    settled: Explains = "partly" if counts["not yet"] else "yes"
    return Verification(
        explains=("no" if counts["fails"] else settled) if apply else None,
        verdict=f"{', '.join(said)}.",
        statements=statements,
        status=run.ending.status.words,
        end=float(run.record["t"][-1]),
        scenario_hash=run.scenario.hash,
        file=run.folder / VERIFY_FILE,
    )


def _check_length(folder: Path, record: Record) -> None:
    """Raises BadRun if a record is too short to be checked."""
    if len(record) < ROWS:
        raise BadRun(
            folder,
            f"its record has {len(record)} rows, {ROWS} are needed",
            "Run the scenario for longer, or record more rows.",
        )


def _lyapunov(run: Run, result: RunResult, premises: str) -> _Outcome:
    """(69): V decreases in every time step, up to the integration error."""
    if not isinstance(run.identifiers[""], NullspaceIdentifier):
        return _no("this law is not (44, 45); the theorem does not apply")
    if premises:
        return _no(premises)
    theory = result.theory
    count = theory.lyapunov_violations
    rise = theory.lyapunov_largest_rise
    bound = theory.lyapunov_bound
    if count is None or rise is None or bound is None:
        return _no("V is not defined")
    if bound > BLIND:
        words = (
            f"integrator and memory may raise V by up to {rounded(bound, 2)} of V(0) in a time "
            f"step, too much for a check; the largest rise is {rounded(rise, 2)}"
        )
        return "not applicable", rise, bound, words
    words = (
        f"V rose in {count} of {len(run.record) - 1} time steps by more than integrator and memory "
        f"explain; the largest rise is {rounded(rise, 2)} of V(0), bound {rounded(bound, 2)}"
    )
    return "fails" if count else "holds", rise, bound, words


def _conserved(theory: Theory) -> _Outcome:
    """(30) in (45): the law conserves θ̂ᵀ Γ⁻¹ θ̂ for any plant and any sensors."""
    drift = theory.conserved_drift
    if drift is None:
        return _no("this law conserves nothing")
    words = f"relative drift {rounded(drift, 2)}, bound {number(DRIFT)}"
    return "holds" if drift <= DRIFT else "fails", drift, DRIFT, words


def _limit(what: str, first: float | None, last: float | None, broken: str) -> _Outcome:
    """A quantity that must vanish: its value at the end of the run over that at the start.

    `broken` is why the run cannot show that; empty if it can.
    """
    if broken:
        return _no(broken)
    if first is None or last is None:
        return _no("the quantity is not defined")
    share = last / first if first else 0.0
    words = (
        f"{what} {rounded(first, 2)} at the start, {rounded(last, 2)} at the end; "
        f"ratio {rounded(share, 2)}, bound {SETTLED:g}"
    )
    if not share < 1 - _ROUNDING:
        return "fails", share, SETTLED, words + "; no decay"
    word: Word = "holds" if share <= SETTLED else "not yet"
    return word, share, SETTLED, words


def _excitation(run: Run, result: RunResult, premises: str) -> _Outcome:
    """(75): every window excites every direction of P_⊥."""
    window = run.scenario.pe_window
    if premises:
        return _no(premises)
    level = result.excitation.pe_level_perp
    share = result.excitation.pe_share_perp
    if level is None or share is None:
        return _no(f"no window of {window:g} s has enough rows; see pe_window")
    bound = _least_seen(run)
    words = (
        f"ε₀ = {rounded(level, 2)} N·m·s in the least excited window of {window:g} s, "
        f"{rounded(share, 2)} of its total excitation, bound {rounded(bound, 2)}: what the "
        "noise of the scenario's sensors would hide"
    )
    if share <= UNEXCITED:
        return "fails", share, UNEXCITED, words
    return "holds" if share > bound else "not yet", share, bound, words


def _least_seen(run: Run) -> float:
    """The smallest share of a window's excitation that the scenario's noisy sensors would show.

    A direction that makes this share of the force makes this share of the motion. Beside it is the
    noise of velocities relative to the motion's rms velocity, averaged over the window's samples.
    """
    scenario = run.scenario
    v = run.record["v"]
    samples = max(1.0, scenario.pe_window / scenario.dt)
    size = max(float(np.sqrt(np.mean(v * v))), np.finfo(float).tiny)
    return min(1.0, max(UNEXCITED, scenario.noise.velocity / size / samples**0.5))


def _convergence(accuracy: Accuracy, premises: str, no_limit: str, excited: Word) -> _Outcome:
    """Theorem 2: with (75), at a level however small, θ̂ → P(θ)."""
    if excited not in ("holds", "not yet") and not premises:
        unmet = "is not met" if excited == "fails" else "no window could be checked for"
        return _no(f"it needs (75), which {unmet}")
    first = accuracy.theta_perp_ratio_initial
    last = accuracy.theta_perp_ratio
    return _limit("‖θ̄_P⊥‖/‖θ̂‖:", first, last, no_limit)


def _premises(run: Run, result: RunResult) -> str:
    """Why the premises of Theorems 1 and 2 are not met; empty if they are."""
    conditions = result.conditions
    if not result.truth_known:
        return "the true θ is not known"
    if conditions.mismatch:
        return f"not in the structure: {'; '.join(conditions.mismatch)}"
    if conditions.sensor_noise:
        return f"the measurements are not exact: sensor {conditions.sensor_noise}"
    if conditions.fault:
        return f"the true θ has changed: {conditions.fault}"
    if isinstance(run.scenario.identifier, ConventionalAID):
        return "the law holds parameters at their prior values, which are not the true ones"
    return ""


def _no_limit(run: Run, result: RunResult) -> str:
    """Why a run cannot show convergence; empty if it can."""
    if run.ending.status is not Ended.completed:
        return f"the run ended early: {run.ending.status.words}"
    first = result.accuracy.theta_perp_ratio_initial
    return "θ̂ started in P(θ)" if first is not None and first < UNEXCITED else ""
