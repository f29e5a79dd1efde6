"""report.html: the results of a run on one self-contained page."""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from ...base import OutputFolder
from ...core import ABSENT, rounded
from ...report import (
    Comparison,
    Figure,
    Figures,
    Fold,
    HeatMap,
    Items,
    Page,
    PageItem,
    Parameter,
    ParameterTables,
    Result,
    Section,
    Table,
    Text,
    count,
    percent,
    print_page,
    robot_picture,
)
from ...report import Panel as Curves
from ..loop import Run
from .run_result import RunResult
from .verify import Verification

_FIRST = 5  # unobservable directions that are not folded
_COMPILED = 0.5  # compile times below this are not mentioned [s]
_NO_RERUN = "none, as Rerun is not installed: pip install 'nsaid-mj[view]'"
_HELD = "Intervals are relative to the mean gain, because the common scale is unobservable."
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


def page(
    run: Run, result: RunResult, checks: Verification | None = None, command: str = ""
) -> Page:
    """The page of a run.

    Args:
        run: a finished run with at least one row in its record.
        result: what `evaluate` makes of it, with its curves.
        checks: of the paper's statements; None for a run that is too short for them.
        command: command line of the run, to be repeated; empty if it is not known.
    """
    from ...report import figures_of as drawn

    robot = _robot(run)
    folder = shlex.quote(str(run.folder))
    made = brief(robot, result)
    forces = [panel for panel in result.curves if isinstance(panel, Comparison)]
    curves = [panel for panel in result.curves if isinstance(panel, Curves) and panel.page]
    origin = result.origin
    more = drawn(curves[2:])
    gains, statistics, *rest = made.sections
    tables = ParameterTables(result)
    shown = drawn(Parameter.forests([p for p in result.gains if p.relative is not None]))
    sections = [
        replace(gains, panels=[*([Figures(shown)] if shown else []), *gains.panels]),
        replace(statistics, beside=robot_picture(run.looks, run.record["q"][0], robot)),
        Section("Time histories", [Figures(more)] if more else []),
        Section(
            "Predicted against measured forces",
            [
                Figures(drawn(forces), "velocities", 6),
                Text(
                    f"{_FORCES[result.truth_known]} Error: rms over rms of the measured force.",
                    True,
                ),
            ]
            if forces
            else [],
        ),
        *rest,
        Section("Parameters", [Text(_relative_to(result)), *tables.folds(gains=False)]),
        Section("Least known directions of θ/scale", _least_known(result)),
        Section("Correlations of what is identified", _correlated(drawn(_correlations(result)))),
        Section(
            "The paper's statements on this run",
            [*(checks.items() if checks else []), *_checks(result)],
        ),
    ]
    return replace(
        made,
        eyebrow=f"run {run.folder.name}",
        tab=f"{robot} · {run.folder.name}",
        carrying=drawn(curves[:2]),
        sections=[section for section in sections if section.panels],
        commands=[
            *filter(None, [command]),
            f"nsaid run {shlex.quote(str(run.folder / 'scenario.json'))}",
            f"nsaid view {folder}",
            f"nsaid verify --run {folder}",
        ],
        notes=[_FILES.format(seed=origin.seed, scenario_hash=origin.scenario_hash)],
        versions=dict(origin.versions),
    )


def brief(heading: str, result: RunResult) -> Page:
    """The page of a run without its drawings, which terminal and recording show."""
    held = [Text(_HELD)] if any(p.relative for p in result.gains) else []
    return Page(
        heading=heading,
        result=result,
        lead=_lead(result),
        sections=[
            Section("Actuator gains", [*ParameterTables(result).gains(), *held], brief=True),
            Section("Statistics", [_statistics(result)], brief=True),
            Section("Confidence", _confidence(result), brief=True),
            Section("What cannot be known from motion", unobservable(result), brief=True),
        ],
    )


def print_result(name: str, result: RunResult, folder: Path) -> None:
    """Prints the verdict on a run, gains and statistics, and the paths of its files."""
    file = folder / OutputFolder.RECORDING
    seen = f"{file}   (nsaid view {shlex.quote(str(folder))})"
    files = (
        f"recording  {seen if file.is_file() else _NO_RERUN}",
        f"report     {folder / Page.FILE}",
    )
    print_page(brief(name, result), Console(highlight=False), files)


def _robot(run: Run) -> str:
    """The robot's name: the plant's `robot` or `vehicle` field, or the name of its class."""
    plant = run.scenario.plant
    chosen = getattr(plant, "robot", "") or getattr(plant, "vehicle", "")
    return Path(chosen).stem if chosen else type(plant).__name__.removesuffix("Plant")


