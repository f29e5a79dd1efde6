"""report.html: the results of a run on one self-contained page."""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from .. import evaluation
from ..evaluation import Truth, mark_of, result_of
from ..evaluation.confidence import INTERVAL
from ..evaluation.result import Mark, Result, figures_of
from ..evaluation.verify import ROWS, Verdict, verify
from ..evaluation.words import CONVERGED
from ..experiment.loop import Run
from ..parameters import Array, rounded
from ..resources import RECORDING
from .page import FILE, Figure, Figures, Fold, Items, Page, Panel, Section, Table, Text
from .panels import COLOURS, LAWS, Comparison, HeatMap, local_rms, thin
from .panels import Panel as Plot
from .parameters import CORRELATIONS, brief_gains, correlations, folds, forests
from .picture import picture
from .terminal import print_page

_RATIO = " ‖θ̄_P⊥‖/‖θ̂‖"  # left out: the first figure's axis has the formula
_FIRST = 5  # unobservable directions that are not folded
_DIRECTIONS = 3  # printed at most; the page has all of them
_LENGTH = 120  # characters of a printed list of parameters, at most
_COMPILED = 0.5  # compile times below this are not mentioned [s]
_NO_RERUN = "none, as Rerun is not installed: pip install 'nsaid-mj[view]'"
_HELD = "Intervals hold the mean of the actuators' gains, since the common scale is unobservable."
_FORCES = {
    True: "On the held-out trajectory, which no identifier has seen. Measured: the actuators' "
    "force at the command, under the estimated gains. Predicted: the force that the motion needs "
    "under the estimated plant. Both are scaled by the one factor that brings the estimate "
    "closest to the truth.",
    False: "On the last tenth of the run, averaged over 0.1 s. Measured: the actuators' force at "
    "the command, under the estimated gains. Predicted: the force that the motion needs under the "
    "estimated plant.",
}
_FILES = (
    "The scenario, including seed {seed}, is in scenario.json (hash {scenario_hash}). With the "
    "same versions of all packages the record is identical to the bit. All figures are in "
    "summary.json, all samples in record.arrow, the recording is run.rrd."
)
_SCRIPT = """\
from pathlib import Path

from nsaid_mj import Scenario, run

run(Scenario.from_json(Path("scenario.json").read_text()), Path("again"))"""


def page(
    run: Run,
    summary: dict[str, Any],
    truth: Truth | None,
    verdicts: Sequence[Verdict] = (),
    command: str = "",
) -> Page:
    """The page of a run.

    Args:
        run: a finished run with at least one row in its record.
        summary: the content of its summary.json.
        truth: true parameters of its plant; None if it is unknown, as on a robot's log. Comparisons
            with the truth are then left out.
        verdicts: on the paper's statements; computed if there are none.
        command: command line of the run, to be repeated; empty if it is not known.
    """
    verdicts = verdicts or (verify(run, truth, summary) if len(run.record) >= ROWS else [])
    from .drawings import figures_of as drawn  # imported late: matplotlib takes half a second

    result = result_of(summary, run.system.space)
    curves = _over_time(run, summary, truth)
    carrying, more, forces = drawn(curves[:2]), drawn(curves[2:]), drawn(_forces(run, truth))
    gains = drawn(forests([p for p in result.gains if p.relative is not None]))
    correlated = drawn(_correlations(summary))
    robot = _robot(run)
    sections = [
        Section("Figures", [
            _figures(summary), Text(_checks(summary), note=True),
        ], picture(run.looks, run.record["q"][0], robot)),
        Section("Time histories", [Figures(more)] if more else []),
        Section("Predicted against measured forces", [
            Figures(forces, "velocities", 6),
            Text(f"{_FORCES[truth is not None]} Error: rms over rms of the measured force.", True),
        ] if forces else []),
        Section("Confidence", _confidence(summary, gains)),
        Section("Parameters", [Text(_relative_to(result)), *folds(result)]),
        Section("Correlations of what is identified", [
            Figures(correlated), Text(f"{CORRELATIONS} {_HELD}", note=True),
        ] if correlated else []),
        Section("The paper's statements on this run", statements(verdicts)),
        Section("What cannot be known from motion", unobservable(summary)),
    ]  # fmt: skip
    folder = shlex.quote(str(run.folder))
    return Page(
        heading=robot,
        verdict=mark_of(summary),
        eyebrow=f"run {run.folder.name}",
        lead=_lead(summary),
        tab=f"{robot} · {run.folder.name}",
        findings=result.findings,
        carrying=carrying,
        sections=[section for section in sections if section.panels],
        commands=[
            *filter(None, [command]), _SCRIPT,
            f"nsaid view {folder}", f"nsaid verify --run {folder}",
        ],
        notes=[_FILES.format(**summary)],
        versions=summary["versions"],
    )  # fmt: skip


def print_summary(name: str, summary: dict[str, Any], folder: Path) -> None:
    """Prints the verdict on a run, the figures behind it, and the paths of its files."""
    print_page(brief(name, summary, folder), Console(highlight=False))


