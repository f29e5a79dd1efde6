"""The page of an identification: verdict, predictions, parameters, unknowns."""

import math
import platform
import shlex
from collections.abc import Sequence

import numpy as np

from ... import __version__
from ...core import number
from ...report import (
    Badges,
    Cell,
    Comparison,
    Figure,
    Figures,
    HeatMap,
    Mark,
    Page,
    PageItem,
    Parameter,
    ParameterTables,
    Section,
    Table,
    Text,
    count,
    estimate,
    figures_of,
)
from ...report import Panel as Curves
from ..logs.recordings import Recordings
from . import wording
from .curves import with_curves
from .result import Identification, JointStructure

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
_SWING = (
    " Rows of a leg's joints are those of its swing; their errors are relative to the command "
    "along the whole log. Where they are large beside the small commands of swing, a joint has no "
    "mark: what its motor does in stance is judged by the rows of the base."
)
_FILTERED = (
    "Both are low-pass filtered at {} Hz like the rows of the fit. Shaded: not used, since the {} "
    "is at rest or an actuator saturated, or the data have an outlier or a gap."
)
_FRAMES = (
    "Inertias are about the origin of the link's joint frame, in its axes. C1, C2 …: the "
    "combination above that the log determines instead."
)


def identification_page(result: Identification, command: str = "") -> Page:
    """The page of an identification; without a `command` line it names model and logs only."""
    from . import picture

    row, rows = wording.rows_of(result)
    n = len(result.joints)
    drawn = [sketch] if (sketch := picture.picture(result)) else []
    result = with_curves(result)
    errors, *panels = result.curves
    compared = [panel for panel in panels if isinstance(panel, Comparison)]
    commands = [panel for panel in compared if panel.key[0] != "validation"]
    validation = [panel for panel in compared if panel.key[0] == "validation"]
    histories = [panel for panel in panels if isinstance(panel, Curves) and panel.page]
    filtered = _FILTERED.format(number(result.cutoff), row)
    arm = row == "joint"
    quality, gains, *determined = _sections(result)
    predicted = Section(
        f"{'Commands' if arm else 'Forces of the actuators'}, measured and predicted",
        [Figures(figures_of(commands), rows), Text(filtered, note=True)],
    )
    checked = [
        Figures(figures_of(validation), rows),
        Text("This log took no part in the fit.", note=True),
    ]
    sections = [
        gains,
        quality,
        Section("Phases of the log", phases_table(result.recordings)),
        predicted,
        Section("Validation log", checked if validation else []),
        *determined,
        Section(
            f"Law {result.law.name} along the log" if result.law else "",
            _law(result, figures_of(histories)),
            brief=True,
        ),
        Section(
            f"Correlations of gains, {'frictions and rotors' if arm else 'drag and damping'}",
            _correlations(result),
        ),
    ]
    return Page(
        heading=result.robot.name,
        result=result,
        eyebrow="identification from logs",
        lead=f"{n} {row if n == 1 else rows}, {count(len(result.parameters), 'parameter')}; "
        f"{wording.logs_in_words(result)}; identified in {result.seconds:.1f} s.",
        tab=f"{result.robot.name} · identification",
        carrying=[*figures_of([errors], len(drawn)), *drawn],
        sections=[section for section in sections if section.panels],
        commands=[command or _command(result)],
        versions={"nsaid-mj": __version__, "Python": platform.python_version()},
    )


def phases_table(recordings: Recordings) -> list[PageItem]:
    """The phases of the logs, and why some take no part in the fit; none if all do in one mode."""
    found = recordings.phases
    if all(phase.used and len(phase.own_modes) < 2 for phase in found):
        return []
    lines: list[list[Cell]] = [list(phase.row) for phase in found]
    return [Table(("log", "time", "phase", "in the fit"), lines, (0, 2, 3), most=_LINES)]


