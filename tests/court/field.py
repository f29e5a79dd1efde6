"""A draw of a user's log, run as its user would, and judged; `scripts/court.py` has the words.

Kinds of `field_causes` are inspected and mended by `--fix`; those of the other files have no single
cause, and are identified as they are.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify.fixing import Fix, fix
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.result import Identification
from nsaid_mj.clinic.logs.mapping import map_of
from nsaid_mj.clinic.logs.recordings import Recordings
from nsaid_mj.clinic.logs.unusable import UnusableLog

from . import (
    field_causes,
    field_commands,
    field_episodes,
    field_phases,
    field_timing,
    field_walking,
)
from .judging import NOT_RUN, Judgement
from .offline import HALF_WIDTHS, LEAST, doubted, judge, judge_ratios

_SAME = 2e-3  # difference, over the size of a signal, at which a mended log is the healthy one
_LATE = 1e-3  # error of a delay from which it can be wrong [s]
_EDGES = 1.0  # of phases that need not be found, or may be left out besides [s]
_KEPT = 0.9  # share of the episodes' motion that must be used


@dataclass
class Tried:
    """What became of a draw.

    Attributes:
        words: what was drawn.
        named: whether the true cause is the first finding; without one, whether none is raised.
        alone: whether it is the only refusal; None without a cause.
        right: whether the remedy, obeyed, ends right; without a cause, whether the result is right;
            None where the log is refused and no line of map.toml is offered.
        confident: whether a result that nothing doubts was given, at any point.
        wrong: what is wrong with such a result.
        said: the first refusal, or the verdict.
        outcome: `judged`, or `not run` of a log that cannot be judged.
    """

    words: str
    named: bool = False
    alone: bool | None = None
    right: bool | None = None
    confident: bool = False
    wrong: list[str] = field(default_factory=list)
    said: str = ""
    outcome: str = "judged"

    def keys(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    def believe(self, found: Judgement) -> None:
        """Takes what is wrong with a result that nothing doubts; a refused log is not `right`."""
        confident = found.manner == "confident"
        self.confident |= confident
        self.wrong += found.wrong if confident else []
        self.right = not found.wrong and not found.figures.get("refused")


# -- one cause ------------------------------------------------------------------------------------


def cause(kind: str, seed: int, folder: Path) -> Tried:
    """A log with one cause, as it is and with the remedy obeyed."""
    drawn = field_causes.draw(seed, kind)
    model, logs, _ = drawn.write(folder)
    robot = load_robot_model(model, drawn.lock, None)
    _, good, _ = drawn.write(folder / "healthy", healthy=True)
    given = fix(good, drawn.map, robot).before
    tried = Tried(f"{drawn.simulated.case.robot}: {drawn.words or 'healthy'}")
    if (raised := refusals(given.findings)) and drawn.codes:  # counted where nothing is changed
        tried.said = str(raised[0])
        tried.outcome = NOT_RUN
        return tried
    found = fix(logs, drawn.map, robot)
    judge_cause(tried, found, drawn.codes, drawn.where)
    run = partial(_judged, model, drawn)
    if not refusals(found.before.findings):
        tried.believe(run(logs, drawn.map))
        tried.confident &= not (drawn.codes and tried.named)  # the result is doubted by its cause
    elif found.kept:
        if same(found.after.recordings, given.recordings):
            tried.right = True
        else:
            tried.believe(run(logs, found.text))
    elif found.changes:
        tried.right = False
    return tried


def judge_cause(tried: Tried, found: Fix, codes: Sequence[str], where: Sequence[str]) -> None:
    """Whether a log's findings name the true cause first, and alone."""
    raised = refusals(found.before.findings)
    if not raised and codes:  # what the log cannot tell may be said so
        raised = [finding for finding in found.before.findings if finding.code in codes]
    tried.said = str(raised[0]) if raised else "no refusal"
    tried.named = not raised
    if codes:
        text = f"{tried.said} {raised[0].remedy}" if raised else ""
        tried.named = bool(raised) and raised[0].code in codes and all(x in text for x in where)
        tried.alone = len(raised) == 1


