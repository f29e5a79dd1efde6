"""An identification as a page, and on the terminal: verdict, predictions, parameters, unknowns."""

from __future__ import annotations

import math
import platform
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console

from ... import __version__
from ...calibration import words
from ...calibration.findings import Finding
from ...calibration.result import Identification, Parameter
from ...evaluation.words import ABSENT, STATUSES, Mark, estimate
from .. import pages
from ..pages import (
    Alarm,
    Badges,
    Cell,
    Figures,
    Fold,
    Items,
    Link,
    Page,
    Section,
    Table,
    Text,
)
from ..terminal import print_page

_OPEN = 12  # parameters in total, up to which no table is collapsed
_LINES, _NOTES, _KINDS = 16, 6, 5  # printed at most; the page has all of them
_SILENT = {
    "not excited": "the motion does not depend on it enough to narrow it",
    "below the noise": "the effect cannot be distinguished from none",
}
_NRMSE = (
    "NRMSE: rms error of the predicted command over the standard deviation of the measured one; 1 "
    "is what predicting the mean has. Held out: fifths of the log, each predicted from the others. "
    "Least squares: weighted least squares on the same rows and columns, held out too. "
)
_CORRELATIONS = (
    "Strong colours: two parameters that the log determines together, so that one known value "
    "narrows the other. Correlations of at least 0.5 are written out."
)


def write_report(result: Identification, folder: Path, command: str = "") -> Path:
    """Writes report.html atomically and returns its path.

    Args:
        result: of an identification.
        folder: an existing folder.
        command: command line that was run, for the page; "" to name model and logs only.
    """
    return pages.write(_page(result, command), folder)


def page(result: Identification, command: str = "") -> str:
    """The report as HTML; see `write_report`."""
    return pages.render(_page(result, command))


def _page(result: Identification, command: str) -> Page:
    from ..drawings import figures_of  # imported late: matplotlib takes half a second
    from . import figures, picture

    row, rows = words.rows_of(result)
    arm, n = row == "joint", len(result.joints)
    sketch = picture.picture(result)
    gains = [p for p in result.parameters if words.is_gain(p)]
    correlations = figures_of(figures.correlations(result))
    notes = _alarms(result.findings, ("note",))
    sections = [
        Section("Does the model explain the log?", [
            _quality(result),
            Text(_NRMSE + ("Columns are kinds of friction; Coulomb friction is tanh(v/s)." * arm),
                 note=True),
        ]),
        Section(f"{'Commands' if arm else 'Forces of the actuators'}, measured and predicted", [
            Figures(figures_of(figures.commands(result)), rows),
            Text(f"Both are low-pass filtered at {words.number(result.cutoff)} Hz like the rows of "
                 f"the fit. Shaded: not used, since the {row} is at rest or an actuator saturated, "
                 "or the data have an outlier or a gap.", note=True),
        ]),
        Section("Validation log", [
            Figures(figures_of(figures.commands(result, validation=True)), rows),
            Text("This log took no part in the fit.", note=True),
        ] if result.validation is not None and len(result.validation.t) else []),
        Section("Actuator gains", [
            Figures(figures_of(figures.forests(result, gains=True))), _parameters(gains, result),
            Text("Lines are 95 % intervals; ◇ is the value before the log.", note=True),
        ] if gains else []),
        Section("Friction, rotors and other forces of the joints" if arm
                else "Drag, damping and other forces",
                _frictions(figures_of(figures.forests(result, gains=False)))),
        Section("What this log cannot tell", _unknown(result)),
        Section("Combinations that the log determines", _combinations(result)),
        Section("All parameters", [
            Badges(_counts(result.parameters)), *_blocks(result),
            Text("Inertias are about the origin of the link's joint frame, in its axes. C1, C2 …: "
                 "the combination above that the log determines instead.", note=True),
        ]),
        Section("Estimates along the log", _some(figures_of(figures.histories(result)))),
        Section(f"Correlations of gains, {'frictions and rotors' if arm else 'drag and damping'}", [
            Figures(correlations), Text(_CORRELATIONS, note=True),
        ] if correlations else []),
        Section("What was done to the log", [
            Items([note.mark.text for note in notes])
        ] if notes else []),
    ]  # fmt: skip
    return Page(
        heading=result.robot.name,
        verdict=verdict_of(result),
        eyebrow="identification from logs",
        lead=f"{n} {row if n == 1 else rows}, {pages.count(len(result.parameters), 'parameter')}; "
        f"{words.logs_in_words(result)}; identified in {result.seconds:.1f} s.",
        tab=f"{result.robot.name} · identification",
        alarms=_alarms(result.findings, ("refusal", "warning")),
        carrying=[*figures_of([figures.joints(result)]), *([sketch] if sketch else [])],
        sections=[section for section in sections if section.panels],
        commands=[command or _command(result)],
        versions={"nsaid-mj": __version__, "Python": platform.python_version()},
    )


