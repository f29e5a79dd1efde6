"""report.html: the results of a run on one self-contained page."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import evaluation
from ..calibration import words
from ..evaluation import Truth
from ..evaluation.confidence import INTERVAL
from ..evaluation.verify import ROWS, Verdict, verify
from ..experiment.loop import Run
from ..parameters import Indices, ParameterSpace
from ..resources import write_text
from . import pages, report_panels
from .drawer import Drawer
from .panels import page_figures
from .picture import picture

FILE = "report.html"
_OPEN = 12  # parameters in total, up to which no table is collapsed
_RATIO = " ‖θ̄_P⊥‖/‖θ̂‖"  # left out: the first figure's axis has the formula
_FIRST = 5  # unobservable directions that are not folded
_MARKS = {
    "identified": pages.mark("good", "identified", "●"),
    "below the noise": pages.mark("weak", "below the noise", "≈"),
    "only in combination": pages.mark("fair", "only in combination", "◐"),
}
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
    drawer: Drawer | None = None,
    verdicts: Sequence[Verdict] = (),
    command: str = "",
) -> Path:
    """Writes a run's report.html atomically and returns its path.

    Args:
        run: a finished run with at least one row in its record.
        summary: the content of its summary.json.
        truth: of its plant; None if it is unknown, as on a robot's log. Comparisons with the
            truth are then left out.
        drawer: draws the curves; None draws them in this process.
        verdicts: on the paper's statements; computed if there are none.
        command: command line of the run, to be repeated; empty if it is not known.
    """
    path = run.folder / FILE
    write_text(path, page(run, summary, truth, drawer, verdicts, command))
    return path


def page(
    run: Run,
    summary: dict[str, Any],
    truth: Truth | None,
    drawer: Drawer | None = None,
    verdicts: Sequence[Verdict] = (),
    command: str = "",
) -> str:
    """A run's report as HTML; see `write`."""
    verdicts = verdicts or (verify(run, truth, summary) if len(run.record) >= ROWS else [])
    made = report_panels.panels(run, summary, truth)
    drawings = (drawer or Drawer()).draw([panel for group in made.values() for panel in group])
    figures: dict[str, list[dict[str, Any]]] = {}
    for name, group in made.items():
        figures[name] = page_figures(group, drawings[: len(group)])
        drawings = drawings[len(group) :]
    robot = _robot(run)
    sketch = picture(run.looks, run.record["q"][0], robot)
    return pages.render(
        "report.html",
        name=run.folder.name,
        eyebrow=f"run {run.folder.name}",
        heading=robot,
        lead=_lead(summary),
        verdict=_verdict(summary),
        carrying=figures["carrying"] + ([sketch] if sketch else []),
        alarms=_alarms(summary),
        figures=_figures(summary),
        checks=_checks(summary),
        curves=figures["curves"],
        gains=figures["gains"],
        forces=figures["forces"],
        forces_note=_FORCES[truth is not None],
        correlations=figures["correlations"],
        confidence=_confidence(summary),
        statements=_statements(verdicts),
        observable=evaluation.observable_line(summary),
        unobservable=_unobservable(summary),
        parameters_note=_parameters_note(summary),
        parameters=_parameters(run.system.space, summary),
        again=_again(run, summary, command),
    )


def _verdict(summary: dict[str, Any]) -> dict[str, str] | None:
    """The verdict with its colour; None if the summary, of an earlier version, has none."""
    told = summary.get("verdict")
    if told is None:
        return None
    kind = {"converged": "good", "still converging": "fair"}.get(told.partition(":")[0], "poor")
    return pages.verdict(kind, told)


def _alarms(summary: dict[str, Any]) -> list[dict[str, str]]:
    """How the run ended early, and what distinguishes it from one in the paper."""
    found = []
    if summary["status"] != "completed":
        found.append(pages.alarm(_ended(summary), "poor", "ended early:", "✘"))
    if summary.get("fault"):
        found.append(pages.alarm(summary["fault"], level="fault in the plant:"))
    for fault in summary.get("faults", []):
        words = f"{fault['words']}, {100 * fault['confidence']:.4g} % sure"
        found.append(pages.alarm(words, "poor", f"fault found at {fault['found']:.4g} s:"))
    found += [pages.alarm(m, level="not in the structure:") for m in summary.get("mismatch", [])]
    if told := stream_line(summary.get("stream", {})):
        found.append(pages.alarm(told, "weak", "samples:", "·"))
    if summary["sensor_noise"]:
        found.append(pages.alarm(summary["sensor_noise"], "weak", "sensors:", "·"))
    return found


def stream_line(counts: dict[str, int]) -> str:
    """What was wrong with the samples of a live robot, in words; empty if nothing was."""
    told = {
        "gaps": "gaps",
        "missing": "samples missing in them",
        "not_finite": "not finite",
        "duplicates": "repeated",
        "late": "out of order",
        "unreadable": "unreadable",
    }
    return ", ".join(f"{counts[key]} {words}" for key, words in told.items() if counts.get(key))


