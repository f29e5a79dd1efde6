"""report.html: the results of a run on one self-contained page."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from .. import evaluation, recording
from ..evaluation import Truth
from ..evaluation.verify import ROWS, Verdict, verify
from ..evaluation.words import Mark
from ..experiment.loop import Run
from . import pages, report_panels
from .pages import Alarm, Figures, Fold, Items, Page, Section, Table, Text
from .picture import picture
from .report_tables import confidence, parameters, parameters_note
from .terminal import print_page

_RATIO = " ‖θ̄_P⊥‖/‖θ̂‖"  # left out: the first figure's axis has the formula
_FIRST = 5  # unobservable directions that are not folded
_GAINS, _DIRECTIONS = 12, 3  # printed at most; the page has all of them
_LENGTH = 120  # characters of a printed list of parameters, at most
_COMPILED = 0.5  # compile times below this are not mentioned [s]
_JUDGEMENTS = {"converged": ("✔", "good"), "still converging": ("◐", "fair")}  # all others are poor
_CORRELATIONS = (
    "Strong colours: two parameters that this motion determines together, so that one known value "
    "narrows the other. Correlations of at least 0.5 are written out. Errors are relative to the "
    "mean of the actuators' gains."
)
_FORCES = {
    True: "On the held-out trajectory, which no identifier has seen. Measured: the actuators' "
    "force at the command, under the estimated gains. Predicted: the force that the motion needs "
    "under the estimated plant. Both are scaled by the one factor that brings the estimate "
    "closest to the truth.",
    False: "On the last tenth of the run. Measured: the actuators' force at the command, under "
    "the estimated gains. Predicted: the force that the motion needs under the estimated plant.",
}
_SCRIPT = """\
from pathlib import Path

from nsaid_mj import Scenario, run

run(Scenario.from_json(Path("scenario.json").read_text()), Path("again"))"""


def write(
    run: Run,
    summary: dict[str, Any],
    truth: Truth | None,
    verdicts: Sequence[Verdict] = (),
    command: str = "",
) -> Path:
    """Writes a run's report.html atomically and returns its path.

    Args:
        run: a finished run with at least one row in its record.
        summary: the content of its summary.json.
        truth: of its plant; None if it is unknown, as on a robot's log. Comparisons with the
            truth are then left out.
        verdicts: on the paper's statements; computed if there are none.
        command: command line of the run, to be repeated; empty if it is not known.
    """
    return pages.write(_page(run, summary, truth, verdicts, command), run.folder)


def page(
    run: Run,
    summary: dict[str, Any],
    truth: Truth | None,
    verdicts: Sequence[Verdict] = (),
    command: str = "",
) -> str:
    """A run's report as HTML; see `write`."""
    return pages.render(_page(run, summary, truth, verdicts, command))


def _page(
    run: Run,
    summary: dict[str, Any],
    truth: Truth | None,
    verdicts: Sequence[Verdict],
    command: str,
) -> Page:
    verdicts = verdicts or (verify(run, truth, summary) if len(run.record) >= ROWS else [])
    from .drawings import figures_of  # imported late: matplotlib takes half a second

    panels = report_panels.panels(run, summary, truth)
    figures = {name: figures_of(group) for name, group in panels.items()}
    robot = _robot(run)
    sketch = picture(run.looks, run.record["q"][0], robot)
    statements = Table(["statement", "claim", "verdict", "figure"], _statements(verdicts),
                       (0, 1, 2, 3))  # fmt: skip
    sections = [
        Section("Figures", [_figures(summary), Text(_checks(summary), note=True)]),
        Section("Time histories", [Figures(figures["curves"])]),
        Section("Predicted against measured forces", [
            Figures(figures["forces"], "velocities", 6),
            Text(f"{_FORCES[truth is not None]} Error: rms over rms of the measured force.", True),
        ] if figures["forces"] else []),
        Section("Confidence", confidence(summary, figures["gains"])),
        Section("Parameters", [
            Text(parameters_note(summary)), *parameters(run.system.space, summary),
        ]),
        Section("Correlations of what is identified", [
            Figures(figures["correlations"]), Text(_CORRELATIONS, note=True),
        ] if figures["correlations"] else []),
        Section("The paper's statements on this run", [statements] if statements.lines else []),
        Section("What cannot be known from motion", _unobservable(summary)),
    ]  # fmt: skip
    folder = shlex.quote(str(run.folder))
    return Page(
        heading=robot,
        verdict=mark_of(summary),
        eyebrow=f"run {run.folder.name}",
        lead=_lead(summary),
        tab=f"{robot} · {run.folder.name}",
        alarms=_alarms(summary),
        carrying=figures["carrying"] + ([sketch] if sketch else []),
        sections=[section for section in sections if section.panels],
        commands=[
            *([command] if command else []),
            _SCRIPT,
            f"nsaid view {folder}",
            f"nsaid verify --run {folder}",
        ],
        notes=[
            f"The scenario, including seed {summary['seed']}, is in scenario.json (hash "
            f"{summary['scenario_hash']}). With the same versions of all packages the record is "
            "identical to the bit. All figures are in summary.json, all samples in record.arrow, "
            "the recording is run.rrd."
        ],
        versions=summary["versions"],
    )