def _sections(result: Identification) -> list[Section]:
    """What the log determines of each parameter, and what it does not."""
    arm = wording.rows_of(result)[0] == "joint"
    gains = result.gains
    bodies = result.bodies
    others = [p for p in result.parameters if p.block not in bodies and not p.is_gain]
    numbers = {c.words: k for k, c in enumerate(result.combinations, 1)}
    tables = ParameterTables(result, numbers)
    return [
        Section(
            "Does the model explain the log?",
            [
                _quality(result),
                Text(
                    f"{_NRMSE}{_COLUMNS if arm else ''}{_SWING if result.robot.floating else ''}",
                    note=True,
                ),
            ],
            brief=True,
        ),
        Section(
            "Actuator gains",
            [
                Figures(figures_of(Parameter.forests(gains))),
                *tables.gains(),
                Text(
                    "Lines are 95 % intervals; ◇ is the prior, the value before the log; "
                    "relative: of the ratio to the other gains.",
                    note=True,
                ),
            ]
            if gains
            else [],
            brief=True,
        ),
        Section(
            "Friction, rotors and other forces of the joints"
            if arm
            else "Drag, damping and other forces",
            [*_frictions(figures_of(Parameter.forests(others))), *_kinds(result)],
            brief=True,
        ),
        Section("What this log does not determine", _unknown(result)),
        Section("Combinations that the log determines", _combinations(result)),
        Section(
            "All other parameters" if gains else "All parameters",
            [
                Badges(Parameter.counted(p for p in result.parameters if not p.is_gain)),
                *tables.folds(gains=False),
                Text(_FRAMES, note=True),
            ],
            brief=True,
        ),
        Section(
            "What would help most",
            [Text(result.suggestion)] if result.suggestion else [],
            brief=True,
        ),
        Section(
            "What fixes the common scale",
            [
                Text(
                    "Scaling all inertias, frictions and gains by one factor does not change the "
                    f"predictions. The scale used here rests on {result.anchor}."
                ),
            ],
            brief=True,
        ),
    ]


def _quality(result: Identification) -> Table:
    """The prediction's quality and the chosen structure, per joint; of many the worst first."""
    checked = any(j.validation is not None for j in result.joints)
    heads = [f"NRMSE by {wording.rows_of(result)[0]}", "fit", "held out"]
    heads += ["least squares", *["validation", "least squares"] * checked]
    units = dict.fromkeys(
        f"{unit}/s"
        for unit, joint in zip(result.robot.units, result.joints, strict=False)
        if math.isfinite(joint.friction_speed)
    )
    heads += ["delay", f"friction speed [{' or '.join(units)}]", "columns"]
    lines: list[list[Cell]] = []
    kept = [j for j in result.joints if j.name not in result.robot.followers]
    if len(kept) > _LINES:
        kept.sort(key=lambda j: -j.held_out if math.isfinite(j.held_out) else -math.inf)
    for j in kept:
        line: list[Cell] = [j.name, wording.nrmse(j.fit), wording.quality(j.held_out, j.alone)]
        line.append(wording.nrmse(j.least_squares))
        if checked:
            line += [wording.nrmse(j.validation), wording.nrmse(j.validation_least_squares)]
        line += [_delay(j), number(j.friction_speed), ", ".join(j.columns)]
        lines.append(line)
    last = len(heads) - 1
    spare = [last, last - 1, *[5] * checked]
    return Table(heads, lines, (0, last), spare=spare, most=_LINES).without_empty_columns()


def _delay(joint: JointStructure) -> str:
    """A delay with its 95 % interval, in milliseconds."""
    words = f"{number(1e3 * joint.delay, 0.1)} ms"
    if joint.delay_interval is None:
        return words
    low, high = (number(1e3 * end, 0.1) for end in joint.delay_interval)
    return f"{words} ({low} … {high})"