def _again(run: Run, summary: dict[str, Any], command: str) -> dict[str, Any]:
    folder = shlex.quote(str(run.folder))
    return pages.again(
        [
            *([command] if command else []),
            _SCRIPT,
            f"nsaid view {folder}",
            f"nsaid verify --run {folder}",
        ],
        summary["versions"],
        f"The scenario, including seed {summary['seed']}, is in scenario.json (hash "
        f"{summary['scenario_hash']}). With the same versions of all packages the record is "
        "identical to the bit. All figures are in summary.json, all samples in record.arrow, the "
        "recording is run.rrd.",
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


def _ended(summary: dict[str, Any]) -> str:
    signal = f" ({summary['status_signal']})" if summary["status_signal"] else ""
    at = f"{summary['status']} at t = {summary['status_time']:.4g} s{signal}"
    return f"{at}. {summary['status_remedy']}"


def _figures(summary: dict[str, Any]) -> dict[str, Any]:
    """The table of figures, one column for each identifier; rows absent from all are left out."""
    identifiers = {evaluation.OWN: summary, **summary["rivals"]}
    lines = [
        [
            label.replace(_RATIO, ""),
            *(evaluation.figure(found.get(key), unit) for found in identifiers.values()),
        ]
        for label, key, unit in evaluation.FIGURES
        if any(key in found for found in identifiers.values())
    ]
    return {"heads": ["", *identifiers], "lines": lines}


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
    kinds = {"holds": "good", "not yet": "fair", "fails": "poor", "not applicable": "weak"}
    return [
        [v.statement, v.claim, pages.mark(kinds[v.verdict], v.verdict), v.words] for v in verdicts
    ]


def _unobservable(summary: dict[str, Any]) -> dict[str, Any]:
    """The five directions that concern most parameters, and the others by block."""
    lines = summary["unobservable"]
    told = evaluation.unobservable_lines(summary)
    sizes = {line["direction"]: len(line["labels"]) for line in lines}
    scales = [entry for entry in told if entry[0].startswith("common scale")]
    others = sorted(
        (entry for entry in told if entry not in scales),
        key=lambda entry: -sizes.get(entry[0], len(lines)),
    )
    ordered = scales + others
    groups: dict[str, list[tuple[str, str]]] = {}
    for what, fix in ordered[_FIRST:]:
        part = what.partition(" against ")[0].partition(" of ")[2] or "others"
        groups.setdefault(part, []).append((what, fix))
    return {"first": ordered[:_FIRST], "groups": list(groups.items())}


def _confidence(summary: dict[str, Any]) -> dict[str, Any] | None:
    """The stated confidence in words, and the least known directions; None if none is stated."""
    stated = summary["confidence"]
    if stated is None:
        return None
    label = {row["name"]: row["label"] for row in summary["parameters"]}
    worst = [
        [
            ", ".join(f"{weight:+.2f} {label[name]}" for name, weight in row["parameters"].items()),
            f"±{row['deviation']:.2g}",
            "below the noise" if row["below_noise"] else "",
        ]
        for row in stated["worst_known"]
    ]
    return {"lines": evaluation.confidence_lines(summary), "worst": worst}


def _parameters_note(summary: dict[str, Any]) -> str:
    told = "Estimates are determined up to the unobservable directions above."
    if _true(summary["parameters"]):
        told += (
            " For comparison, prior and estimate are multiplied by the one factor that makes the "
            "mean of the estimated gains equal to the true one."
        )
    if summary["confidence"] is not None:
        told += (
            " Intervals hold the mean of the actuators' gains, since the common scale is "
            "unobservable. What the motion reveals only in sums has none."
        )
    return told


def _parameters(space: ParameterSpace, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """A table for each block of θ; those of actuators are expanded."""
    rows, stated = summary["parameters"], summary["confidence"]
    known = (stated or {}).get("parameters", {})
    factor = _common_factor(rows, space.actuators) if _true(rows) else 1.0
    tables = []
    for block, place in space:
        heads = ["parameter", "estimate", "unit"]
        heads += ["95 % interval", "status"] * bool(known)
        heads += ["prior", *["true"] * _true(rows)]
        lines, statuses = [], []
        for row in rows[place]:
            value, half = factor * row["estimate"], 0.0
            if known:
                found = known.get(row["name"])
                statuses.append(_status(found))
                half = INTERVAL * abs(factor) * (found["deviation"] if found else 0.0)
            told, interval = words.estimate(value, value - half, value + half)
            line = [row["label"], told, row["unit"]]
            line += [interval, _MARKS[statuses[-1]]] if known else []
            line.append(words.number(factor * row["prior"]))
            line += [words.number(row["true"])] if "true" in row else []
            lines.append(line)
        counts = [
            mark | {"text": f"{statuses.count(name)} {name}"}
            for name, mark in _MARKS.items()
            if name in statuses
        ]
        shown = block.actuator or len(rows) <= _OPEN
        text = (0, 2, 4) if known else (0, 2)
        tables.append(pages.block(block.name, heads, lines, text=text, open=shown, counts=counts))
    return tables


def _status(found: dict[str, Any] | None) -> str:
    """Whether a parameter is identified, from its entry of the summary's confidence."""
    if found is None:
        return "only in combination"
    return "below the noise" if found["below_noise"] else "identified"


def _true(rows: Sequence[dict[str, Any]]) -> bool:
    """Whether the parameters of a summary include their true values."""
    return all("true" in row for row in rows)


def _common_factor(rows: Sequence[dict[str, Any]], actuators: Indices) -> float:
    """The factor that makes the mean of the actuators' gains exact.

    Without an actuator, or with one of the wrong sign, that which brings the estimate closest to
    the truth in θ/scale.
    """
    true, estimate = (
        np.array([row[key] / row["scale"] for row in rows]) for key in ("true", "estimate")
    )
    ratio = estimate[actuators] / true[actuators]
    if len(ratio) and (ratio > 0).all():
        return float(1 / ratio.mean())
    return float(true @ estimate / (estimate @ estimate))