def refusals(findings: Sequence[Finding]) -> list[Finding]:
    """The findings at which `identify` stops."""
    return [finding for finding in findings if finding.level == "refusal"]


def same(one: Recordings | None, other: Recordings | None) -> bool:
    """Whether two recordings are one log."""
    if one is None or other is None or len(one.segments) != len(other.segments):
        return False
    for a, b in zip(one.segments, other.segments, strict=True):
        for x, y in zip(a.log[1:], b.log[1:], strict=True):
            if x.shape != y.shape or np.abs(x - y).max() > _SAME * np.abs(y).max():
                return False
        if abs(np.ptp(a.log.t) - np.ptp(b.log.t)) > _SAME * np.ptp(b.log.t):
            return False
    return True


def _judged(model: str, drawn: field_causes.Drawn, logs: Sequence[Path], text: str) -> Judgement:
    mapping = map_of(tomllib.loads(text)) if text else None
    try:
        found = identify_forces(model, logs, mapping=mapping, lock=drawn.lock)
    except UnusableLog as error:
        return _refused(error)
    return judge(found, drawn.simulated, np.ones(drawn.simulated.setup.system.n_u))


def _refused(error: UnusableLog) -> Judgement:
    said = [str(finding) for finding in refusals(error.findings)]
    return Judgement(flagged=said, figures={"refused": True})


# -- no cause, identified as they are -------------------------------------------------------------


def numbers(found: Identification, truth: dict[str, float]) -> Judgement:
    """Judges identified parameters and ratios of gains by true values under names or labels."""
    said = Judgement(figures={"explains": found.explains})
    said.flagged += [f"the verdict is {found.explains}"] if doubted(found) else []
    known = {
        p.name: truth[key] for p in found.parameters for key in (p.label, p.name) if key in truth
    }
    for p in found.parameters:
        if p.status != "identified" or p.name not in known:
            continue
        true = known[p.name]
        like = [
            abs(known[o.name]) for o in found.parameters if o.name in known and o.unit == p.unit
        ]
        size = max(like) if p.name.startswith(("h", "I", "m_c")) else abs(true)
        half = p.high - p.value if true > p.value else p.value - p.low
        if not np.isfinite([p.value, p.low, p.high]).all():
            said.wrong.append(f"the interval of {p.name} is not a number")
        elif abs(p.value - true) > max(HALF_WIDTHS * half, LEAST * size):
            said.wrong.append(
                f"{p.name} {p.value:.3g} ({p.low:.3g} … {p.high:.3g}), truly {true:.3g}"
            )
    gains = [p for p in found.parameters if p.relative is not None and p.name in known]
    judge_ratios(said, gains, np.array([known[p.name] for p in gains]))
    return said


def identified(
    words: str,
    truth: dict[str, float],
    run: Callable[[], Identification],
    named: Callable[[Identification], bool],
) -> Tried:
    """A log without a cause of refusal; `named` says whether what is special of it is found."""
    tried = Tried(words)
    try:
        found = run()
    except UnusableLog as error:
        raised = refusals(error.findings)
        tried.said = str(raised[0])
        return tried
    tried.said = found.verdict
    tried.named = named(found)
    tried.believe(numbers(found, truth))
    return tried


def phase(kind: str, seed: int, folder: Path) -> Tried:
    """A log with phases in which the structure does not hold."""
    drawn = field_phases.draw(seed, folder, kind)

    def named(found: Identification) -> bool:
        missed = 0.0
        for segment in found.recordings.segments:
            t = segment.log.t[segment.usable.any(axis=1)]
            inside = np.zeros(len(t), dtype=bool)
            for start, end in drawn.out:
                inside |= (t > start) & (t < end)
            missed += float(inside.sum()) / found.recordings.rate
        good = drawn.total - sum(end - start for start, end in drawn.out)
        out = [phase for phase in found.recordings.phases if not phase.used]
        lost = sum(phase.seconds for phase in out) - (drawn.total - good)
        return missed <= _EDGES and lost <= _EDGES + 0.05 * good

    run = partial(identify_forces, drawn.model, drawn.log, lock=drawn.lock)
    return identified(f"{drawn.model}: {kind}", drawn.truth, run, named)