def print_summary(name: str, summary: dict[str, Any], folder: Path) -> None:
    """Prints the verdict on a run, the figures behind it, and the paths of its files.

    Args:
        name: of the run.
        summary: the content of its summary.json.
        folder: of the run.
    """
    compiled = summary["compile_s"]
    done = "followed" if "stream" in summary else "simulated"
    lead = (
        f"{summary['sim_s']:.4g} s {done} in {summary['wall_s']:.1f} s "
        f"({summary['real_time_factor']:.1f} × real time)"
        + (f", plus {compiled:.0f} s of one-time compilation" if compiled > _COMPILED else "")
    )
    lines = [(_cut(what), _cut(fix)) for what, fix in evaluation.unobservable_lines(summary)]
    more = [f"… all in {folder / pages.FILE}"] if len(lines) > _DIRECTIONS else []
    among = ", among them" if more else ""
    known = f"{evaluation.observable_line(summary)}{among}{':' if lines else ''}"
    file = folder / recording.FILE
    seen = f"{file}   (nsaid view {shlex.quote(str(folder))})"
    print_page(
        Page(
            heading=name,
            verdict=mark_of(summary),
            lead=lead,
            alarms=_alarms(summary),
            sections=[
                Section("", [*_gains(summary), _figures(summary, terminal=True)]),
                Section("", [Text(line) for line in evaluation.confidence_lines(summary)]),
                Section("", [Text(known), Items([*lines[:_DIRECTIONS], *more])]),
            ],
            commands=[
                f"recording  {seen if file.is_file() else recording.HINT}",
                f"report     {folder / pages.FILE}",
            ],
        ),
        Console(highlight=False),
    )


def mark_of(summary: dict[str, Any]) -> Mark | None:
    """The verdict with its mark; None if the summary, of an earlier version, has none."""
    told = summary.get("verdict")
    if told is None:
        return None
    glyph, kind = _JUDGEMENTS.get(told.partition(":")[0], ("✘", "poor"))
    return Mark(glyph, kind, told)


def _alarms(summary: dict[str, Any]) -> list[Alarm]:
    """How the run ended early, and what distinguishes it from one in the paper."""
    found = []
    if summary.get("status", "completed") != "completed":
        found.append(Alarm(Mark("✘", "poor", _ended(summary)), "ended early:"))
    if summary.get("fault"):
        found.append(Alarm(Mark("▲", "fair", summary["fault"]), "fault in the plant:"))
    for fault in summary.get("faults", []):
        words = f"{fault['words']}, {100 * fault['confidence']:.4g} % sure"
        found.append(Alarm(Mark("▲", "poor", words), f"fault found at {fault['found']:.4g} s:"))
    found += [
        Alarm(Mark("▲", "fair", m), "not in the structure:") for m in summary.get("mismatch", [])
    ]
    if told := _stream_line(summary.get("stream", {})):
        found.append(Alarm(Mark("", "weak", told), "samples:"))
    if summary["sensor_noise"]:
        found.append(Alarm(Mark("", "weak", summary["sensor_noise"]), "sensors:"))
    return found


def _stream_line(counts: dict[str, int]) -> str:
    """What was wrong with the samples of a live robot, in words; empty if nothing was."""
    one = counts.get("gaps") == 1
    told = {
        "gaps": "gap" if one else "gaps",
        "missing": f"{'sample' if counts.get('missing') == 1 else 'samples'} missing in "
        + ("it" if one else "them"),
        "not_finite": "not finite",
        "duplicates": "repeated",
        "late": "out of order",
        "unreadable": "unreadable",
    }
    return ", ".join(f"{counts[key]} {words}" for key, words in told.items() if counts.get(key))