def brief(name: str, summary: dict[str, Any], folder: Path) -> Page:
    """The page of a run for terminal and recording.

    Args:
        name: name of the run.
        summary: the content of its summary.json.
        folder: folder of the run.
    """
    compiled = summary["compile_s"]
    done = "followed" if "stream" in summary else "simulated"
    lead = (
        f"{summary['sim_s']:.4g} s {done} in {summary['wall_s']:.1f} s "
        f"({summary['real_time_factor']:.1f} × real time)"
        + (f", plus {compiled:.0f} s of one-time compilation" if compiled > _COMPILED else "")
    )
    result = result_of(summary)
    gains = brief_gains(result)
    lines = [(_cut(what), _cut(fix)) for what, fix in evaluation.unobservable_lines(summary)]
    more = [f"… all in {folder / FILE}"] if len(lines) > _DIRECTIONS else []
    among = ", among them" if more else ""
    known = f"{evaluation.observable_line(summary)}{among}{':' if lines else ''}"
    file = folder / RECORDING
    seen = f"{file}   (nsaid view {shlex.quote(str(folder))})"
    return Page(
        heading=name,
        verdict=mark_of(summary),
        lead=lead,
        findings=result.findings,
        sections=[
            Section("", [*gains, *[Text(f"({_HELD[:1].lower()}{_HELD[1:-1]})")] * bool(gains)]),
            Section("", [_figures(summary, terminal=True)]),
            Section("", [Text(line) for line in evaluation.confidence_lines(summary)]),
            Section("", [Text(known), Items([*lines[:_DIRECTIONS], *more])]),
        ],
        commands=[
            f"recording  {seen if file.is_file() else _NO_RERUN}",
            f"report     {folder / FILE}",
        ],
    )


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


def _figures(summary: dict[str, Any], terminal: bool = False) -> Table:
    """The table of figures, one column for each identifier.

    The page's first figure has the formula of the distance on its axis.
    """
    figures = figures_of(summary)
    lines = [
        [
            figure.name if terminal else figure.name.replace(_RATIO, ""),
            *(evaluation.figure(value, figure.unit) for value in figure.values.values()),
        ]
        for figure in figures
    ]
    return Table(["figures" if terminal else "", *(figures[0].values if figures else ())], lines)


def _confidence(summary: dict[str, Any], gains: Sequence[Figure]) -> list[Panel]:
    """The stated confidence in words, and the least known directions; empty if none is stated."""
    stated = summary["confidence"]
    if stated is None:
        return []
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    worst = [
        [
            ", ".join(
                f"{weight:+.2f} {label[name]}".replace("-", "−", 1)
                for name, weight in row["parameters"].items()
            ),
            f"±{rounded(100 * row['deviation'], 2)} %",
            "below the noise" if row["below_noise"] else "",
        ]
        for row in stated["worst_known"]
    ]
    return [
        *([Figures(gains)] if gains else []),
        Items(evaluation.confidence_lines(summary)),
        Text("Least known directions of θ/scale", head=True),
        Table(["largest components", "standard deviation / ‖θ̂/scale‖", ""], worst),
    ]


def _relative_to(result: Result) -> str:
    """What the tables of parameters are relative to."""
    words = "Estimates are determined up to the unobservable directions below."
    if any(p.true is not None for p in result.parameters):
        words += (
            " For comparison, prior and estimate are multiplied by the one factor that makes the "
            "mean of the estimated gains equal to the true one."
        )
    if any(p.status for p in result.parameters):
        words += f" {_HELD} What the motion reveals only in sums has none."
    return words


def _checks(summary: dict[str, Any]) -> str:
    """Agreement of the run with the theory: conserved quantity and excitation."""
    said = []
    if (drift := summary.get("conserved_drift")) is not None:
        said.append(f"Relative drift of the conserved quantity θ̂ᵀΓ⁻¹θ̂: {rounded(drift, 2)}.")
    levels = [
        f"{rounded(summary[key], 2)} N·m·s in ({equation})"
        for key, equation in (("pe_level_perp", "75"), ("pe_level", "2"))
        if summary.get(key) is not None
    ]
    measured = ("pe_level_perp", "pe_level", "pe_share_perp")  # 0 or None without a window
    if levels and any(summary.get(key) for key in measured):
        said.append(f"Smallest level of excitation ε₀ of any window: {', '.join(levels)}.")
    return " ".join(said)


def statements(verdicts: Sequence[Verdict]) -> list[Panel]:
    """The paper's statements with their verdicts, then those that do not apply, by reason."""
    kinds = {"holds": ("✔", "good"), "not yet": ("◐", "fair"), "fails": ("✘", "poor")}
    lines, apart = [], dict[str, list[str]]()
    for v in verdicts:
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