def print_identification(
    result: Identification, console: Console, files: Sequence[Path] = ()
) -> None:
    """Prints the verdict, warnings, quality per joint, gains and frictions.

    Args:
        result: of an identification.
        console: to print on.
        files: paths of the files written, which are listed last.
    """
    counts = ", ".join(f"{mark.glyph} {mark.text}" for mark in _counts(result.parameters))
    total = len(result.parameters)
    last = [f"of {pages.count(total, 'parameter')}: {counts}"]
    last += [result.suggestion] if result.suggestion else []
    last.append(f"The scale rests on {result.anchor}.")
    gains = [p for p in result.parameters if words.is_gain(p)]
    print_page(
        Page(
            heading="",
            verdict=verdict_of(result),
            lead=f"{result.robot.name}: {words.logs_in_words(result)}; identified in "
            f"{result.seconds:.1f} s",
            alarms=brief_alarms(result.findings),
            sections=[
                Section("", [_quality(result, brief=True), *_brief_gains(gains), *_kinds(result)]),
                *(Section("", [Text(line)]) for line in last),
            ],
            commands=list(map(str, files)),
        ),
        console,
    )


def verdict_of(result: Identification) -> Mark:
    """The verdict with its mark."""
    return words.EXPLAINS[result.explains]._replace(text=result.verdict)


def brief_alarms(findings: Sequence[Finding]) -> list[Alarm]:
    """Refusals, warnings and the first notes, except those on the choice of columns."""
    notes = [f for f in findings if f.level == "note" and f.code != "columns"]
    shown = [*(f for f in findings if f.level != "note"), *notes[:_NOTES]]
    told = [Alarm(words.LEVELS[f.level]._replace(text=str(f)), "") for f in shown]
    if more := len(notes[_NOTES:]):
        told.append(Alarm(words.LEVELS["note"]._replace(text=f"and {more} more "
                          f"{'note' if more == 1 else 'notes'}"), ""))  # fmt: skip
    return told


def _alarms(findings: Sequence[Finding], levels: Sequence[str]) -> list[Alarm]:
    return [
        Alarm(words.LEVELS[finding.level]._replace(text=str(finding)), finding.level)
        for finding in findings
        if finding.level in levels
    ]


def _status(parameter: Parameter) -> Mark:
    return STATUSES[parameter.status]


def _counts(parameters: Iterable[Parameter]) -> list[Mark]:
    """A badge for each status, with the number of parameters that have it."""
    return [
        STATUSES[status]._replace(text=f"{count} {status}")
        for status, count in words.counts(parameters)
    ]


def _quality(result: Identification, brief: bool = False) -> Table:
    """The prediction's quality and the chosen structure, per joint.

    Args:
        result: of the identification.
        brief: for the terminal, which prints the worst ones of many.
    """
    checked = any(j.validation is not None for j in result.joints)
    heads = ["NRMSE of the command" if brief else words.rows_of(result)[0], "fit", "held out"]
    heads += ["least squares", *["validation", "least squares"] * checked]
    heads += ["delay", "s [rad/s, m/s]", "columns"]
    lines: list[list[Cell]] = []
    kept = list(result.joints)
    if brief and len(kept) > _LINES:
        kept.sort(key=lambda j: -j.held_out if math.isfinite(j.held_out) else -math.inf)
    for j in kept:
        held_out = words.quality(j.held_out)._replace(text=words.nrmse(j.held_out))
        line: list[Cell] = [j.name, words.nrmse(j.fit), held_out, words.nrmse(j.least_squares)]
        if checked:
            line += [words.nrmse(j.validation), words.nrmse(j.validation_least_squares)]
        line += [words.delay(j.delay), words.number(j.friction_speed), ", ".join(j.columns)]
        lines.append(line)
    last = len(heads) - 1
    spare = [last, last - 1, *[5] * checked]
    return Table(heads, lines, (0, last), spare=spare, most=_LINES)


def _brief_gains(gains: Sequence[Parameter]) -> list[Table]:
    """The gains with intervals and statuses; a narrow terminal leaves two columns out."""
    names = [words.of_joint(p) for p in gains]
    names = names if len(set(names)) == len(names) else [p.label for p in gains]
    lines: list[list[Cell]] = []
    for name, p in zip(names, gains, strict=True):
        value, interval = estimate(p.value, p.low, p.high)
        interval = ABSENT if p.status == "known" else interval
        lines.append([name, value, interval, words.relative(p), words.number(p.prior), p.unit,
                      _status(p)])  # fmt: skip
    heads = ["gains", "estimate", "95 % interval", "relative", "before", "unit", "status"]
    return [Table(heads, lines, (0, 5, 6), spare=(4, 3), most=_LINES)] if gains else []


