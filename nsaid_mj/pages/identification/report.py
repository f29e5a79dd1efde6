"""Page and terminal output of an identification: verdict, predictions, parameters, unknowns."""

import math
import platform
import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ... import __version__
from ...calibration import words
from ...calibration.result import Identification
from ...evaluation.confidence import INTERVAL
from ...evaluation.result import STATUSES, Mark, Parameter, counts
from ...evaluation.words import estimate
from ...parameters import number
from ..page import Badges, Cell, Figure, Figures, Items, Page, Panel, Section, Table, Text, count
from ..panels import COLOURS, AnyPanel, Comparison, Forest, HeatMap, Points
from ..panels import Panel as Plot
from ..parameters import CORRELATIONS, brief_gains, correlations, folds, forests, table

_WIDEST = 2.0  # half-width of a drawn interval, of a gain's logarithm
_LINES = 16  # largest number of printed lines of a table; the page has all of them
_SILENT = {
    "not excited": "the motion does not depend on it enough to narrow it",
    "below the noise": "the effect cannot be distinguished from none",
}
_NRMSE = (
    "NRMSE: rms error of the predicted command over the standard deviation of the measured one; "
    "predicting the mean gives 100 %; without an actuator, rms force over that of inertia and "
    "weight. "
    "Held out: fifths of the log, each predicted from the others. "
    "Least squares: weighted least squares on the same rows and columns, held out too. "
)
_COLUMNS = (
    "Columns are kinds of friction; Coulomb friction is proportional to tanh(velocity / friction "
    "speed)."
)
_FILTERED = (
    "Both are low-pass filtered at {} Hz like the rows of the fit. Shaded: not used, since the {} "
    "is at rest or an actuator saturated, or the data have an outlier or a gap."
)
_FRAMES = (
    "Inertias are about the origin of the link's joint frame, in its axes. C1, C2 …: the "
    "combination above that the log determines instead."
)


def page(result: Identification, command: str = "") -> Page:
    """The page of an identification; without a `command` line it names model and logs only."""
    from ..drawings import figures_of  # imported late: matplotlib takes half a second
    from . import picture

    row, rows = words.rows_of(result)
    arm, n = row == "joint", len(result.joints)
    drawn = [sketch] if (sketch := picture.picture(result)) else []
    gains, bodies = result.gains, result.bodies
    others = [p for p in result.parameters if p.block not in bodies and not p.is_gain]
    correlated = figures_of(_correlated(result))
    numbers = {c.words: k for k, c in enumerate(result.combinations, 1)}
    notes = [str(finding) for finding in result.findings if finding.level == "note"]
    sections = [
        Section("Does the model explain the log?", [
            _quality(result),
            Text(f"{_NRMSE}{_COLUMNS if arm else ''}", note=True),
        ]),
        Section(f"{'Commands' if arm else 'Forces of the actuators'}, measured and predicted", [
            Figures(figures_of(_commands(result)), rows),
            Text(_FILTERED.format(number(result.cutoff), row), note=True),
        ]),
        Section("Validation log", [
            Figures(figures_of(_commands(result, validation=True)), rows),
            Text("This log took no part in the fit.", note=True),
        ] if result.validation is not None and len(result.validation.t) else []),
        Section("Actuator gains", [
            Figures(figures_of(forests(gains))), table(gains, numbers),
            Text("Lines are 95 % intervals; ◇ is the prior, the value before the log; relative: of "
                 "the ratio to the other gains.", note=True),
        ] if gains else []),
        Section("Friction, rotors and other forces of the joints" if arm
                else "Drag, damping and other forces",
                _frictions(figures_of(forests(others)))),
        Section("What this log does not determine", _unknown(result)),
        Section("Combinations that the log determines", _combinations(result)),
        Section("All other parameters" if gains else "All parameters", [
            Badges(counts(p for p in result.parameters if not p.is_gain)),
            *folds(result, numbers, gains=False), Text(_FRAMES, note=True),
        ]),
        Section(f"Law {result.law.name} along the log" if result.law else "",
                _law(result, figures_of(_histories(result)))),
        Section(f"Correlations of gains, {'frictions and rotors' if arm else 'drag and damping'}", [
            Figures(correlated), Text(CORRELATIONS, note=True),
        ] if correlated else []),
        Section("How the log was processed", [Items(notes)] if notes else []),
    ]  # fmt: skip
    return Page(
        heading=result.robot.name,
        verdict=result.mark,
        eyebrow="identification from logs",
        lead=f"{n} {row if n == 1 else rows}, {count(len(result.parameters), 'parameter')}; "
        f"{words.logs_in_words(result)}; identified in {result.seconds:.1f} s.",
        tab=f"{result.robot.name} · identification",
        findings=[finding for finding in result.findings if finding.level != "note"],
        carrying=[*figures_of([_errors(result)], len(drawn)), *drawn],
        sections=[section for section in sections if section.panels],
        commands=[command or _command(result)],
        versions={"nsaid-mj": __version__, "Python": platform.python_version()},
    )