def _kinds(result: Identification) -> list[PageItem]:
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
        if not any(name in members for members in kinds.values()):
            continue  # a velocity of a base that floats
        cells: list[Cell] = [name]
        for members in kinds.values():
            p = members.get(name)
            value = "" if p is None else estimate(p.value, p.low, p.high)[0]
            firm = p is None or p.firm
            cells.append(value if firm else Mark("", "weak", f"({value})"))
        lines.append(cells)
    spare = tuple(range(len(kinds), 2, -1))
    table = Table(["friction", *kinds], lines, spare=spare, most=_LINES)
    return [table, Text("In brackets: not identified by itself.")]


def _frictions(figures: Sequence[Figure]) -> list[PageItem]:
    note = Text(
        "Lines are 95 % intervals; ◇ is the prior, a guess from the model and the motion. "
        "The numbers are in the tables below.",
        note=True,
    )
    return [Figures(figures), note] if figures else []


def _law(result: Identification, figures: Sequence[Figure]) -> list[PageItem]:
    """Gains of a law and its prediction of the log's last fifth, beside the batch fit's."""
    along = result.law
    if along is None:
        return []
    law = f"law {along.name}"
    limits = "95 % interval"
    heads = ["gain / mean", law, limits, "batch fit", limits, "agree"]
    gains = []
    if along.gains:
        gains = [Table(heads, wording.law_gains(along), (0, 5), spare=(4, 2), most=_LINES)]
    rows = zip(result.joints, along.last, along.batch_last, strict=True)
    lines = [[joint.name, wording.nrmse(own), wording.nrmse(fit)] for joint, own, fit in rows]
    last = Table(["NRMSE of the last fifth", law, "batch fit"], lines, most=_LINES)
    note = (
        "The law followed the log once, sample by sample, with columns, delays and prior of the "
        "batch fit. Gains are over their geometric mean, since no motion reveals their scale; they "
        "agree where both intervals meet. NRMSE: the last fifth of the log under the estimate "
        "before it. v̂ − v and all of θ̂ are on the page of the law's own run, "
        f"{along.name}/report.html beside this one."
    )
    return [*gains, last, *([Figures(figures)] if figures else []), Text(note, note=True)]


def _unknown(result: Identification) -> list[PageItem]:
    """Parameters that the log does not determine."""
    found: list[PageItem] = []
    for status, names in wording.unknown_in_words(result):
        found += [Badges([Mark.of(status)]), Text(f"{_SILENT[status].capitalize()}: {names}.")]
    return found


def _combinations(result: Identification) -> list[PageItem]:
    lines = []
    for k, combination in enumerate(result.combinations, 1):
        value, interval = estimate(combination.value, combination.low, combination.high)
        lines.append([f"C{k}", combination.words, value, combination.unit, interval])
    if not lines:
        return []
    heads = ["", "combination", "estimate", "unit", "95 % interval"]
    return [
        Text(
            "The motion reveals these sums, not their terms; gains are taken as given. Any "
            "division among the terms predicts the same commands."
        ),
        Table(heads, lines, (0, 1, 3), ids="combination"),
    ]


def _command(result: Identification) -> str:
    """Command line with the model and the logs, as far as they are in the result."""
    source = result.robot.source
    model = str(source) if source is not None else result.robot.name
    logs = list(dict.fromkeys(s.source for s in result.recordings.segments))
    return shlex.join(["nsaid", "identify", "--model", model, "--log", *logs])


def _correlations(result: Identification) -> list[PageItem]:
    """Correlations of gains, frictions and rotor inertias; empty for fewer than two."""
    bodies = result.bodies
    variance = np.diag(result.covariance)
    chosen = [
        k for k, p in enumerate(result.parameters) if p.block not in bodies and variance[k] > 0
    ]
    chosen.sort(key=lambda k: not result.parameters[k].is_gain)
    r = result.covariance[np.ix_(chosen, chosen)]
    deviation = np.sqrt(variance[chosen])
    labels = [result.parameters[k].label for k in chosen]
    figures = figures_of(HeatMap.of_strongest(labels, r / np.outer(deviation, deviation)))
    return [Figures(figures), Text(HeatMap.MEANING, note=True)] if figures else []
