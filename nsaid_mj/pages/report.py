"""report.html: the results of a run on one self-contained page."""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from .. import evaluation
from ..evaluation import Truth, result_of
from ..evaluation.curves import curves_of
from ..evaluation.panels import Comparison, HeatMap
from ..evaluation.result import Mark, Result
from ..evaluation.verify import ROWS, Verdict, verify
from ..evaluation.verify import result_of as verified
from ..experiment.loop import Run
from ..parameters import ParameterSpace, rounded
from ..resources import RECORDING
from .page import FILE, Figure, Figures, Fold, Items, Page, Panel, Section, Table, Text
from .parameters import CORRELATIONS, correlations, folds, forests, gains_of
from .picture import picture
from .terminal import print_page

_FIRST = 5  # unobservable directions that are not folded
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

    robot, folder = _robot(run), shlex.quote(str(run.folder))
    made = brief(robot, summary, run.system.space)
    result = replace(made.result, curves=curves_of(run, summary, truth))
    forces = [panel for panel in result.curves if isinstance(panel, Comparison)]
    curves = [panel for panel in result.curves if not isinstance(panel, Comparison)]
    more, figures, gains, *rest = drawn(curves[2:]), *made.sections
    shown = drawn(forests([p for p in result.gains if p.relative is not None]))
    sections = [
        replace(figures, beside=picture(run.looks, run.record["q"][0], robot)),
        Section("Time histories", [Figures(more)] if more else []),
        Section("Predicted against measured forces", [
            Figures(drawn(forces), "velocities", 6),
            Text(f"{_FORCES[truth is not None]} Error: rms over rms of the measured force.", True),
        ] if forces else []),
        replace(gains, panels=[*([Figures(shown)] if shown else []), *gains.panels]),
        *rest,
        Section("Parameters", [Text(_relative_to(result)), *folds(result, gains=False)]),
        Section("Least known directions of θ/scale", _least_known(summary)),
        Section("Correlations of what is identified",
                _correlated(drawn(_correlations(summary)))),
        Section("The paper's statements on this run",
                [*statements(verdicts), *_checks(summary)]),
    ]  # fmt: skip
    return replace(
        made,
        result=result,
        eyebrow=f"run {run.folder.name}",
        tab=f"{robot} · {run.folder.name}",
        carrying=drawn(curves[:2]),
        sections=[section for section in sections if section.panels],
        commands=[
            *filter(None, [command]), _SCRIPT,
            f"nsaid view {folder}", f"nsaid verify --run {folder}",
        ],
        notes=[_FILES.format(**summary)],
        versions=summary["versions"],
    )  # fmt: skip


def brief(heading: str, summary: dict[str, Any], space: ParameterSpace | None = None) -> Page:
    """The page of a run as far as its summary alone has it, which terminal and recording show."""
    result = result_of(summary, space)
    held = [Text(_HELD)] if any(p.relative for p in result.gains) else []
    return Page(
        heading=heading,
        result=result,
        lead=_lead(summary),
        sections=[
            Section("Figures", [_figures(result)], brief=True),
            Section("Actuator gains", [*gains_of(result), *held], brief=True),
            Section("Confidence", _confidence(summary), brief=True),
            Section("What cannot be known from motion", unobservable(summary), brief=True),
        ],
    )  # fmt: skip


def print_summary(
    name: str, summary: dict[str, Any], folder: Path, space: ParameterSpace | None = None
) -> None:
    """Prints the verdict on a run, the figures behind it, and the paths of its files."""
    file = folder / RECORDING
    seen = f"{file}   (nsaid view {shlex.quote(str(folder))})"
    files = (
        f"recording  {seen if file.is_file() else _NO_RERUN}",
        f"report     {folder / FILE}",
    )
    print_page(brief(name, summary, space), Console(highlight=False), files)


def _robot(run: Run) -> str:
    """The robot's name: the plant's `robot` or `vehicle` field, or the name of its class."""
    plant = run.scenario.plant
    chosen = getattr(plant, "robot", "") or getattr(plant, "vehicle", "")
    return Path(chosen).stem if chosen else type(plant).__name__.removesuffix("Plant")


def _lead(summary: dict[str, Any]) -> str:
    done, compiled = "followed" if "stream" in summary else "simulated", summary["compile_s"]
    said = (
        f"Law {summary['law']}, {summary['sensors']} sensors, seed {summary['seed']}: "
        f"{summary['n']} velocities, {summary['p']} parameters; {summary['sim_s']:.4g} s {done} in "
        f"{summary['wall_s']:.1f} s ({summary['real_time_factor']:.1f} × real time)"
    )
    compiling = f", plus {compiled:.0f} s of one-time compilation"
    return f"{said}{compiling if compiled > _COMPILED else ''}."


def _figures(result: Result) -> Table:
    """The table of figures, one column for each identifier."""
    lines = [
        [f.name, *(evaluation.figure(value, f.unit) for value in f.values.values())]
        for f in result.figures
    ]
    return Table(["figures", *(result.figures[0].values if result.figures else ())], lines)


def _confidence(summary: dict[str, Any]) -> list[Panel]:
    """The stated confidence in words; empty if none is stated."""
    lines = evaluation.confidence_lines(summary)
    return [Items(lines)] if lines else []


def _least_known(summary: dict[str, Any]) -> list[Panel]:
    """The least known directions; empty if no confidence is stated."""
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
    return [Table(["largest components", "standard deviation / ‖θ̂/scale‖", ""], worst)]


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


def _correlated(figures: Sequence[Figure]) -> list[Panel]:
    """The heat map of correlations with its explanation; empty if there is none."""
    return [Figures(figures), Text(f"{CORRELATIONS} {_HELD}", note=True)] if figures else []


def _checks(summary: dict[str, Any]) -> list[Panel]:
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
    return [Text(" ".join(said), note=True)] if said else []


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


def verdicts_page(name: str, run: Run, verdicts: Sequence[Verdict]) -> Page:
    """The page of a check of the paper's statements on a run, for the terminal."""
    lines = [f"{v.verdict:15} {v.statement}: {v.claim}\n{' ' * 20}{v.words}" for v in verdicts]
    end = float(run.record["t"][-1])
    return Page(
        heading=name,
        result=verified(verdicts),
        lead=f"{run.ending.status.words}, {end:.4g} s simulated",
        sections=[Section("", [Items(lines)], brief=True)],
    )


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


def _correlations(summary: dict[str, Any]) -> list[HeatMap]:
    """Correlations of the parameters that are identified."""
    stated = (summary["confidence"] or {}).get("correlations", {"parameters": [], "lower": []})
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    r = np.eye(len(stated["lower"]))
    for i, row in enumerate(stated["lower"]):
        r[i, :i] = r[:i, i] = row
    return correlations([label[name] for name in stated["parameters"]], r)