def delay(seed: int, folder: Path) -> Tried:
    """An arm whose commands act late, with friction that falls with speed, at a drawn rate."""
    rate = float(np.random.default_rng([seed, 5]).choice([50.0, 100.0, 125.0, 250.0, 500.0]))
    drawn = field_timing.draw(seed, rate)
    told: list[field_timing.Judged] = []

    def named(found: Identification) -> bool:
        told.append(field_timing.judge(found, drawn))
        return bool(np.abs(told[0].delays - drawn.delay).max() < _LATE)

    words = f"{drawn.robot}: {1e3 * drawn.delay:.1f} ms at {rate:g} Hz"
    run = partial(field_timing.identified, drawn)
    tried = identified(words, drawn.truth, run, named)
    if told and tried.confident and abs(told[0].error) > _LATE and not told[0].covered:
        tried.wrong.append(f"delay off by {1e3 * told[0].error:.1f} ms")
    return tried


def command(draw: Callable[..., field_commands.Drawn], code: str, seed: int, folder: Path) -> Tried:
    """Commands that people have; `code` is that of the finding that must be there, "" for none."""
    drawn = draw(seed, folder)

    def named(found: Identification) -> bool:
        return not code or code in {finding.code for finding in found.findings}

    run = partial(identify_forces, str(drawn.model), drawn.logs, mapping=drawn.map)
    return identified(f"{drawn.model.stem}", drawn.truth, run, named)


def walking(kind: str, seed: int, folder: Path) -> Tried:
    """A robot that walks: what is wrong is named and mended, and the result holds."""
    drawn = field_walking.draw(seed, folder, kind)
    robot = load_robot_model(str(drawn.model))
    tried = Tried(drawn.words)

    def run(log: Path, text: str) -> Judgement:
        mapping = map_of(tomllib.loads(text)) if text else None
        known = {"mass": drawn.mass}
        try:
            found = identify_forces(str(drawn.model), log, mapping=mapping, known=known)
        except UnusableLog as error:
            return _refused(error)
        return numbers(found, drawn.truth)

    found = fix([drawn.log], "", robot)
    judge_cause(tried, found, drawn.codes, ())
    if not refusals(found.before.findings):
        tried.believe(run(drawn.log, ""))
    elif found.kept:
        tried.believe(run(drawn.log, found.text))
    elif found.changes:
        tried.right = False
    return tried


def episodes(seed: int, folder: Path) -> Tried:
    """Short episodes, in one file or in many."""
    drawn = field_episodes.draw(seed, folder)

    def named(found: Identification) -> bool:
        phases = [phase for phase in found.recordings.phases if phase.used]
        return sum(phase.seconds for phase in phases) > _KEPT * drawn.seconds

    run = partial(identify_forces, drawn.robot, drawn.logs)
    return identified(drawn.words, drawn.truth, run, named)


KINDS: dict[str, Callable[[int, Path], Tried]] = {
    **{kind: partial(cause, kind) for kind in field_causes.KINDS},
    **{f"phases: {kind}": partial(phase, kind) for kind in field_phases.KINDS},
    "PD law": partial(command, field_commands.draw_pd, ""),
    "constant command": partial(command, field_commands.draw_constant, "constant_command"),
    "coupled joints": partial(command, field_commands.draw_coupled, ""),
    "thruster curves": partial(command, field_commands.draw_curve, ""),
    "delay, friction, rate": delay,
    "episodes": episodes,
    **{kind: partial(walking, kind) for kind in field_walking.KINDS},
}
"""What is drawn from a seed and tried in a folder, by name."""