def _kinds(result: Identification) -> list[pages.Panel]:
    """Friction and rotor inertia, one line for each joint, one column for each kind."""
    inertial, names = words.links(result.parameters), [j.name for j in result.joints]
    kinds: dict[str, dict[str, Parameter]] = {}
    for p in result.parameters:
        if p.block not in inertial and not words.is_gain(p) and words.of_joint(p) in names:
            unit = f" [{p.unit}]" if p.unit else ""
            head = p.block.replace(" friction", "").replace("-dependent", "")
            kinds.setdefault(head + unit, {})[words.of_joint(p)] = p
    if not kinds:
        return []
    lines: list[list[Cell]] = []
    for name in names:
        cells: list[Cell] = [name]
        for members in kinds.values():
            p = members.get(name)
            value = "" if p is None else estimate(p.value, p.low, p.high)[0]
            told = p is None or p.status in {"identified", "known"}
            cells.append(value if told else Mark("", "weak", f"({value})"))
        lines.append(cells)
    heads = [head.replace(" [", "\n[") for head in kinds]
    spare = range(len(kinds), 2, -1)
    table = Table(["friction", *heads], lines, spare=tuple(spare), most=_LINES)
    return [table, Text("  (in brackets: not identified by itself; all are in the report)")]


def _parameters(parameters: Sequence[Parameter], result: Identification) -> Table:
    """Parameters with intervals; combinations are referred to by their numbers."""
    known = [c.words for c in result.combinations]
    lines: list[list[Cell]] = []
    for p in parameters:
        value, interval = estimate(p.value, p.low, p.high)
        number = known.index(p.combination) + 1 if p.combination in known else 0
        status: list[Mark | Link | str] = [_status(p)]
        if number:
            status.append(Link(f"C{number}", f"combination-{number}"))
        apart = f"{words.relative(p)} of the other gains" if p.relative else ""
        if more := "; ".join(filter(None, ("" if number else p.combination, apart))):
            status.append(more)
        interval = ABSENT if p.status == "known" else interval
        lines.append([p.label, value, p.unit, interval, words.number(p.prior), tuple(status)])
    heads = ["parameter", "estimate", "unit", "95 % interval", "before the log", "status"]
    return Table(heads, lines, (0, 2, 5))


def _some(figures: Sequence[pages.Figure]) -> list[pages.Panel]:
    return [Figures(figures)] if figures else []


def _frictions(figures: Sequence[pages.Figure]) -> list[pages.Panel]:
    note = Text("Lines are 95 % intervals; ◇ is the value before the log, a guess from the model "
                "and the motion. The numbers are in the tables below.", note=True)  # fmt: skip
    return [Figures(figures), note] if figures else []


def _unknown(result: Identification) -> list[pages.Panel]:
    """What the log does not tell, what would help, and what fixes the common scale."""
    found: list[pages.Panel] = []
    for status, names in words.unknown_in_words(result):
        found += [Badges([STATUSES[status]]), Text(f"{_SILENT[status].capitalize()}: {names}.")]
    if result.suggestion:
        found += [Text("What would help most", head=True), Text(result.suggestion)]
    return [
        *found,
        Text("What fixes the common scale", head=True),
        Text("A log of commands in unknown units predicts equally well with all inertias, "
             "frictions and gains multiplied by one factor. Here it rests on "
             f"{result.anchor}."),
    ]  # fmt: skip


def _combinations(result: Identification) -> list[pages.Panel]:
    lines = []
    for number, combination in enumerate(result.combinations, 1):
        value, interval = estimate(combination.value, combination.low, combination.high)
        lines.append([f"C{number}", combination.words, value, combination.unit, interval])
    if not lines:
        return []
    heads = ["", "combination", "estimate", "unit", "95 % interval"]
    return [
        Text("The motion reveals these sums, not their terms; gains are taken as given. Any "
             "division among the terms predicts the same commands."),
        Table(heads, lines, (0, 1, 3), ids="combination"),
    ]  # fmt: skip


def _blocks(result: Identification) -> list[Fold]:
    """A table for each block of θ, with the number of parameters of each status."""
    blocks: dict[str, list[Parameter]] = {}
    for parameter in result.parameters:
        blocks.setdefault(parameter.block, []).append(parameter)
    inertial, shown = words.links(result.parameters), len(result.parameters) <= _OPEN
    return [
        Fold(
            words.of_joint(members[0]) if name in inertial else name,
            [_parameters(members, result)],
            _counts(members),
            open=shown,
        )
        for name, members in blocks.items()
    ]


def _command(result: Identification) -> str:
    """Command line with the model and the logs, as far as the result knows them."""
    source = result.robot.source
    model = str(source) if source is not None else result.robot.name
    logs = list(dict.fromkeys(s.source for s in result.recordings.segments))
    return shlex.join(["nsaid", "identify", "--model", model, "--log", *logs])