def _gains(summary: dict[str, Any]) -> list[Table]:
    """The actuators' gains with their intervals, if the law states any."""
    rows = evaluation.gain_rows(summary)
    if not rows:
        return []
    relative, true = rows[0][1] is not None, rows[0][3] is not None
    heads = ["actuators", *["gain / mean"] * relative, "± (95 %)", *["true"] * true]
    lines = [
        [label, *([f"{value:.4f}"] if value is not None else []), f"{100 * interval:.2g} %",
         *([f"{truth:.4f}"] if truth is not None else [])]
        for label, value, interval, truth in rows
    ]  # fmt: skip
    return [Table(heads, lines, most=_GAINS)]


def _robot(run: Run) -> str:
    """The robot's name: the plant's `robot` or `vehicle` field, or the name of its class."""
    plant = run.scenario.plant
    chosen = getattr(plant, "robot", "") or getattr(plant, "vehicle", "")
    return Path(chosen).stem if chosen else type(plant).__name__.removesuffix("Plant")


def _lead(summary: dict[str, Any]) -> str:
    return (
        f"Law {summary['law']}, {summary['sensors']} sensors, seed {summary['seed']}: "
        f"{summary['n']} velocities, {summary['p']} parameters, {summary['sim_s']:.4g} s of motion "
        f"in {summary['wall_s']:.1f} s of wall time."
    )


def _ended(summary: dict[str, Any]) -> str:
    signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
    at = f"{summary['status']} at t = {summary['status_time']:.4g} s{signal}"
    return f"{at}. {summary['status_remedy']}"


def _figures(summary: dict[str, Any], terminal: bool = False) -> Table:
    """The table of figures, one column for each identifier; rows absent from all are left out.

    The page's first figure has the formula of the distance on its axis.
    """
    identifiers = {evaluation.OWN: summary, **summary["rivals"]}
    lines = [
        [
            label if terminal else label.replace(_RATIO, ""),
            *(evaluation.figure(found.get(key), unit) for found in identifiers.values()),
        ]
        for label, key, unit in evaluation.FIGURES
        if any(key in found for found in identifiers.values())
    ]
    return Table(["figures" if terminal else "", *identifiers], lines)


def _checks(summary: dict[str, Any]) -> str:
    """How far the run agrees with the theory: conserved quantity and excitation."""
    said = []
    if (drift := summary.get("conserved_drift")) is not None:
        said.append(f"Relative drift of the conserved quantity θ̂ᵀΓ⁻¹θ̂: {drift:.1e}.")
    levels = [
        f"{summary[key]:.2g} N·m·s in ({equation})"
        for key, equation in (("pe_level_perp", "75"), ("pe_level", "2"))
        if summary.get(key) is not None
    ]
    measured = ("pe_level_perp", "pe_level", "pe_share_perp")  # 0 or None without a window
    if levels and any(summary.get(key) for key in measured):
        said.append(f"Smallest level of excitation ε₀ of any window: {', '.join(levels)}.")
    return " ".join(said)


def _statements(verdicts: Sequence[Verdict]) -> list[list[Any]]:
    """The paper's statements with their verdicts, as lines of a table."""
    kinds = {
        "holds": ("✔", "good"),
        "not yet": ("◐", "fair"),
        "fails": ("✘", "poor"),
        "not applicable": ("○", "weak"),
    }
    return [[v.statement, v.claim, Mark(*kinds[v.verdict], v.verdict), v.words] for v in verdicts]


def _unobservable(summary: dict[str, Any]) -> list[pages.Panel]:
    """The five directions that concern most parameters, and the others by block."""
    lines = summary["unobservable"]
    told = evaluation.unobservable_lines(summary)
    sizes = {line["direction"]: len(line["labels"]) for line in lines}
    scales = [entry for entry in told if entry[0].startswith("common scale")]
    others = sorted(
        (entry for entry in told if entry not in scales),
        key=lambda entry: -sizes.get(entry[0], len(lines)),
    )
    ordered = [(what, f"{fix}.") for what, fix in scales + others]
    groups: dict[str, list[tuple[str, str]]] = {}
    for what, fix in ordered[_FIRST:]:
        part = what.partition(" against ")[0].partition(" of ")[2] or "others"
        groups.setdefault(part, []).append((what, fix))
    first = ". First those that concern most parameters:" if groups else ":" if ordered else "."
    return [
        Text(f"{evaluation.observable_line(summary)}{first}"),
        *([Items(ordered[:_FIRST], ordered=True)] if ordered else []),
        *(Fold(name, [Items(some)], small=str(len(some))) for name, some in groups.items()),
    ]


def _cut(words: str) -> str:
    """A list in words; a long one is cut after a comma."""
    if len(words) <= _LENGTH:
        return words
    end = words.rfind(", ", 0, _LENGTH)
    return f"{words[: end if end > 0 else _LENGTH]}, …"