def brief(result: Identification, files: Sequence[Path] = ()) -> Page:
    """The page for terminal and recording: warnings, quality per joint, gains and frictions.

    The paths of the written `files` come last.
    """
    total = count(len(result.parameters), "parameter")
    statuses = ", ".join(f"{mark.glyph} {mark.text}" for mark in counts(result.parameters))
    last = [f"of {total}: {statuses}"]
    last += [result.suggestion] if result.suggestion else []
    last.append(f"The scale rests on {result.anchor}.")
    return Page(
        heading=result.robot.name,
        verdict=result.mark,
        lead=f"{words.logs_in_words(result)}; identified in {result.seconds:.1f} s",
        findings=[finding for finding in result.findings if finding.code != "columns"],
        sections=[
            Section("", [_quality(result, brief=True), *brief_gains(result), *_kinds(result)]),
            Section("", _law_tables(result)),
            *(Section("", [Text(line)]) for line in last),
        ],
        commands=list(map(str, files)),
    )


def _quality(result: Identification, brief: bool = False) -> Table:
    """The prediction's quality and the chosen structure, per joint; `brief` for the worst only."""
    checked = any(j.validation is not None for j in result.joints)
    heads = ["NRMSE of the command" if brief else words.rows_of(result)[0], "fit", "held out"]
    heads += ["least squares", *["validation", "least squares"] * checked]
    units = ", ".join(f"{unit}/s" for unit in dict.fromkeys(result.robot.units))
    heads += ["delay", f"friction speed [{units}]", "columns"]
    lines: list[list[Cell]] = []
    kept = list(result.joints)
    if brief and len(kept) > _LINES:
        kept.sort(key=lambda j: -j.held_out if math.isfinite(j.held_out) else -math.inf)
    for j in kept:
        line: list[Cell] = [j.name, words.nrmse(j.fit), words.quality(j.held_out)]
        line.append(words.nrmse(j.least_squares))
        if checked:
            line += [words.nrmse(j.validation), words.nrmse(j.validation_least_squares)]
        line += [f"{number(1e3 * j.delay, 0.1)} ms", number(j.friction_speed), ", ".join(j.columns)]
        lines.append(line)
    last = len(heads) - 1
    spare = [last, last - 1, *[5] * checked]
    return Table(heads, lines, (0, last), spare=spare, most=_LINES).without_empty_columns()


def _kinds(result: Identification) -> list[Panel]:
    """Friction and rotor inertia, one line for each joint, one column for each kind."""
    names = [j.name for j in result.joints]
    kinds: dict[str, dict[str, Parameter]] = {}
    for p in result.parameters:
        if p.block not in result.bodies and not p.is_gain and p.part in names:
            unit = f" [{p.unit}]" if p.unit else ""
            head = p.block.replace(" friction", "").replace("-dependent", "")
            kinds.setdefault(head + unit, {})[p.part] = p
    if not kinds:
        return []
    lines: list[list[Cell]] = []
    for name in names:
        cells: list[Cell] = [name]
        for members in kinds.values():
            p = members.get(name)
            value = "" if p is None else estimate(p.value, p.low, p.high)[0]
            firm = p is None or p.firm
            cells.append(value if firm else Mark("", "weak", f"({value})"))
        lines.append(cells)
    heads = [head.replace(" [", "\n[") for head in kinds]
    spare = range(len(kinds), 2, -1)
    table = Table(["friction", *heads], lines, spare=tuple(spare), most=_LINES)
    return [table, Text("  (in brackets: not identified by itself; all are in the report)")]


def _frictions(figures: Sequence[Figure]) -> list[Panel]:
    note = Text("Lines are 95 % intervals; ◇ is the prior, a guess from the model and the motion. "
                "The numbers are in the tables below.", note=True)  # fmt: skip
    return [Figures(figures), note] if figures else []


def _law(result: Identification, figures: Sequence[Figure]) -> list[Panel]:
    """Gains and predictions of a law that followed the log, beside the batch fit's."""
    along = result.law
    if along is None:
        return []
    note = (
        "The law followed the log once, sample by sample, with columns, delays and prior of the "
        "batch fit. Gains are over their geometric mean, since no motion reveals their scale; they "
        "agree where both intervals meet. NRMSE: the last fifth of the log under the estimate "
        "before it. v̂ − v and all of θ̂ are on the page of the law's own run, "
        f"{along.name}/report.html beside this one."
    )
    return [*_law_tables(result), *([Figures(figures)] if figures else []), Text(note, note=True)]


def _law_tables(result: Identification) -> list[Table]:
    """Gains of a law, and its prediction of the log's last fifth."""
    along = result.law
    if along is None:
        return []
    law, limits = f"law {along.name}", "95 % interval"
    heads = ["gain / mean", law, limits, "batch fit", limits, "agree"]
    gains = []
    if along.gains:
        gains = [Table(heads, words.law_gains(along), (0, 5), spare=(4, 2), most=_LINES)]
    rows = zip(result.joints, along.last, along.batch_last, strict=True)
    lines = [[joint.name, words.nrmse(own), words.nrmse(fit)] for joint, own, fit in rows]
    return [*gains, Table(["NRMSE of the last fifth", law, "batch fit"], lines, most=_LINES)]