def _lead(result: RunResult) -> str:
    done = "followed" if result.samples else "simulated"
    law = result.law.law
    conditions = result.conditions
    cost = result.cost
    said = (
        f"Law {law}, {conditions.sensors} sensors, seed {result.origin.seed}: "
        f"{count(result.dimensions.n, 'velocity', 'velocities')}, "
        f"{count(result.dimensions.p, 'parameter')}; "
        f"{cost.sim_s:.4g} s {done} in {cost.wall_s:.1f} s "
        f"({cost.real_time_factor:.1f} × real time)"
    )
    compiling = f", plus {cost.compile_s:.0f} s of one-time compilation"
    return f"{said}{compiling if cost.compile_s > _COMPILED else ''}."


def _statistics(result: Result) -> Table:
    """The table of statistics, one column for each identifier."""
    lines = [[one.name, *map(one.words, one.values.values())] for one in result.statistics]
    return Table(["statistics", *(result.statistics[0].values if result.statistics else ())], lines)


def _confidence(result: RunResult) -> list[PageItem]:
    """The stated confidence in words; empty if none is stated."""
    lines = result.confidence_in_words
    return [Items(lines)] if lines else []


def _least_known(result: RunResult) -> list[PageItem]:
    """The least known directions; empty if no confidence is stated."""
    stated = result.confidence
    labels = result.labels
    if stated is None:
        return []
    worst = [
        [
            ", ".join(
                f"{weight:+.2f} {labels[name]}".replace("-", "−", 1)
                for name, weight in direction.parameters.items()
            ),
            ABSENT if direction.deviation is None else f"±{percent(direction.deviation, 2)}",
            "below the noise" if direction.below_noise else "",
        ]
        for direction in stated.worst_known
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


def _correlated(figures: Sequence[Figure]) -> list[PageItem]:
    """The heat map of correlations with its explanation; empty if there is none."""
    return [Figures(figures), Text(f"{HeatMap.MEANING} {_HELD}", note=True)] if figures else []


def _checks(result: RunResult) -> list[PageItem]:
    """Agreement of the run with the theory: conserved quantity and excitation."""
    said = []
    if (drift := result.theory.conserved_drift) is not None:
        said.append(f"Relative drift of the conserved quantity θ̂ᵀΓ⁻¹θ̂: {rounded(drift, 2)}.")
    motion = result.excitation
    levels = [
        f"{rounded(level, 2)} N·m·s in ({equation})"
        for level, equation in ((motion.pe_level_perp, "75"), (motion.pe_level, "2"))
        if level is not None
    ]
    measured = (motion.pe_level_perp, motion.pe_level, motion.pe_share_perp)
    if levels and any(measured):  # 0 or None without a window
        said.append(f"Smallest level of excitation ε₀ of any window: {', '.join(levels)}.")
    return [Text(" ".join(said), note=True)] if said else []


def unobservable(result: RunResult) -> list[PageItem]:
    """The five directions that concern most parameters, and the others by block."""
    entries = result.unobservable_in_words
    sizes = {one.direction: len(one.labels) for one in result.unobservable}
    scales = [entry for entry in entries if entry[0].startswith("common scale")]
    others = sorted(
        (entry for entry in entries if entry not in scales),
        key=lambda entry: -sizes.get(entry[0], len(result.unobservable)),
    )
    ordered = [(what, f"{fix}.") for what, fix in scales + others]
    groups: dict[str, list[tuple[str, str]]] = {}
    for what, fix in ordered[_FIRST:]:
        part = what.partition(" against ")[0].partition(" of ")[2] or "others"
        groups.setdefault(part, []).append((what, fix))
    first = ". First those that concern most parameters:" if groups else ":" if ordered else "."
    return [
        Text(f"{result.observable_in_words}{first}"),
        *([Items(ordered[:_FIRST], ordered=True)] if ordered else []),
        *(Fold(name, [Items(some)], small=str(len(some))) for name, some in groups.items()),
    ]


def _correlations(result: RunResult) -> list[HeatMap]:
    """Correlations of the parameters that are identified."""
    if result.confidence is None:
        return []
    stated = result.confidence.correlations
    labels = result.labels
    r = np.eye(len(stated.lower))
    for i, row in enumerate(stated.lower):
        r[i, :i] = r[:i, i] = np.array(row, dtype=float)
    return HeatMap.of_strongest([labels[name] for name in stated.parameters], r)