def unobservable(summary: dict[str, Any]) -> list[Panel]:
    """The five directions that concern most parameters, and the others by block."""
    lines = summary["unobservable"]
    entries = evaluation.unobservable_lines(summary)
    sizes = {line["direction"]: len(line["labels"]) for line in lines}
    scales = [entry for entry in entries if entry[0].startswith("common scale")]
    others = sorted(
        (entry for entry in entries if entry not in scales),
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


# -- the panels of the page's figures ------------------------------------------------------------

_POINTS = 600  # of a curve of forces
_TAIL = 0.9  # share of the run after which the stated intervals are drawn


def _over_time(run: Run, summary: dict[str, Any], truth: Truth | None) -> list[Plot]:
    """The run's curves over time; the first carries the verdict."""
    record, rows = run.record, thin(len(run.record))
    t, later = record["t"][rows], rows[1:]
    names = {"": evaluation.OWN} | {name: name for name in record.rivals}
    distance = Plot(
        "Distance to the true set", "‖P⊥ᵀ θ̂‖ / ‖θ̂‖, of θ/scale [–]", True,
        level=CONVERGED, level_name=f"converged: within {100 * CONVERGED:g} %",
    )  # fmt: skip
    units = ", ".join(dict.fromkeys(run.system.velocity_units))
    error = Plot("Velocity error, rms over short intervals", f"rms Δv [{units}]", True)
    for k, (name, label) in enumerate(names.items()):
        suffix = f"_{name}" if name else ""
        colour = COLOURS[LAWS.get(name or summary["law"], k % len(COLOURS))]
        if truth is not None:
            ratio = truth.distance(t, record.rows(f"theta_hat{suffix}", rows))
            distance.add(t, ratio, label, colour=colour)
        dv = record[f"v_hat{suffix}"][later] - record["v"][later]
        if len(later):
            error.add(*local_rms(record["t"][later], dv), label, colour=colour)
    gains = _gains(run, summary, rows, None if truth is None else truth.theta_at(t))
    energy = Plot("Lyapunov function", "V [J]", True)
    if truth is not None:
        energy.add(t, evaluation.energy(run, truth, rows))
    panels = [distance, gains, error, energy] if truth is not None else [error, gains]
    found = [fault.found for fault in run.faults]
    return [replace(p, events=found, event_name="fault found") for p in panels if p.curves]


def _gains(run: Run, summary: dict[str, Any], rows: Any, true: Array | None) -> Plot:
    """Actuator parameters relative to the true ones, or to the prior if the truth is unknown.

    The intervals that the law states at the end are drawn over the last tenth.
    """
    space, t = run.system.space, run.record["t"][rows]
    k, theta_hat = space.actuators, run.record.rows("theta_hat", rows)
    ratio = theta_hat[:, k] / (theta_hat[:1, k] if true is None else true[:, k])
    over = "k̂/k̂(0)" if true is None else "k̂/k"
    title = "Actuators relative to the " + ("prior" if true is None else "truth (1 is exact)")
    panel = Plot(
        title, f"{over}, relative to the mean [–]", level=1.0,
        band_name="95 % interval, as stated at the end",
    )  # fmt: skip
    stated = (summary["confidence"] or {}).get("actuators", {})
    end = t >= t[0] + _TAIL * (t[-1] - t[0])
    for i, share in zip(k, (ratio / ratio.mean(axis=1, keepdims=True)).T, strict=True):
        band = None
        if space.names[i] in stated and len(k) > 1:
            half = INTERVAL * stated[space.names[i]] * share[-1]
            band = np.where(end, share[-1] - half, np.nan), np.where(end, share[-1] + half, np.nan)
        panel.add(t, share, space.labels[i], band)
    return panel


def _forces(run: Run, truth: Truth | None) -> list[Comparison]:
    """Predicted against measured force along every velocity, the worst predicted first."""
    found = evaluation.forces_of(run, truth)
    if found is None or not found.measured.any():
        return []
    rows = np.unique(np.linspace(0, len(found.t) - 1, min(len(found.t), _POINTS)).astype(int))
    labels, units = evaluation.velocity_labels(run.system), evaluation.force_units(run.system)
    error = found.nrmse
    order = np.argsort(-np.where(np.isfinite(error), error, -1.0), kind="stable")
    panels = []
    for j in order:
        known, number = np.isfinite(error[j]), evaluation.figure(float(error[j]), "%")
        note = f": error {number}" if known else ", not actuated"
        kind = {"N": "force", "N·m": "torque"}.get(units[j], "generalised force")
        panels.append(
            Comparison(
                f"{labels[j]}{note}", kind, units[j], found.t[rows],
                found.measured[rows, j], found.predicted[rows, j],
                None if found.half is None else found.half[rows, j],
            )
        )  # fmt: skip
    return panels


def _correlations(summary: dict[str, Any]) -> list[HeatMap]:
    """Correlations of the parameters that are identified."""
    stated = (summary["confidence"] or {}).get("correlations", {"parameters": [], "lower": []})
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    r = np.eye(len(stated["lower"]))
    for i, row in enumerate(stated["lower"]):
        r[i, :i] = r[:i, i] = row
    return correlations([label[name] for name in stated["parameters"]], r)