def _unknown(result: Identification) -> list[Panel]:
    """Parameters that the log does not determine, the best remedy, and the source of the scale."""
    found: list[Panel] = []
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


def _combinations(result: Identification) -> list[Panel]:
    lines = []
    for k, combination in enumerate(result.combinations, 1):
        value, interval = estimate(combination.value, combination.low, combination.high)
        lines.append([f"C{k}", combination.words, value, combination.unit, interval])
    if not lines:
        return []
    heads = ["", "combination", "estimate", "unit", "95 % interval"]
    return [
        Text("The motion reveals these sums, not their terms; gains are taken as given. Any "
             "division among the terms predicts the same commands."),
        Table(heads, lines, (0, 1, 3), ids="combination"),
    ]  # fmt: skip


def _command(result: Identification) -> str:
    """Command line with the model and the logs, as far as they are in the result."""
    source = result.robot.source
    model = str(source) if source is not None else result.robot.name
    logs = list(dict.fromkeys(s.source for s in result.recordings.segments))
    return shlex.join(["nsaid", "identify", "--model", model, "--log", *logs])


def _commands(result: Identification, validation: bool = False) -> list[AnyPanel]:
    """One figure for each joint: command, measured and predicted, and their difference."""
    curves = result.validation if validation else result.curves
    if curves is None or not len(curves.t):
        return []
    found: list[AnyPanel] = []
    for j, fit in enumerate(result.joints):
        symbol, unit = words.quantity(result, j)
        panel = Comparison(
            words.title_of(fit, validation), symbol, unit, curves.t, curves.measured[:, j],
            curves.predicted[:, j], used=curves.usable[:, j], segment=curves.segment,
        )  # fmt: skip
        found.append(panel)
    return found


def _errors(result: Identification) -> Forest:
    """NRMSE of every joint on a logarithmic axis, beside least squares and the mean."""
    held_out, least_squares, validation = (
        100 * np.array([getattr(j, key) for j in result.joints], dtype=float)
        for key in ("held_out", "least_squares", "validation")
    )
    others = [Points("weighted least squares, held out", least_squares, "|", COLOURS[1])]
    if np.isfinite(validation).any():
        others.append(Points("validation log", validation, "D", COLOURS[3]))
    empty = np.full(len(held_out), np.nan)
    return Forest(
        f"Prediction error per {words.rows_of(result)[0]}",
        "NRMSE of the command (100: predicting the mean) [%]", [j.name for j in result.joints],
        held_out, empty, empty, np.ones(len(held_out), bool), others, "held out", 100.0,
    )  # fmt: skip


def _correlated(result: Identification) -> list[HeatMap]:
    """Correlation of gains, frictions and rotor inertias; empty for fewer than two."""
    bodies, variance = result.bodies, np.diag(result.covariance)
    chosen = [
        k for k, p in enumerate(result.parameters) if p.block not in bodies and variance[k] > 0
    ]
    chosen.sort(key=lambda k: not result.parameters[k].is_gain)
    r = result.covariance[np.ix_(chosen, chosen)]
    deviation = np.sqrt(variance[chosen])
    labels = [result.parameters[k].label for k in chosen]
    return correlations(labels, r / np.outer(deviation, deviation))


def _histories(result: Identification) -> list[AnyPanel]:
    """A law's estimates along the log over the batch fit's: gains, frictions, rotor inertias.

    Gains are over their geometric mean, with intervals.
    """
    along = result.law
    if along is None or len(along.t) < 2:
        return []
    bodies, panels = result.bodies, dict[str, Plot]()
    gains = along.actuators.tolist() if along.gains else []
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = along.theta / result.theta
        common = (
            np.exp(np.mean(np.log(ratios[:, gains]), axis=1)) if gains else np.ones(len(ratios))
        )
    half = INTERVAL * along.deviation
    for k, p in enumerate(result.parameters):
        if p.block in bodies or not result.theta[k] > 0:
            continue
        if k not in gains and not p.firm:
            continue
        label = "over the batch fit [–]"
        panel = panels.setdefault(
            p.block, Plot(p.block[:1].upper() + p.block[1:], label, True, level=1.0)
        )
        name, ratio, band = p.part, ratios[:, k] / common, None
        if k in gains and np.isfinite(half).any():
            factor = np.exp(np.minimum(half[:, gains.index(k)], _WIDEST))
            band = ratio / factor, ratio * factor
        panel.add(along.t, ratio, p.label if p.block.startswith("coupling") else name, band)
    gains_first = sorted(panels, key=lambda block: "gain" not in block)
    return [panels[block] for block in gains_first]
